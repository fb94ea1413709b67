"""What of a trial is likely a mistake: ground that is never met, feet without friction, chaos, unsolved steps."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from optim.problem import Objective
from optim.problems.robot_designing import RobotDesigning
from robots.ground import AHEAD, Ground
from robots.robot import Outcome, Robot, World
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute

SAME = 1e-9  # of a value: smaller differences are rounding
FAR = 1.0  # lengths of the robot ahead of its front, from which on a search tells
SMALL_CHANGE = 0.01  # of a parameter's range
MANY_TIMES = 3.0  # what such a change does to a measure: a derivative that promises as much is worth a warning


def doubts_before(problem: object) -> Iterator[str]:
    """Likely mistakes of a search: grounds that begin farther ahead of robots than these are long, and the robots'."""
    if not isinstance(problem, RobotDesigning):
        return
    robot, space, worlds = problem.offered, problem.space, problem.tried_in
    if robot is None and any(map(_uneven, worlds)):  # only there a design in the middle is worth making
        robot = problem.robot_of(space.round((space.low + space.high) / 2))
    if robot is not None:
        yield from _far(robot, worlds, None)
        yield from _of_robot(robot, worlds)


def doubts_after(robot: Robot, world: World, outcome: Outcome) -> Iterator[str]:
    """Doubts of a trial: ground whose uneven part began farther ahead than any robot has gone, unsolved steps."""
    gone = outcome.measures.get("distance", np.zeros(0))
    if np.isfinite(gone).any():
        yield from _far(robot, (world,), float(np.nanmax(gone)))
    yield from _of_robot(robot, (world,))
    yield from robot.doubts_about(outcome)


def _of_robot(robot: Robot, worlds: Iterable[World]) -> Iterator[str]:
    """What the robot itself doubts in these worlds, each line once."""
    yield from dict.fromkeys(doubt for world in worlds for doubt in robot.doubts_in(world))


def constants_in(objectives: Sequence[Objective], values: Floats) -> Iterator[str]:
    """A line for each objective that is the same in all first designs of a search, of values of shape (N, K)."""
    for objective, column in zip(objectives, values.T, strict=True):
        known = column[np.isfinite(column)]
        if len(known) > 1 and np.ptp(known) <= SAME * abs(known[0]):
            told = f"it is {objective.value(known[0])} in all {len(known)} designs that the search begins with"
            yield f"objective: {objective.name} tells no design from another so far: {told}"


def chaos_in(robot: Robot, points: Floats, world: World, outcome: Outcome, compute: Compute) -> Iterator[str]:
    """Measures that a small change of a parameter hardly changes, of what their derivatives say.

    Tried is only a change that would be larger than the measure itself, of a design in the middle of all: some lie
    beside a switch.
    """
    reach = SMALL_CHANGE * np.array([parameter.high - parameter.low for parameter in robot.parameters])
    for name, slopes in outcome.gradients.items():
        size, told = np.abs(outcome.measures[name]), np.abs(slopes) * reach
        usable = np.flatnonzero(np.isfinite(size) & np.isfinite(told).all(axis=1))
        if not (len(usable) and told.size):
            continue
        column = int(np.median(told[usable], axis=0).argmax())
        middle = usable[np.argsort(told[usable, column])[len(usable) // 2]]
        if told[middle, column] <= size.max(initial=0.0, where=np.isfinite(size)):
            continue
        of, ends = robot.parameters[column], points[[middle, middle]]
        ends[:, column] = np.clip(ends[:, column] + [reach[column], -reach[column]], of.low, of.high)
        change = abs(slopes[middle, column]) * (ends[0, column] - ends[1, column])  # 0 for a design beyond the bounds
        one, other = robot.simulate(ends, world, compute=compute).measures[name]
        if change > MANY_TIMES * abs(one - other):
            yield (
                f"{name}: by its derivative, a small change of {of.name}, from {ends[1, column]:.4g} to "
                f"{ends[0, column]:.4g}, would change it by {change:.2g}, and it changes by {abs(one - other):.2g}; "
                "gradient-check measures what derivatives are worth here (docs/gradients.md)"
            )


def _uneven(world: World) -> Ground | None:
    """A world's uneven ground; None of planes."""
    return world.uneven if isinstance(world, Terrain) else None


def _far(robot: Robot, worlds: Iterable[World], gone: float | None) -> Iterator[str]:
    """A line for each ground that is level up to where a robot hardly gets, in a trial in which it has gone so far [m].

    What it goes before its distance counts, and how far its front moves, are taken to be half its length at most.
    """
    grounds = [ground for world in worlds if (ground := _uneven(world)) is not None]
    if not grounds or robot.footprint is None:
        return
    begin, front = robot.footprint
    length = front - begin
    for ground in grounds:
        start = ground.level_until(begin, front)
        near = front + (FAR * length if gone is None else max(gone, 0.0) + length / 2)
        closer = math.ceil((front + length / 10) / 0.01) * 0.01
        way = ground.beginning_at(closer)
        if start is None or start <= near or (math.isinf(start) and way is None):
            continue
        told = f"; give its {ground.start_name}, such as {way}" if way else ""
        if math.isinf(start):
            yield f"terrain: {ground.text} is level as far as ground is made, {AHEAD:g} m ahead{told}"
            continue
        lengths = f"{(start - front) / length:.2g} body lengths"
        went = "one that goes less far" if gone is None else f"this one went {gone:.3g} m, so it"
        yield (
            f"terrain: {ground.text} is level up to {start:.2g} m ahead of the robot's origin, {lengths} beyond its "
            f"front; {went} meets nothing else{told}"
        )
