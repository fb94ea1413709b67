"""The study: metrics of many soft bodies, and the evaluations that three kinds of learning need in them.

Source: dissertation, chapter 4, which found in vehicles of two wheels that M_L and M_CI tell how many evaluations a
search needs; chapter 6 asks whether that holds for complex robots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.body_metrics import Environments, Measuring, measure_body
from optim.experiments.data import Data
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, write_records
from optim.problems.robot import RobotProblem
from optim.studies.beyond.body_and_learning.bodies import LIGHT_AT, WORLDS, walker
from optim.studies.beyond.body_and_learning.learning import LEARNERS, learn_until, learned_cells, run_columns
from optim.studies.beyond.body_and_learning.report import write_report
from robots.lattice_robot import LatticeRobot
from robots.robot import part_of
from robots.tasks import Success
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.checks import positive
from taichi_sim.base.compute import Compute
from taichi_sim.base.results_folder import ResultsFolder

TABLE = "bodies.csv"
FILES = (TABLE, "table.md", "summary.json", "evaluations.png", "parts")
OBJECTIVE = ("worst", "minimise:remaining")


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


def rewrite_as(kind: type[BodyAndLearning], data: Data, folder: Path) -> None:
    """Write what goes with what, and the picture, from the rows of bodies of a kind."""
    counts = ("body", "voxels", "all", "any", *(f"{name}_solved" for name in LEARNERS))
    columns = {**dict.fromkeys(counts, int), **dict.fromkeys(("M_L", "M_CI", "felt", *LEARNERS), float)}
    settings = data.settings(kind)
    _report(folder, data.records(TABLE, columns | run_columns(data, TABLE)), settings)


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
        row |= learned_cells(parts, f"learned_{name}", name, settings.repetitions, settings.budget, learn_here)
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
    return learn_until(
        problem, -settings.bound, LEARNERS[name], LEARNERS[name].evaluations(settings.budget), seeds, progress
    )


STUDY = Study(
    title="whether metrics of a soft body tell how soon controllers are learned in it",
    source="chapters 4 and 6, whose metrics were found in vehicles",
    scales={
        "small": BodyAndLearning(bodies=3, controllers=16, repetitions=2, budget=16, cycles=1),
        "medium": BodyAndLearning(),
        "full": BodyAndLearning(bodies=128, controllers=1024, repetitions=10, budget=256),
    },
    run=study,
    rewrite=partial(rewrite_as, BodyAndLearning),
    writes=(TABLE, "table.md", "summary.json", "evaluations.png"),
    cost="about 20 hours of a core",
)
