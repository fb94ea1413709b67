"""The design problem of any robot: its free parameters become a space, its measures in some worlds objectives."""

import dataclasses
import json
import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import OK, Evaluation, Minibatch, Objective
from optim.problems.goals import Goals, Names, named, objective_of, score_in_each
from optim.problems.limits import LOST, broken_limits
from optim.problems.objectives import RobotObjective
from optim.problems.robot_designing import RobotDesigning, subject_of
from optim.problems.uncertain import (
    TrialWorlds,
    check_drawn,
    check_part,
    checked_uncertain,
    held_out_products,
    mean_outcome,
    under_risk,
)
from optim.space import Space
from robots.partly_fixed import robot_of_description
from robots.robot import KINDS, Facts, Measure, Outcome, Robot, Trial, World, without_lost
from robots.uncertainty import Risk, Score
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import shown
from taichi_sim.base.parsing import parse_json

OVER = {"mean": ", the mean over the worlds", "each": " in each world", "worst": " in the worst world"}  # in reports


class RobotDesignProblem(RobotDesigning):
    """Base class of problems that design a robot of any kind; subclasses provide the robot, worlds and description."""

    objective: Names = "mean"
    measure = ""
    summed = False
    risk = "mean"
    gradient_horizon: float | None = None
    relaxed_precision: str | None = "f32"  # of mixtures of designs, which only lead to results

    @property
    @abstractmethod
    def offered(self) -> Robot:
        """The robot, with its free parameters."""

    @property
    def robot_kind(self) -> str:
        """Name of the robot's kind."""
        return self.offered.kind

    @cached_property
    def space(self) -> Space:
        """Space of the robot's free parameters."""
        if not self.offered.parameters:
            raise ValueError("robot: nothing of it is free to change; make some value Free")
        return Space.of_parameters(self.offered.parameters)

    @property
    def usual_measure(self) -> Measure:
        """The measure of an objective that names none: that of the settings, or the robot's first."""
        measures = self.offered.measures_in(self.tried_in)
        names = [measure.name for measure in measures]
        if self.measure and self.measure not in names:
            raise ValueError(f"measure: {self.measure!r} is unknown; choose one of {', '.join(names)}")
        return measures[names.index(self.measure) if self.measure else 0]

    @cached_property
    def _objective(self) -> RobotObjective:
        return objective_of(self.objective, self.offered.measures_in(self.tried_in), self.summed)

    @property
    def _objectives(self) -> tuple[Objective, ...]:
        return self._objective.objectives(self.usual_measure, self.tried_in)

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return tuple(objective.name for objective in self._objectives)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Units of the objectives."""
        return tuple(objective.unit for objective in self._objectives)

    def design(self, point: ArrayLike) -> Any:
        """Return the robot of a point, shape (D,), with nothing free."""
        return self.robot_of(point)

    def robot_of(self, point: ArrayLike) -> Robot:
        """Return the robot of a point, shape (D,), with nothing free, for commands and reports.

        It lacks measures that only a file of Python defines, if a run folder was read, so that it can be tried.
        """
        return without_lost(self.offered).design(self.space.validate(point))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate the robots of all points, shape (N, D), in each world.

        Details: the other measures by name, each of shape (N,); in several worlds all of them, such as
        ``speed_flat``.
        """
        return self._scored(self.space.validate(points), Trial(self.tried_in[0], self.compute))

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Evaluate points as :meth:`evaluate` does, with the gradient of the objective if wanted.

        Raises:
            ValueError: if the robot has binary parameters, or no gradients.
        """
        robot, compute = self.offered, self.compute
        if self.space.relaxed() != self.space and not robot.relaxable:
            raise ValueError("robot: it has binary parameters, which have no gradient; choose another method")
        if not robot.relaxable or sharpness == math.inf:
            points, sharpness = self.space.round(points), math.inf
        else:
            compute = dataclasses.replace(compute, precision=self.relaxed_precision or self.precision)
        if not gradients and sharpness == math.inf:
            return self.evaluate(points)
        if gradients:
            self.check_gradients()
        measures = tuple(self._objective.differentiated(self.usual_measure)) if gradients else ()
        trial = Trial(
            self.tried_in[0],
            compute,
            gradients=measures,
            sharpness=sharpness,
            gradient_horizon=self.gradient_horizon,
        )
        return self._scored(points, trial)

    def check_mixtures(self) -> None:
        """Refuse worlds, before any work, in which mixtures of designs cannot be simulated.

        Raises:
            ValueError: for props.
        """
        for world in self.tried_in if self.offered.relaxable else ():
            if props := getattr(world, "props", ()):
                raise ValueError(
                    f"props: {props[0].name} is not allowed with a method that goes through mixtures of tissues, which "
                    "meet none; choose one of true robots, such as nes, genetic or lamarckian"
                )

    def check_gradients(self) -> None:
        """Raise a one-line ValueError if the robot has no gradients, or none in one of its worlds."""
        if not self.offered.differentiable:
            title = KINDS.of(self.offered).title
            raise ValueError(f"robot: {title} has no gradients; choose a method that needs none")
        for world in self.tried_in:
            self.offered.check_gradients(world)

    check_true_gradients = check_gradients  # those of mixtures are of the same laws

    def check_minibatch(self, size: int) -> None:
        """Refuse minibatches, before any work, if the objective over a few worlds or draws means something else.

        Raises:
            ValueError: for a single one of several worlds or draws, of which there is no worst.
        """
        word = self.objective if isinstance(self.objective, str) else self.objective[0]
        if self.uncertain:
            check_part(size, "draws", self.draws, self.risk)
        else:
            check_part(size, "worlds", len(self.tried_in), word)

    def in_minibatch(self, minibatch: Minibatch) -> "RobotDesignProblem":
        """Return the problem in a few of the draws, each in all worlds; or in a few worlds, if nothing is uncertain."""
        part, count = copy(self), len(self.tried_in)
        if self.uncertain:
            chosen = minibatch.of(self.draws)
            rows = (chosen[:, None] * count + np.arange(count)).ravel()
        else:
            rows = minibatch.of(count)
            object.__setattr__(part, "_evaluated_in", tuple(self.tried_in[row] for row in rows))
        object.__setattr__(part, "_trials", self._trials.part(rows, len(part._evaluated_in)))
        return part

    @cached_property
    def _evaluated_in(self) -> Sequence[World]:
        """The worlds: all but in a minibatch."""
        return self.tried_in

    def _scored(self, points: ArrayLike, trial: Trial) -> Evaluation:
        """Evaluate points by what the robot does in every world; over draws, if something is uncertain."""
        points = self.space.relaxed().validate(np.atleast_2d(points))
        gradients, told = bool(trial.gradients), dataclasses.replace(trial, progress=self.progress)
        outcomes = self._trials.outcomes(self.offered, points, told)
        values = [self._objective.values(each, self.usual_measure) for each in outcomes]
        limits = self._objective if isinstance(self._objective, Goals) and self._objective.limits else None
        lost = np.max([limits.lost(each, self.usual_measure) for each in outcomes], axis=0) if limits else None
        slopes = [self._objective.gradients(each, self.usual_measure) for each in outcomes] if gradients else []
        if not self.uncertain:
            return self._evaluation(outcomes[0], values[0], slopes[0] if gradients else None, lost)
        found = under_risk(Risk.parse(self.risk), values, slopes)
        return self._evaluation([mean_outcome(each) for each in zip(*outcomes, strict=True)], *found, lost)

    @cached_property
    def _trials(self) -> TrialWorlds:
        """Its worlds; as they are in each draw, if something is uncertain."""
        return TrialWorlds.of(self.offered, self.tried_in, self.uncertain, self.draws)

    def products(self, point: ArrayLike) -> Mapping[str, Callable[[Path], None]]:
        """Further files about the best robot: its measures over unseen draws, where something is uncertain."""

        def score(best: Robot) -> Score:
            return score_in_each(self._objective, self.usual_measure) or Score.first_of(best, stands_in=True)

        best = partial(self.robot_of, point)
        return held_out_products(best, self.tried_in, self.uncertain, self.risk, self.compute, score)

    def _evaluation(
        self, outcomes: list[Outcome], values: Floats, gradients: Floats | None, lost: Floats | None
    ) -> Evaluation:
        status = np.full(len(values), OK, dtype=object)
        details = {} if lost is None else {LOST: lost}
        single = len(outcomes) == 1
        for world, outcome in zip(self._evaluated_in, outcomes, strict=True):
            status = np.where(status == OK, outcome.status_or_reason, status)
            for name, found in outcome.measures.items():
                if not (single and (name,) == self.objective_names):
                    details[name if single else f"{name}_{world.name}"] = found
        return Evaluation(values, status, details, gradients)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of a point, for ``robots.robot.load_design`` or the kind's own reader."""
        self.offered.save(self.space.validate(point), path)

    @property
    def subject(self) -> str:
        """Description of the robot and its worlds, in a few words."""
        return subject_of(self.offered.name, self.tried_in)

    @property
    def curves(self) -> Mapping[str, str]:
        """Details to plot over a search: the measure in each world, or of each goal, and what the robot adds."""
        several = self.tried_in if len(self.tried_in) > 1 else ()
        about = (self._objective.measures if isinstance(self._objective, Goals) else ()) or (self.usual_measure,)
        if len(about) == 1:
            name = about[0].name
            return {f"{name}_{world.name}": world.spoken or world.name for world in several} or self.offered.curves
        labels = {measure.name: Objective(measure.name, measure.unit).label for measure in about}
        places = [(f"_{world.name}", f" {world.spoken or world.name}") for world in several] or [("", "")]
        return {name + end: label + place for name, label in labels.items() for end, place in places}

    def limits_broken(self, details: Mapping[str, float]) -> list[str]:
        """What details of a point break of the objective's limits, such as ``mass <= 0.1: 0.12``, world by world."""
        bounds = self._objective.bounds if isinstance(self._objective, Goals) else ()
        return broken_limits(bounds, details, self.tried_in, self.draws)

    @property
    def detail_names(self) -> set[str]:
        """Names of the details that every evaluation tells; it may tell more."""
        measures = [measure.name for measure in self.offered.measures_in(self.tried_in)]
        lost = {LOST} if isinstance(self._objective, Goals) and self._objective.limits else set()
        if len(self.tried_in) > 1:
            return {f"{name}_{world.name}" for name in measures for world in self.tried_in} | lost
        return {*measures} - ({self.objective_names[0]} if len(self.objective_names) == 1 else set()) | lost

    @property
    def descriptors(self) -> Mapping[str, tuple[float, float]]:
        """The robot's descriptors in the first world, by their names in evaluations, with lowest and highest values."""
        world = f"_{self.tried_in[0].name}" if len(self.tried_in) > 1 else ""
        ends = {f"{name}{world}": ends for name, ends in self.offered.descriptors.items()}
        return {name: each for name, each in ends.items() if (name,) != self.objective_names}

    def columns_of(self, points: Floats) -> Mapping[str, Sequence[str]]:
        """Columns of a table of several points, shape (C, D), from the robot: values by name."""
        return self.offered.columns(points)

    def command_options(self, folder: Path) -> dict[str, Any]:
        """Options of the robot that its saved designs do not hold."""
        return self.offered.command_options()

    def facts(self) -> Facts:
        """Rows for a report: the robot, its worlds, the objective and the simulation."""
        first, over = self._objectives[0], ""
        if len(self.tried_in) > 1:
            over = OVER.get(self.objective if isinstance(self.objective, str) else self.objective[0], "")
        if isinstance(self._objective, Goals):
            told = self._objective.spoken(self.usual_measure) + over
        else:
            spoken = self.usual_measure.spoken if first.name.endswith(self.usual_measure.name) else first.name
            told = spoken + over + (f" ({first.unit})" if first.unit else "")
        return [
            *self.offered.facts(),
            (
                f"{KINDS.of(self.offered).world_option.capitalize()}s",
                ", ".join(KINDS.of(self.offered).world_told(world) for world in self.tried_in),
            ),
            ("Objective", told),
            *([("Uncertain", f"{self.uncertain}: {self.risk} of {self.draws} draws")] if self.uncertain else []),
            ("Free", ", ".join(self.space.names)),
            ("Simulation", f"{self.precision} on {self.device}"),
        ]


