"""The shape-changing robot with other parameters: what each of them changes, and what stays.

Source: Powers 2021 dissertation, ch. 5, "Discussion": modulus, timescale, maximum pressure, number of voxels per
bladder and density "could be adjusted without causing drastic changes in behavior".
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.schedule import MAXIMUM_PRESSURE

FULL_PRESSURE = ACTUATION.round_pressure  # Pa, of the round robot


@dataclass(frozen=True)
class Variant:
    """A robot of which one thing is different."""

    geometry: InflatableGeometry = PUBLISHED  # shape and materials
    actuation: InflatableActuation = ACTUATION  # rates and timing
    pressure: float = FULL_PRESSURE  # of the core of the round robot [Pa]


def retimed(steps: float) -> InflatableActuation:
    """All strokes and pauses stretched to ``steps`` times as many time steps; rates are per step."""
    return replace(
        ACTUATION,
        inflation_rate=ACTUATION.inflation_rate / steps,
        pressure_ramp=ACTUATION.pressure_ramp / steps,
        hold_steps=round(ACTUATION.hold_steps * steps),
        settle_steps=round(ACTUATION.settle_steps * steps),
    )


def in_the_same_time(**changed: Any) -> Variant:
    """A robot of a changed geometry, whose gait takes as many seconds as the published one, whatever its time step."""
    geometry = replace(PUBLISHED, **changed)
    return Variant(geometry, retimed(PUBLISHED.time_step / geometry.time_step))


def with_modulus(factor: float) -> Variant:
    """Young's modulus of skin and bladders times a factor."""
    skin, bladders = PUBLISHED.youngs_modulus * factor, PUBLISHED.bladder_modulus * factor
    return in_the_same_time(youngs_modulus=skin, bladder_modulus=bladders)


def with_density(factor: float) -> Variant:
    """Density times a factor."""
    return in_the_same_time(density=PUBLISHED.density * factor)


def with_time_step(factor: float) -> Variant:
    """The time step times a factor, at most 1.3, the robot's margin to the largest stable one."""
    safety = PUBLISHED.time_step_safety
    if not 0 < factor <= safety:
        raise ValueError(f"time step: a factor of {factor:g} is not allowed; give a positive one, at most {safety:g}")
    return in_the_same_time(time_step_safety=safety / factor)


def with_duration(factor: float) -> Variant:
    """All that happens takes a factor times as long, in time steps of the same length."""
    return Variant(actuation=retimed(factor))


def with_pressure(factor: float) -> Variant:
    """The pressure of the round robot times a factor; at that pressure bladders lengthen least."""
    pressure = FULL_PRESSURE * factor
    if not 0 < pressure <= MAXIMUM_PRESSURE:
        allowed = f"give a positive one, at most {MAXIMUM_PRESSURE / FULL_PRESSURE:g}"
        raise ValueError(f"maximum pressure: a factor of {factor:g} is not allowed; {allowed}")
    return Variant(actuation=replace(ACTUATION, round_pressure=pressure), pressure=pressure)


def with_voxels(factor: float) -> Variant:
    """So many times the voxels across a bladder, which has 3, in a robot of the same size.

    Rows and layers follow, as whole numbers allow. The skins keep their mass per area and their bending stiffness:
    density is divided by the voxels' size h, Young's modulus by h cubed.
    """
    across = round(PUBLISHED.bladder_columns * factor)
    if across < 1:
        raise ValueError(f"voxels per bladder: a factor of {factor:g} is not allowed; it leaves none")
    size = PUBLISHED.columns * PUBLISHED.voxel_size / (4 * across + 3)
    ratio = size / PUBLISHED.voxel_size
    return in_the_same_time(
        bladder_columns=across,
        rows=round(PUBLISHED.rows / ratio),
        foot_rows=max(1, round(PUBLISHED.foot_rows / ratio)),
        bladder_layers=max(1, round(PUBLISHED.bladder_layers / ratio)),
        voxel_size=size,
        youngs_modulus=PUBLISHED.youngs_modulus / ratio**3,
        bladder_modulus=PUBLISHED.bladder_modulus / ratio**3,
        density=PUBLISHED.density / ratio,
    )


VARIATIONS: Mapping[str, Callable[[float], Variant]] = {
    "Young's modulus": with_modulus,
    "density": with_density,
    "time step": with_time_step,
    "duration": with_duration,
    "maximum pressure": with_pressure,
    "voxels per bladder": with_voxels,
}
