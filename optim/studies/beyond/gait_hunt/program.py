"""A program that finds gaits which climb, by itself: many looks, the kinds among them, and the best led uphill.

1. Look: random networks that write cycles of two columns, half of them with an empty core, on flat ground.
2. Turn: there a robot goes its way whatever its heading, so the best heading is where it goes. With that, the fastest
   are tried on a ladder of slopes.
3. Kinds: the best of each kind ("clearing": Pétrowski, "A clearing procedure as a niching method for genetic
   algorithms", Proc. ICEC 1996) becomes the start of a search of its own on the ladder, since what climbs later is
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
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Several, Whole
from optim.problem import Request
from optim.problems.inflatable.outcomes import HARD
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.generation import Generation
from optim.runs.history import History, read_result
from optim.studies.beyond.gait_hunt.searches import CYCLE, SHORT, STEPPED, cost, first_of, read_spent, search_within
from robots.inflatable import simulation
from robots.inflatable.body import InflatableGeometry
from robots.inflatable.design import InflatableDesign, each_pressure
from robots.inflatable.timing import Counting, predicted_steps
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.results_folder import ResultsFolder

APART = 0.25  # of a full stroke, root mean square over all actuators and columns: gaits closer are one kind
PRESSURE = 12_000.0  # [Pa], which counts as a full stroke of everything


def difference(one: InflatableDesign, other: InflatableDesign, body: InflatableGeometry) -> float:
    """Distance between two gaits of as many columns, 0 to 1, wherever their cycles begin.

    Headings and times do not count: what moves when is the kind. Pressures of the cores count too: the larger of both
    differences is the result.
    """
    first, second = one.schedule.levels, other.schedule.levels
    turned = [np.roll(second, column, axis=1) for column in range(second.shape[1])]
    moves = min(float(np.sqrt(np.mean((first - levels) ** 2))) for levels in turned)
    pressures = [np.array(each_pressure(design.pressure, body)) for design in (one, other)]
    return max(moves, float(abs(pressures[0] - pressures[1]).max()) / PRESSURE)


def best_of_kinds(
    designs: Sequence[InflatableDesign], scores: Floats, count: int, body: InflatableGeometry
) -> list[int]:
    """Indices of the best designs of which none is of the kind of a better one, the best first; scores may be NaN."""
    chosen: list[int] = []
    for number in (int(n) for n in np.argsort(-scores, kind="stable") if np.isfinite(scores[n])):
        if len(chosen) == count:
            break
        if all(difference(designs[number], designs[other], body) >= APART for other in chosen):
            chosen.append(number)
    return chosen


def heading_of(displacement: Floats) -> Floats:
    """The heading, 0 to 90 degrees, along which robots with displacements x and y, shape (..., 2), get furthest."""
    angle = np.rad2deg(np.arctan2(displacement[..., 1], displacement[..., 0]))
    away = np.where(angle < -135.0, angle + 360.0, angle)  # the nearer end of the range is the better one
    return np.asarray(np.clip(away, 0.0, 90.0))


def turned(problem: GaitProblem, designs: Sequence[InflatableDesign], options: Mapping[str, Any]) -> Arrays:
    """Turn N designs to where they go on flat ground, and judge them; ``options`` are those of ``simulate`` there.

    Returns:
        ``points`` of the problem, shape (N, D); ``scores``, shape (N,), NaN of what failed; ``speeds`` on every
        terrain, shape (N, T); ``spent`` [robot-steps] and ``wall_s`` on both simulations.
    """
    started = time.perf_counter()
    flat = simulation.simulate(designs, replace(problem.terrains[0], slope=0.0), **options)
    ok = np.asarray(flat.status) == "ok"
    headings = heading_of(np.where(ok[:, None], flat.displacement, 0.0))
    facing = [replace(design, orientation=float(angle)) for design, angle in zip(designs, headings, strict=True)]
    points = np.array([problem.space.from_dict(problem.start_values(design)) for design in facing])
    judged = problem.evaluate(points)
    looked = sum(predicted_steps(design) for design in designs)
    return {
        "points": points,
        "scores": np.where(ok, judged.objectives[:, 0], np.nan),
        "speeds": np.stack([judged.details[f"speed_{terrain.name}"] for terrain in problem.terrains], axis=1),
        "spent": np.array(looked + cost(problem, Request(points), judged)),
        "wall_s": np.array(time.perf_counter() - started),
    }


def history_of(problem: GaitProblem, found: Arrays, folder: Path) -> History:
    """Present what :func:`turned` found as a run of a single generation."""
    scores, count = found["scores"], len(found["scores"])
    known = np.flatnonzero(np.isfinite(scores))
    value: float | None = None
    point = details = None
    if known.size:
        best = int(known[np.argmax(scores[known])])
        value, point = float(scores[best]), problem.space.to_dict(found["points"][best])
        names = [f"speed_{terrain.name}" for terrain in problem.terrains]
        details = dict(zip(names, found["speeds"][best].tolist(), strict=True))
    last = Generation(0, 2 * count, count - known.size, value, None, None, None, point, details, {})
    return History(folder, {}, (last,), (float(found["wall_s"]),), None, False)


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
    compute: Mapping[str, Any] = field(default_factory=dict)  # geometry, precision, device, threads of simulations
    ground: Terrain = field(default_factory=Terrain)  # level; its friction is that of all slopes
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
        compute = {name: getattr(problem, name) for name in ("precision", "device", "threads")}
        options = {"counting": Counting(LOOK["warm_up"]), "geometry": problem.body, **compute}
        folder = ResultsFolder(self.folder / "turn", "turn", settings)
        each, spent = Allowed((len(designs),), failed=np.nan), Allowed((), 0.0)
        speeds = Allowed((len(designs), len(problem.terrains)), failed=np.nan)
        allowed = {"points": Allowed((len(designs), problem.space.size)), "scores": each, "speeds": speeds}
        check = partial(check_arrays, {**allowed, "spent": spent, "wall_s": spent})
        known = cached(folder, "turn", lambda: turned(problem, designs, options), check)
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
        return GaitProblem(
            tuple(replace(self.ground, slope=rung * self.slope) for rung in rungs), **options, **self.compute
        )

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
