"""The study: are bodies better learners if evolution asks for resistance to interference, and what do two loops gain?

Source: dissertation, chapters 4 and 6, which evolve bodies of vehicles for M_CI and ask for complex robots.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from optim.experiments.data import Data, Kind
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, write_records
from optim.studies.beyond.body_and_learning.learning import LEARNERS
from optim.studies.beyond.body_and_learning.study import BodyAndLearning
from optim.studies.beyond.evolving_bodies.loops import ARMS as SEARCHES
from optim.studies.beyond.evolving_bodies.loops import TABLE as LOOPS_TABLE
from optim.studies.beyond.evolving_bodies.loops import Loops, run_loops
from optim.studies.beyond.evolving_bodies.metrics import ARMS, Evolving, arm_part
from optim.studies.beyond.evolving_bodies.report import BODY_COLUMNS, write_report
from robots.robot import part_of
from taichi_sim.base.checks import positive
from taichi_sim.base.results_folder import ResultsFolder

NAME, TABLE = "evolving-bodies", "bodies.csv"


@dataclass(frozen=True)
class EvolvingBodies(Settings):
    """How bodies evolve, how they are measured, and how long loops search.

    Attributes:
        seeds: runs of each arm.
        population, generations: of the evolution of bodies for their metrics, generation 0 included.
        controllers: drawn in each body for that.
        held_out: others, drawn in the body that a run chooses.
        repetitions: of each kind of learning in that body.
        budget: evaluations of a repetition, each in all worlds; of one with gradients a quarter of them.
        nearer: success: how much nearer the light a controller has to come in every world [m].
        seconds: of CPU time of a search with one loop or two.
        cycles: of a trial.
    """

    seeds: Several = 5
    population: Several = 6
    generations: Count = 4
    controllers: Count = 24
    held_out: Count = 128
    repetitions: Count = 2
    budget: Several = 64
    nearer: Annotated[float, positive] = 0.01
    seconds: Annotated[float, positive] = 240.0  # some eight lives of all members
    cycles: Count = 3

    @property
    def evolving(self) -> Evolving:
        """Settings of the evolution for metrics."""
        learning = BodyAndLearning(
            repetitions=self.repetitions, budget=self.budget, nearer=self.nearer, cycles=self.cycles
        )
        return Evolving(self.population, self.generations, self.controllers, self.held_out, learning)


def study(folder: Path, settings: EvolvingBodies, progress: Progress = None, jobs: int = 1) -> None:
    """Write a row for each evolved body and each search, and a report; what is whole is not done again."""
    ResultsFolder(folder, NAME, settings.lasting("seeds"))
    runs = [(arm, seed) for seed in range(settings.seeds) for arm in ARMS]
    parts = [(f"{arm}, seed {seed}", partial(arm_part, folder, settings.evolving, arm, seed)) for arm, seed in runs]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 2))
    rows: list[Record] = []
    for number, (_, part) in enumerate(parts):
        rows.append(part({}, progress and part_of(progress, number, 2 * len(parts))))
        write_records(folder / TABLE, rows)  # what there is so far is of use
    write_report(folder, rows, [], settings.describe())  # before the searches, which take as long
    loops = Loops(settings.seconds, settings.seeds, settings.cycles)
    found = run_loops(folder, loops, progress and part_of(progress, 1, 2), jobs)
    write_report(folder, rows, found, settings.describe())


def rewrite(data: Data, folder: Path) -> None:
    """Write the report from the rows of bodies and loops."""
    counts = dict.fromkeys(("seed", *(f"{name}_solved" for name in LEARNERS)), int)
    bodies = data.records(TABLE, {"arm": tuple(ARMS), **counts, **dict.fromkeys(BODY_COLUMNS, float)}, "arm")
    about = {**dict.fromkeys(("seed", "evaluations"), int), "nearer": float | None}
    columns: dict[str, Kind] = {"search": tuple(SEARCHES), **about}
    loops = data.records(LOOPS_TABLE, columns) if data.has(LOOPS_TABLE) else []
    write_report(folder, bodies, loops, data.settings(EvolvingBodies).describe())


STUDY = Study(
    title="bodies that evolve for learning, and evolution and learning in two loops",
    source="chapters 4 and 6, which evolve bodies of vehicles for M_CI",
    scales={
        "small": EvolvingBodies(
            seeds=2,
            population=4,
            generations=1,
            controllers=4,
            held_out=8,
            repetitions=1,
            budget=4,
            seconds=1.0,
            cycles=1,
        ),
        "medium": EvolvingBodies(),
        "full": EvolvingBodies(
            seeds=10,
            population=16,
            generations=12,
            controllers=256,
            held_out=1024,
            repetitions=5,
            budget=256,
            seconds=600.0,
        ),
    },
    run=study,
    rewrite=rewrite,
    writes=(TABLE, LOOPS_TABLE, "table.md", "summary.json", "evolving.png"),
    cost="about a day of a core",
)
