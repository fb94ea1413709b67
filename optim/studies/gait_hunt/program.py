"""A program that finds gaits which climb, by itself: many looks, the kinds among them, and the best led uphill.

1. Look: random networks that write cycles of two columns, half of them with an empty core, on a ladder of slopes.
2. Kinds: the best of each kind becomes the start of a search of its own, on the same ladder, since what climbs later is
   seldom the fastest on flat ground. After every round the better half of the kinds goes on ("successive halving":
   Jamieson & Talwalkar, "Non-stochastic best arm identification", Proc. AISTATS 2016).
3. Lead: the best is refined on the slopes that it does not yet climb.
4. Turn: its heading alone, in full, on the steepest slope.
5. Finish: everything, on the steepest slope.

All searches are genetic. What they cost is counted as in the hunt, in robot-steps.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.gait_outcomes import NEXT
from optim.gait_problem import GaitProblem
from optim.gait_start import start_values
from optim.runs.history import History, read_result
from optim.runs.loop import Generation
from optim.studies.gait_hunt.kinds import best_of_kinds
from optim.studies.gait_hunt.searches import CYCLE, STEPPED
from optim.studies.gait_hunt.spending import read_spent, search_within
from optim.studies.results import Progress
from robots.gaits import GaitDesign
from robots.terrain import Terrain

RUNGS = (0.0, 1 / 3, 2 / 3, 1.0)  # of the slope
PATTERNS: Mapping[str, Any] = {**STEPPED, "ladder": True}
GRADED: Mapping[str, Any] = {**CYCLE, "hard": False}


@dataclass(frozen=True)
class Plan:
    """How much the program does in each of its steps.

    Attributes:
        looks: random gaits, with an empty core, and as many with any.
        kept: of the best of either, among which kinds are sought.
        kinds: that get a search of their own.
        population: of these searches.
        rounds: generations of each round of these; the better half of the kinds goes on to the next.
        leads: searches on the slopes that are not climbed yet, one from the other's best.
        headings: that are tried.
        refined: population of these searches, and of the last one.
        generations: of each of these.
    """

    looks: int = 128
    kept: int = 48
    kinds: int = 6
    population: int = 12
    rounds: tuple[int, ...] = (2, 2, 4)
    leads: int = 2
    headings: int = 16
    refined: int = 24
    generations: int = 4

    @property
    def evaluations(self) -> int:
        """Gaits that are judged in all of it, if there are so many kinds."""
        left, found = self.kinds, 2 * self.looks + self.headings
        found += left * self.population  # the starts of their searches
        for more in self.rounds:
            found += left * self.population * more
            left = (left + 1) // 2
        return found + (self.leads + 1) * self.refined * (self.generations + 1)


@dataclass(frozen=True, eq=False)
class Step:
    """A search that the program made.

    Attributes:
        name: of its folder.
        problem: what was searched.
        history: of the run.
        spent: by it [robot-steps].
    """

    name: str
    problem: GaitProblem
    history: History
    spent: float

    @property
    def last(self) -> Generation:
        """Its last generation."""
        return self.history.generations[-1]

    @property
    def score(self) -> float:
        """The best; minus infinity if all failed."""
        return -math.inf if self.last.best is None else self.last.best

    @property
    def speeds(self) -> dict[str, float]:
        """Of the best [body lengths/s], on the terrains that it was tried on, by name."""
        found: dict[str, float] = {}
        for terrain in self.problem.terrains:
            speed = (self.last.best_details or {}).get(f"speed_{terrain.name}")
            if speed is None or any(before <= NEXT for before in found.values()):
                break
            found[terrain.name] = float(speed)
        return found

    @property
    def design(self) -> GaitDesign:
        """The best gait, as long as it was judged; a ValueError in one line if all failed."""
        if self.last.best_point is None:
            raise ValueError(f"{self.history.path}: every gait failed")
        return self.problem.design(self.problem.space.from_dict(self.last.best_point))


@dataclass(eq=False)
class Program:
    """The program for one seed.

    Attributes:
        folder: takes a run folder of every search; what is there is not computed again.
        plan: how much is done.
        seed: of all searches.
        slope: to be climbed in the end [degrees].
        progress: called with the fraction done, which is estimated from the number of gaits.
        where: geometry, precision, device and threads of the simulations.
        steps: made so far.
    """

    folder: Path
    plan: Plan
    seed: int
    slope: float
    progress: Progress = None
    where: Mapping[str, Any] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)

    def run(self) -> Step:
        """All of it; the last step has found what the program has found."""
        plan = self.plan
        best = self._lead(self._halve(self._kinds()))
        gait = replace(self._on((1.0,), GRADED), encoding="graded").in_full()
        full = gait.design(gait.space.from_dict(start_values(gait, best.design)))
        heading = replace(gait, encoding="codes", pressure=full.pressure, schedule=full.schedule)
        turned = self._search("heading", heading, "random", {"climbers": plan.headings}, 0)
        return self._refine("finish", (1.0,), turned.design, plan.refined, plan.generations)

    def _kinds(self) -> list[GaitDesign]:
        """Of random gaits, the best of each kind."""
        plan, points = self.plan, {"population": self.plan.kept, "starts": self.plan.looks}
        designs: list[GaitDesign] = []
        scores: list[float] = []
        for name, pressure in (("look-empty", 0.0), ("look-any", None)):
            step = self._search(name, replace(self._on(RUNGS, PATTERNS), pressure=pressure), "genetic", points, 0)
            if found := read_result(step.history, step.problem):
                designs += [step.problem.design(point) for point in found.points]
                scores += found.scores.tolist()
        body = self._on((1.0,), GRADED).body
        return [designs[n] for n in best_of_kinds(designs, np.array(scores), plan.kinds, body)]

    def _halve(self, designs: Sequence[GaitDesign]) -> Step:
        """The best of searches near each design, of which the worse halves end early."""
        left, generations = list(enumerate(designs)), 0
        if not left:
            raise ValueError(f"{self.folder}: every random gait failed")
        for more in self.plan.rounds:
            generations += more
            found = [
                (self._refine(f"kind-{n + 1}", RUNGS, design, self.plan.population, generations), (n, design))
                for n, design in left
            ]
            found.sort(key=lambda pair: -pair[0].score)
            left = [pair[1] for pair in found[: (len(found) + 1) // 2]]
        return found[0][0]

    def _lead(self, step: Step) -> Step:
        """Search again on the slopes that are not climbed yet, the one before the first of them left behind."""
        for number in range(self.plan.leads):
            names = [terrain.name for terrain in step.problem.terrains]
            ahead = [step.speeds.get(name, 0.0) > NEXT for name in names]
            first = len(RUNGS) - len(names) + next((n for n, enough in enumerate(ahead) if not enough), len(names) - 1)
            step = self._refine(
                f"lead-{number + 1}", RUNGS[first:], step.design, self.plan.refined, self.plan.generations
            )
        return step

    def _refine(
        self, name: str, rungs: Sequence[float], start: GaitDesign, population: int, generations: int
    ) -> Step:  # fmt: skip
        """A genetic search of graded cycles near a gait, on a ladder of these parts of the slope."""
        problem = replace(self._on(rungs, GRADED), ladder=len(rungs) > 1)
        settings = {"population": population, "start": start_values(problem, start)}
        return self._search(name, problem, "genetic", settings, generations)

    def _on(self, rungs: Sequence[float], options: Mapping[str, Any]) -> GaitProblem:
        return GaitProblem(tuple(self._terrain(rung) for rung in rungs), **options, **self.where)

    def _terrain(self, rung: float) -> Terrain:
        return Terrain(rung * self.slope)

    def _search(
        self, name: str, problem: GaitProblem, method: str, settings: Mapping[str, Any], generations: int
    ) -> Step:  # fmt: skip
        """A search up to a generation, which may have been made before."""
        folder, settings, count = self.folder / name, {**settings, "seed": self.seed}, generations + 1
        history = search_within(problem, method, settings, folder, math.inf, None, generations)
        # A run that was begun before may have come further: what counts is what it had found then.
        history = replace(history, generations=history.generations[:count], seconds=history.seconds[:count])
        step = Step(name, problem, history, sum(read_spent(folder)[:count]))
        self.steps = [known for known in self.steps if known.name != name] + [step]
        if self.progress:
            self.progress(min(sum(s.last.evaluations for s in self.steps) / self.plan.evaluations, 1.0))
        return step
