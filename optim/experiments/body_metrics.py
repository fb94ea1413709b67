"""What a body does to learning, for any robot: sampled controllers tried in several environments.

Of a robot whose body is fixed, all that is free is its controller. Controllers that are drawn or lie on a grid tell M_L
and M_CI; climbers that mutate them tell M1 to M4 of chapter 2; what those that succeed everywhere feel tells how alike
environments look (homeostasis).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain, pairwise
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Whole
from optim.measures import homeostasis
from optim.measures.catastrophic_interference import RunMeasures, SeveralRuns, measure_run
from optim.measures.sampled import SampledMetrics, sampled_metrics
from optim.measures.statistics import mean_interval
from optim.space import Space
from robots.robot import Robot, Trial, World, part_of
from robots.tasks import Success, check_success
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.checks import within
from taichi_sim.base.compute import Compute
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.base.short_text import ShortText
from taichi_sim.signals import warping_distances

MEASURABLE = "pouch, feeling-quadruped, legged or vehicle"  # robots of which something is free
AT_ONCE = 256  # controllers that are tried together, and kept together
GENERATIONS_AT_ONCE = 10
MOST_ON_GRID = 2_000_000
FELT_BY = 20  # controllers whose senses are compared, at most
SAMPLES = 500  # of what they feel in a trial


@dataclass(frozen=True)
class Measuring(Settings):
    """How a body is measured.

    Attributes:
        controllers: drawn at random from the whole space.
        grid: values of each variable on a grid of all controllers, from its lowest to its highest, instead; 0 for none.
        climbers: that mutate controllers, for M1 to M4; 0 for none.
        generations: of their mutations.
        seed: of all that is drawn.
        runs: of the climbers, independent of each other. The first are the same however many there are.
    """

    controllers: Count = 1000
    grid: Whole = 0
    climbers: Whole = 0
    generations: Count = 50
    seed: Whole = 0
    runs: Count = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.grid == 1:
            raise ValueError(f"grid: {self.grid} is not allowed; give at least 2 values, or 0 for none")
        if self.runs > 1 and not self.climbers:
            raise ValueError(
                f"runs: {self.runs} is not allowed without climbers, which alone it repeats; give climbers"
            )


@dataclass(frozen=True)
class Environments:
    """Where a robot is tried, and what has to be kept in each.

    Attributes:
        worlds: E of them, at least 1.
        success: bounds in each, (E,) sets of at least one; the first measures how far a controller is from success.
    """

    worlds: tuple[World, ...]
    success: tuple[tuple[Success, ...], ...]

    def __post_init__(self) -> None:
        if not self.worlds or len(self.success) != len(self.worlds) or not all(self.success):
            raise ValueError(f"success: {len(self.success)} sets of bounds do not fit {len(self.worlds)} environments")


@dataclass(frozen=True, eq=False, repr=False)
class BodyMetrics(ShortText):
    """What was measured of a body.

    Attributes:
        succeeded: which controllers succeeded where, shape (N, E).
        sampled: M_L, M_CI.
        mutations: M1 to M4 of each run of the climbers, and their means; distances are margins below the bounds, in
            bounds, or in the measure's unit where the bound is 0. None without climbers.
        felt: mean warping distance between what controllers that succeed everywhere feel in two environments, with its
            95 % interval, and how many these were; None if none does, or the robot feels nothing.
    """

    succeeded: Bools
    sampled: SampledMetrics
    mutations: SeveralRuns | None = None
    felt: tuple[float, float, float, int] | None = None

    def document(self) -> dict[str, Any]:
        """All of it but single controllers, fit for JSON; what none was counted of is null."""
        felt = (
            None if self.felt is None else dict(zip(("distance", "low", "high", "controllers"), self.felt, strict=True))
        )
        mutations = None
        if self.mutations is not None:
            mutations = {**asdict(self.mutations), "changes": self.mutations.changes}
            for run in mutations["runs"]:
                run.update({name: None for name, value in run.items() if value != value})
        sampled = asdict(self.sampled)
        for share in (sampled["learnability"], sampled["resistance"], *sampled["each"]):
            if not share["of"]:
                share.update(value=None, low=None, high=None)
        return {**sampled, "mutations": mutations, "felt": felt}


def controllers_of(space: Space, settings: Measuring) -> list[Floats]:
    """All controllers that are tried, in parts of ``AT_ONCE`` and fewer.

    Raises:
        ValueError: for a grid that is too large, or of variables that have no values between their bounds.
    """
    if not settings.grid:
        counts = [min(AT_ONCE, settings.controllers - first) for first in range(0, settings.controllers, AT_ONCE)]
        return [space.sample(np.random.default_rng((settings.seed, n)), count) for n, count in enumerate(counts)]
    if settings.grid**space.size > MOST_ON_GRID:
        raise ValueError(
            f"grid: {settings.grid} values of {space.size} variables are too many; leave it out, and draw --controllers"
        )
    axes = [np.linspace(low, high, settings.grid) for low, high in zip(space.low, space.high, strict=True)]
    every = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, space.size)
    return np.split(space.validate(every), range(16 * AT_ONCE, len(every), 16 * AT_ONCE))


def felt_by(points: Floats, settings: Measuring) -> Floats:
    """The first ``FELT_BY`` of the points; of a grid, where these are side by side, that many drawn by the seed."""
    if not settings.grid or len(points) <= FELT_BY:
        return points[:FELT_BY]
    random = np.random.default_rng((settings.seed, 0, 3))
    return points[np.sort(random.choice(len(points), FELT_BY, replace=False))]


def measure_body(
    robot: Robot,
    environments: Environments,
    settings: Measuring,
    compute: Compute,
    folder: ResultsFolder | None = None,
    progress: Progress = None,
) -> BodyMetrics:
    """Measure a body; a folder keeps what is done, so that a kill loses one part at most.

    Raises:
        ValueError: if nothing of the robot is free, or it lacks a measure that a bound is about.
    """
    space = Space.of_parameters(robot.parameters)
    check_bounds(robot, environments)
    tries = Tries(robot, environments, compute)
    parts = controllers_of(space, settings)
    runs = range(settings.runs if settings.climbers else 0)
    steps = len(parts) + len(runs)
    solved = []
    for number, points in enumerate(parts):
        told = part_of(progress, number, steps)
        check = partial(check_succeeded, len(points), len(environments.worlds))
        part = cached(folder, f"controllers{number}", partial(tries.successes, points, told), check)
        solved.append(part["succeeded"])
    succeeded = np.concatenate(solved).astype(bool)
    climbed = [
        _climb(Climb(space, tries, settings, run), folder, part_of(progress, len(parts) + run, steps)) for run in runs
    ]
    everywhere = felt_by(np.concatenate(parts)[succeeded.all(axis=1)], settings)
    distances = partial(check_arrays, {"distance": Allowed(("N",), 0.0)})
    name = "felt_of_grid" if settings.grid else "felt"  # before, the file of a grid was of its corner
    felt = cached(folder, name, partial(tries.felt, everywhere), distances)["distance"]
    interval = (float(felt.mean()), *mean_interval(felt), len(felt)) if len(felt) > 1 else None
    return BodyMetrics(succeeded, sampled_metrics(succeeded), SeveralRuns.of(climbed) if climbed else None, interval)


def check_succeeded(controllers: int, environments: int, arrays: Arrays) -> None:
    """Refuse a file that does not tell of each controller whether it succeeds in each environment, by a ValueError."""
    if (shape := arrays["succeeded"].shape) != (controllers, environments):
        raise ValueError(f"succeeded: shape {shape} is not allowed; give ({controllers}, {environments})")
    within("succeeded", arrays["succeeded"], 0, 1)


def check_bounds(robot: Robot, environments: Environments) -> None:
    """Refuse a robot of which nothing is free, and bounds on what it has no measure of.

    Raises:
        ValueError: that names it.
    """
    if not robot.parameters:
        raise ValueError(
            f"robot: nothing of {robot.name} is free, so it has no controllers to try; give one that has, such "
            f"as {MEASURABLE}, or a run, with --hold for what is no controller"
        )
    check_success(chain.from_iterable(environments.success), robot, environments.worlds)


@dataclass(frozen=True, eq=False)
class Tries:
    """Controllers tried in all environments."""

    robot: Robot
    environments: Environments
    compute: Compute

    def outcomes(self, points: Floats, progress: Progress = None) -> Any:
        """Outcomes of controllers in each environment."""
        trial = Trial(self.environments.worlds[0], self.compute, progress=progress)
        return self.robot.run_in(self.robot.points(points), self.environments.worlds, trial)

    def successes(self, points: Floats, progress: Progress = None) -> Arrays:
        """Which of them keep all bounds of each environment, ``succeeded``, shape (N, E)."""
        found = zip(self.outcomes(points, progress), self.environments.success, strict=True)
        kept = [np.all([bound.kept(outcome) for bound in bounds], axis=0) for outcome, bounds in found]
        return {"succeeded": np.stack(kept, axis=1)}

    def shortfalls(self, points: Floats) -> Floats:
        """How far each is from the first bound of each environment, shape (N, E); NaN where it failed.

        In bounds, or where the bound is 0, in the unit of its measure.
        """
        found = []
        for outcome, (bound, *_) in zip(self.outcomes(points), self.environments.success, strict=True):
            sign = 1.0 if bound.sign == ">=" else -1.0
            value = np.asarray(outcome.measures[bound.measure], float)
            short = sign * (bound.bound - value) / (abs(bound.bound) or 1.0)
            found.append(np.where(np.asarray(outcome.status) == "ok", short, np.nan))
        return np.stack(found, axis=1)

    def felt(self, points: Floats) -> Arrays:
        """Mean warping distance of what each feels in every two environments, ``distance``; none without senses."""
        worlds = self.environments.worlds
        if len(worlds) < 2 or not len(points) or not self.robot.feels:
            return {"distance": np.zeros(0)}
        signals = np.stack([self.robot.readings(points, world, SAMPLES, self.compute) for world in worlds], axis=1)
        threads = self.compute.threads
        distance = homeostasis(signals, partial(warping_distances, normalise=False, threads=threads))
        return {"distance": distance[np.isfinite(distance)]}


@dataclass(frozen=True, eq=False)
class Climb:
    """A run of climbers that keep a mutation if their worst environment becomes better, as in chapter 2."""

    space: Space
    tries: Tries
    settings: Measuring
    run: int

    def name(self, generation: int) -> str:
        """What the folder calls the part that ends there; the first run's are named as when it was the only one."""
        return f"run{self.run}climb{generation}" if self.run else f"climb{generation}"

    def random(self, *of: int) -> np.random.Generator:
        """Random numbers of this run alone; those of the first are as when it was the only one."""
        return np.random.default_rng((self.settings.seed, *of, self.run) if self.run else (self.settings.seed, *of))

    def first(self) -> Arrays:
        """Climbers at their start."""
        points = self.space.sample(self.random(0, 1), self.settings.climbers)
        short = self.tries.shortfalls(points)
        return {"points": points, "short": short, "climber": np.arange(self.settings.climbers), "distance": short}

    def check(self, arrays: Arrays) -> None:
        """Refuse a file that holds no climbers of this run and the mutations that they kept, by a ValueError."""
        climbers, environments = self.settings.climbers, len(self.tries.environments.worlds)
        points = Allowed((climbers, self.space.size), float(self.space.low.min()), float(self.space.high.max()))
        short = Allowed((climbers, environments), failed=np.nan)
        climber, distance = Allowed(("N",), 0, climbers - 1, kind="i"), Allowed(("N", environments), failed=np.nan)
        check_arrays({"points": points, "short": short, "climber": climber, "distance": distance}, arrays)

    def generations(self, state: Arrays, numbers: Sequence[int]) -> Arrays:
        """Climbers after some generations, with the mutations that they kept."""
        points, short = state["points"].copy(), state["short"].copy()
        climber, distance = [np.zeros(0, int)], [np.zeros((0, short.shape[1]))]
        for number in numbers:
            steps = self.random(number, 2).normal(size=points.shape) * self.space.step
            children = self.space.round(self.space.reflect(points + steps))
            found = self.tries.shortfalls(children)
            better = _worst(found) < _worst(short)
            points[better], short[better] = children[better], found[better]
            climber.append(np.flatnonzero(better))
            distance.append(found[better])
        ends = {"climber": np.concatenate(climber), "distance": np.concatenate(distance)}
        return {"points": points, "short": short, **ends}


def _climb(climb: Climb, folder: ResultsFolder | None, progress: Progress) -> RunMeasures:
    """M1 to M4 of a run of climbers."""
    state = cached(folder, climb.name(0), climb.first, climb.check)
    kept = [state]
    last_of_all = climb.settings.generations
    marks = [*range(0, last_of_all, GENERATIONS_AT_ONCE), last_of_all]
    for first, last in pairwise(marks):
        state = cached(folder, climb.name(last), partial(climb.generations, state, range(first, last)), climb.check)
        kept.append(state)
        if progress:
            progress(last / last_of_all)
    climber, distance = (np.concatenate([part[name] for part in kept]) for name in ("climber", "distance"))
    return measure_run(climber, distance)


def _worst(short: Floats) -> Floats:
    """The largest shortfall of each; infinite where something failed."""
    return np.asarray(np.nan_to_num(short.max(axis=1), nan=np.inf))
