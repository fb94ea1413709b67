"""A program that finds gaits which climb, by itself: many looks, the kinds among them, and the best led uphill.

1. Look: random networks that write cycles of two columns, half of them with an empty core, on flat ground.
2. Turn: there a robot goes its way whatever its heading, so the best heading is where it goes. With that, the fastest
   are tried on a ladder of slopes.
3. Kinds: the best of each kind becomes the start of a search of its own on the ladder, since what climbs later is
   seldom what is ahead now. After every round the better half of the kinds goes on ("successive halving": Jamieson &
   Talwalkar, "Non-stochastic best arm identification", Proc. AISTATS 2016).
4. Lead: near the best, by the mean speed on an easier slope and on the steepest, the easier one ever steeper. On a
   ladder, a gait that is tried on the next slope and slides down it loses to one that is not tried; here all are, and
   what makes it faster where it climbs pays for what it still slides elsewhere. Near a gait that climbs, the mean no
   longer leads to those that roll.
5. Heading: that alone, in full, on the steepest slope.
6. Finish: everything, on the steepest slope.
7. Firm: the same under the harder conditions of ``robustness``, too. Before, they would be in the way: hardly any
   gait that has still to learn to climb stands them.

Searches are genetic up to the kinds; where few numbers have to fit together, from the leads on, they are CMA-ES. What
they cost is counted as in the hunt, in robot-steps.
"""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Several, Whole
from optim.problems.inflatable.problem import HARD, GaitProblem
from optim.runs.generation import Generation
from optim.runs.history import History, read_result
from optim.studies.beyond.gait_hunt.kinds import best_of_kinds, history_of, turned
from optim.studies.beyond.gait_hunt.searches import CYCLE, SHORT, STEPPED, first_of, read_spent, search_within
from robots.inflatable.design import InflatableDesign
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.results_folder import ResultsFolder

