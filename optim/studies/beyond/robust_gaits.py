"""Gaits for a real floor: measured friction, bladders that weigh, and what is not known exactly.

On each slope the lab searches for a gait whose *worst* draw is fast. A draw scales the friction of the floor, how far
every bladder goes and how long strokes last, and tilts the ground. First, every wave around the ring of bladders, with
at most so many full ones at a time, is played once, in both directions (*screen*). The best, or the gait of the slope
below if that is better here, begins a genetic search of levels, shift, feet and settling under draws (*robust*), and
one of the same cost without (*nominal*): so gaits are led up. All that is found, and the gaits that were made by hand,
are then played in double precision under the same draws, which no search has seen. Speeds are of the time simulated,
without pneumatic lag.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure
from optim.experiments.results import Progress, computed_arrays, part_of, write_json
from optim.experiments.study import Count, Settings, Study, Whole
from optim.experiments.tables import MISSING, Record, cell, distinct, markdown, page, where, write_records
from optim.problem import Request, judge
from optim.problems.inflatable.encoding import LEAST_MOTION, SETTLING
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import read_history
from optim.studies.beyond.gait_hunt.searches import search_within
from optim.studies.chapter5.gaits import repeated
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign, load_design, save_design
from robots.inflatable.robot import InflatableRobot
from robots.inflatable.schedule import BLADDERS
from robots.uncertainty import HELD_OUT, Uncertainty, summary
from robots.world import FLOORS, STEEPEST, Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text
from taichi_sim.base.results_folder import ResultsFolder

NAME = "robust-gaits"
PRESSURE = 12e3  # of the core [Pa]
BATCH = 8  # gaits, or draws, of a part whose results are kept
HAND_MADE = {"inching": repeated(INCHING, 1), "rolling": repeated(ROLLING, 1)}
TAIL = 0.1  # of the draws, which a slope may beat
SCREEN, DRAWS, GAITS = "screen.csv", "draws.csv", "gaits"
FILES = ("table.md", SCREEN, "speeds.csv", DRAWS, "robust.png", "summary.json", GAITS, "runs")
SCREENED: dict[str, Kind] = {
    "slope": float,
    "levels": str,
    "full": int,
    "settling": float,
    "speed": float,
}
DRAWN: dict[str, Kind] = {
    "gait": str,
    "slope": float,
    "precision": str,
    "draw": int,
    "speed": float,
}


def _slopes(field_name: str, value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or not value or len(set(value)) < len(value):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give one or more different slopes")
    return tuple(checks.number(field_name, each, 0.0, STEEPEST, "degrees") for each in value)


@dataclass(frozen=True)
class RobustGaits(Settings):
    """How large the study is."""

    slopes: Annotated[tuple[float, ...], _slopes] = (0.0, 9.0, 11.0, 12.0, 13.0, 14.0)  # [degrees]
    floor: Annotated[str, partial(checks.choice, names=FLOORS)] = "wood"
    geometry: str = "published"
    uncertain: str = "friction=20%,slope=1,levels=5%,timing=5%"
    draws: Count = 4  # that a search sees
    held_out: Count = 64  # by which gaits are judged
    most_full: Annotated[int, partial(checks.integer, low=1, high=BLADDERS)] = 4  # bladders at a time, of waves
    settling: tuple[float, ...] = (0.0,)  # of screened waves, time steps after each column
    steps: Count = 60_000  # of gaits in searches
    warm_up: Whole = 15_000  # of these, before what counts
    budget: float = 10e6  # of each search [robot-steps]
    population: Count = 12
    seed: Whole = 0
    steeper: tuple[float, ...] = (2.0, 4.0, 6.0, 8.0)  # than the steepest slope, on which its gait is tried [degrees]
    precision: str = "f64"  # of the judgement

    @cached_property
    def told(self) -> Uncertainty:
        """What is not known exactly."""
        return Uncertainty.parse(self.uncertain)

    def terrain(self, slope: float) -> Terrain:
        """The floor, tilted."""
        low, high = FLOORS[self.floor]
        return Terrain(slope, high, low)

    def problem(self, slope: float, robust: bool, threads: int | None = None, rolls: bool = True) -> GaitProblem:
        """The problem of a search on a slope, over draws or without, for waves that roll or a flat body."""
        own: dict[str, Any] = {"uncertain": self.told.text, "draws": self.draws, "risk": "worst"} if robust else {}
        return GaitProblem(
            (self.terrain(slope),),
            orientation=0.0 if rolls else None,
            pressure=PRESSURE if rolls else 0.0,
            encoding="graded-wave" if rolls else "graded",
            steps=self.steps,
            warm_up=self.warm_up,
            geometry=self.geometry,
            weight="physical",
            threads=threads,
            **own,
        )


def study(folder: Path, settings: RobustGaits, progress: Progress = None, threads: int | None = None) -> None:
    """Write screened waves, gaits, speeds of all draws, the page and the figure."""
    parts = ResultsFolder(folder, NAME, settings.describe())
    screened = _screen(settings, parts, threads, part_of(progress, 0, 10, 3))
    write_records(folder / SCREEN, screened)
    found: dict[str, dict[float, InflatableDesign]] = {name: {} for name in ("robust", "nominal")}
    tasks = list(product(sorted(settings.slopes), (True, False)))
    for number, (slope, robust) in enumerate(tasks):
        best = max((row for row in screened if row["slope"] == slope), key=lambda row: row["speed"])
        share = part_of(part_of(progress, 3, 10, 3), number, len(tasks))
        own = found["robust" if robust else "nominal"]
        problem, below = settings.problem(slope, robust, threads), list(own.values())[-1:]
        start = _start(problem, best, below)
        path = folder / "runs" / f"{'robust' if robust else 'nominal'}-{slope:g}"
        own[slope] = _refined(problem, settings, start, path, share)
    if 0.0 in settings.slopes:
        share = part_of(progress, 64, 100, 6)
        found["flat body"] = {0.0: _walk(folder, settings, threads, share)}
    gaits = {f"{name} {slope:g}°": (design, slope) for name, each in found.items() for slope, design in each.items()}
    gaits |= {f"{name} {s:g}°": (design, s) for name, design in HAND_MADE.items() for s in settings.slopes}
    steepest = max(settings.slopes)
    gaits |= {
        f"robust {steepest:g}° on {steepest + more:g}°": (found["robust"][steepest], steepest + more)
        for more in settings.steeper
    }
    (folder / GAITS).mkdir(exist_ok=True)
    for name, (design, _) in gaits.items():
        save_design(design, folder / GAITS / f"{_file(name)}.json")
    judged = {name: (load_design(folder / GAITS / f"{_file(name)}.json"), slope) for name, (_, slope) in gaits.items()}
    draws = _judge(settings, parts, judged, threads, part_of(progress, 7, 10, 3))
    write_records(folder / DRAWS, draws)
    report(folder, settings.describe(), screened, draws, {name: design for name, (design, _) in judged.items()})
    if progress:
        progress(1.0)


def tell(data: Data, folder: Path) -> None:
    """Write table, page, figure and summary from the tables of waves and draws, and from gaits.

    Nothing is told of the settings where their file is missing, nor of the bladders of a gait whose file is.
    """
    screened, draws = data.records(SCREEN, SCREENED), data.records(DRAWS, DRAWN)
    for name in distinct(draws, "gait"):
        if not any(row["draw"] >= 0 for row in where(draws, gait=name)):
            raise ValueError(f"{data.folder / DRAWS}: gait {name} has no held-out draw (draw: at least 0)")
        if Path(_file(name)).name != _file(name):
            raise ValueError(f"{data.folder / DRAWS}: gait {name!r} is not allowed; it names no file")
    files = {name: data.folder / GAITS / f"{_file(name)}.json" for name in distinct(draws, "gait")}
    settings = data.kept(NAME, dict) if data.has(f"{NAME}.json") else {}
    designs = {name: load_design(path) for name, path in files.items() if path.exists()}
    report(folder, settings, screened, draws, designs)


def _file(name: str) -> str:
    return name.replace(" ", "-").replace("°", "")


def waves(most_full: int) -> list[tuple[int, ...]]:
    """All that a bladder can do, full (1) or empty, in the columns of a wave, of which none is another one shifted."""
    found, seen = [], set[tuple[int, ...]]()
    for levels in product((0, 1), repeat=BLADDERS):
        if 0 < sum(levels) <= most_full and levels not in seen:
            seen |= {levels[i:] + levels[:i] for i in range(BLADDERS)}
            found.append(levels)
    return found


def _points(problem: GaitProblem, rows: Sequence[Mapping[str, Any]]) -> Floats:
    """Points of a problem for waves in records; feet slide."""
    points = np.zeros((len(rows), problem.space.size))
    names = problem.space.names
    for point, row in zip(points, rows, strict=True):
        point[[names.index(f"level_{column + 1}") for column in range(BLADDERS)]] = list(map(int, row["levels"]))
        point[names.index("shift")], point[names.index("settle")] = row["shift"], row["settling"]
    return points


def _screen(
    settings: RobustGaits, parts: ResultsFolder, threads: int | None, progress: Progress
) -> list[dict[str, Any]]:
    """Speeds of all waves on all slopes, without draws."""
    waved = product(waves(settings.most_full), (1, BLADDERS - 1), settings.settling)
    about = [
        {"levels": "".join(map(str, each)), "full": sum(each), "shift": shift, "settling": settling}
        for each, shift, settling in waved
    ]
    groups = [about[first : first + BATCH] for first in range(0, len(about), BATCH)]

    def speeds(slope: float, group: Sequence[Mapping[str, Any]], told: Progress) -> Floats:
        problem = settings.problem(slope, False, threads)
        speeds = judge(problem, Request(_points(problem, group), "points")).objectives[:, 0]
        return np.where(np.isfinite(speeds), speeds, -np.inf)

    tasks = {
        f"screen_{slope:g}_{number}": partial(speeds, slope, group)
        for slope in settings.slopes
        for number, group in enumerate(groups)
    }
    found = np.concatenate(computed_arrays(parts, "speeds", tasks, progress))
    rows = [{"slope": slope, **each} for slope in settings.slopes for each in about]
    return [{**row, "speed": float(speed)} for row, speed in zip(rows, found, strict=True)]


def _start(problem: GaitProblem, wave: Mapping[str, Any], below: Sequence[InflatableDesign]) -> dict[str, Any]:
    """Where a search begins: a wave, or the gait found on the slope below, whichever is better in the problem."""
    starts = [dict(zip(problem.space.names, _points(problem, [wave])[0].tolist(), strict=True))]
    starts += [problem.start_values(design) for design in below]
    if len(starts) == 1:
        return starts[0]
    points = np.stack([problem.space.from_dict(each) for each in starts])
    scores = judge(problem, Request(points, "points")).objectives[:, 0]
    return starts[int(np.argmax(np.nan_to_num(scores, nan=-np.inf)))]


def _refined(
    problem: GaitProblem, settings: RobustGaits, start: Mapping[str, Any], path: Path, progress: Progress
) -> InflatableDesign:
    """The gait that a genetic search finds from a start."""
    own = {"population": settings.population, "seed": settings.seed, "start": start}
    search_within(problem, "genetic", own, path, settings.budget, progress)
    return _best(problem, path)


def _walk(folder: Path, settings: RobustGaits, threads: int | None, progress: Progress) -> InflatableDesign:
    """The gait on level ground that a genetic search under draws finds from inching, of a body that cannot roll."""
    problem, columns = settings.problem(0.0, True, threads, False), INCHING.schedule.columns
    times: dict[str, Any] = {"motion_steps": np.full(columns, LEAST_MOTION), "settle_steps": np.full(columns, SETTLING)}
    start = problem.start_values(replace(INCHING, schedule=replace(INCHING.schedule, repeats=1, **times)))
    return _refined(problem, settings, start, folder / "runs" / "flat-body", progress)


def _best(problem: GaitProblem, run: Path) -> InflatableDesign:
    """The best gait of a run."""
    found = read_history(run).generations[-1].best_point
    assert found is not None  # the start is a gait
    return problem.design(problem.space.from_dict(found))


def _judge(
    settings: RobustGaits,
    parts: ResultsFolder,
    gaits: Mapping[str, tuple[InflatableDesign, float]],
    threads: int | None,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Speeds of all gaits under the held-out draws, and under none (draw -1)."""
    drawn = settings.told.draw(settings.held_out, HELD_OUT, actuators=BLADDERS)
    compute = Compute(precision=settings.precision, threads=threads)

    def speeds(name: str, first: int, told: Progress) -> Floats:
        design, slope = gaits[name]
        robot = InflatableRobot(design, settings.geometry, "physical")
        terrain, some = settings.terrain(slope), drawn[first : first + BATCH]
        terrains = [one.around(robot, terrain) for one in some]
        if first < 0:
            some, terrains = [], [terrain]
        outcomes = robot.simulate_in(terrains, draws=some, compute=compute, progress=told)
        return np.array([float(outcome.measures["speed_simulated"][0]) for outcome in outcomes])

    firsts = [-1, *range(0, settings.held_out, BATCH)]
    tasks = {f"judge_{_file(name)}_{first}": partial(speeds, name, first) for name in gaits for first in firsts}
    found = computed_arrays(parts, "speeds", tasks, progress)
    rows, each = [], iter(found)
    for name, (_, slope) in gaits.items():
        for first in firsts:
            for number, speed in enumerate(next(each)):
                about = {"gait": name, "slope": slope, "precision": settings.precision}
                rows.append({**about, "draw": first + number, "speed": float(speed)})
    return rows


