"""Actuation of the inflatable robot: rates of inflation, timing, damping and friction.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

from robots.terrain_fields import check_taken
from robots.world import FLUID_FIELDS, FRICTION_FIELDS, Terrain
from taichi_sim.base.checks import Friction, NotNegative, Positive, check_fields, choice, whole_number

TERRAIN_FIELDS = ("slope", *FRICTION_FIELDS, *FLUID_FIELDS, "ground", "light")  # which inflatable robots take
REFUSED = {"static_friction": ", as it is of lattice robots; give high_friction and low_friction"}
WEIGHTS = ("published", "physical")
PUBLISHED_COLUMNS = 16  # of a gait, 8 played twice
PUBLISHED_STEPS = 186_719  # that they take where bladders always move; what published speeds are counted by


@dataclass(frozen=True)
class InflatableActuation:
    """Actuation of the inflatable robot: rates, timing, damping and friction. Defaults are the published experiment's.

    Attributes:
        high_friction: Coulomb coefficient of gripping feet, static and kinetic; also of skin, seams and bladders that
            have none of their own, see the last three.
        low_friction: Coulomb coefficient of sliding feet.
        deflated, inflated: thickness of a bladder, in voxels per voxel.
        inflation_rate: change of that thickness per time step.
        widening: growth across the pouch per growth in thickness.
        lengthening_flat, lengthening_round: a bladder grows 1/c along the pouch per growth in thickness, with c
            rising linearly with core pressure from the first to the second. Of several cores it is the mean of their
            pressures, weighted by the rows that each has under the bladders.
        round_pressure: core pressure [Pa] at which c reaches ``lengthening_round``.
        pressure_ramp: rise of the core pressure per time step of the initialisation [Pa].
        ramp_steps: time steps in which the core pressure rises instead, to whatever value, linearly: then the length of
            a program does not depend on the pressure. None is by ``pressure_ramp``, as published. From 6000 steps on,
            the small robot is left as by the published ramp, within what noise of 1e-6 m does to it; 3000 shake it too
            much.
        hold_steps: time steps at full pressure before the gait begins.
        settle_steps: time steps between the end of one column's motion and the next column.
        moving_damping, settling_damping: damping ratio against the world while bladders move, and between.
        weight: "published": bladders have no weight while they move or stay inflated, a quirk of the experiment;
            "physical": they always have it.
        bladder_friction: Coulomb coefficient of bladders; None is a third of ``high_friction``, as published.
        skin_friction: of skin beside seams and feet; None is ``high_friction``.
        seam_friction: of seams, within feet too; None is ``high_friction``, but those within feet slide as feet do
            until the first column has ended, as published.

    Raises:
        ValueError: for a value that is not allowed.
    """

    high_friction: Friction = 2.0
    low_friction: Friction = 1e-4
    deflated: Positive = 0.2
    inflated: NotNegative = 2.5
    inflation_rate: Positive = 3e-4
    widening: NotNegative = 1 / 20
    lengthening_flat: Positive = 1.7
    lengthening_round: Positive = 10.0
    round_pressure: Positive = 12e3
    pressure_ramp: Positive = 0.5
    hold_steps: Annotated[int, partial(whole_number, low=0)] = 2000
    settle_steps: Annotated[int, partial(whole_number, low=0)] = 4001
    moving_damping: NotNegative = 0.002
    settling_damping: NotNegative = 0.01
    weight: Annotated[str, partial(choice, names=WEIGHTS)] = "published"
    ramp_steps: Annotated[int, partial(whole_number, low=1)] | None = None
    bladder_friction: Friction | None = None
    skin_friction: Friction | None = None
    seam_friction: Friction | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.inflated <= self.deflated:
            raise ValueError(f"inflated: {self.inflated!r} is not allowed; it must exceed deflated, {self.deflated!r}")

    def on(self, terrain: Terrain) -> "InflatableActuation":
        """Return this actuation with the friction of a terrain; in a fluid, only the fluid resists motion.

        Raises:
            ValueError: for props, and the friction of a lattice robot's materials.
        """
        check_taken(terrain, TERRAIN_FIELDS, REFUSED)
        given: dict[str, Any] = {name: getattr(terrain, name) for name in FRICTION_FIELDS}
        if terrain.is_fluid:
            given |= {"moving_damping": 0.0, "settling_damping": 0.0}
        return replace(self, **{name: value for name, value in given.items() if value is not None})

    @property
    def friction_of_bladders(self) -> float:
        """Coulomb coefficient of the bladders."""
        return self.high_friction / 3 if self.bladder_friction is None else self.bladder_friction

    @property
    def largest_size(self) -> float:
        """Largest rest size that an inflated bladder has along any of its axes [edges]."""
        across, through = max(self.widening, 1 / self.lengthening_flat, 1 / self.lengthening_round), self.inflated
        return max(through, 1 + (through - self.deflated) * across)

    def growth(self, pressure: Any) -> tuple[float, Any, float]:
        """Return a bladder's growth across, along and through the pouch per growth in thickness, at a pressure [Pa]."""
        along = (
            self.lengthening_flat + (self.lengthening_round - self.lengthening_flat) * pressure / self.round_pressure
        )
        return self.widening, 1 / along, 1.0

    def initial_steps(self, pressure: float) -> int:
        """Count the time steps of the initialisation: a ramp to the highest core pressure [Pa], then a hold."""
        ramp = math.floor(pressure / self.pressure_ramp) + 1 if self.ramp_steps is None else self.ramp_steps
        return ramp + self.hold_steps


ACTUATION = InflatableActuation()


def each_actuation(given: InflatableActuation | Sequence[InflatableActuation], count: int) -> list[InflatableActuation]:
    """The actuation of each of ``count`` robots of a batch: one for all, or one each.

    Raises:
        ValueError: for another number of them.
    """
    if isinstance(given, InflatableActuation):
        return [given] * count
    if len(given) != count:
        raise ValueError(f"actuation: {len(given)} are not allowed for {count} designs; give one, or one each")
    return list(given)