JudgedRobot = RobotDesignProblem  # its name up to 2.0


@dataclass(frozen=True, eq=False)
class RobotProblem(RobotDesignProblem):
    """Design a robot of any kind: search its free parameters for the best of its own measures in some worlds.

    Attributes:
        robot: the robot, with its free parameters.
        worlds: worlds in which it is simulated, or their names, such as ``["flat", "hill:5"]``; by default its own.
        objective: name in ``OBJECTIVES``: ``"mean"`` over the worlds, ``"each"`` world, ``"worst"`` world; or several
            texts, such as ``("worst", "speed", "minimise:0.1*energy")``, see ``optim.problems.goals``.
        measure: measure of the robot for an objective that names none; the first one by default.
        relaxed_precision: of mixtures of designs, where the robot has any, as they only lead to results; None is that
            of true designs.
        summed: whether goals add up to one objective, for methods that take one; else each is one.
        uncertain: what is not known exactly, such as ``"friction=20%,slope=1"``, see ``robots.uncertainty``: every
            design is judged over the same draws. Empty is none.
        risk: how the scores over these draws become one: ``"mean"``, ``"cvar:SHARE"`` or ``"worst"``.
        draws: number of draws.
        gradient_horizon: time [s] over which gradients see what a change of shape or speed does; None is all the time,
            as long as a trial. What robots that feel do becomes chaotic: shorter gradients lead them farther.
    """

    robot: Robot
    worlds: tuple[World, ...] = ()
    objective: Names = "mean"
    measure: str = ""
    summed: bool = False
    relaxed_precision: str | None = "f32"
    uncertain: str = ""
    risk: str = "mean"
    draws: int = 1
    gradient_horizon: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise ValueError(f"robot: {shown(self.robot)} is not allowed; give a Robot, as morpholab.robot makes")
        object.__setattr__(self, "objective", named(self.objective))
        given = self.worlds if isinstance(self.worlds, Iterable) and not isinstance(self.worlds, str) else [self.worlds]
        # A robot of a file may be of a kind without an entry point, whose worlds are not named.
        worlds = tuple(each if hasattr(each, "where") else KINDS.of(self.robot).named_world(each) for each in given)
        object.__setattr__(self, "worlds", worlds or self.robot.worlds)
        names = [world.name for world in self.worlds]
        if len(set(names)) < len(names):
            raise ValueError(f"{KINDS.of(self.robot).world_option}: {', '.join(names)}; give none twice")
        object.__setattr__(self, "uncertain", checked_uncertain(self.uncertain, self.risk, self.draws))
        check_drawn(self.robot, self.worlds, self.uncertain, self.draws)
        if self.gradient_horizon is not None:
            KINDS.of(self.robot).check_gradient_horizon(self.gradient_horizon)
        _ = self.space, self.compute, self.objective_names
        if self.measure and isinstance(self._objective, Goals) and self._objective.names_all:
            raise ValueError(f"measure: {self.measure!r} is not used; each objective names its own, so leave it out")

    @property
    def offered(self) -> Robot:
        """The robot, whose free parameters are searched."""
        return self.robot

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The worlds in which the robot is simulated."""
        return self.worlds

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; :meth:`from_description` builds the problem again."""
        kind = KINDS.of(self.robot)
        return {
            "kind": self.robot.kind,
            "robot": json.dumps(self.robot.describe(), separators=(",", ":")),
            "worlds": [kind.world_record(world) for world in self.worlds],
            "objective": self.objective if isinstance(self.objective, str) else list(self.objective),
            **({} if isinstance(self.objective, str) else {"summed": self.summed}),
            **({} if self.relaxed_precision == "f32" else {"relaxed_precision": self.relaxed_precision}),
            **({"measure": self.measure} if self.measure else {}),
            **({"uncertain": self.uncertain, "risk": self.risk, "draws": self.draws} if self.uncertain else {}),
            **({} if self.gradient_horizon is None else {"gradient_horizon": self.gradient_horizon}),
            "precision": self.precision,
            "device": self.device,
        }

    @classmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a description from :meth:`describe` to the fields of the problem."""
        settings = {name: value for name, value in description.items() if name != "kind"}
        kind = KINDS.find(description["kind"])
        worlds = tuple(kind.world_of(record) for record in description["worlds"])
        return {**settings, "worlds": worlds, "robot": robot_of_description(kind, parse_json(description["robot"]))}
