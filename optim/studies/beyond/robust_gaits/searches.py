"""What gradients add to searches of gaits for a real floor: searches with and without them at equal CPU time.

Every search maximises the speed in the worst of a few draws of friction, slope, levels and timing, with bladders that
weigh. On each slope the waves around the ring of bladders are screened once without draws; the best ones are the starts
of the runs, one for each seed, moved a little away from empty and full, where levels have slopes. What a run has found
when its CPU time is used up is played under other draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Arm, Contest, Entry
from optim.experiments.judged_runs import JudgedRuns, Run, best_of_search
from optim.experiments.results import Progress, write_json
from optim.experiments.study import Count, Settings, Several, Study, Whole, some_of
from optim.experiments.tables import Record, cell, column, distinct, markdown, page, select
from optim.measures.statistics import known_interval, known_mean
from optim.problems.inflatable.problem import GaitProblem
from optim.studies.beyond.robust_gaits.judgement import judged
from optim.studies.beyond.robust_gaits.search import kept, screened, starts_of
from optim.studies.beyond.robust_gaits.settings import Geometry, RobustGaits, checked_slopes
from robots.inflatable.schedule import BLADDERS
from robots.robot import part_of
from robots.world import FLOORS
from taichi_sim.base import checks
from taichi_sim.base.checks import positive
from taichi_sim.base.compute import Precision
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME = "robust-searches"
TABLE = "runs.csv"
FILES = ("table.md", TABLE, "summary.json", "runs", "designs")
WITHIN = 0.05  # of a level: how far starts are from empty and full
GROUND = "slope-{:g}"


@dataclass(frozen=True)
class EncodedArm(Arm):
    """A search of waves, or of the levels of every bladder."""

    encoding: str = "graded-wave"


_CLIMB = {"climbers": 1}
_POPULATION = {"population": 12}
_REFINED = {**_POPULATION, "refine": 2, "every": 3}
ARMS = {
    "hill-climb": EncodedArm("hill climbing", "hill-climb", _CLIMB),
    "gradient-hill-climb": EncodedArm("gradient hill climbing", "gradient-hill-climb", {**_CLIMB, "blind": "mutate"}),
    "genetic": EncodedArm("genetic", "genetic", _POPULATION),
    "memetic": EncodedArm("memetic", "memetic", _REFINED),
    "genetic-levels": EncodedArm("genetic, of all levels", "genetic", _POPULATION, encoding="graded"),
    "gradient-levels": EncodedArm(
        "gradient ascent of all levels", "gradient", {**_CLIMB, "verify": True}, None, "graded"
    ),
    "memetic-levels": EncodedArm("memetic, of all levels", "memetic", _REFINED, encoding="graded"),
}
MAIN = tuple(name for name, arm in ARMS.items() if arm.encoding == "graded-wave")
JUDGED = ("searched", "nominal", "speed", "worst")  # speeds of a gait; none where none was found
COLUMNS: dict[str, Kind] = {
    "ground": str,
    "search": tuple(ARMS),
    "seed": int,
    "start": str,
    "evaluations": int,
    **dict.fromkeys(JUDGED, float | None),
}


@dataclass(frozen=True)
class RobustSearches(Settings):
    """How gaits are searched for and judged.

    Attributes:
        seconds: of CPU time of a run.
        seeds: runs of every search on every slope, each from a start of its own.
        slopes: of the ground [degrees].
        arms: of ``ARMS``.
        floor: whose friction feet have.
        geometry: of the body.
        draws: that a search sees.
        held_out: draws by which gaits are judged.
        steps: of gaits in searches.
        warm_up: of these, before what counts.
        most_full: bladders that may be full at a time, of screened waves.
        precision: of the judgement.
    """

    seconds: Annotated[float, positive] = 480.0
    seeds: Count = 3
    slopes: Annotated[tuple[float, ...], checked_slopes] = (0.0, 9.0)
    arms: Annotated[tuple[str, ...], partial(some_of, names=ARMS)] = MAIN
    floor: Annotated[str, partial(checks.choice, names=FLOORS)] = "wood"
    geometry: Geometry = "published"
    draws: Several = 4
    held_out: Several = 16
    steps: Count = 60_000
    warm_up: Whole = 15_000
    most_full: Annotated[int, partial(checks.integer, low=1, high=BLADDERS)] = 4
    precision: Precision = "f32"

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.searches  # what it refuses is refused here; what problems do, by ``check``

    @cached_property
    def searches(self) -> RobustGaits:
        """The settings of screening, problems and judgement."""
        own = {name: value for name, value in vars(self).items() if name not in ("seconds", "seeds", "arms")}
        return RobustGaits(**own, begins=1, steeper=())

    @property
    def runs(self) -> list[Run]:
        """Ground, search and seed of every run, seed by seed."""
        return [(GROUND.format(s), arm, seed) for seed in range(self.seeds) for s in self.slopes for arm in self.arms]

    def check(self) -> None:
        """Refuse, by a ValueError, what problems refuse, before any work."""
        for arm in self.arms:
            self.problem(self.slopes[0], arm)

    def problem(self, slope: float, arm: str) -> GaitProblem:
        """What a search designs on a slope, for one thread."""
        return replace(self.searches.problem(slope, True, 1), encoding=ARMS[arm].encoding)


@dataclass(frozen=True)
class Searches:
    """Runs in the folder of the study, from waves of the screen."""

    folder: Path
    settings: RobustSearches
    screen: Sequence[Record]

    def start(self, slope: float, seed: int) -> Record:
        """The wave from which a run begins: the best of its slope is that of seed 0."""
        mine = sorted(select(self.screen, slope=slope), key=lambda row: -row["speed"])
        if seed >= len(mine):
            raise ValueError(f"seeds: {seed + 1} are not allowed; there are {len(mine)} waves to start from")
        return mine[seed]

    def contest(self, slope: float, seed: int) -> Contest:
        """The searches on a slope from one start."""
        wave = self.settings.problem(slope, MAIN[0])
        (begun,) = starts_of(wave, self.settings.searches, self.start(slope, seed), [])
        begun |= {name: inside(level) for name, level in begun.items() if name.startswith("level_")}
        design = wave.design(wave.space.from_dict(begun))
        entries = {}
        for name in self.settings.arms:
            start = self.settings.problem(slope, name).start_values(design)
            own = {**ARMS[name].settings, "start": start}
            entries[name] = Entry(partial(self.settings.problem, slope, name), ARMS[name].method, own)
        runs = self.folder / "runs" / GROUND.format(slope)
        return Contest(entries, "cpu", self.settings.seconds, runs, lambda line: None)

    def judged(self, run: Run) -> Record:
        """What a search finds, under draws that it has not met; its gait is saved."""
        ground, arm, seed = run
        slope = float(ground.partition("-")[2])
        contest, began = self.contest(slope, seed), self.start(slope, seed)
        best, evaluations = best_of_search(contest, arm, seed, self.settings.seconds, ARMS[arm].gradients)
        found: Record = {"start": f"{began['levels']}+{began['shift']}", "evaluations": evaluations}
        if best is None:
            return {**found, **dict.fromkeys(JUDGED)}
        problem = self.settings.problem(slope, arm)
        point = problem.space.from_dict(best)
        name = "-".join(map(str, run))
        gaits = kept(self.folder / "designs", {name: (problem.design(point), slope)})
        own = replace(self.settings.searches, slopes=(slope,))
        parts = ResultsFolder(self.folder / "judged" / name, NAME, own.describe())
        # One that diverged counts as standing still.
        speeds = {row["draw"]: float(np.nan_to_num(row["speed"])) for row in judged(own, parts, gaits, 1, None)}
        drawn = np.array([speed for draw, speed in speeds.items() if draw >= 0])
        return {
            **found,
            "searched": float(problem.evaluate(point[None]).objectives[0, 0]),
            "nominal": speeds[-1],
            "speed": float(drawn.mean()),
            "worst": float(drawn.min()),
        }


def inside(level: float) -> float:
    """The level that is nearest to a level, and not nearer to empty and full than starts are."""
    return min(max(level, WITHIN), 1.0 - WITHIN)


def study(folder: Path, settings: RobustSearches, progress: Progress = None, jobs: int = 1) -> None:
    """Write what runs have found, and a table; runs that are whole in the folder are not run again."""
    settings.check()
    parts = ResultsFolder(folder, NAME, settings.lasting("seeds", "arms", "slopes"))
    own = settings.searches
    screen = screened(own, parts, None, part_of(progress, 0, 20, 1))
    searches = Searches(folder, settings, screen)
    searches.start(settings.slopes[0], settings.seeds - 1)  # refuses more seeds than waves
    runs = JudgedRuns(folder, TABLE, "ground", settings.seconds, searches.judged)
    rows = runs.complete(settings.runs, part_of(progress, 1, 20, 19), jobs)
    _report(folder, settings, [row for row in rows if (row["ground"], row["search"], row["seed"]) in settings.runs])


def rewrite(data: Data, folder: Path) -> None:
    """Write the table and ``summary.json`` from the table of runs."""
    settings = data.settings(RobustSearches)
    columns = {**COLUMNS, "ground": tuple(map(GROUND.format, settings.slopes))}
    rows = data.records(TABLE, columns, finite=JUDGED)
    runs = [(row["ground"], row["search"], row["seed"]) for row in rows]
    for number, (run, row) in enumerate(zip(runs, rows, strict=True)):
        if run in runs[:number]:
            raise ValueError(f"{data.folder / TABLE}: {' '.join(map(str, run))} is there twice")
        if len({row[name] is None for name in JUDGED}) > 1:
            raise ValueError(f"{data.folder / TABLE}: {' '.join(map(str, run))} lacks some of {', '.join(JUDGED)}")
    _report(folder, settings, rows)


def _report(folder: Path, settings: RobustSearches, rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the table of runs."""
    told = {ground: _of_ground(select(rows, ground=ground)) for ground in distinct(rows, "ground")}
    write_json(folder / "summary.json", {"settings": settings.describe(), "grounds": told})
    text = (
        f"Gaits on {settings.floor}, bladders weighing, found in {settings.seconds:g} s of CPU time a run for the "
        f"worst of {settings.draws} draws, and judged in {settings.precision} in {settings.held_out} others "
        "[body lengths/s of the time simulated]. Seed 0 begins at the best wave of the screen, seed 1 at the next. "
        "Searched: the speed that searches maximise. Worst: the mean of the runs' worst draws. The pairs are with and "
        "without gradients, start by start."
    )
    write_text(folder / "table.md", page(text, *[part for ground, one in told.items() for part in _table(ground, one)]))


