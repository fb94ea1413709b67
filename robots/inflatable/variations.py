"""Changed conditions under which a gait is tried again: measured floors, weight, friction, half the time step.

Every one is a change of the conditions given, whatever they are. Bladders weigh on measured floors; where those given
have the published weight, weight and floors are tried apart, too, which tells by which of both a gait lives.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robots.inflatable.actuation import InflatableActuation
from robots.inflatable.body import InflatableGeometry
from robots.inflatable.convention import SpeedConvention, speeds_by
from robots.inflatable.design import InflatableDesign
from robots.inflatable.rubbing import Rubbing
from robots.inflatable.schedule import LONGEST_COLUMN
from robots.inflatable.simulation import InflatableResult
from robots.world import FLOORS, Terrain, friction_of_parts
from taichi_sim.base.arrays import Floats

HALF_STEP = "half the time step"
WEIGHT = "bladders that keep their weight"
FRICTION_PARTS = (0.8, 1.2)  # of the coefficients of the whole robot


@dataclass(frozen=True, eq=False)
class Conditions:
    """All that decides how fast a gait is.

    Attributes:
        design: what the robot does.
        terrain: where.
        geometry: of the robot.
        actuation: how it is driven.
        convention: by which its speed counts; None is the published one.
    """

    design: InflatableDesign
    terrain: Terrain
    geometry: InflatableGeometry
    actuation: InflatableActuation
    convention: SpeedConvention | None = None

    def speeds(self, result: InflatableResult) -> Floats:
        """Speeds under these conditions, by their convention."""
        return speeds_by(self.convention, result, self.geometry, self.actuation)

    @property
    def friction(self) -> tuple[float, float]:
        """Friction coefficients of sliding and of gripping feet; means of the two, where they have their own."""
        made, own = self.design.materials, self.actuation.on(self.terrain)
        if made is None or made.friction is None:
            return own.low_friction, own.high_friction
        grip, slide = np.mean(made.friction, axis=1).tolist()
        return slide, grip


def with_weight(conditions: Conditions) -> Conditions:
    """The conditions with bladders that keep their weight."""
    return replace(conditions, actuation=replace(conditions.actuation, weight="physical"))


def on_floor(conditions: Conditions, floor: str) -> Conditions:
    """The conditions on a floor on which friction was measured, which feet have instead of their own."""
    low, high = FLOORS[floor]
    terrain, design = replace(conditions.terrain, low_friction=low, high_friction=high), conditions.design
    if design.materials is not None:
        design = replace(design, materials=replace(design.materials, friction=None))
    return replace(conditions, design=design, terrain=terrain)


def with_friction(conditions: Conditions, part: float) -> Conditions:
    """The conditions with all coefficients of friction multiplied by ``part``."""
    own = conditions.actuation.on(conditions.terrain)
    feet: dict[str, Any] = {"low_friction": part * own.low_friction, "high_friction": part * own.high_friction}
    return replace(
        conditions,
        design=Rubbing(part, part).of(conditions.design),
        terrain=replace(conditions.terrain, **feet, **friction_of_parts(own, part)),
    )


def at_half_step(conditions: Conditions) -> Conditions:
    """The conditions with half the time step: twice as many steps, each with half the change."""
    drive, gait = conditions.actuation, conditions.design.schedule
    ramp = drive.ramp_steps
    slower = replace(
        drive,
        inflation_rate=drive.inflation_rate / 2,
        pressure_ramp=drive.pressure_ramp / 2,
        ramp_steps=None if ramp is None else 2 * ramp,
        hold_steps=2 * drive.hold_steps,
        settle_steps=2 * drive.settle_steps,
    )
    motion, settle = (None if own is None else 2 * own for own in (gait.motion_steps, gait.settle_steps))
    geometry = conditions.geometry
    return replace(
        conditions,
        design=replace(conditions.design, schedule=replace(gait, motion_steps=motion, settle_steps=settle)),
        geometry=replace(geometry, time_step_safety=2 * geometry.time_step_safety),
        actuation=slower,
        convention=conditions.convention and conditions.convention.slower(2),
    )


def variations_of(conditions: Conditions) -> dict[str, Conditions]:
    """Changed conditions by their names; half the time step is left out where columns would be too long for it."""
    heavy = with_weight(conditions)
    found = {floor: on_floor(heavy, floor) for floor in FLOORS}
    if conditions.actuation.weight != heavy.actuation.weight:
        found |= {WEIGHT: heavy}
        found |= {f"{floor}, weight as published": on_floor(conditions, floor) for floor in FLOORS}
    found |= {f"{part:g} of the friction": with_friction(conditions, part) for part in FRICTION_PARTS}
    gait = conditions.design.schedule
    longest = max((int(own.max()) for own in (gait.motion_steps, gait.settle_steps) if own is not None), default=0)
    return found if 2 * longest > LONGEST_COLUMN else {**found, HALF_STEP: at_half_step(conditions)}
