"""Which gait on which terrain: by how fast a robot gets over all of them, changes of shape included."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robots.inflatable.design import InflatableDesign, common_pressure


@dataclass(frozen=True)
class Plan:
    """A gait for each terrain."""

    gaits: tuple[str, ...]  # names of gaits, one per terrain, in the order of the terrains
    speed: float  # over all terrains and back to the first, see :func:`route_speed` [body lengths/s]


def route_speed(speeds: Sequence[float], changes: Sequence[float], stretch: float) -> float:
    """Mean speed over equal stretches [body lengths], with times of changes in between [s] [body lengths/s]."""
    return len(speeds) * stretch / (sum(stretch / speed for speed in speeds) + sum(changes))


def rank_plans(
    designs: Mapping[str, InflatableDesign],
    speeds: Mapping[str, Sequence[float]],
    stretch: float,
    least: float,
    times: tuple[float, float],
) -> list[Plan]:
    """All plans whose gaits work on their terrains, with ``least`` speed [body lengths/s], the fastest first.

    Speeds are those of each gait on each terrain [body lengths/s], times those that the core takes up and down [s].
    """
    terrains = len(next(iter(speeds.values())))
    able = [[name for name, each in speeds.items() if each[place] >= least] for place in range(terrains)]
    plans = []
    for names in itertools.product(*able):
        pressures = [core_of(designs[name]) for name in names]
        changes = [change_time(a, b, times) for a, b in zip(pressures, [*pressures[1:], pressures[0]], strict=True)]
        speed = route_speed([speeds[name][place] for place, name in enumerate(names)], changes, stretch)
        plans.append(Plan(names, speed))
    return sorted(plans, key=lambda plan: (-plan.speed, plan.gaits))


def core_of(design: InflatableDesign) -> float:
    """The core pressure of a design [Pa]; a task has checked that there is one, as a table can say no more."""
    pressure = common_pressure(design.pressure)
    assert pressure is not None
    return pressure


def change_time(before: float, after: float, times: tuple[float, float]) -> float:
    """Time of the core from a pressure to another [s]."""
    return 0.0 if before == after else times[0] if after > before else times[1]


def best_of_one_gait(plans: Sequence[Plan]) -> Plan | None:
    """The fastest plan with the same gait everywhere."""
    return next((plan for plan in plans if len(set(plan.gaits)) == 1), None)


def best_of_one_shape(plans: Sequence[Plan], designs: Mapping[str, InflatableDesign]) -> Plan | None:
    """The fastest plan with the same core pressure everywhere."""
    return next((plan for plan in plans if len({core_of(designs[name]) for name in plan.gaits}) == 1), None)