PAIRS = (("gradient-hill-climb", "hill-climb"), ("memetic", "genetic"), ("memetic-levels", "genetic-levels"))


def _of_ground(rows: Sequence[Record]) -> dict[str, Any]:
    """What the searches of a ground found, and how those along gradients compare with their kin without."""
    found = {arm: select(rows, search=arm) for arm in distinct(rows, "search")}
    pairs = []
    for one, other in PAIRS:
        if one in found and other in found:
            pairs.append({"of": one, "over": other, **_difference(found[one], found[other])})
    return {"searches": {arm: _summary(mine) for arm, mine in found.items()}, "pairs": pairs}


def _difference(rows: Sequence[Record], others: Sequence[Record]) -> dict[str, Any]:
    """By how much rows are faster than others of the same starts, in the mean over these."""
    theirs = {row["seed"]: row["searched"] for row in others}
    apart = [
        row["searched"] - theirs[row["seed"]]
        for row in rows
        if row["searched"] is not None and theirs.get(row["seed"]) is not None
    ]
    return {"starts": len(apart), **known_mean(apart, "difference")}


def _summary(rows: Sequence[Record]) -> dict[str, Any]:
    """What a search found, as means over its runs that found a gait."""
    some = [row for row in rows if row["speed"] is not None]
    means = {name: float(column(some, name).mean()) if some else None for name in ("searched", "speed", "worst")}
    low, high = known_interval(column(some, "searched"))
    evaluations = float(np.median(column(rows, "evaluations")))
    each = [row["searched"] for row in rows]
    return {"seeds": len(rows), "evaluations": evaluations, **means, "low": low, "high": high, "each": each}