def report(
    folder: Path,
    settings: Mapping[str, Any],
    screened: Sequence[Record],
    draws: Sequence[Record],
    designs: Mapping[str, InflatableDesign],
) -> None:
    """Write what follows from the records: table, page, figure and summary.

    Settings are those of the study as it describes them, as far as they are known, and so are the designs of gaits.
    """
    rows = [_row(where(draws, gait=name), designs.get(name)) for name in distinct(draws, "gait")]
    write_records(folder / "speeds.csv", rows)
    best = [
        {"slope": slope, "full": full, **max(mine, key=lambda row: row["speed"])}
        for slope in distinct(screened, "slope")
        for full in sorted(distinct(screened, "full"))
        if (mine := where(screened, slope=slope, full=full))
    ]
    write_json(folder / "summary.json", {**settings, "rows": rows, "screened": best})
    write_text(folder / "table.md", text_of(settings, rows, best))
    draw(rows, draws, folder / "robust.png")


def _row(mine: Sequence[Record], design: InflatableDesign | None) -> dict[str, Any]:
    """A gait in a line, of its draws; one that diverged counts as standing still."""
    speeds = np.nan_to_num([row["speed"] for row in mine if row["draw"] >= 0])
    nominal = next((row["speed"] for row in mine if row["draw"] < 0 and math.isfinite(row["speed"])), None)
    found = summary(speeds.tolist(), 0.2) if len(speeds) > 1 else {}
    told = {key: found.get(key) for key in ("mean", "mean_low", "mean_high", "worst", "sd")}
    return {
        **{key: mine[0][key] for key in ("gait", "slope", "precision")},
        "nominal": nominal,
        **told,
        "forward": float((speeds > 0).mean()),
        "full": None if design is None else float(design.schedule.inflation.sum(axis=0).max()),
        "n": len(speeds),
    }


