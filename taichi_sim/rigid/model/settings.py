"""Settings of the world of rigid robots, and of their neurons."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from taichi_sim.rigid.model.shapes import is_number, positive


@dataclass(frozen=True)
class World:
    """Ground, gravity and time step of a simulation.

    Attributes:
        time_step: [s].
        gravity: along z [m/s^2].
        slip: speed of a point on the ground for each newton of friction [m/(N s)].
        friction: coefficient of friction; if infinite, viscous slip alone acts.
        error_reduction: part of a penetration that a step undoes (ODE's ERP).
        integration: ``"momentum"`` carries momenta from step to step and conserves them in free flight;
            ``"velocity"`` carries each body's velocity, adds the gyroscopic moment at the start of the step and lets
            bodies drift off their hinges, as the solver does that the studies of chapters 2 and 3 ran on (ODE).
    """

    time_step: float = 0.05
    gravity: float = -9.81
    slip: float = 0.01
    friction: float = np.inf
    error_reduction: float = 0.2
    integration: Literal["momentum", "velocity"] = "momentum"

    def __post_init__(self) -> None:
        positive("time_step", self.time_step)
        positive("slip", self.slip)
        if not is_number(self.gravity):
            raise ValueError(f"gravity: {self.gravity!r} is not allowed; give a finite number")
        if not (is_number(self.friction) or self.friction == np.inf) or self.friction < 0:
            raise ValueError(f"friction: {self.friction!r} is not allowed; give a number of at least 0, or infinity")
        if not is_number(self.error_reduction) or not 0 <= self.error_reduction <= 1:
            raise ValueError(f"error_reduction: {self.error_reduction!r} is not allowed; give a number from 0 to 1")
        if self.integration not in ("momentum", "velocity"):
            raise ValueError(f"integration: {self.integration!r} is unknown; choose momentum or velocity")


@dataclass(frozen=True)
class Network:
    """Neural network with one neuron m = tanh(memory m + gain sum of W s) for each motor.

    Attributes:
        memory: weight of a neuron's own last value.
        gain: factor of all sensor values.
        touch_values: readings of touch sensors off the ground, and on it.
    """

    memory: float = 1.0
    gain: float = 1.0
    touch_values: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        for name, values in (("memory", [self.memory]), ("gain", [self.gain]), ("touch_values", self.touch_values)):
            if not all(is_number(value) for value in values) or (name == "touch_values" and len(values) != 2):
                allowed = "two finite numbers" if name == "touch_values" else "a finite number"
                raise ValueError(f"{name}: {getattr(self, name)!r} is not allowed; give {allowed}")
