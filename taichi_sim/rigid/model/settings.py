"""Settings of the world of rigid robots, and of their neurons."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

from taichi_sim.base.checks import Finite, NotNegative, Positive, check_fields, number, numbers

CREEP = 1e-4  # m/s, of a robot that a force of its weight on earth drags along
EARTH = 9.81  # m/s^2


def _friction(field: str, value: float) -> float:
    try:
        return value if value == math.inf else number(field, value, low=0.0)
    except ValueError:
        raise ValueError(f"{field}: {value!r} is not allowed; give a number of at least 0, or infinity") from None


def _two(field: str, values: tuple[float, float]) -> tuple[float, float]:
    try:
        apart, touching = numbers(field, values, 2).tolist()
    except ValueError:
        raise ValueError(f"{field}: {values!r} is not allowed; give two finite numbers") from None
    return apart, touching


@dataclass(frozen=True)
class Physics:
    """Ground, gravity and time step of a simulation.

    Attributes:
        time_step: time step [s].
        gravity: gravity along z [m/s^2].
        slip: speed of a point on the ground for each newton of friction [m/(N s)]; None: so little that a force of the
            robot's weight on earth makes a point creep 0.1 mm/s, whatever the robot weighs.
        friction: coefficient of friction; if infinite, no cone limits it, and it has gradients.
        error_reduction: part of a penetration that a step undoes (ODE's ERP).
        integration: ``"momentum"`` carries momenta from step to step and conserves them in free flight;
            ``"velocity"`` carries each body's velocity, adds the gyroscopic moment at the start of the step and lets
            bodies drift off their hinges, as the solver does that the studies of chapters 2 and 3 ran on (ODE).
        gravity_across: gravity along x and y [m/s^2], of ground that is tilted, whose normal is z.
        pressure_drag: in water, coefficient of faces that it meets; 1.2 is that of a plate broadside on (Hoerner,
            Fluid-Dynamic Drag, 1965, ch. III).
        friction_drag: in water, coefficient of faces that it flows along.

    Raises:
        ValueError: for a value that is not allowed.
    """

    time_step: Positive = 0.05
    gravity: Finite = -9.81
    slip: Positive | None = None
    friction: Annotated[float, _friction] = math.inf
    error_reduction: Annotated[float, partial(number, low=0.0, high=1.0)] = 0.2
    integration: Literal["momentum", "velocity"] = "momentum"
    gravity_across: Annotated[tuple[float, float], _two] = (0.0, 0.0)
    pressure_drag: NotNegative = 1.2
    friction_drag: NotNegative = 0.02

    def __post_init__(self) -> None:
        check_fields(self)

    def slip_strength(self, mass: float) -> float:
        """Impulse of friction for each speed of a point that slips, under a robot of some mass [N s / (m/s)]."""
        return self.time_step * mass * EARTH / CREEP if self.slip is None else self.time_step / self.slip


@dataclass(frozen=True)
class Network:
    """Neural controller with one neuron m = tanh(memory m + gain sum of W s) for each motor.

    Attributes:
        memory: weight of a neuron's own last value.
        gain: factor of all sensor values.
        touch_values: readings of touch sensors off the ground, and on it.

    Raises:
        ValueError: for a value that is not allowed.
    """

    memory: Finite = 1.0
    gain: Finite = 1.0
    touch_values: Annotated[tuple[float, float], _two] = (0.0, 1.0)

    def __post_init__(self) -> None:
        check_fields(self)
