"""One controller for many bodies: trained on hundreds of walkers, tested on others, beside training in each body.

A universal controller is one point, the same in every body; or it is told the body, and is linear in what describes it.
Both go along exact gradients of the way ahead, averaged over some bodies a step. Training in each of the test bodies
has as many gradients in all.
"""

import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data, Kind
from optim.experiments.figures import PAGE, dots, figure
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, cached, write_json
from optim.experiments.study import Count, Settings, Study
from optim.experiments.tables import Record, column, markdown, mean_with_interval, page, select, write_records
from optim.measures.statistics import difference_of_means, mean_interval
from optim.search.step_rules import Adam
from optim.space import Space
from optim.studies.beyond.body_and_learning.bodies import WORLDS, described, different, walker
from robots.robot import Trial, part_of
from taichi_sim.base.arrays import Arrays, Floats, Ints
from taichi_sim.base.checks import integer, positive
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME, TABLE, PICTURE = "universal-control", "runs.csv", "universal-control.png"
HERE, WORLD = Compute(precision="f32", threads=1), WORLDS[0]
UNCLIPPED = 1e9  # gradients are shortened body by body
STEEPEST = 1.0  # body lengths per range: longer gradients of a body are shortened to it
FIRST_TRAINED, FIRST_TESTED = 10_000, 20_000  # numbers of the bodies
ARMS = {
    "universal": "universal, the same everywhere",
    "told": "universal, told the body",
    "each": "trained in each body",
    "tuned": "told, then trained in each body",
}
COLUMNS: dict[str, Kind] = {
    "arm": tuple(ARMS),
    "seed": int,
    **dict.fromkeys(("speed", "backwards", "seconds"), float),
}
BODIES = {"bodies": "different"}  # what folders keep of how bodies are drawn: once, some were met twice