def _table(ground: str, told: Mapping[str, Any]) -> list[str | list[str]]:
    """A table of the searches of a ground, the best first, and what gradients add."""
    found = {name: each for name, each in told["searches"].items() if each["searched"] is not None}
    ranked = sorted(found.items(), key=lambda item: -item[1]["searched"])
    ranked += [(name, each) for name, each in told["searches"].items() if name not in found]
    lines = [
        (
            f"**{ARMS[name].label}**" if ARMS[name].gradients else ARMS[name].label,
            each["seeds"],
            f"{each['evaluations']:.0f}",
            cell(each["searched"], ".3f"),
            f"{cell(each['low'], '.3f')} to {cell(each['high'], '.3f')}",
            ", ".join(cell(speed, ".3f") for speed in each["each"]),
            cell(each["speed"], ".3f"),
            cell(each["worst"], ".3f"),
        )
        for name, each in ranked
    ]
    header = ("search", "runs", "evaluations", "searched", "95 % interval", "each start", "held-out mean", "worst")
    parts: list[str | list[str]] = [f"{ground}:", markdown(header, "lrrrrrrr", lines)]
    for one in told["pairs"]:
        label, other = (ARMS[one[key]].label for key in ("of", "over"))
        parts.append(
            f"{label} less {other}: {cell(one['difference'], '+.3f')} BL/s in the mean (n = {one['starts']} starts), "
            f"95 % interval {cell(one['low'], '+.3f')} to {cell(one['high'], '+.3f')}."
        )
    return parts


MEDIUM = RobustSearches()
STUDY = Study(
    title="gaits for a real floor: what gradients add to searches under draws, at equal CPU time",
    source="beyond chapter 5",
    scales={
        "small": RobustSearches(
            seconds=12.0,
            seeds=1,
            slopes=(0.0,),
            arms=("hill-climb", "gradient-hill-climb"),
            geometry="small",
            draws=2,
            held_out=2,
            steps=2000,
            warm_up=0,
            most_full=1,
        ),
        "medium": MEDIUM,
        "full": RobustSearches(seconds=3600.0, seeds=5, arms=tuple(ARMS), slopes=(0.0, 9.0, 14.0), held_out=64),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="five days of one core; medium takes four hours",
)
