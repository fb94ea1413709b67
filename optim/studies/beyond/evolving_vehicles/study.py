"""The study: vehicles that evolve by what drawn controllers do in them, and vehicles that evolve while they learn.

Source: dissertation, chapters 3, 4 and 6, which name resistance to catastrophic interference as an objective for bodies
and ask for bodies and controllers that are optimised together. Two loops: Whitley, Gordon & Mathias, Proc. PPSN 1994.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, write_records
from optim.studies.beyond.body_and_learning.learning import LEARNERS, learn_until, learned_cells
from optim.studies.beyond.evolving_vehicles.bodies import BOUND, drawn_body, exact, problem_of, tried
from optim.studies.beyond.evolving_vehicles.report import ARMS, BODIES, COLUMNS, LEARNED, LOOPED, PICTURE, write_report
from optim.studies.beyond.evolving_vehicles.searches import LOOPS, MARKS, OBJECTIVES, BodyProblem, evolve, loop
from robots.robot import part_of
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import positive
from taichi_sim.base.results_folder import ResultsFolder

NAME = "evolving-vehicles"


@dataclass(frozen=True)
class EvolvingVehicles(Settings):
    """How vehicles evolve, how they are judged, and how long loops are.

    Attributes:
        seeds: runs of everything.
        population, generations: of the evolution of bodies by objectives.
        controllers: drawn, in which each body is judged there.
        weights: values of each weight on the grid of controllers that judges what evolution ends with.
        budget: evaluations of learning in that body; with gradients a quarter of them.
        repetitions: of learning.
        pairs: population of the loops over body and controller.
        life: steps along gradients in the inner loop.
        loop_budget: evaluations of a loop, those with gradients counted at their ``price``.
        price: of an evaluation with its gradient, in those without; it took 2.0 to 2.3 of their time when measured.
    """

    seeds: Count = 10
    population: Several = 12
    generations: Count = 11
    controllers: Count = 64
    weights: Several = 121
    budget: Several = 128
    repetitions: Count = 5
    pairs: Several = 6
    life: Count = 5
    loop_budget: Several = 500
    price: Annotated[float, positive] = 2.5


@dataclass(frozen=True)
class Part:
    """All of one seed: a part of the study that is kept by itself."""

    folder: Path
    settings: EvolvingVehicles
    seed: int

    def __call__(self, _: Mapping[str, Any], progress: Progress) -> tuple[list[Record], list[Record]]:
        """Do what is not done yet; rows of evolved bodies, and of loops."""
        about = {"seed": self.seed, **self.settings.lasting("seeds")}
        kept = ResultsFolder(self.folder / "parts" / f"{self.seed}", "seed", about)
        arms, steps = ("random", *OBJECTIVES), 1 + len(OBJECTIVES) + len(LOOPS)
        bodies: list[Record] = []
        for number, arm in enumerate(arms):
            bodies.append(self._evolved(kept, arm, part_of(progress, number, steps)))
        looped: list[Record] = []
        for number, arm in enumerate(LOOPS, len(arms)):
            told, how = part_of(progress, number, steps), self.settings
            run = partial(loop, arm, how.pairs, how.life, how.loop_budget, how.price, self.seed, told)
            found = cached(kept, f"loop_{arm}", partial(_timed, run), partial(check_loop, how.loop_budget))
            for cost, best in zip(found["costs"].tolist(), found["best"].tolist(), strict=True):
                row = {"arm": arm, "seed": self.seed, "evaluations": cost}
                known = best if np.isfinite(best) else None  # nothing yet
                looped.append({**row, "best": known, "seconds": float(found["seconds"])})
        return bodies, looped

    def _evolved(self, kept: ResultsFolder, arm: str, progress: Progress) -> Record:
        """Evolve a body by some objectives, or draw one, judge it by others, and learn in it."""
        settings, told = self.settings, partial(part_of, progress, count=2 + len(LEARNED))
        if arm == "random":
            found: Arrays = {"body": drawn_body(self.seed)}
        else:
            problem = BodyProblem(OBJECTIVES[arm], settings.controllers, self.seed)
            search = partial(evolve, problem, settings.population, settings.generations, told(0))
            ranges = Allowed((problem.space.size,), float(problem.space.low.min()), float(problem.space.high.max()))
            found = cached(kept, f"evolved_{arm}", search, partial(check_arrays, {"body": ranges}))
        body = found["body"]
        judged = cached(kept, f"judged_{arm}", partial(self._judge, body), check_judged)
        names = ("body", "M_L", "M_CI", "performance", "seen_M_L", "seen_M_CI")
        values = (body.astype(int).tolist(), *(float(judged[name]) for name in names[1:]))
        row: dict[str, Any] = {"arm": arm, "seed": self.seed}
        row |= zip(names, values, strict=True)
        for number, name in enumerate(LEARNED, 2):
            learner = LEARNERS[name]
            budget = learner.evaluations(settings.budget)
            seeds = [int(n) for n in np.random.SeedSequence((self.seed, 5)).generate_state(settings.repetitions)]
            run = partial(learn_until, problem_of(body), -BOUND, learner, budget, seeds, told(number))
            row |= learned_cells(kept, f"learned_{arm}_{name}", name, settings.repetitions, settings.budget, run)
        return row

    def _judge(self, body: Floats) -> Arrays:
        """Exact metrics of a body; performance and metrics with the controllers that a search of the seed draws."""
        learnability, resistance = exact(body, self.settings.weights)
        seen, performance = tried(body, self.settings.controllers, self.seed)
        values = {"M_L": learnability, "M_CI": resistance, "performance": performance}
        values |= {"seen_M_L": seen.learnability.value, "seen_M_CI": seen.resistance.value}
        return {name: np.array(value) for name, value in values.items()}


def check_judged(arrays: Arrays) -> None:
    """Refuse a file that does not hold the metrics and the performance of a body, by a ValueError."""
    shares = dict.fromkeys(("M_L", "M_CI", "seen_M_L", "seen_M_CI"), Allowed((), 0.0, 1.0, failed=np.nan))
    check_arrays({**shares, "performance": Allowed((), failed=np.nan)}, arrays)


def check_loop(budget: float, arrays: Arrays) -> None:
    """Refuse a file that holds no course of a loop of this budget, see ``searches.loop``, by a ValueError."""
    best = Allowed((MARKS,), failed=-np.inf)  # nothing yet
    check_arrays({"costs": Allowed((MARKS,), 0.0, budget), "best": best, "seconds": Allowed((), 0.0)}, arrays)


def _timed(run: Callable[[], Arrays]) -> Arrays:
    """What a run gives, and its CPU time [s]."""
    begun = time.process_time()
    return {**run(), "seconds": np.array(time.process_time() - begun)}


def study(folder: Path, settings: EvolvingVehicles, progress: Progress = None, jobs: int = 1) -> None:
    """Write a row for each evolved body and each mark of a loop, tables and a picture; seeds that are whole stay."""
    ResultsFolder(folder, NAME, settings.lasting("seeds"))
    parts = [(f"seed {seed}", Part(folder, settings, seed)) for seed in range(settings.seeds)]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
    bodies: list[Record] = []
    loops: list[Record] = []
    for number, (_, part) in enumerate(parts):
        evolved, looped = part({}, progress and part_of(progress, number, len(parts)))
        bodies, loops = bodies + evolved, loops + looped
        write_records(folder / BODIES, bodies)  # what there is so far is of use
        write_records(folder / LOOPED, loops)
    write_report(folder, bodies, loops, settings.describe())


def rewrite(data: Data, folder: Path) -> None:
    """Write tables and the picture from the rows of bodies and loops."""
    counts = dict.fromkeys(("seed", *(f"{name}_solved" for name in LEARNED)), int)
    bodies = data.records(BODIES, {"arm": tuple(ARMS), **counts, **dict.fromkeys(COLUMNS, float)}, "arm")
    numbers = {"evaluations": float, "best": float | None, "seconds": float}  # at first there is no best
    loops = data.records(LOOPED, {"arm": tuple(LOOPS), "seed": int, **numbers}, "arm")
    write_report(folder, bodies, loops, data.settings(EvolvingVehicles).describe())


STUDY = Study(
    title="vehicles that evolve so that controllers are easily learned in them, and that evolve while they learn",
    source="chapters 3, 4 and 6, which ask for M_CI as an objective of bodies",
    scales={
        "small": EvolvingVehicles(2, 4, 1, 8, 5, 8, 1, 2, 1, 8),
        "medium": EvolvingVehicles(),
        "full": EvolvingVehicles(30, 32, 30, 256, 121, 256, 10, 16, 8, 5000),
    },
    run=study,
    rewrite=rewrite,
    writes=(BODIES, LOOPED, "table.md", "summary.json", PICTURE),
    cost="about 8 hours of a core",
)
