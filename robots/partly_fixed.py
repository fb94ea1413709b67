"""A robot some of whose parameters are held, as those of a body that a search has found."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.delegation import delegating
from robots.free import Free
from robots.kind import OWN_MEASURES_FIELD
from robots.robot import Facts, Outcome, Parameter, Robot, RobotKind, Trial, World
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import nearest, number, table
from taichi_sim.base.names import joined, matching

if TYPE_CHECKING:
    from robots.own_measures import OwnMeasure
    from robots.uncertainty import Perturbation

MOST_TOLD = 12  # names in a message


def held_at(robot: Robot, point: ArrayLike, patterns: str | Iterable[str]) -> "PartlyFixed":
    """Hold the parameters whose names match any of some patterns at their values in a point; the others stay free.

    Args:
        robot: the robot.
        point: values of all its P parameters, shape (P,).
        patterns: a name or a pattern of names such as ``"*_size"``, or several.

    Raises:
        ValueError: for a pattern that matches none, or if nothing stays free.
    """
    found = names_matching(robot, patterns)
    values = dict(zip((parameter.name for parameter in robot.parameters), robot.points(point)[0], strict=True))
    return PartlyFixed(robot, {name: float(values[name]) for name in found})


def names_matching(robot: Robot, patterns: str | Iterable[str]) -> list[str]:
    """Names of the free parameters that match any of some patterns; a pattern may match what is held already.

    Raises:
        ValueError: for a pattern that matches nothing.
    """
    names, held = [parameter.name for parameter in robot.parameters], held_names(robot)
    if not names:
        raise ValueError(f"hold: nothing of {robot.name} is free; give the run that designed it, or its file")
    found = dict[str, None]()
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        new = [names[n] for n in matching(pattern, names)]
        if not new and not matching(pattern, held):
            told = ", ".join(names[:MOST_TOLD]) + (f", ... ({len(names)})" if len(names) > MOST_TOLD else "")
            raise ValueError(f"hold: {pattern} matches none of {told}{nearest(pattern, names)}")
        found |= dict.fromkeys(new)
    return list(found)


def held_names(robot: Robot) -> list[str]:
    """Names of the parameters that are held of a robot."""
    return [*held_names(robot.robot), *robot.held] if isinstance(robot, PartlyFixed) else []


def freed(robot: Robot, options: Mapping[str, Any]) -> Robot:
    """Return a robot from a run with other values of its kind's options, some of which free more of it.

    Raises:
        ValueError: for other options than ``Robot.changed`` takes, and for those that would change what is fixed of the
            robot, or lose a parameter.
    """
    if isinstance(robot, PartlyFixed):
        return PartlyFixed(freed(robot.robot, options), robot.held)
    free = {name: value for name, value in options.items() if name in robot.freeing}
    more: Any = robot.changed({name: value for name, value in options.items() if name not in free})
    if free:
        several = (name for name in free if isinstance(free[name], list | tuple))
        free |= {name: joined(name, free[name]) for name in several}
        for name, value in free.items():
            _check_freed(name, getattr(robot, name), value)
        more = dataclasses.replace(more, **free)
    names = {parameter.name for parameter in more.parameters}
    if lost := [parameter.name for parameter in robot.parameters if parameter.name not in names]:
        raise ValueError(f"{' and '.join(free)}: {lost[0]}, which the run searches, is not free; keep it free, too")
    return more


def _check_freed(option: str, before: Any, now: Any) -> None:
    """Refuse an option that changes what a robot from a run has, and frees nothing more."""
    if not isinstance(before, Mapping):
        if before is not None and before != now:
            raise ValueError(f"{option}: the run has its own; leave it out")
        return
    for name, value in before.items():
        if name not in now or (now[name] != value and not isinstance(now[name], Free)):
            told = f"{value:g}" if isinstance(value, float | int) else f"{value.low:g}:{value.high:g}"
            raise ValueError(f"{option}: the run has {name}={told}; give that, too, or free it by this name")


def held_as(robot: Robot, other: Robot) -> Robot:
    """A robot, whatever is held of it, with those parameters held that are held of another one, at the same values."""
    while isinstance(robot, PartlyFixed):
        robot = robot.robot
    return PartlyFixed(held_as(robot, other.robot), other.held) if isinstance(other, PartlyFixed) else robot


def inner_description(description: dict[str, Any]) -> dict[str, Any]:
    """The part of a description that is of the robot itself, whatever is held of it; it is not copied."""
    while description.keys() == {"robot", "held"}:
        description = description["robot"]
    return description


def robot_of_description(kind: RobotKind, description: Mapping[str, Any]) -> Robot:
    """Build a robot from what ``Robot.describe`` returned, also one some of whose parameters are held."""
    if description.keys() == {"robot", "held"}:
        held = {name: number(name, value) for name, value in table("held", description["held"]).items()}
        return PartlyFixed(robot_of_description(kind, description["robot"]), held)
    return kind.from_description(description)


@delegating("robot", {"points": "_completed", "point": "_completed_one"})
class PartlyFixed(Robot):
    """A robot with fewer free parameters: some are held. It asks the robot all that is not defined here.

    Example:
        >>> from robots.robot import KINDS
        >>> vehicle = KINDS["vehicle"].build(None, {"design": 162})
        >>> [parameter.name for parameter in PartlyFixed(vehicle, {"w1": 0.5}).parameters]
        ['w2']
    """

    has_table, pictured, can_be_judged = False, False, False
    judge, table, rig_report, save_picture = Robot.judge, Robot.table, Robot.rig_report, Robot.save_picture
    points, differentiate = Robot.points, Robot.differentiate
    simulate, simulate_in = Robot.simulate, Robot.simulate_in

    def __init__(self, robot: Robot, held: Mapping[str, float]) -> None:
        """Hold parameters of a robot at values, by their names.

        Raises:
            ValueError: for names that it has no parameters of, or if none stays free.
        """
        names = [parameter.name for parameter in robot.parameters]
        for name in held:
            if name not in names:
                raise ValueError(f"held: {name!r} is no free parameter{nearest(name, names)}")
        self.robot, self.held = robot, dict(held)
        self._free = np.array([name not in held for name in names], bool)
        if not self._free.any():
            if len(names) == 1:
                raise ValueError(f"hold: {names[0]} is the only parameter; leave it free")
            raise ValueError(f"hold: all {len(names)} parameters are held; leave some free")
        self._values = np.array([held.get(name, 0.0) for name in names])

    @property
    def own_measures(self) -> "tuple[OwnMeasure, ...]":
        """Measures that only a file or another package defines, of robots that can have some."""
        found: tuple[OwnMeasure, ...] = getattr(self.robot, OWN_MEASURES_FIELD)
        return found

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The parameters that are free."""
        return tuple(each for each, free in zip(self.robot.parameters, self._free, strict=True) if free)

    @property
    def start(self) -> Floats:
        """Where searches of the robot start, without what is held, shape (F,)."""
        return np.array(self.robot.start[self._free])

    def _completed(self, points: ArrayLike) -> Floats:
        """Points of the robot, shape (N, P), for those of this one, shape (N, F)."""
        given = self.points(points)
        whole = np.tile(self._values, (len(given), 1))
        whole[:, self._free] = given
        return whole

    def _completed_one(self, point: ArrayLike) -> Floats:
        """The point of the robot, shape (P,), for that of this one, shape (F,)."""
        return np.array(self._completed(point)[0])

    def _own(self, outcome: Outcome) -> Outcome:
        """An outcome with gradients by what is free."""
        slopes = {name: values[:, self._free] for name, values in outcome.gradients.items()}
        return dataclasses.replace(outcome, gradients=slopes)

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Try the robot at points of this one, shape (N, F)."""
        return self._own(self.robot.run(self._completed(points), trial))

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: Sequence[Self] = ()
    ) -> list[Outcome]:
        """Try it in several worlds, in the robot's own way, which may make one batch of them."""
        found = self.robot.run_in(self._completed(points), worlds, trial, [variant.robot for variant in variants])
        return [self._own(outcome) for outcome in found]

    def perturbed(self, drawn: "Perturbation") -> Self:
        """The same, with what a draw says of the robot."""
        return type(self)(self.robot.perturbed(drawn), self.held)

    def at_horizon(self, length: int) -> tuple[str, Self]:
        """The same in trials of another length."""
        spoken, robot = self.robot.at_horizon(length)
        return spoken, type(self)(robot, self.held)

    def changed(self, options: Mapping[str, Any]) -> Self:
        """The same of the robot with other values of options."""
        return type(self)(self.robot.changed(options), self.held)

    def design(self, point: ArrayLike) -> Robot:
        """The robot of one point, with nothing free."""
        return self.robot.design(self._completed_one(point))

    def facts(self) -> Facts:
        """Rows for a report: those of the robot, and what is held of it."""
        told = [f"{name} = {value:.4g}" for name, value in self.held.items()]
        more = f", ... ({len(told)})" if len(told) > MOST_TOLD else ""
        return [*self.robot.facts(), ("Held", ", ".join(told[:MOST_TOLD]) + more)]

    def describe(self) -> dict[str, Any]:
        """All that results depend on: the robot, and the values that are held."""
        return {"robot": self.robot.describe(), "held": dict(self.held)}

    def document(self) -> dict[str, Any]:
        """What the robot tells machines, and the values that are held."""
        return {**self.robot.document(), "held": dict(self.held)}
