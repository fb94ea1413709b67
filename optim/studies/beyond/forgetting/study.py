"""The study: bodies are measured, those with the best and the worst M_CI learn A and then B, by every method.

Source: dissertation, chapters 3, 4 and 6: a good body avoids forgetting whatever the method. Methods against forgetting
were not tried there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.body_metrics import Measuring, Tries, check_succeeded, controllers_of
from optim.experiments.data import Data, Kind
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, cached
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, write_records
from optim.measures.sampled import sampled_metrics
from optim.space import Space
from optim.studies.beyond.forgetting.families import FAMILIES, LOST, Learning
from optim.studies.beyond.forgetting.methods import METHODS, SEQUENTIAL, Recipe, train
from optim.studies.beyond.forgetting.report import LEVELS, TABLE, write_report
from robots.robot import part_of
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

NAME, MEASURED = "forgetting", "bodies.csv"
STRENGTH, REPLAY = 10.0, 2  # of elastic weights; every second step in B is one in A
DIGITS = 6  # of means over starts, from which all else follows
MEASURING = 1 / 4  # part of the time, for progress


@dataclass(frozen=True)
class Effort(Settings):
    """What is spent on a robot.

    Attributes:
        bodies: that learn, with a high M_CI and as many with a low one; 0 leaves the robot out.
        measured: bodies that are measured for every one of them.
        controllers: drawn in each that is measured.
        starts: controllers that learn in each body.
        steps: of learning in each environment.
    """

    bodies: Whole
    measured: Several = 5
    controllers: Count = 128
    starts: Count = 4
    steps: Count = 60


@dataclass(frozen=True)
class Forgetting(Settings):
    """What is spent on every robot.

    Attributes:
        vehicle, quadruped, walker: effort of each.
    """

    vehicle: Effort = field(default_factory=lambda: Effort(24, controllers=256))
    quadruped: Effort = field(default_factory=lambda: Effort(8, steps=30))
    walker: Effort = field(default_factory=lambda: Effort(5, measured=4, controllers=64, starts=1, steps=15))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.efforts:
            raise ValueError("bodies: 0 of every robot are not allowed; give some of one")

    @property
    def efforts(self) -> dict[str, Effort]:
        """Effort by robot, of those that are not left out."""
        found: dict[str, Effort] = {name: getattr(self, name) for name in FAMILIES}
        return {name: effort for name, effort in found.items() if effort.bodies}


def study(folder: Path, settings: Forgetting, progress: Progress = None, jobs: int = 1) -> None:
    """Write what every body learned and forgot, what explains it, and a picture; what is whole is not done again."""
    ResultsFolder(folder, NAME, settings.describe())
    measured: list[Record] = []
    rows: list[Record] = []
    for done, (name, effort) in enumerate(settings.efforts.items()):
        told = part_of(progress, done, len(settings.efforts))
        count = effort.bodies * effort.measured
        metrics = _each(folder, jobs, measure, name, effort, list(range(count)), _within(told, 0.0, MEASURING))
        measured += metrics
        write_records(folder / MEASURED, measured)
        levels = levels_of(metrics, effort.bodies)
        numbers = [number for level in levels.values() for number in level]
        found = _each(folder, jobs, learn, name, effort, numbers, _within(told, MEASURING, 1.0))
        known = {row["body"]: row for row in metrics}
        level_of = {number: level for level, some in levels.items() for number in some}
        for row in (row for each in found for row in each):
            body = known[row["body"]]
            rows.append({**row, "level": level_of[row["body"]], "M_CI": body["M_CI"], "M_L": body["M_L"]})
        write_records(folder / TABLE, rows)
        write_report(folder, means_over_starts(rows), measured, settings.describe())


# Of a training, in both environments.
MEASURES = ("start_a", "start_b", "learned_a", "learned_b", "final_a", "final_b", "worse")
# Shares of the steps in A that were needed, at first and on the return, by those that learn one after the other.
NEEDED = ("first", "again")


def rewrite(data: Data, folder: Path) -> None:
    """Write what explains what bodies forgot, and the picture, from both tables; that of runs may lack starts."""
    metrics = dict.fromkeys(("M_CI", "M_L"), float)
    texts: dict[str, Kind] = {"robot": tuple(FAMILIES), "method": tuple(METHODS), "level": tuple(LEVELS)}
    told: dict[str, Kind] = {"body": int, **texts, **metrics, **dict.fromkeys(MEASURES, float)}
    told |= dict.fromkeys(NEEDED, float | None)
    rows = data.records(TABLE, told, "level", "method")
    measured = data.records(MEASURED, {"robot": tuple(FAMILIES), "body": int, **metrics})
    settings = data.from_summary(lambda summary: checks.table("settings", summary["settings"]))
    write_report(folder, means_over_starts(rows), measured, settings)


def means_over_starts(rows: Sequence[Record]) -> list[Record]:
    """One row for each body and method, from rows of their starts; those of older tables are such means already."""
    if "start" not in rows[0]:
        return list(rows)
    groups: dict[tuple[Any, ...], list[Record]] = {}
    for row in rows:
        groups.setdefault((row["robot"], row["body"], row["method"]), []).append(row)
    return [_mean(some) for some in groups.values()]


def _mean(some: Sequence[Record]) -> Record:
    """The mean of rows of starts, with what is the same in all of them, and how many of all failed."""
    names = [name for name in (*MEASURES, *NEEDED) if some[0][name] is not None]
    means = {name: round(float(column(some, name).mean()), DIGITS) for name in names}
    same = {name: value for name, value in some[0].items() if name != "start"}
    return {**same, **means, "failed": sum(row["failed"] for row in some)}


def _within(progress: Progress, first: float, last: float) -> Progress:
    return progress and (lambda fraction: progress(first + (last - first) * fraction))


def _each(
    folder: Path, jobs: int, do: Any, name: str, effort: Effort, numbers: Sequence[int], progress: Progress
) -> list[Any]:
    """Do something with bodies, several at the same time if asked to; what comes of each."""
    parts = [(f"{name} {number}", partial(do, folder, name, effort, number)) for number in numbers]
    run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
    return [part({}, part_of(progress, number, len(parts))) for number, (_, part) in enumerate(parts)]


def levels_of(metrics: Sequence[Record], count: int) -> dict[str, list[int]]:
    """Numbers of the bodies with the highest M_CI, and of those with the lowest, M_L where it is the same.

    Only bodies in which some controller succeeds in A and some in B count, if there are enough: others are not less
    resistant, but unable.
    """
    able = [row for row in metrics if row["some_a"] and row["some_b"]]
    chosen = able if len(able) >= 2 * count else metrics
    order = [row["body"] for row in sorted(chosen, key=lambda row: (row["M_CI"], row["M_L"], row["body"]))]
    return {"high": order[: -count - 1 : -1], "low": order[:count]}


def measure(
    folder: Path, name: str, effort: Effort, number: int, _: Mapping[str, Any], progress: Progress
) -> dict[str, Any]:
    """M_L and M_CI of a body, unless they are known."""
    kept = ResultsFolder(folder / "measured" / f"{name}-{number}", "body", {"controllers": effort.controllers})
    check = partial(check_succeeded, effort.controllers, 2)
    sampled = sampled_metrics(cached(kept, "tried", partial(_tried, name, effort, number), check)["succeeded"])
    if progress:
        progress(1.0)
    some_a, some_b = (share.count for share in sampled.each)
    return {
        "robot": name,
        "body": number,
        "M_CI": sampled.resistance.value,
        "M_L": sampled.learnability.value,
        "all": sampled.learnability.count,
        "any": sampled.resistance.of,
        "some_a": some_a,
        "some_b": some_b,
    }


def learn(
    folder: Path, name: str, effort: Effort, number: int, _: Mapping[str, Any], progress: Progress
) -> list[dict[str, Any]]:
    """What controllers of a body learn and forget, a row for each method and start; unless it is known.

    Numbers are written in full, so that only their means over starts are rounded, as in tables that have no starts.
    """
    known = {"starts": effort.starts, "steps": effort.steps}
    kept = ResultsFolder(folder / "learned" / f"{name}-{number}", "body", known)
    found = cached(kept, "trained", partial(_learned, name, effort, number), partial(check_trained, effort))
    if progress:
        progress(1.0)
    again = dict(zip(SEQUENTIAL, found["again"], strict=True))
    rows: list[dict[str, Any]] = []
    for method, final in zip(METHODS, found["final"], strict=True):
        shares = [*found["start"].T, *found["learned"].T, *final.T, final.min(axis=1)]
        needed = [found["first"], again[method]] if method in again else []
        told = dict(zip((*MEASURES, *NEEDED), [*shares, *needed], strict=False))
        for start in range(len(final)):
            one = {key: float(told[key][start]) if key in told else None for key in (*MEASURES, *NEEDED)}
            failed = int((final[start] == LOST).sum())
            rows.append({"robot": name, "body": number, "method": method, "start": start, **one, "failed": failed})
    return rows


def check_trained(effort: Effort, arrays: Arrays) -> None:
    """Refuse a file that holds nothing that ``methods.train`` can have found, by a ValueError."""
    starts, least = effort.starts, 1 / effort.steps  # of the looks, the first of which may be enough
    allowed = {
        **dict.fromkeys(("start", "learned"), Allowed((starts, 2))),
        "final": Allowed((len(METHODS), starts, 2)),
        "first": Allowed((starts,), least, 1.0),
        "again": Allowed((len(SEQUENTIAL), starts), least, 1.0),
    }
    check_arrays(allowed, arrays)


def _tried(name: str, effort: Effort, number: int) -> Arrays:
    """Which drawn controllers of a body succeed where, ``succeeded``, shape (N, 2)."""
    family = FAMILIES[name]
    robot = family.body(number)
    tries = Tries(robot, family.environments, family.compute)
    parts = controllers_of(Space(tuple(robot.parameters)), Measuring(effort.controllers, seed=1))
    return {"succeeded": np.concatenate([tries.successes(points)["succeeded"] for points in parts])}


def _learned(name: str, effort: Effort, number: int) -> Arrays:
    family = FAMILIES[name]
    task = Learning(family, family.body(number))
    first = np.random.default_rng((number, 7)).random((effort.starts, task.space.size))
    return train(task, first, Recipe(effort.steps, family.rate, STRENGTH, REPLAY))


_TINY = Effort(2, measured=2, controllers=8, starts=1, steps=3)
_FULL = {"controllers": 1024, "starts": 8, "steps": 100}
STUDY = Study(
    title="forgetting: whether a good body or a method against it keeps more of what was learned first",
    source="chapters 3, 4 and 6, which promise it of bodies",
    scales={
        "small": Forgetting(_TINY, _TINY, _TINY),
        "medium": Forgetting(),
        "full": Forgetting(Effort(50, **_FULL), Effort(30, **_FULL), Effort(20, **_FULL)),
    },
    run=study,
    rewrite=rewrite,
    writes=(TABLE, MEASURED, "table.md", "summary.json", "forgetting.png"),
    cost="about 30 hours of a core",
)