RUNGS = (0.0, 1 / 3, 2 / 3, 1.0)  # of the slope
# A look lasts until a cycle counts, and is along the middle of all headings: who goes that way goes well along its own.
LOOK: Mapping[str, Any] = {**STEPPED, "steps": SHORT // 2, "stages": 1}
MIDDLE = 45.0  # degrees
# First deviations of CMA-ES near a gait [ranges]: with 0.3 nothing of it is left; in the end it is to stay what it is.
SIGMA, FIRM_SIGMA = 0.05, 0.02
GRADED: Mapping[str, Any] = {**CYCLE, "hard": False}  # the harder conditions are for what climbs


def check_rounds(name: str, rounds: Sequence[int]) -> tuple[int, ...]:
    """Return generations of rounds; raises ValueError for none, or negative ones."""
    if not rounds:
        raise ValueError(f"{name}: none given; give the generations of at least one")
    return tuple(checks.integer(name, generations, 0) for generations in rounds)


def check_parts(name: str, parts: Sequence[float]) -> tuple[float, ...]:
    """Return parts of the slope; raises ValueError for others than from 0 to 1."""
    return tuple(checks.number(name, part, 0.0, 1.0) for part in parts)


@dataclass(frozen=True)
class Plan(Settings):
    """How much the program does in each of its steps."""

    looks: Several = 192  # random gaits, with an empty core, and as many with any
    kept: Count = 32  # of the best of either, which are turned, and among which kinds are sought
    kinds: Count = 4  # that get a search of their own
    population: Several = 12  # of these searches
    rounds: Annotated[tuple[int, ...], check_rounds] = (2, 2, 4)  # generations; the better half goes on to the next
    # parts of the slope whose speed counts beside that on all of it, a search each, one from the other's best
    leads: Annotated[tuple[float, ...], check_parts] = (0.0, 2 / 3)
    headings: Several = 16  # near that of the best that are tried
    refined: Several = 16  # population of the searches that lead, and of the last two
    generations: Whole = 20  # of each of these

    @property
    def evaluations(self) -> int:
        """Gaits that are judged in all of it, if there are so many kinds."""
        left, found = self.kinds, 2 * self.looks + 4 * self.kept + self.headings  # who is kept is judged twice more
        found += left * self.population  # the starts of their searches
        for more in self.rounds:
            found += left * self.population * more
            left = (left + 1) // 2
        return found + (len(self.leads) + 2) * (1 + self.refined * (self.generations + 1))


class NothingFound(Exception):
    """Every gait of a step failed."""


@dataclass(frozen=True, eq=False)
class Step:
    """A search that the program made."""

    name: str  # of its folder
    problem: GaitProblem  # what was searched
    history: History  # of the run
    spent: float  # by it [robot-steps]

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
        """Speeds of the best gait [body lengths/s] on the terrains that it was tried on, by name."""
        found: dict[str, float] = {}
        for terrain in self.problem.terrains:
            speed = (self.last.best_details or {}).get(f"speed_{terrain.name}")
            if speed is None or (self.problem.ladder and any(one <= self.problem.ahead for one in found.values())):
                break
            found[terrain.name] = float(speed)
        return found

    @property
    def hard_speeds(self) -> list[float]:
        """The same under the harder conditions; empty if it was not tried there."""
        details = self.last.best_details or {}
        names = [f"speed_{terrain.name}{HARD}" for terrain in self.problem.terrains]
        return [details[name] for name in names if name in details]

    @property
    def design(self) -> InflatableDesign:
        """The best gait, as long as it was judged; raises ``NothingFound`` if all failed."""
        if self.last.best_point is None:
            raise NothingFound
        return self.problem.design(self.problem.space.from_dict(self.last.best_point))


@dataclass(eq=False)
class Program:
    """The program for one seed."""

    folder: Path  # takes a run folder of every search; what is there is not computed again
    plan: Plan  # how much is done
    seed: int  # of all searches
    slope: float  # to be climbed in the end [degrees]
    progress: Progress = None  # called with the fraction done, which is estimated from the number of gaits
    where: Mapping[str, Any] = field(default_factory=dict)  # geometry, precision, device and threads of the simulations
    steps: dict[str, Step] = field(default_factory=dict)  # made so far, by name, in the order in which they began

    def run(self) -> tuple[Step, ...]:
        """Run all steps; return the last three, any of which may hold the best. None if all gaits of a step failed."""
        try:
            facing = self._face(self._lead(self._halve(self._kinds()).design))
            finish = self._refine("finish", (1.0,), facing.design)
            return facing, finish, self._refine("firm", (1.0,), finish.design, firm=True)
        except NothingFound:
            return ()

    def _kinds(self) -> list[InflatableDesign]:
        """The best of each kind among random gaits, turned to where they go."""
        points = {"population": self.plan.kept, "starts": self.plan.looks, "seed": self.seed}
        found: list[InflatableDesign] = []
        for name, pressure in (("look-empty", 0.0), ("look-any", None)):
            problem = replace(self._on((0.0,), LOOK), orientation=MIDDLE, pressure=pressure)
            step = self._search(name, problem, points, 0)
            if best := read_result(step.history, step.problem):
                found += [problem.design(point) for point in best.points]
        return self._turn(found)

    def _turn(self, designs: Sequence[InflatableDesign]) -> list[InflatableDesign]:
        """Designs with headings where they go on flat ground; of each kind the best on the ladder."""
        problem = replace(self._on(RUNGS, GRADED), ladder=True)
        settings = {"seed": self.seed, "looks": self.plan.looks, "kept": self.plan.kept, "problem": problem.describe()}
        where = {name: getattr(problem, name) for name in ("precision", "device", "threads")}
        options = {"warm_up": LOOK["warm_up"], "geometry": problem.body, **where}
        folder = ResultsFolder(self.folder / "turn", "turn", settings)
        known = cached(folder, "turn", lambda: turned(problem, designs, options))
        self._note(Step("turn", problem, history_of(problem, known, self.folder / "turn"), float(known["spent"])))
        facing = [problem.design(point) for point in known["points"]]
        chosen = best_of_kinds(facing, known["scores"], self.plan.kinds, problem.body)
        return [facing[number] for number in chosen]

    def _halve(self, designs: Sequence[InflatableDesign]) -> Step:
        """The best of searches near each design, of which the worse halves end early."""
        left, generations = list(enumerate(designs)), 0
        ladder = replace(self._on(RUNGS, GRADED), ladder=True)
        if not left:
            raise NothingFound
        for more in self.plan.rounds:
            generations += more
            size: Any = {"generations": generations, "method": "genetic", "population": self.plan.population}
            found = [(self._near(f"kind-{n + 1}", ladder, design, **size), (n, design)) for n, design in left]
            found.sort(key=lambda pair: -pair[0].score)
            left = [pair[1] for pair in found[: (len(found) + 1) // 2]]
        return found[0][0]

    def _lead(self, design: InflatableDesign) -> InflatableDesign:
        """Searches by the mean of an easier slope and the steepest, one from the other's best."""
        for number, part in enumerate(self.plan.leads):
            design = self._refine(f"lead-{number + 1}", (part, 1.0), design).design
        return design

    def _face(self, design: InflatableDesign) -> Step:
        """A gait with the best of some headings near its own, in full on the steepest slope."""
        gait = self._on((1.0,), GRADED).in_full()
        full = gait.design(gait.space.from_dict(gait.start_values(design)))
        problem = replace(gait, pressure=full.pressure, schedule=full.schedule)
        return self._near("heading", problem, full, 0, "genetic", population=self.plan.headings)

    def _refine(self, name: str, rungs: Sequence[float], start: InflatableDesign, firm: bool = False) -> Step:
        """CMA-ES of graded cycles close to a gait, by the mean speed on these parts of the slope.

        If ``firm``, the harder conditions count, too, and the search stays closer.
        """
        options, sigma = (CYCLE, FIRM_SIGMA) if firm else (GRADED, SIGMA)
        own = {"population": self.plan.refined, "sigma": sigma}
        return self._near(name, self._on(rungs, options), start, self.plan.generations, "cma", **own)

    def _near(
        self, name: str, problem: GaitProblem, start: InflatableDesign, generations: int, method: str, **settings: Any
    ) -> Step:
        """A search near a gait; with the numbers of another search it would try the same directions."""
        stream = np.random.SeedSequence([self.seed, zlib.crc32(name.encode())]).generate_state(1)
        settings |= {"start": problem.start_values(start), "seed": int(stream[0])}
        return self._search(name, problem, settings, generations, method)

    def _on(self, rungs: Sequence[float], options: Mapping[str, Any]) -> GaitProblem:
        return GaitProblem(tuple(Terrain(rung * self.slope) for rung in rungs), **options, **self.where)

    def _search(
        self, name: str, problem: GaitProblem, settings: Mapping[str, Any], generations: int, method: str = "genetic"
    ) -> Step:
        """A search up to a generation, which may have been made before."""
        folder, count = self.folder / name, generations + 1
        history = search_within(problem, method, settings, folder, math.inf, None, generations)
        # A run that was begun before may have come further: what counts is what it had found then.
        return self._note(Step(name, problem, first_of(history, count), sum(read_spent(folder)[:count])))

    def _note(self, step: Step) -> Step:
        """Remember a step, or that it has come further."""
        self.steps[step.name] = step
        if self.progress:
            self.progress(min(sum(s.last.evaluations for s in self.steps.values()) / self.plan.evaluations, 1.0))
        return step
