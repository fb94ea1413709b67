"""Designing a robot of any kind: what is free of it becomes a space, what it does in some worlds its objectives."""

import json
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import OK, Evaluation, Objective, Problem
from optim.problems.objectives import OBJECTIVES, RobotObjective
from optim.space import Space
from robots.robot import KINDS, Facts, Measure, Outcome, Robot, World
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute


class JudgedRobot(Problem):
    """A robot, judged by what it does in some worlds. Subclasses say which, and how to describe that.

    Attributes:
        precision: ``"f32"`` or ``"f64"``.
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        threads: CPU threads, all available if None; changes no result, so it is not part of the description.
        progress: called now and then during an evaluation with the fraction done; not part of it either.
    """

    objective: str = "mean"
    measure: str = ""
    precision: str
    device: str
    threads: int | None
    progress: Callable[[float], None] | None

    @property
    @abstractmethod
    def offered(self) -> Robot:
        """The robot, with what is free of it."""

    @property
    @abstractmethod
    def tried_in(self) -> tuple[World, ...]:
        """The worlds in which it is tried."""

    @cached_property
    def space(self) -> Space:
        """What is free."""
        if not self.offered.parameters:
            raise ValueError("robot: nothing of it is free to change; make some value Free")
        return Space(tuple(self.offered.parameters))

    @property
    def judged_by(self) -> Measure:
        """The measure that the objective is about."""
        names = [measure.name for measure in self.offered.measures]
        if self.measure and self.measure not in names:
            raise ValueError(f"measure: {self.measure!r} is unknown; choose one of {', '.join(names)}")
        return self.offered.measures[names.index(self.measure) if self.measure else 0]

    @cached_property
    def _objective(self) -> RobotObjective:
        return OBJECTIVES.find(self.objective)()

    @property
    def _objectives(self) -> tuple[Objective, ...]:
        return self._objective.objectives(self.judged_by, self.tried_in)

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return tuple(objective.name for objective in self._objectives)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Their units."""
        return tuple(objective.unit for objective in self._objectives)

    @property
    def compute(self) -> Compute:
        """Where and how trials are computed."""
        return Compute(self.device, self.precision, self.threads)

    def design(self, point: ArrayLike) -> Any:
        """The robot of a point, shape (D,), with nothing free."""
        return self.robot_of(point)

    def robot_of(self, point: ArrayLike) -> Robot:
        """The robot of a point, shape (D,), with nothing free, as commands and reports see it."""
        return self.offered.design(self.space.validate(point))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Try all points, shape (N, D), in each world.

        Details: the other measures by name, each of shape (N,); in several worlds all of them, such as
        ``speed_flat``.
        """
        outcomes = self._tried(points, self.offered.simulate)
        return self._judged(outcomes, self._objective.values(outcomes, self.judged_by), None)

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points as :meth:`evaluate` does, with the gradient of the objective if wanted.

        Raises:
            ValueError: if the robot has binary parameters, or no gradients.
        """
        if self.space.relaxed() != self.space:
            raise ValueError("robot: it has binary parameters, which have no gradient; choose another method")
        if not gradients:
            return self.evaluate(points)
        outcomes = self._tried(points, self.offered.differentiate)
        values = self._objective.values(outcomes, self.judged_by)
        return self._judged(outcomes, values, self._objective.gradients(outcomes, self.judged_by))

    def _tried(self, points: ArrayLike, attempt: Callable[..., Outcome]) -> list[Outcome]:
        points, count = self.space.validate(np.atleast_2d(points)), len(self.tried_in)
        outcomes = []
        for number, world in enumerate(self.tried_in):
            tick = _part(self.progress, number, count) if self.progress else None
            outcomes.append(attempt(points, world, compute=self.compute, progress=tick))
        return outcomes

    def _judged(self, outcomes: list[Outcome], values: Floats, gradients: Floats | None) -> Evaluation:
        status = np.full(len(values), OK, dtype=object)
        details = {}
        single = len(outcomes) == 1
        for world, outcome in zip(self.tried_in, outcomes, strict=True):
            status = np.where(status == OK, outcome.told, status)
            for name, found in outcome.measures.items():
                if not (single and (name,) == self.objective_names):
                    details[name if single else f"{name}_{world.name}"] = found
        return Evaluation(values, status, details, gradients)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of a point, for ``robots.robot.load_design`` or the kind's own reader."""
        self.offered.save(self.space.validate(point), path)

    def facts(self) -> Facts:
        """Rows for a report: the robot, its worlds, the objective and the simulation."""
        (first, *_), several = self._objectives, len(self.tried_in) > 1
        over = {"mean": ", the mean over the worlds", "each": " in each world", "worst": " in the worst world"}
        spoken = self.judged_by.spoken if first.name.endswith(self.judged_by.name) else first.name
        told = spoken + (over.get(self.objective, "") if several else "") + (f" ({first.unit})" if first.unit else "")
        return [
            *self.offered.facts(),
            ("Worlds", ", ".join(world.name for world in self.tried_in)),
            ("Objective", told),
            ("Free", ", ".join(self.space.names)),
            ("Simulation", f"{self.precision} on {self.device}"),
        ]


@dataclass(frozen=True, eq=False)
class RobotProblem(JudgedRobot):
    """Designing a robot of any kind by its own measures.

    Attributes:
        robot: with what is free of it.
        worlds: where it is tried; its own by default.
        objective: name in ``OBJECTIVES``: ``"mean"`` over the worlds, ``"each"`` world, ``"worst"`` world.
        measure: of the robot, that the objective is about; the first by default.
        precision, device, threads, progress: see :class:`JudgedRobot`.
    """

    robot: Robot
    worlds: tuple[World, ...] = ()
    objective: str = "mean"
    measure: str = ""
    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "worlds", tuple(self.worlds) or self.robot.worlds)
        names = [world.name for world in self.worlds]
        if len(set(names)) < len(names):
            raise ValueError(f"{KINDS[self.robot.kind].world_option}: {', '.join(names)}; give none twice")
        _ = self.space, self.compute, self.objective_names

    @property
    def offered(self) -> Robot:
        """The robot."""
        return self.robot

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The worlds."""
        return self.worlds

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again."""
        kind = KINDS[self.robot.kind]
        return {
            "kind": self.robot.kind,
            "robot": json.dumps(self.robot.describe(), separators=(",", ":")),
            "worlds": [kind.world_record(world) for world in self.worlds],
            "objective": self.objective,
            **({"measure": self.measure} if self.measure else {}),
            "precision": self.precision,
            "device": self.device,
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Self:
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: that names what is missing, unknown or not allowed.
        """
        settings = {name: value for name, value in description.items() if name != "kind"}
        try:
            kind = KINDS.find(description["kind"])
            settings["worlds"] = tuple(kind.world_of(record) for record in description["worlds"])
            settings["robot"] = kind.from_description(json.loads(description["robot"]))
            return cls(**settings)
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None


def _part(report: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    """Progress of one of several worlds, as that of the evaluation."""
    return lambda fraction: report((number + fraction) / count)