@dataclass(frozen=True)
class UniversalControl(Settings):
    """Bodies and training.

    Attributes:
        trained: bodies that universal controllers are trained on, all different.
        tested: others, none of which is one of them, in which all are tested.
        gradients: of one training, over all of its bodies.
        batch: bodies whose gradients make a step of a universal controller.
        rate: of steps, in ranges of the variables.
        seeds: trainings of each kind.
        cycles: of a trial.
    """

    trained: Annotated[int, partial(integer, low=1, high=5000)] = 500
    tested: Annotated[int, partial(integer, low=1, high=2000)] = 100
    gradients: Count = 500
    batch: Count = 5
    rate: Annotated[float, positive] = 0.03
    seeds: Count = 5
    cycles: Count = 3

    @property
    def steps(self) -> int:
        """Steps of a universal training."""
        return max(1, self.gradients // self.batch)

    @cached_property
    def numbers_trained(self) -> Ints:
        """Numbers of the bodies for training."""
        return different(FIRST_TRAINED, self.trained)

    @cached_property
    def numbers_tested(self) -> Ints:
        """Numbers of the bodies for the test."""
        return different(FIRST_TESTED, self.tested, self.numbers_trained.tolist())


class Controller:
    """Points of a space, in its ranges, linear in what describes a body; steps go along gradients."""

    def __init__(self, first: Floats, inputs: int, rate: float) -> None:
        """Start at a point, shape (P,), whatever the body, with so many numbers that describe one; the last is 1."""
        self.weights = np.zeros((len(first), inputs))
        self.weights[:, -1] = first
        self.rule = Adam(1, self.weights.size, rate, UNCLIPPED)

    def point(self, told: Floats) -> Floats:
        """The point for a body, within the ranges."""
        return np.clip(self.weights @ told, 0.0, 1.0)

    def step(self, bodies: Sequence[Floats], slopes: Sequence[Floats]) -> None:
        """Go along the mean of the gradients in some bodies; none counts where a bound holds the point."""
        total = np.zeros(self.weights.shape)
        for told, slope in zip(bodies, slopes, strict=True):
            inner = self.weights @ told
            free = ~(((inner <= 0) & (slope < 0)) | ((inner >= 1) & (slope > 0)))
            total += np.outer(slope * free, told) / len(bodies)
        every = np.ones((1, total.size), bool)
        self.weights += self.rule.steps(np.ones(1, bool), total.reshape(1, -1), every).reshape(self.weights.shape)


@dataclass(frozen=True)
class Walks:
    """Trials of walkers at points in ranges of the variables."""

    cycles: int

    @property
    def space(self) -> Space:
        """What is free, the same in every body."""
        return Space(tuple(walker(0, self.cycles).parameters))

    def start(self, seed: int) -> Floats:
        """Waves of half the amplitude with drawn phases, and reflexes that do nothing."""
        space = self.space
        drawn = np.random.default_rng((seed, 1)).random(space.size)
        names = space.names
        return np.where([name.startswith("muscle_phase") for name in names], drawn, 0.5)

    def speed(self, number: int, unit: Floats) -> float:
        """Speed of one body at a point; NaN if it fails."""
        robot, space = walker(number, self.cycles), self.space
        outcome = robot.run(robot.points(space.low + space.span * unit), Trial(WORLD, HERE))
        return float(outcome.measures["speed"][0]) if outcome.status_or_reason[0] == "ok" else np.nan

    def slope(self, number: int, unit: Floats) -> Floats:
        """Gradient of the way in body lengths, by ranges, shortened to ``STEEPEST``; zero if the body fails."""
        robot, space = walker(number, self.cycles), self.space
        outcome = robot.run(robot.points(space.low + space.span * unit), Trial(WORLD, HERE, gradients=("distance",)))
        found = np.nan_to_num(outcome.gradients["distance"][0]) * space.span / robot.length
        return np.asarray(found * min(1.0, STEEPEST / max(float(np.linalg.norm(found)), 1e-12)))


def train(settings: UniversalControl, seed: int, told: bool, progress: Progress = None) -> Arrays:
    """A universal controller: its weights, and what it took in seconds of CPU time."""
    begun, walks = time.process_time(), Walks(settings.cycles)
    controller = Controller(walks.start(seed), len(described(0)), settings.rate)
    for step, numbers in enumerate(drawn_bodies(settings, seed)):
        bodies = [_description(int(number), told) for number in numbers]
        slopes = [walks.slope(int(n), controller.point(body)) for n, body in zip(numbers, bodies, strict=True)]
        controller.step(bodies, slopes)
        if progress:
            progress((step + 1) / settings.steps)
    return {"weights": controller.weights, "seconds": np.array(time.process_time() - begun)}


def drawn_bodies(settings: UniversalControl, seed: int) -> Ints:
    """Numbers of the bodies of each step, shape (steps, B): none comes again before all others have come."""
    rng, count = np.random.default_rng((seed, 2)), settings.steps * settings.batch
    rounds = -(-count // settings.trained)
    drawn = np.concatenate([rng.permutation(settings.trained) for _ in range(rounds)])
    return settings.numbers_trained[drawn[:count]].reshape(settings.steps, settings.batch)


def train_each(settings: UniversalControl, seed: int, weights: Floats | None, progress: Progress = None) -> Arrays:
    """Speeds of the test bodies after training in each, from a universal controller or the usual start, shape (T,)."""
    begun, walks = time.process_time(), Walks(settings.cycles)
    steps, speeds = max(1, settings.gradients // settings.tested), []
    for count, number in enumerate(settings.numbers_tested.tolist()):
        first = walks.start(seed) if weights is None else np.clip(weights @ _description(number, True), 0.0, 1.0)
        one = np.ones(1)
        own = Controller(first, 1, settings.rate)
        for _ in range(steps):
            own.step([one], [walks.slope(number, own.point(one))])
        speeds.append(walks.speed(number, own.point(one)))
        if progress:
            progress((count + 1) / settings.tested)
    return {"speeds": np.array(speeds), "seconds": np.array(time.process_time() - begun)}


def test(settings: UniversalControl, weights: Floats, told: bool) -> Arrays:
    """Speeds of the test bodies with a universal controller, shape (T,)."""
    walks, numbers = Walks(settings.cycles), settings.numbers_tested.tolist()
    points = [np.clip(weights @ _description(number, told), 0.0, 1.0) for number in numbers]
    return {"speeds": np.array([walks.speed(number, point) for number, point in zip(numbers, points, strict=True)])}


def _description(number: int, told: bool) -> Floats:
    """The numbers that describe a body, or none of them but the constant one."""
    numbers = described(number)
    return numbers if told else np.append(np.zeros(len(numbers) - 1), 1.0)


def seed_part(folder: Path, settings: UniversalControl, seed: int, _: Any, progress: Progress) -> list[Record]:
    """All trainings and tests of a seed, unless they are done: a row for each kind."""
    kept = ResultsFolder(folder / "parts" / f"{seed}", "seed", {"seed": seed, **settings.lasting("seeds"), **BODIES})
    speeds_of, seconds_of = {"speeds": Allowed((settings.tested,), failed=np.nan)}, {"seconds": Allowed((), 0.0)}
    weights_of = {"weights": Allowed((Walks(settings.cycles).space.size, len(described(0))))}
    tested, alone = partial(check_arrays, speeds_of), partial(check_arrays, speeds_of | seconds_of)
    rows: list[Record] = []
    weights = {}
    for count, name in enumerate(ARMS):
        part = part_of(progress, count, len(ARMS))
        if name in ("universal", "told"):
            told = name == "told"
            run, check = partial(train, settings, seed, told, part), partial(check_arrays, weights_of | seconds_of)
            trained = cached(kept, f"trained_{name}", run, check)
            weights[name] = trained["weights"]
            found = cached(kept, f"tested_{name}", partial(test, settings, weights[name], told), tested)
            seconds = float(trained["seconds"])
        else:
            first = weights["told"] if name == "tuned" else None
            run = partial(train_each, settings, seed, first, part)
            found = cached(kept, f"tested_{name}", run, alone)
            seconds = float(found["seconds"])
        speeds = np.nan_to_num(found["speeds"])
        quarters = np.percentile(speeds, [25, 75])
        rows.append(
            {
                "arm": name,
                "seed": seed,
                "speed": float(speeds.mean()),
                "lowest_quarter": float(quarters[0]),
                "highest_quarter": float(quarters[1]),
                "backwards": float((speeds < 0).mean()),
                "failed": int(np.isnan(found["speeds"]).sum()),
                "seconds": seconds,
            }
        )
    return rows


def study(folder: Path, settings: UniversalControl, progress: Progress = None, jobs: int = 1) -> None:
    """Write what every training reached, and a table; seeds that are whole are not trained again."""
    ResultsFolder(folder, NAME, settings.lasting("seeds") | BODIES)
    seeds = range(settings.seeds)
    parts = [(f"seed {seed}", partial(seed_part, folder, settings, seed)) for seed in seeds]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
    rows: list[Record] = []
    for seed, (_, part) in enumerate(parts):
        rows += part({}, progress and part_of(progress, seed, len(parts)))
        write_records(folder / TABLE, rows)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    _report(folder, settings, rows, peak)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``table.md``, ``summary.json`` and the picture from the table of trainings."""
    rows = data.records(TABLE, COLUMNS, "arm")
    _report(folder, data.settings(UniversalControl), rows, data.count("peak_memory"))


def _report(folder: Path, settings: UniversalControl, rows: Sequence[Record], peak: int) -> None:
    """Write ``table.md``, ``summary.json`` and a picture with a dot for each training."""
    lines, summary = [], dict[str, Any]()
    each = column(select(rows, arm="each"), "speed")
    for name, title in ARMS.items():
        part = select(rows, arm=name)
        speeds = column(part, "speed")
        several = len(speeds) > 1
        ends = mean_interval(speeds) if several else None
        gain = difference_of_means(each, speeds, paired=True) if several and name != "each" else None
        interval = f" ({ends[0]:.3f} to {ends[1]:.3f})" if ends else ""
        against = f"{gain.difference:+.3f} ({gain.low:+.3f} to {gain.high:+.3f})" if gain else "-"
        seconds, backwards = column(part, "seconds"), 100 * column(part, "backwards")
        others = [mean_with_interval(backwards, ".0f"), mean_with_interval(seconds, ".0f")]
        lines.append([title, f"{speeds.mean():.3f}{interval}", against, *others])
        summary[name] = {"speeds": speeds.tolist(), "seconds": float(seconds.mean())}
    header = ["controller", "mean speed in unseen bodies [lengths/s]", "more than trained in each"]
    header += ["bodies that walk backwards [%]", "CPU time [s]"]
    met = min(settings.steps * settings.batch, settings.trained)
    told = (
        f"{settings.gradients} gradients for each training: a universal one over {met} bodies, one in each of "
        f"{settings.tested} unseen bodies, {max(1, settings.gradients // settings.tested)} steps; "
        f"{settings.seeds} seeds, 95 % intervals over seeds, of differences by pairs of them."
    )
    write_text(folder / "table.md", page(told, markdown(header, "lrrrr", lines)))
    write_json(folder / "summary.json", {"settings": settings.describe(), "arms": summary, "peak_memory": peak})
    with figure(folder / PICTURE, PAGE, 2.2, ncols=2, sharey=True) as (_, ((speeds_of, backwards_of),)):
        dots(speeds_of, {title: column(select(rows, arm=name), "speed") for name, title in ARMS.items()})
        speeds_of.set_xlabel("mean speed in unseen bodies [lengths/s]")
        dots(backwards_of, {title: 100 * column(select(rows, arm=name), "backwards") for name, title in ARMS.items()})
        backwards_of.set_xlabel("bodies that walk backwards [%]")


STUDY = Study(
    title="one controller for many bodies, tested on bodies that it has not met",
    source="chapter 6, which asks for controllers that fit many bodies",
    scales={
        "small": UniversalControl(trained=4, tested=2, gradients=4, batch=2, seeds=2, cycles=1),
        "medium": UniversalControl(),
        "full": UniversalControl(trained=2000, gradients=5000, seeds=10),
    },
    run=study,
    rewrite=rewrite,
    writes=("table.md", TABLE, "summary.json", PICTURE),
    cost="about 15 hours of a core; medium takes one",
)
