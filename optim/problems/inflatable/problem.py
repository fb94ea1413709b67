"""Designing shape, orientation and gait of the inflatable robot for one terrain or several.

Source: Powers 2021 dissertation, ch. 5, "Optimization": the robot travels as fast as it can on flat ground or
up an incline of 15 degrees; orientation, shape and control are free to change, or only the last two or one.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import OK, Evaluation
from optim.problems.inflatable.description import LATER_OPTIONS, description_of, problem_of_description
from optim.problems.inflatable.encoding import ENCODINGS, FixedGait, GaitEncoding, GradedGait
from optim.problems.inflatable.outcomes import NEXT, Batch, Condition, Outcome, capped, effort, outcomes
from optim.problems.inflatable.shape import EMPTY_CORE, ShapeGenes
from optim.problems.inflatable.told import GaitDesigning
from optim.space import Space
from robots.calibration import Properties, robot_of
from robots.inflatable import gradient, simulation
from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.body import NAMED_GEOMETRIES, InflatableGeometry
from robots.inflatable.cores import Pressure, checked_pressure, each_pressure
from robots.inflatable.design import InflatableDesign
from robots.inflatable.files import save_design
from robots.inflatable.program import Counting
from robots.inflatable.robustness import harder
from robots.inflatable.schedule import FEET, MOST_COLUMNS, MOST_REPEATS, GaitSchedule
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import counted_steps, gait_steps, nominal_steps, predicted_steps
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import choice, number, whole_number

# What may be free to change, and the attribute of a design that holds it.
PARTS = {"orientation": "orientation", "shape": "pressure", "control": "schedule"}
GRADED_OPTIONS = ("steps", "warm_up", "stages")  # of a free graded gait
OBJECTIVES = ("mean", "terrains")
LONGEST_GAIT = 2**31 - 1  # time steps, which kernels count in 32 bits
HARD = "_hard"  # how details end that are of the harder conditions
RAMP_STEPS = 6000  # half as long as 6 kPa take as published


@dataclass(frozen=True, eq=False)
class GaitProblem(GaitDesigning):
    """Objective: the speed [body lengths/s], by the published convention; mean over the terrains, or one each.

    What is given is fixed, what is None is free to change. The variables: ``orientation`` 0 to 90 degrees,
    ``pressure`` 0 to 12,000 Pa, and the genes of the schedule, see ``encoding``. Beside graded genes
    the pressure begins at ``EMPTY_CORE``, and is cut as they are: the flat robot is found, and kept, easily.
    A body with N cores has ``pressure_1`` to ``pressure_N`` instead.

    Attributes:
        terrains: where the robot travels, one simulation each.
        orientation: [degrees], or None.
        pressure: of the core [Pa], the body's shape, or None; of several cores one for all, or a tuple.
        schedule: the control, or None.
        columns: of a free schedule.
        repeats: of a free schedule.
        encoding: of a free schedule, one of ``ENCODINGS``: ``"codes"``, ``"bits"``, ``"pattern"``, ``"graded"``,
            ``"graded-pattern"``, ``"graded-wave"``; only bits and graded levels have gradients.
        objectives: ``"mean"`` of the speeds on all terrains; ``"terrains"``, the speed on each.
        ramp_steps: of the core pressure in relaxed evaluations. None is as published, but ``RAMP_STEPS`` if
            pressure is free: as published, the length of the ramp depends on it, and jumps.
        steps: time steps that a gait with times of its own may take, by which its speed is counted; None is those of a
            published gait, 186,719 of the published robot. Fewer are a cheaper judgement of the same gait.
        warm_up: time steps of a graded gait that do not count, nor does the cycle in which they end: what a robot does
            while it finds its stride. The time of the whole cycles that follow counts the speed.
        stages: equally long parts of a graded gait, of as many cycles after a warm-up, of which the slowest tells the
            speed: a gait that goes on beats one that lurches once.
        ladder: whether a terrain is for those gaits alone that are faster than ``ahead`` on the one before; the
            others are not simulated there, their speed is 0. In the mean all terrains but the last count ``ahead``
            at most. So gaits are led from easy ground to hard.
        ahead: speed that leads to the next terrain of the ladder [body lengths/s].
        hard: whether terrains count twice: as they are, and under the harder conditions of ``robustness``, where
            gaits fail that slide for their living; details end with ``_hard`` there. A gait
            that does not get ahead as it is counts so for both, and is not simulated again.
        effort: what moving the bladders costs [body lengths/s], subtracted from the mean of the speeds: so much where
            every one makes a full stroke in every column, see ``outcomes.effort``. Gaits become cleaner.
        geometry: name of a geometry, see ``NAMED_GEOMETRIES``.
        weight: of bladders, ``"published"`` or ``"physical"``, see ``InflatableActuation``.
        properties: of the robot on a rig, as fitted to it; None is as published.
        precision: ``"f32"`` or ``"f64"``.
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        threads: CPU threads, all available if None; changes no result, so it is not part of the description.
        progress: called now and then during an evaluation with the fraction done; not part of it either.
    """

    terrains: tuple[Terrain, ...]
    orientation: float | None = None
    pressure: Pressure | None = None
    schedule: GaitSchedule | None = None
    columns: int = 8
    repeats: int = 2
    encoding: str = "codes"
    objectives: str = "mean"
    ramp_steps: int | None = None
    steps: int | None = None
    warm_up: int = 0
    stages: int = 1
    ladder: bool = False
    ahead: float = NEXT
    hard: bool = False
    effort: float = 0.0
    geometry: str = "published"
    weight: str = "published"
    properties: Properties | None = None
    precision: str = "f32"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        names = [terrain.name for terrain in self.terrains]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"terrains: {', '.join(names) or 'none'} given; give at least one, and none twice")
        choice("geometry", self.geometry, NAMED_GEOMETRIES)
        if self.pressure is not None:
            object.__setattr__(self, "pressure", checked_pressure(self.pressure))
            each_pressure(self.pressure, self.body)
        if not self.free:
            raise ValueError(f"free: nothing is free to change; free at least one of {', '.join(PARTS)}")
        if self.schedule is not None:
            object.__setattr__(self, "columns", self.schedule.columns)
            object.__setattr__(self, "repeats", self.schedule.repeats)
            object.__setattr__(self, "encoding", "codes")  # of nothing
        choice("encoding", self.encoding, ENCODINGS)
        if self.properties is not None and self._timed:
            self.properties.check_time_step(NAMED_GEOMETRIES[self.geometry])
        choice("objectives", self.objectives, OBJECTIVES)
        for name, low, high in (
            ("columns", 1, MOST_COLUMNS),
            ("repeats", 1, MOST_REPEATS),
            ("stages", 1, MOST_COLUMNS),
            ("warm_up", 0, LONGEST_GAIT),
        ):
            object.__setattr__(self, name, whole_number(name, getattr(self, name), low, high))
        for name in GRADED_OPTIONS:
            if (value := getattr(self, name)) != LATER_OPTIONS[name] and not self.graded:
                what = f"encoding {self.encoding!r}" if self.schedule is None else "a fixed gait"
                raise ValueError(f"{name}: {value} is not allowed with {what}; they are of a free graded gait")
        if self.steps is not None:
            whole_number("steps", self.steps, 1, LONGEST_GAIT)
        if not 0 <= 2 * self.warm_up <= self.most_steps:
            raise ValueError(f"warm_up: {self.warm_up} is not allowed; give 0 to half of the steps")
        if self.ladder and len(self.terrains) < 2:
            raise ValueError("ladder: one terrain is not allowed; give several, the easiest first")
        object.__setattr__(self, "ahead", number("ahead", self.ahead, 0.0))
        if self.ahead != NEXT and not self.ladder:
            raise ValueError(f"ahead: {self.ahead:g} is not allowed without a ladder")
        _ = self.conditions  # refuses terrains that have no harder ones
        object.__setattr__(self, "effort", number("effort", self.effort, 0.0))
        if self.effort and self.objectives != "mean":
            raise ValueError(f"effort: {self.effort:g} is not allowed with objectives, {self.objectives}; choose mean")
        if self.ramp_steps is not None:
            whole_number("ramp_steps", self.ramp_steps, 1)
        # What is fixed is checked where it is used: better now than in the first evaluation. Of any point: the lowest
        # moves nothing, and is played again and again to fill its time.
        self.design(self.space.sample(np.random.default_rng(0), 1)[0])

    @cached_property
    def _robot(self) -> tuple[InflatableGeometry, InflatableActuation]:
        return robot_of(self.geometry, self.weight, self.properties)

    @property
    def body(self) -> InflatableGeometry:
        """The robot's geometry."""
        return self._robot[0]

    @property
    def actuation(self) -> InflatableActuation:
        """How it is driven."""
        return self._robot[1]

    @property
    def most_steps(self) -> int:
        """Time steps that a gait with times of its own may take."""
        return nominal_steps(PUBLISHED_COLUMNS, self.actuation) if self.steps is None else self.steps

    @property
    def shape(self) -> ShapeGenes:
        """Variables of orientation and the body's shape."""
        least = EMPTY_CORE if self.graded else 0.0
        return ShapeGenes(self.orientation, self.pressure, self.body.cores, least)

    @property
    def free(self) -> tuple[str, ...]:
        """Which of ``PARTS`` are free to change."""
        return tuple(part for part, attribute in PARTS.items() if getattr(self, attribute) is None)

    @property
    def graded(self) -> bool:
        """Whether a schedule is searched that may have levels between 0 and 1, and has times of its own."""
        return self.schedule is None and issubclass(ENCODINGS[self.encoding], GradedGait)

    @property
    def objective_names(self) -> tuple[str, ...]:
        """The mean speed, or that on each terrain."""
        if self.objectives == "mean":
            return ("speed",)
        return tuple(condition.name for condition in self.conditions)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Body lengths per second."""
        return ("BL/s",) * len(self.objective_names)

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """Under which gaits are simulated."""
        found: list[Condition] = []
        below = None
        for terrain in self.terrains:
            usual = Condition(f"speed_{terrain.name}", terrain, self.actuation, below, False, self.ahead)
            found.append(usual)
            if self.hard:
                found.append(Condition(usual.name + HARD, *harder(terrain, self.actuation), usual.name))
            below = usual.name if self.ladder else None
        return tuple(found)

    @cached_property
    def space(self) -> Space:
        """The free variables; the steps of their mutation are the published ones."""
        return Space((*self.shape.variables(), *self._control.variables()))

    def design(self, point: ArrayLike) -> InflatableDesign:
        """The design of a point, shape (D,)."""
        schedule = self._control.schedule(self._genes(self.space.validate(point)))
        return InflatableDesign(*self.shape.values(point), schedule)

    def in_full(self) -> "GaitProblem":
        """The same with gaits of the full length."""
        return dataclasses.replace(self, steps=None, warm_up=0, stages=1)

    def counted_steps(self, design: InflatableDesign) -> int:
        """Time steps by which the speed of a design is counted."""
        if self.steps is None:
            return counted_steps(design.schedule, self.actuation)
        return max(self.steps, gait_steps(design.schedule, self.actuation))

    def _genes(self, point: ArrayLike) -> Floats:
        """What a point, shape (D,), says of the schedule; it comes last."""
        return np.asarray(point, float)[self.shape.size :]

    @cached_property
    def _control(self) -> GaitEncoding:
        """Of the schedule."""
        if self.schedule is not None:
            return FixedGait(self.columns, self.repeats, self.schedule)
        encoding = ENCODINGS[self.encoding]
        if issubclass(encoding, GradedGait):
            return encoding(self.columns, self.repeats, self.most_steps, self.warm_up, self.actuation)
        return encoding(self.columns, self.repeats)

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D), as one batch per terrain.

        Details: ``speed_flat``, ``speed_hill:15`` and so on [body lengths/s], each of shape (N,).
        """
        designs = [self.design(point) for point in self.space.validate(np.atleast_2d(points))]
        return self._judged(Batch(simulation.simulate, designs))

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Like :meth:`evaluate` for points of the relaxed space, with the gradient of the mean speed if wanted.

        Without a value between 0 and 1 it can still be another judgement than :meth:`evaluate`: by ``ramp_steps``,
        and because no idle columns are skipped, see ``GaitSchedule``.
        """
        points = self.space.relaxed().validate(np.atleast_2d(points))
        designs = [self.relaxed_design(point, sharpness) for point in points]
        if not gradients:
            return self._judged(Batch(simulation.simulate, designs, relaxed=True))
        return self._judged(Batch(gradient.differentiate, designs, points, sharpness, relaxed=True))

    @property
    def _relaxed_actuation(self) -> InflatableActuation:
        """How the robot is driven in relaxed evaluations."""
        ramp_steps = RAMP_STEPS if self.ramp_steps is None and self.pressure is None else self.ramp_steps
        return dataclasses.replace(self.actuation, ramp_steps=ramp_steps)

    def relaxed_design(self, point: ArrayLike, sharpness: float) -> InflatableDesign:
        """The design of a point of the relaxed space, shape (D,); what is free of its schedule is sharpened."""
        return InflatableDesign(*self.shape.values(point), self._control.relaxed(self._genes(point), sharpness))

    def _slopes(self, run: gradient.InflatableGradient, points: Floats, sharpness: float) -> Floats:
        """d speed / d variable on one terrain, shape (N, D), by the convention of ``InflatableResult.speed``."""
        levels = np.concatenate([run.inflation, run.grip], axis=1)
        genes = [
            self._control.slopes(self._genes(point), sharpness, slope)
            for point, slope in zip(points, levels, strict=True)
        ]
        slopes = [self.shape.slopes(run, points), np.array(genes)]
        seconds = self._counted(run.result)[:, None] * self.body.time_step
        return np.concatenate(slopes, axis=1) / (self.body.body_length * seconds)

    def _counted(self, result: InflatableResult) -> Ints:
        """Time steps by which the speeds of a batch are counted, shape (N,); see :meth:`counted_steps`."""
        if self.warm_up:  # whole cycles that follow it
            return result.steps
        if self._timed:
            return np.maximum(result.steps, self.most_steps)
        return np.full(len(result.status), nominal_steps(self.columns * self.repeats, self.actuation))

    @property
    def _timed(self) -> bool:
        """Whether gaits have times of their own."""
        return self.graded if self.schedule is None else self.schedule.has_own_times

    def speeds(self, result: InflatableResult) -> Floats:
        """Speeds of a batch [body lengths/s], shape (N,): the result's, or by what counts of a free graded gait."""
        if all(getattr(self, name) == LATER_OPTIONS[name] for name in GRADED_OPTIONS):
            return result.speed
        lengths = self.stages * result.stages.min(axis=1) / self.body.body_length
        return lengths / (self._counted(result) * result.time_step)

    def _judged(self, batch: Batch) -> Evaluation:
        """Simulate a batch under all conditions: speeds on all terrains, or their mean; the first failure counts."""
        found = outcomes(
            self.conditions,
            len(batch.designs),
            lambda number, condition, chosen: self._outcome(batch.part(chosen), condition, number),
        )
        mean = self.objectives == "mean"
        counted = capped(found, self.conditions, self.ahead) if self.ladder and mean else found
        each = np.stack([outcome.speeds for outcome in counted.values()], axis=1)
        status = np.full(len(each), OK, dtype=object)
        for outcome in found.values():
            status = np.where(status == OK, outcome.status, status)
        slopes = [outcome.slopes for outcome in counted.values() if outcome.slopes is not None]
        objectives = each.mean(axis=1) if mean else each
        gradients: Floats | None = np.mean(slopes, axis=0) if slopes else None
        details = {name: outcome.speeds for name, outcome in found.items()}
        if self.effort:
            details["effort"], by_effort = self._efforts(batch)
            objectives = objectives - self.effort * details["effort"]
            gradients = None if gradients is None else gradients - self.effort * by_effort
        return Evaluation(objectives, status, details, gradients)

    def _efforts(self, batch: Batch) -> tuple[Floats, Floats]:
        """Efforts of a batch, shape (N,), and their derivatives by the points, shape (N, D), if it has some."""
        each = [effort(design, self.counted_steps(design), self.actuation) for design in batch.designs]
        slopes = np.zeros((len(each), self.space.size))
        for row, (_, by_level), point in zip(slopes, each, () if batch.points is None else batch.points, strict=False):
            genes = self._genes(point)
            levels = np.concatenate([by_level, np.zeros((FEET, by_level.shape[1]))])
            row[len(point) - len(genes) :] = self._control.slopes(genes, batch.sharpness, levels)
        return np.array([used for used, _ in each]), slopes

    def _outcome(self, batch: Batch, condition: Condition, number: int) -> Outcome:
        """Of one simulation of a batch, under the condition of that number."""
        where = {name: getattr(self, name) for name in ("precision", "device", "threads")}
        actuation = condition.actuation
        if batch.relaxed:
            actuation = dataclasses.replace(actuation, ramp_steps=self._relaxed_actuation.ramp_steps)
        run = batch.run(
            batch.designs,
            condition.terrain,
            geometry=self.body,
            actuation=actuation,
            counting=Counting(self.warm_up, self.stages),
            **where,
            progress=self._progress_on(number),
        )
        if batch.points is None:
            return Outcome(self.speeds(run), np.asarray(run.status, object), None)
        slopes = self._slopes(run, batch.points, batch.sharpness)
        return Outcome(self.speeds(run.result), np.asarray(run.result.status, object), slopes)

    def _progress_on(self, number: int) -> Callable[[float], None] | None:
        """Turns the progress under one condition into that of the evaluation."""
        if (report := self.progress) is None:
            return None
        return lambda fraction: report((number + fraction) / len(self.conditions))

    def robot_steps(
        self, points: ArrayLike, judged: Evaluation, *, relaxed: bool = False, sharpness: float = 0.0
    ) -> Ints:
        """Time steps that judging each of some points took, over all simulations of it, shape (N,); cheap.

        Args:
            points: shape (N, D).
            judged: what they were judged.
            relaxed: whether as relaxed points.
            sharpness: of these.
        """
        points = np.atleast_2d(points)
        designs = [self.relaxed_design(p, sharpness) if relaxed else self.design(p) for p in points]
        drive = self._relaxed_actuation if relaxed else self.actuation
        each = np.array([predicted_steps(design, drive) for design in designs])
        return each * np.sum([condition.simulated(judged.details) for condition in self.conditions], axis=0)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of a point as JSON, for ``robots.inflatable.load_design``."""
        save_design(self.design(point), path)

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again."""
        return description_of(self)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> "GaitProblem":
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: in one line, that names what is missing, unknown or not allowed.
        """
        return problem_of_description(cls, description)
