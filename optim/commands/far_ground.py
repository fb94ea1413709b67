"""Notes on ground that a robot hardly reaches: level below it, and uneven only far ahead of it."""

import math
from collections.abc import Iterable

from optim.notes import note
from optim.problems.robot_designing import RobotDesigning
from robots.ground import AHEAD, Ground
from robots.robot import OK, Outcome, Robot, World
from robots.world import Terrain

FAR = 1.0  # lengths of the robot ahead of its front, from which on a search tells


def note_far_ground(problem: object) -> None:
    """Tell, before a search, of grounds that begin farther ahead of a robot than it is long."""
    if not isinstance(problem, RobotDesigning) or not any(map(_uneven, problem.tried_in)):
        return
    space = problem.space
    robot = problem.offered or problem.robot_of(space.round((space.low + space.high) / 2))
    _tell(_far(robot, problem.tried_in, None))


def note_unmet_ground(robot: Robot, world: World, outcome: Outcome) -> None:
    """Tell of a ground whose uneven part began farther ahead of a robot than it has gone."""
    if outcome.status[0] == OK and "distance" in outcome.measures:
        _tell(_far(robot, (world,), float(outcome.measures["distance"][0])))


def _tell(notes: Iterable[str]) -> None:
    for text in notes:
        note(text)


def _uneven(world: World) -> Ground | None:
    """A world's uneven ground; None of planes."""
    return world.uneven if isinstance(world, Terrain) else None


def _far(robot: Robot, worlds: Iterable[World], gone: float | None) -> Iterable[str]:
    """A line for each ground that is level up to where a robot hardly gets, in a trial in which it has gone so far [m].

    What it goes before its distance counts, and how far its front moves, are taken to be half its length at most.
    """
    if robot.footprint is None:
        return
    begin, front = robot.footprint
    length = front - begin
    for ground in filter(None, map(_uneven, worlds)):
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
