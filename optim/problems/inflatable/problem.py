"""Designing shape, orientation and gait of the inflatable robot for one terrain or several.

Source: Powers 2021 dissertation, ch. 5, "Optimization": the robot travels as fast as it can on flat ground or
up an incline of 15 degrees; orientation, shape and control are free to change, or only the last two or one.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.problem import OK, Evaluation, Minibatch
from optim.problems.inflatable.draws import Copies, Draws, UncertainDraws, eased
from optim.problems.inflatable.outcomes import Condition, Outcomes, effort, hardened
from optim.problems.inflatable.points import GaitPoints
from optim.problems.inflatable.settings import RIG_FILE
from optim.problems.robot_designing import subject_of
from optim.problems.uncertain import check_part, held_out_products
from robots.batches import grouped, in_groups
from robots.calibration import save_properties
from robots.inflatable import gradient, simulation
from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation, each_actuation
from robots.inflatable.convention import counting_of, speeds_by
from robots.inflatable.design import InflatableDesign, save_design
from robots.inflatable.layout import told_layout
from robots.inflatable.robot import InflatableRobot, core_pressure_rows
from robots.inflatable.schedule import FEET
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import counted_steps, gait_steps, nominal_steps
from robots.robot import Robot, part_of
from robots.uncertainty import Risk, Score, Uncertainty
from taichi_sim.base.arrays import Floats, Indices, Ints

RAMP_STEPS = 6000  # half as long as 6 kPa take as published


@dataclass(frozen=True, eq=False)
class GaitProblem(GaitPoints):
    """Objective: the speed [body lengths/s], by the published convention; mean over the terrains, or one each.

    What is given is fixed, what is None is free to change. The variables: ``orientation`` 0 to 90 degrees,
    ``pressure`` 0 to 12,000 Pa, and the genes of the schedule, see ``encoding``. Beside graded genes
    the pressure begins at ``EMPTY_CORE``, and is cut as they are: the flat robot is found, and kept, easily.
    A body with N cores has ``pressure_1`` to ``pressure_N`` instead.
    """

    plays_on_rigs = True
    robot_kind = "inflatable"

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.conditions  # refuses terrains that have no harder ones
        # What is fixed is checked where it is used: better now than in the first evaluation. Of any point: the lowest
        # moves nothing, and is played again and again to fill its time.
        self.design(self.space.sample(np.random.default_rng(0), 1)[0])

    @property
    def objective_names(self) -> tuple[str, ...]:
        """The mean speed, or that on each terrain."""
        if self.objectives == "mean":
            return ("speed",)
        return tuple(condition.name for condition in self.conditions)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """The unit of all objectives: body lengths per second."""
        return ("BL/s",) * len(self.objective_names)

    @cached_property
    def conditions(self) -> tuple[Condition, ...]:
        """Conditions under which gaits are simulated."""
        found: list[Condition] = []
        below = None
        for terrain in self.terrains:
            usual = Condition(f"speed_{terrain.name}", terrain, self.actuation, below, False, self.ahead)
            found.append(usual)
            if self.hard:
                found.append(hardened(usual))
            below = usual.name if self.ladder else None
        return tuple(found)

    @property
    def detail_names(self) -> set[str]:
        """Names of the details that every evaluation tells."""
        return {condition.name for condition in self.conditions} | ({"effort"} if self.effort else set())

    def in_full(self) -> "GaitProblem":
        """This problem with gaits of the full length."""
        return dataclasses.replace(self, steps=None, warm_up=0, stages=1)

    def counted_steps(self, design: InflatableDesign) -> int:
        """Time steps by which the speed of a design is counted."""
        if self.steps is None:
            return counted_steps(design.schedule, self.actuation)
        return max(self.steps, gait_steps(design.schedule, self.actuation))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D), as one batch per terrain.

        Details: ``speed_flat``, ``speed_hill:15`` and so on [body lengths/s], each of shape (N,).
        """
        return self._judged([self.design(point) for point in self.space.validate(np.atleast_2d(points))])

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Like :meth:`evaluate` for points of the relaxed space, with the gradient of the mean speed if wanted.

        Without a value between 0 and 1 it can still be another judgement than :meth:`evaluate`: by ``ramp_steps``,
        and because no idle columns are skipped, see ``GaitSchedule``.

        Raises:
            ValueError: if the sharpness is infinite, as that judgement would be none of true points.
        """
        if sharpness == math.inf:
            self.check_true_gradients()
        points = self.space.relaxed().validate(np.atleast_2d(points))
        designs = [self.relaxed_design(point, sharpness) for point in points]
        return self._judged(designs, True, points if gradients else None, sharpness)

    @property
    def _relaxed_actuation(self) -> InflatableActuation:
        """How the robot is driven in relaxed evaluations."""
        ramp_steps = RAMP_STEPS if self.ramp_steps is None and self.pressure is None else self.ramp_steps
        return dataclasses.replace(self.actuation, ramp_steps=ramp_steps)

    def _slopes(self, run: gradient.InflatableGradient, points: Floats, sharpness: float, copies: Copies) -> Floats:
        """d speed / d variable on one terrain, shape (N, D), by the convention of ``InflatableResult.speed``.

        Args:
            run: the derivatives of the distances.
            points: shape (N, D).
            sharpness: with which they were judged.
            copies: of robots that were simulated, one for each point.
        """
        tables = {name: getattr(run, name) for name in self._control.more_tables}
        genes = []
        for robot, (point, slope) in enumerate(zip(points, run.levels * copies.by_level, strict=True)):
            own = {name: np.reshape(table[robot], (-1, table.shape[-1])) for name, table in tables.items()}
            genes.append(self._control_of(point).slopes(self._genes(point), sharpness, slope, **own))
        # Which bladders there are has no slopes: a body has a bladder or not.
        made = [self.shape.slopes(run, points), self.made_of.slopes(run, copies.by_friction)]
        slopes = [*made, np.zeros((len(points), self.laid.size)), np.array(genes)]
        seconds = self._counted(run.result, copies.drives)[:, None] * self.body.time_step
        return np.concatenate(slopes, axis=1) / (self.body.body_length * seconds)

    def _counted(
        self, result: InflatableResult, drives: InflatableActuation | Sequence[InflatableActuation] | None = None
    ) -> Ints:
        """Time steps by which the speeds of a batch are counted, shape (N,); see :meth:`counted_steps`."""
        if self.convention:
            return self.convention.counted(result, self.actuation)
        each = each_actuation(self.actuation if drives is None else drives, len(result.status))
        if not self._timed:
            nominal = np.array([nominal_steps(self.columns * self.repeats, drive) for drive in each])
            return np.maximum(result.steps, nominal) if self._paced else nominal
        return np.maximum(result.steps, [nominal_steps(PUBLISHED_COLUMNS, drive) for drive in each])

    def speeds(self, result: InflatableResult) -> Floats:
        """Speeds of a batch [body lengths/s], shape (N,): the result's, or by what counts of a free graded gait."""
        return speeds_by(self.convention, result, self.body, self.actuation)

    def _judged(
        self,
        designs: Sequence[InflatableDesign],
        relaxed: bool = False,
        points: Floats | None = None,
        sharpness: float = 0.0,
    ) -> Evaluation:
        """Simulate designs under all conditions: speeds on all terrains, or their mean; the first failure counts.

        Args:
            designs: of N points.
            relaxed: whether the points are relaxed.
            points: shape (N, D), for gradients by them; None for none.
            sharpness: of the relaxed points.
        """

        def simulate(number: int, chosen: Indices) -> tuple[Floats, NDArray[Any], Floats]:
            """Batch by batch: robots of one have the same voxels, those of a layout of bladders."""

            def batch(group: Sequence[int], progress: Callable[[float], None] | None) -> Iterable[Any]:
                mine = chosen[list(group)]
                some, own = None if points is None else points[mine], [designs[place] for place in mine]
                return zip(*self._simulated(own, number, relaxed, some, sharpness, progress), strict=True)

            groups = grouped(designs[place].bladders for place in chosen)
            each = in_groups(groups, part_of(self.progress, number, len(self.conditions)), batch)
            speeds, status, slopes = zip(*each, strict=True)
            return np.array(speeds), np.array(status, dtype=object), np.array(slopes)

        variables = 0 if points is None else self.space.size
        found = Outcomes.simulated(self.conditions, len(designs), variables, simulate)
        mean = self.objectives == "mean"
        counted = found.capped(self.ahead) if self.ladder and mean else found
        each = np.stack(list(counted.speeds), axis=1)
        objectives = each.mean(axis=1) if mean else each
        gradients: Floats | None = None if points is None else counted.slopes.mean(axis=0)
        details = {condition.name: speeds for condition, speeds in zip(self.conditions, found.speeds, strict=True)}
        if self.effort:
            details["effort"], by_effort = self._efforts(designs, points, sharpness)
            objectives = objectives - self.effort * details["effort"]
            gradients = None if gradients is None else gradients - self.effort * by_effort
        status = np.full(len(designs), OK, dtype=object)
        for told in found.status:
            status = np.where(status == OK, told, status)
        return Evaluation(objectives, status, details, gradients)

    def _efforts(
        self, designs: Sequence[InflatableDesign], points: Floats | None, sharpness: float
    ) -> tuple[Floats, Floats]:
        """Efforts of designs, shape (N,), and their derivatives by the points, shape (N, D), if these are given."""
        each = [effort(design, self.counted_steps(design), self.actuation) for design in designs]
        slopes = np.zeros((len(each), self.space.size))
        for row, (_, by_level), point in zip(slopes, each, () if points is None else points, strict=False):
            genes = self._genes(point)
            levels = np.concatenate([by_level, np.zeros((FEET, by_level.shape[1]))])
            # Strokes follow from levels alone; a pace changes only whole numbers of steps, core pressures nothing.
            others = dict.fromkeys(self._control.more_tables, np.zeros(1))
            row[len(point) - len(genes) :] = self._control_of(point).slopes(genes, sharpness, levels, **others)
        return np.array([used for used, _ in each]), slopes

    def _simulated(
        self,
        designs: Sequence[InflatableDesign],
        number: int,
        relaxed: bool,
        points: Floats | None,
        sharpness: float,
        progress: Callable[[float], None] | None,
    ) -> tuple[Floats, NDArray[Any], Floats]:
        """Speeds, status and slopes under the condition of a number, see :meth:`_judged`."""
        condition = self.conditions[number]
        actuation = condition.actuation
        if relaxed:
            actuation = dataclasses.replace(actuation, ramp_steps=self._relaxed_actuation.ramp_steps)
        settings: dict[str, Any] = {
            "geometry": self.body,
            "counting": counting_of(self.convention),
            **self.compute.options,
            "progress": progress,
        }
        drawn = self._draws(relaxed)
        ground = eased(condition.terrain, sharpness, self.gentle)
        copies = drawn.copies(designs, ground, actuation, condition.least_friction)
        settings |= {"actuation": copies.drives, **drawn.noise_of(len(designs))}
        if points is None:
            result = simulation.simulate(copies.designs, copies.terrains, **settings)
            speeds, slopes, status = self.speeds(result), np.zeros((len(copies.designs), 0)), result.status
        else:
            rows = np.repeat(points, drawn.count, axis=0)
            speeds, slopes, status = self._sloped(drawn, copies, rows, sharpness, settings)
        judged, by_points = drawn.judged(speeds, slopes)
        return judged, drawn.first_failure(status), by_points

    def _sloped(
        self, drawn: Draws, copies: Copies, points: Floats, sharpness: float, settings: Mapping[str, Any]
    ) -> tuple[Floats, Floats, NDArray[Any]]:
        """Speeds, slopes and status of copies, with the points of each; only slopes that count are taken.

        Where few draws weigh, as under the risk of the worst, all are simulated first, which says which these are.
        """
        progress, chosen = settings["progress"], np.arange(len(points))
        speeds, status = np.zeros(len(points)), np.full(len(points), OK, dtype=object)
        if find := drawn.few_that_weigh:
            plain = {**settings, "progress": part_of(progress, 0, 2)}
            result = simulation.simulate(copies.designs, copies.terrains, **plain)
            speeds, status = self.speeds(result), np.array(result.status, dtype=object)
            chosen = find(speeds)
            copies, progress = copies.some(chosen), part_of(progress, 1, 2)
        counting = dataclasses.replace(settings["counting"], window=self.window)
        own = {**settings, "actuation": copies.drives, "counting": counting, "progress": progress}
        run = gradient.differentiate(copies.designs, copies.terrains, **own)
        slopes = np.zeros(points.shape)
        slopes[chosen] = self._slopes(run, points[chosen], sharpness, copies)
        if not find:
            speeds = self.speeds(run.result)
        status[chosen] = np.where(status[chosen] == OK, run.result.status, status[chosen])
        return speeds, slopes, status

    def check_true_gradients(self) -> None:
        """Raise a one-line ValueError: only relaxed gaits have gradients."""
        raise ValueError(
            "method: it wants gradients of true designs, which gaits do not have; choose memetic or gradient"
        )

    def check_minibatch(self, size: int) -> None:
        """Refuse minibatches in which the objective is another one, before any work.

        Raises:
            ValueError: with ``ladder``, which compares terrains; and see ``check_part``.
        """
        if self.ladder and not self.uncertain:
            raise ValueError(f"minibatch_size: {size} is not allowed with ladder, which compares terrains")
        if self.uncertain:
            check_part(size, "draws", self.draws, self.risk)
        else:
            check_part(size, "worlds", len(self.terrains), "mean")

    def in_minibatch(self, minibatch: Minibatch) -> "GaitProblem":
        """The problem in a few of the draws, each on all terrains; or terrains, if nothing is uncertain."""
        if not self.uncertain:
            return dataclasses.replace(self, terrains=tuple(self.terrains[n] for n in minibatch.of(len(self.terrains))))
        part = copy(self)
        object.__setattr__(part, "_all_draws", self._all_draws.part(minibatch.of(self.draws)))
        return part

    @cached_property
    def _all_draws(self) -> UncertainDraws:
        """The draws of all that is uncertain."""
        return UncertainDraws(self.draws, uncertainty=Uncertainty.parse(self.uncertain), risk=Risk.parse(self.risk))

    def _draws(self, relaxed: bool) -> Draws:
        """The draws over which gaits are judged."""
        if self.uncertain:
            return self._all_draws
        return Draws(self.draws, self.noise, self.friction_spread) if relaxed else Draws()

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
        simulated = np.sum([condition.simulated(judged.details) for condition in self.conditions], axis=0)
        return self._draws(relaxed).steps(designs, self._relaxed_actuation if relaxed else self.actuation) * simulated

    def robot_of(self, point: ArrayLike) -> Robot:
        """The inflatable robot with the gait of a point, shape (D,); its speeds are counted as the search counts."""
        return InflatableRobot(
            self.design(point),
            geometry=self.geometry,
            weight=self.weight,
            properties=self.properties,
            convention=self.convention,
        )

    def products(self, point: ArrayLike) -> Mapping[str, Callable[[Path], None]]:
        """How the best gait does over draws that the search has not seen, where something is uncertain."""
        best, score = partial(self.robot_of, point), partial(Score.first_of, stands_in=self.effort > 0)
        return held_out_products(best, self.terrains, self.uncertain, self.risk, self.compute, score)

    @property
    def subject(self) -> str:
        """The robot and the terrains on which it travels, in words."""
        return subject_of("inflatable robot", self.terrains)

    def columns_of(self, points: Floats) -> Mapping[str, Sequence[str]]:
        """Columns of pressures and orientation in a table of points."""
        designs = [self.design(point) for point in points]
        each = [core_pressure_rows("Pressure", design) for design in designs]
        found = {f"{name} [kPa]": [f"{pressures[name]:.2f}" for pressures in each] for name in each[0]} if each else {}
        laid = {"Bladders": [told_layout(design.bladders or ()) for design in designs]} if self.laid.free else {}
        return {**found, "Orientation [°]": [f"{design.orientation:.1f}" for design in designs], **laid}

    @property
    def curves(self) -> Mapping[str, str]:
        """The speed on each terrain, of several."""
        several = self.terrains if len(self.terrains) > 1 else ()
        return {f"speed_{terrain.name}": terrain.spoken for terrain in several}

    def logged(self, point: ArrayLike, best: float | None, details: Mapping[str, Any]) -> list[dict[str, float]]:
        """Speed on each terrain, and its distance [m], unless the slowest of several stages counts, which is a part."""
        design, rule = self.design(point), self.convention
        steps = rule.counted_of(design.schedule, self.actuation) if rule else self.counted_steps(design)
        metres = self.body.body_length * steps * self.body.time_step
        speeds = [details.get(f"speed_{terrain.name}") for terrain in self.terrains]
        if self.stages > 1:
            return [{} if v is None else {"speed": v} for v in speeds]
        return [{} if v is None else {"speed": v, "distance": float(v * metres)} for v in speeds]

    def command_options(self, folder: Path) -> dict[str, Any]:
        """Options for body and rig, which saved designs do not hold."""
        rig = {} if self.properties is None else {"calibration": folder / RIG_FILE}
        return {"geometry": self.geometry, "weight": self.weight, **rig}

    def prepare(self, folder: Path) -> None:
        """Write the properties of the rig, if the robot has some, for ``robots.calibration.load_calibration``."""
        if self.properties is None:
            (folder / RIG_FILE).unlink(missing_ok=True)  # of a run that ended before it began
        else:
            save_properties(self.properties, self.geometry, folder / RIG_FILE, self.weight)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of a point as JSON, for ``robots.inflatable.load_design``."""
        save_design(self.design(point), path)
