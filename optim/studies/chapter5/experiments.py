"""The searches of chapter 5: for a gait on flat ground and up a hill, with more and with less free to change.

Source: Powers 2021 dissertation, ch. 5, "Optimization" and "Summary of experiments".
"""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optim.experiments.results import Costs, Progress
from optim.experiments.side_by_side import run_side_by_side
from optim.experiments.study import Count, Settings, Several, Whole
from optim.problem import Evaluation, Request, evaluate_request
from optim.problems.inflatable.problem import GaitProblem
from optim.runs import open_run
from optim.runs.environment import environment
from optim.runs.loop import FolderSearch
from optim.search import HillClimb
from optim.studies.chapter5.gaits import Uphill
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign, highest_pressure
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base import checks

PARTS = ("orientation", "shape", "control")
FLAT, HILL = "flat", "hill"


@dataclass(frozen=True)
class Experiment:
    """One search."""

    name: str  # also of its run folder
    row: str  # of the table, where it is a line
    place: str  # ``"flat"`` or ``"hill"``
    free: tuple[str, ...]  # what may change; what may not is as in ``fixed``
    fixed: InflatableDesign  # a design
    start: Mapping[str, float] = dataclasses.field(default_factory=dict)  # of every climber; else it is random


# As published, what is not free is as in rolling on flat ground and as in inching on the hill. Whether shape has to
# change was asked by rolling on the hill: by the text with shape and orientation fixed, as it ran with all free and
# only the start as in rolling.
EXPERIMENTS = (
    *(
        Experiment(f"{'-'.join(free)}-{place}", ", ".join(free), place, free, gait)
        for free in (PARTS, PARTS[1:], PARTS[2:])
        for place, gait in ((FLAT, ROLLING), (HILL, INCHING))
    ),
    Experiment("rolling-on-the-hill-by-the-text", "rolling on the hill, by the text", HILL, ("control",), ROLLING),
    Experiment(
        "rolling-on-the-hill-as-run",
        "rolling on the hill, as run",
        HILL,
        PARTS,
        ROLLING,
        {"orientation": ROLLING.orientation, "pressure": highest_pressure(ROLLING.pressure)},
    ),
)
ROWS = tuple(dict.fromkeys(experiment.row for experiment in EXPERIMENTS))
PAIRED = tuple(row for row in ROWS if {e.place for e in EXPERIMENTS if e.row == row} == {FLAT, HILL})


@dataclass(frozen=True)
class ShapeChange(Settings):
    """Settings of the searches and of what follows them."""

    climbers: Several = 60  # of each experiment
    generations: Whole = 200  # after the random starts; may be raised later
    slope: Uphill = 15.0  # of the hill [degrees]
    seed: Whole = 1  # of all random numbers
    geometry: str = "published"  # name of the robot's, see ``NAMED_GEOMETRIES``
    repeats: Count = 2  # how often the columns of a gait are played
    copies: Count = 8  # of gaits made by hand and of each experiment's best design, with noise on their starts, in f64
    others: Count = 16  # best designs of each experiment that are simulated on the other terrain

    def __post_init__(self) -> None:
        super().__post_init__()
        known = [name for name, each in NAMED_GEOMETRIES.items() if each.cores == 1 and not each.closed]
        checks.choice("geometry", self.geometry, known)

    def terrain(self, place: str) -> Terrain:
        """The terrain of a place, ``"flat"`` or ``"hill"``."""
        return Terrain() if place == FLAT else Terrain(self.slope)

    def problem(self, experiment: Experiment, threads: int | None = None) -> GaitProblem:
        """The problem that an experiment searches."""
        free, fixed = experiment.free, experiment.fixed
        return GaitProblem(
            (self.terrain(experiment.place),),
            None if "orientation" in free else fixed.orientation,
            None if "shape" in free else fixed.pressure,
            repeats=self.repeats,
            geometry=self.geometry,
            threads=threads,
        )

    def method(self, experiment: Experiment) -> dict[str, Any]:
        """The settings of an experiment's hill climbers."""
        started = {"start": dict(experiment.start)} if experiment.start else {}
        return {"climbers": self.climbers, "seed": self.seed, **started}


def search(
    settings: ShapeChange,
    folder: Path,
    costs: Costs,
    after_round: Callable[[], object],
    threads: int | None = None,
    progress: Progress = None,
) -> None:
    """Run all experiments, a generation of each in turn; each is a run folder of its own, that ``codesign`` knows.

    A study that is interrupted has something of each experiment, and a kill loses at most one generation. Raises
    ValueError for run folders of other settings, in use, or that went further.
    """
    turns = len(EXPERIMENTS) * (settings.generations + 1)

    def evaluate(searches: Sequence[_Turns], requests: Sequence[Request]) -> Iterator[Evaluation]:
        for search, request in zip(searches, requests, strict=True):
            done = search.turns * len(EXPERIMENTS) + EXPERIMENTS.index(search.experiment)
            problem = dataclasses.replace(search.gaits, progress=part_of(progress, done, turns))
            with costs.of(search.experiment.name):
                yield evaluate_request(problem, request)

    with ExitStack() as stack:
        searches = [_Turns(settings, experiment, folder, threads, stack) for experiment in EXPERIMENTS]
        run_side_by_side(searches, evaluate, after_round)


class _Turns(FolderSearch):
    """The search of an experiment in its run folder, new or as it was left.

    Attributes:
        experiment: what is searched for.
        gaits: its problem.
        generations: number of the last generation.
    """

    def __init__(
        self, settings: ShapeChange, experiment: Experiment, folder: Path, threads: int | None, stack: ExitStack
    ) -> None:
        """Open the folder, which the stack closes."""
        self.experiment, self.generations = experiment, settings.generations
        self.gaits, method = settings.problem(experiment, threads), settings.method(experiment)
        compute: dict[str, Any] = {"device": self.gaits.device, "precision": self.gaits.precision, "threads": threads}
        about, named = environment(seed=settings.seed, **compute), {"name": "hill-climb", **method}
        config = {"problem": self.gaits.describe(), "method": named, "generations": self.generations}
        run = stack.enter_context(open_run(folder / experiment.name, config, resume=True, environment=about))
        super().__init__(self.gaits, HillClimb(self.gaits.space, **method), run)

    @property
    def done(self) -> bool:
        """Whether all generations are made."""
        return self.turns > self.generations
