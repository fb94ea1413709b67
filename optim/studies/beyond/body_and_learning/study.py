"""The study: metrics of many soft bodies, and the evaluations that three kinds of learning need in them.

Source: dissertation, chapter 4, which found in vehicles of two wheels that M_L and M_CI tell how many evaluations a
search needs; chapter 6 asks whether that holds for complex robots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from optim.experiments.body_metrics import Environments, Measuring, measure_body
from optim.experiments.data import Data
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, cached
from optim.experiments.side_by_side import run_with_budget
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, write_records
from optim.problem import Evaluation, Request, judge
from optim.problems.robot import RobotProblem
from optim.search import build_method
from optim.studies.beyond.body_and_learning.bodies import LIGHT_AT, WORLDS, walker
from optim.studies.beyond.body_and_learning.report import write_report
from robots.lattice_robot import LatticeRobot
from robots.robot import part_of
from robots.tasks import Success
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import positive, within
from taichi_sim.base.compute import Compute
from taichi_sim.base.results_folder import ResultsFolder

TABLE = "bodies.csv"
FILES = (TABLE, "table.md", "summary.json", "evaluations.png", "parts")
OBJECTIVE = ("worst", "minimise:remaining")


@dataclass(frozen=True)
class Learner:
    """A kind of learning.

    Attributes:
        title: as tables say it.
        method, settings: of the search.
        share: of the budget of evaluations that it has; one with its gradient takes as long as several without.
    """

    title: str
    method: str
    settings: Mapping[str, Any]
    share: float = 1.0


LEARNERS = MappingProxyType(
    {
        "evolution": Learner("evolution", "hill-climb", {"climbers": 8}),
        "nes": Learner("evolution strategies", "nes", {"population": 16, "random_mean": True, "sigma": 0.1}),
        "gradient": Learner("gradients", "gradient", {"climbers": 2, "candidates": 8, "patience": 20}, 0.25),
    }
)


@dataclass(frozen=True)
class BodyAndLearning(Settings):
    """Bodies, how they are measured, and how controllers are learned in them.

    Attributes:
        bodies: walkers, by number from 0.
        controllers: drawn in each, for its metrics.
        repetitions: of each kind of learning in each body.
        budget: evaluations of a repetition, each in all worlds; of one with gradients a quarter of them.
        nearer: success: how much nearer the light a controller has to come in every world [m].
        cycles: of a trial.
    """

    bodies: Several = 64
    controllers: Count = 256
    repetitions: Count = 5
    budget: Several = 128
    nearer: Annotated[float, positive] = 0.01
    cycles: Count = 3

    name = "body-and-learning"

    def robot(self, number: int) -> LatticeRobot:
        """The walker of a number."""
        return walker(number, self.cycles)

    @property
    def bound(self) -> float:
        """Distance to the light at which a controller has succeeded [m]."""
        return LIGHT_AT - self.nearer

    @cached_property
    def environments(self) -> Environments:
        """The worlds, and what has to be kept in them."""
        near = (Success("remaining", "<=", self.bound),)
        return Environments(WORLDS, (near,) * len(WORLDS))

    def budget_of(self, learner: str) -> int:
        """Evaluations of a repetition of a kind of learning."""
        return max(2, round(LEARNERS[learner].share * self.budget))


def study(folder: Path, settings: BodyAndLearning, progress: Progress = None, jobs: int = 1) -> None:
    """Write a row for each body, what goes with what, and a picture; bodies that are whole are not tried again."""
    ResultsFolder(folder, settings.name, settings.lasting("bodies"))
    numbers = range(settings.bodies)
    parts = [(f"body {number}", partial(body_part, folder, settings, number)) for number in numbers]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
    rows: list[Record] = []
    for number, (_, part) in enumerate(parts):
        rows.append(part({}, progress and part_of(progress, number, len(parts))))
        write_records(folder / TABLE, rows)  # what there is so far is of use
    _report(folder, rows, settings)


def tell_as(kind: type[BodyAndLearning], data: Data, folder: Path) -> None:
    """Write what goes with what, and the picture, from the rows of bodies of a kind."""
    counts = ("body", "voxels", "all", "any", *(f"{name}_solved" for name in LEARNERS))
    columns = {**dict.fromkeys(counts, int), **dict.fromkeys(("M_L", "M_CI", "felt", *LEARNERS), float)}
    _report(folder, data.records(TABLE, columns), data.settings(kind))


def _report(folder: Path, rows: Sequence[Record], settings: BodyAndLearning) -> None:
    write_report(folder, rows, {name: each.title for name, each in LEARNERS.items()}, settings.describe())


def body_part(folder: Path, settings: BodyAndLearning, number: int, _: Mapping[str, Any], progress: Progress) -> Record:
    """Measure a body and learn in it, unless that is done; its row."""
    parts = ResultsFolder(folder / "parts" / f"{number:03d}", "body", {"number": number, **settings.lasting("bodies")})
    robot, compute = settings.robot(number), Compute(precision="f32", threads=1)
    measuring = Measuring(settings.controllers, seed=1)
    share = 1 + len(LEARNERS)
    found = measure_body(robot, settings.environments, measuring, compute, parts, part_of(progress, 0, share))
    sampled = found.sampled
    row: dict[str, Any] = {
        "body": number,
        "voxels": robot.body.voxel_count,
        "M_L": sampled.learnability.value,
        "M_CI": sampled.resistance.value,
        "all": sampled.learnability.count,
        "any": sampled.resistance.of,
        "felt": np.nan if found.felt is None else found.felt[0],
    }
    for count, name in enumerate(LEARNERS, 1):
        told = part_of(progress, count, share)
        learn_here = partial(learn, settings, robot, number, name, told)
        check = partial(check_learned, settings.repetitions, settings.budget_of(name))
        learned = cached(parts, f"learned {name}".replace(" ", "_"), learn_here, check)
        row[name] = float(learned["evaluations"].mean())
        row[f"{name}_solved"] = int(learned["solved"].sum())
    return row


def learn(settings: BodyAndLearning, robot: LatticeRobot, stream: int, name: str, progress: Progress = None) -> Arrays:
    """Evaluations until a controller succeeds in all worlds, or all there are, and whether one did, shape (R,) each.

    Args:
        settings: repetitions, budget and success.
        robot: the body.
        stream: of random numbers, one for each body.
        name: of the learner.
        progress: told the share that is done.
    """
    problem = RobotProblem(robot, WORLDS, objective=OBJECTIVE, summed=True, precision="f32", threads=1)
    seeds = [int(np.random.SeedSequence((stream, run)).generate_state(1)[0]) for run in range(settings.repetitions)]
    return learn_until(problem, -settings.bound, LEARNERS[name], settings.budget_of(name), seeds, progress)


def learn_until(
    problem: RobotProblem, score: float, learner: Learner, budget: int, seeds: Sequence[int], progress: Progress = None
) -> Arrays:
    """Evaluations until a search finds a score, or its budget, and whether it did, shape (R,) each; R seeds."""
    evaluations, solved = np.zeros(len(seeds), np.int64), np.zeros(len(seeds), bool)

    def evaluate(_: Sequence[Any], request: Request) -> Evaluation:
        return judge(problem, request)

    def observe(run: int, points: Floats, evaluation: Evaluation) -> bool:
        good = np.flatnonzero(np.nan_to_num(evaluation.objectives[:, 0], nan=-np.inf) >= score)
        solved[run] = good.size > 0
        evaluations[run] += good[0] + 1 if good.size else len(points)
        return bool(solved[run])

    methods = [build_method(learner.method, problem.space, {**learner.settings, "seed": seed}) for seed in seeds]
    run_with_budget(methods, budget, evaluate, observe, progress)
    return {"evaluations": evaluations, "solved": solved}


def check_learned(repetitions: int, budget: int, arrays: Arrays) -> None:
    """Refuse outcomes of a file that :func:`learn_until` cannot have found, by a ValueError."""
    for name in ("evaluations", "solved"):
        if (shape := arrays[name].shape) != (repetitions,):
            raise ValueError(f"{name}: shape {shape} is not allowed; give ({repetitions},)")
    within("evaluations", arrays["evaluations"], 1, budget)
    within("solved", arrays["solved"], 0, 1)


STUDY = Study(
    title="whether metrics of a soft body tell how soon controllers are learned in it",
    source="chapters 4 and 6, whose metrics were found in vehicles",
    scales={
        "small": BodyAndLearning(bodies=3, controllers=16, repetitions=2, budget=16, cycles=1),
        "medium": BodyAndLearning(),
        "full": BodyAndLearning(bodies=128, controllers=1024, repetitions=10, budget=256),
    },
    run=study,
    tell=partial(tell_as, BodyAndLearning),
    writes=(TABLE, "table.md", "summary.json", "evaluations.png"),
    cost="about 20 hours of a core",
)