def text_of(settings: Mapping[str, Any], rows: Sequence[Record], best: Sequence[Record]) -> str:
    """The page: every gait under the held-out draws, and the best waves by how many bladders are full at a time."""
    header = ("gait", "precision", "nominal", "mean", "95 % interval", "worst", "climb", "full bladders", "n")
    table = [
        (
            row["gait"],
            row["precision"],
            cell(row["nominal"]),
            cell(row["mean"]),
            MISSING if row["mean"] is None else f"{row['mean_low']:.4f} to {row['mean_high']:.4f}",
            cell(row["worst"]),
            f"{100 * row['forward']:.0f} %",
            cell(row["full"], ".1f"),
            row["n"],
        )
        for row in rows
    ]
    waved = [(f"{r['slope']:g}°", r["full"], r["levels"], f"{r['settling']:g}", cell(r["speed"])) for r in best]
    floor = f" on {settings['floor']}" if "floor" in settings else ""
    uncertain = f" of {settings['uncertain']}" if "uncertain" in settings else ""
    return page(
        f"Speeds{floor} with bladders that weigh, under {rows[0]['n']} draws{uncertain} that no search has seen "
        "[body lengths/s of the time simulated, no pneumatic lag]. Robust: searched for the worst of draws; nominal: "
        "at the same cost without. Climb: the share of draws that go forward. Full bladders: the sum of levels, at "
        "most.",
        markdown(header, "llrrrrrrr", table),
        "Best waves without draws, by how many bladders are full at a time; levels of a bladder in 8 columns.",
        markdown(("slope", "full", "levels", "settling", "speed"), "rrlrr", waved),
    )


def draw(rows: Sequence[Record], draws: Sequence[Record], path: Path) -> None:
    """Draw the speed of every gait in every draw."""
    rows = [row for row in rows if " on " not in row["gait"]]
    slopes = sorted({row["slope"] for row in rows})
    with figure(path, PAGE, 2.6, ncols=len(slopes), sharey=True) as (_, panels):
        for axes, slope in zip(panels[0], slopes, strict=True):
            here = [row for row in rows if row["slope"] == slope]
            for place, row in enumerate(here):
                each = [d["speed"] for d in draws if d["gait"] == row["gait"] and d["draw"] >= 0]
                spread = place + 0.3 * (np.arange(len(each)) / max(len(each) - 1, 1) - 0.5)
                axes.plot(spread, each, ".", markersize=2, color=COLOURS[place % len(COLOURS)])
            axes.axhline(0, color="0.7", linewidth=0.6, zorder=0)
            names = [row["gait"].replace(f" {slope:g}°", "").replace(", ", ",\n") for row in here]
            axes.set_xticks(range(len(here)), names, rotation=40, ha="right")
            axes.set_title(f"{slope:g}°")
        panels[0, 0].set_ylabel("speed [BL/s]")


STUDY = Study(
    title="gaits for a real floor: fast on wood in the worst of draws of friction, slope, levels and timing",
    source="chapter 5, transferring to a physical robot",
    scales={
        "small": RobustGaits(
            (0.0,), geometry="small", draws=2, held_out=4, most_full=1, settling=(0.0,), steeper=(), budget=0.5e6
        ),
        "medium": RobustGaits(),
        "full": RobustGaits(
            (0.0, 5.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0),
            settling=(0.0, 1000.0),
            draws=8,
            most_full=5,
            budget=600e6,
            population=24,
        ),
    },
    run=study,
    tell=tell,
    writes=FILES,
    cost="40 h of CPU time",
)
