"""The inflatable robot with a hundred variables: gradients and hybrids beside gradient-free searches at equal CPU time.

Free are the orientation, levels, feet, settling, core pressure and paces of every column, friction of the feet, and
moduli and sizes of all regions: 104 variables with three columns; the robot begins flat. All searches start at random
points. A run counts what it has found when its CPU time is used up: the best design is written as a file, read again,
and played in double precision with noise on its start; its speed is the median of several starts.

The robot is the small one, on a rig that inflates bladders four times as fast as published, so that more evaluations
fit into a budget. Pressure acts on its closed surface: by the published law a pouch whose regions differ drives itself
along, and searches find that. Gaits are played for 32,000 time steps; after the first 8,000 whole cycles count, of
which the slower half tells the speed, so that a gait that lurches once does not win. No search was tuned.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Arm, Contest, Entry, Point, of_kind
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, check_runs, write_json
from optim.experiments.study import Count, Settings, Study, some_of
from optim.experiments.tables import Record, cell, column, markdown, page, read_records, select, write_records
from optim.measures.statistics import effect, holm, known_mean, mann_whitney
from optim.problem import Request, evaluate_request
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import read_history
from robots.calibration import Properties
from robots.inflatable import simulation
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import load_design, save_design
from robots.inflatable.timing import Counting
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, positive
from taichi_sim.base.files import write_text

NAME = "inflatable-gradients"
FLAT, HILL, BOTH = "flat", "hill", "both"
WORLDS = {FLAT: (Terrain(),), HILL: (Terrain(15.0),), BOTH: (Terrain(), Terrain(15.0))}
SHARES = {FLAT: 1.0, HILL: 0.5, BOTH: 1.0}  # of the budget: on the hill alone hardly any random gait moves
MORE = ("core", "pace", "friction", "modulus", "size")
FASTER = 4.0  # than the published inflation
STEPS, WARM_UP, STAGES = 32_000, 8_000, 2  # of gaits
NOISE = 1e-6  # of a replay's start [m]
ABOUT = ("seconds", "geometry", "seeds", "variables")  # what a report says of all runs
TABLES = ("runs.csv", "curves.csv")
FILES = ("table.md", *TABLES, "summary.json", "runs", "gaits")
SIZE = 8  # members of populations, and climbers without gradients
FEW = 2  # that follow gradients, which cost more


@dataclass(frozen=True)
class GaitArm(Arm):
    """A search of the comparison.

    Attributes:
        relaxed: how the problem judges relaxed gaits for it.
        worlds: where it runs.
    """

    relaxed: Mapping[str, Any] = field(default_factory=dict)
    worlds: tuple[str, ...] = (FLAT, HILL, BOTH)


_ASCENT = {"climbers": 1, "candidates": SIZE, "learning_rate": 0.1, "verify": True}
_LAST: Mapping[str, Any] = {"window": 1}
ARMS = {
    "random": GaitArm("random", "random", {"climbers": SIZE}),
    "hill-climb": GaitArm("hill climbing", "hill-climb", {"climbers": SIZE}),
    "genetic": GaitArm("genetic", "genetic", {"population": SIZE}),
    "de": GaitArm("differential evolution", "de", {"population": SIZE}),
    "cma": GaitArm("CMA-ES", "cma", {"population": SIZE}),
    "nes": GaitArm("NES", "nes", {"population": SIZE}),
    "gradient": GaitArm("gradient", "gradient", _ASCENT, relaxed=_LAST),
    "gradient-hill-climb": GaitArm(
        "gradient hill climbing", "gradient-hill-climb", {"climbers": FEW, "blind": "mutate"}, relaxed=_LAST
    ),
    "memetic": GaitArm("memetic", "memetic", {"population": SIZE, "refine": FEW, "every": 3}, relaxed=_LAST),
    "cma-gradient": GaitArm("CMA-ES led by gradients", "cma-gradient", {"population": SIZE}, relaxed=_LAST),
    "gradient-whole": GaitArm("gradient of the whole way", "gradient", _ASCENT, worlds=(FLAT,)),
    "gradient-draws": GaitArm(
        "gradient, mean of 2 draws",
        "gradient",
        {**_ASCENT, "candidates": SIZE // 2},
        relaxed={**_LAST, "draws": 2, "noise": 1e-5, "friction_spread": 0.3},
        worlds=(FLAT,),
    ),
    "gradient-gentle": GaitArm(
        "gradient from flat ground to the hill",
        "gradient",
        {**_ASCENT, "stage": 2},
        relaxed={**_LAST, "gentle": 8.0},
        worlds=(HILL,),
    ),
}


MAIN = tuple(name for name, arm in ARMS.items() if arm.worlds == tuple(WORLDS))  # the others are variants of these


@dataclass(frozen=True)
class Comparison(Settings):
    """How large the comparison is.

    Attributes:
        seconds: of CPU time for a run on flat ground, and in proportion elsewhere, see ``SHARES``.
        seeds: runs of every search.
        starts: replays of what a run has found.
        columns: of the gaits.
        geometry: of the body.
        worlds: of ``WORLDS``.
        arms: of ``ARMS``.
    """

    seconds: Annotated[float, positive] = 12.0
    seeds: Count = 5
    starts: Count = 3
    columns: Count = 3
    geometry: Annotated[str, partial(choice, names=NAMED_GEOMETRIES)] = "small-closed"
    worlds: Annotated[tuple[str, ...], partial(some_of, names=WORLDS)] = tuple(WORLDS)
    arms: Annotated[tuple[str, ...], partial(some_of, names=ARMS)] = MAIN

    @property
    def runs(self) -> list[tuple[str, str, int]]:
        """World, search and seed of every run, world by world, and there seed by seed."""
        pairs = [(world, seed) for world in self.worlds for seed in range(self.seeds)]
        return [(world, arm, seed) for world, seed in pairs for arm in self.arms if world in ARMS[arm].worlds]

    @property
    def about(self) -> dict[str, Any]:
        """What a report says of all runs."""
        told = (self.seconds, self.geometry, self.seeds, self.problem(FLAT, "random").space.size)
        return dict(zip(ABOUT, told, strict=True))

    def problem(self, world: str, arm: str, **more: Any) -> GaitProblem:
        """What a search designs in a world."""
        body = NAMED_GEOMETRIES[self.geometry]
        published = Properties.of(body)
        rig = dataclasses.replace(published, inflation_rate=FASTER * published.inflation_rate)
        timing = {"steps": STEPS, "warm_up": WARM_UP, "stages": STAGES}
        settings: dict[str, Any] = {**timing, "threads": 1, **ARMS[arm].relaxed, **more}
        return GaitProblem(
            WORLDS[world],
            pressure=0.0,
            columns=self.columns,
            encoding="graded",
            more=MORE,
            geometry=self.geometry,
            properties=rig,
            **settings,
        )

    def contest(self, world: str, folder: Path) -> Contest:
        """The searches in a world."""
        arms = {name: ARMS[name] for name in self.arms if world in ARMS[name].worlds}
        entries = {
            name: Entry(partial(self.problem, world, name), arm.method, arm.settings) for name, arm in arms.items()
        }
        return Contest(entries, "cpu", SHARES[world] * self.seconds, folder / "runs" / world, lambda line: None)


def study(folder: Path, settings: Comparison, progress: Progress = None, jobs: int = 1, **compute: Any) -> None:
    """Write runs, the best gait of each, tables, and what follows from them; runs go on where they ended."""
    check_runs(folder, NAME, TABLES, FILES, settings.lasting("seconds", "seeds", "worlds", "arms"))
    tasks = [("-".join(map(str, run)), partial(_task, folder, settings, run)) for run in settings.runs]
    run_parallel(tasks, jobs, compute, progress and part_of(progress, 0, 10, 9))
    rows, curves = list[Record](), list[Record]()
    for number, (run, (_, task)) in enumerate(zip(settings.runs, tasks, strict=True)):
        task(compute, None)
        row, curve = _found(folder, settings, *run)
        rows.append(row)
        curves.extend(curve)
        if progress:
            progress((number + 1) / len(tasks))
        if number + 1 == len(tasks) or settings.runs[number + 1][2] != run[2]:  # what there is so far is of use
            write_records(folder / TABLES[0], rows)
            write_records(folder / TABLES[1], curves)
            _report(folder, settings.about, rows, curves)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and ``table.md`` from the tables of runs and their courses."""
    about: dict[str, Kind] = {"world": tuple(WORLDS), "search": tuple(ARMS), "seed": int}
    rows = data.records(TABLES[0], {**about, "evaluations": int, "score": float | None, "speed": float})
    curves = data.records(TABLES[1], {**about, "cpu": float, "best": float | None})

    def about_all(summary: Mapping[str, Any]) -> dict[str, Any]:
        return {**{name: summary[name] for name in ABOUT}, "seconds": positive("seconds", summary["seconds"])}

    _report(folder, data.from_summary(about_all), rows, curves)


def _warm_up(settings: Comparison, gradients: bool) -> None:
    """Have kernels ready before the clock of a search starts; replays in another precision put them away."""
    problem = settings.problem(FLAT, "random", steps=1, warm_up=0, stages=1)
    point = problem.space.relaxed().low[None]
    evaluate_request(problem, Request(point))
    if gradients:
        evaluate_request(problem, Request(point, "gradients"))


def _task(
    folder: Path, settings: Comparison, run: tuple[str, str, int], compute: Mapping[str, Any], progress: Progress
) -> None:
    """Run a search, and replay what it has found, if that is not done."""
    world, name, seed = run
    path, kept = _gait(folder, *run), _gait(folder, *run).with_suffix(".csv")
    budget = settings.contest(world, folder).budget
    if kept.exists() and read_records(kept)[0].get("budget") == budget:
        return
    _warm_up(settings, ARMS[name].gradients)
    contest = settings.contest(world, folder)
    contest.run_one(name, seed)
    end, problem = contest.last_within(name, seed, contest.budget) or 0, settings.problem(world, name)
    best = read_history(contest.folder(name, seed)).generations[end].best_point
    path.parent.mkdir(parents=True, exist_ok=True)
    if best is None:
        save_design(problem.design(problem.space.low), path)
    else:
        save_design(problem.design(problem.space.from_dict(best)), path)
    speeds = replayed(problem, path, settings.starts)
    columns = [terrain.name for terrain in problem.terrains]
    write_records(kept, [{"budget": budget, **dict(zip(columns, row, strict=True))} for row in speeds.T.tolist()])


def _gait(folder: Path, world: str, name: str, seed: int) -> Path:
    return folder / "gaits" / f"{world}-{name}-{seed}.json"


def replayed(problem: GaitProblem, path: Path, starts: int) -> Floats:
    """Speeds of a gait in a file, in double precision, from noisy starts on every terrain, shape (terrains, starts).

    A robot that diverges counts as one that does not move.
    """
    design = load_design(path)
    exact = dataclasses.replace(problem, precision="f64", threads=1)
    found = [
        exact.speeds(
            simulation.simulate(
                [design] * starts,
                terrain,
                geometry=exact.body,
                actuation=exact.actuation,
                counting=Counting(exact.warm_up, exact.stages),
                perturbation=NOISE,
                **exact.compute.options,
            )
        )
        for terrain in exact.terrains
    ]
    return np.nan_to_num(np.array(found))


def _found(folder: Path, settings: Comparison, world: str, name: str, seed: int) -> tuple[Record, list[Record]]:
    """What a run has found, and its course."""
    contest = settings.contest(world, folder)
    curve, end = contest.curve(name, seed), contest.last_within(name, seed, contest.budget) or 0
    records = read_records(_gait(folder, world, name, seed).with_suffix(".csv"))
    speeds = np.mean([column(records, terrain.name) for terrain in WORLDS[world]], axis=0)
    about = {"world": world, "search": name, "seed": seed}
    row = {
        **about,
        "evaluations": curve[end]["evaluations"],
        "cpu_s": round(curve[end]["cpu"], 3),
        "score": curve[end]["best"],
        "speed": float(np.median(speeds)),
        "slowest": float(speeds.min()),
        "fastest": float(speeds.max()),
    }
    return row, [{**about, **_rounded(point)} for point in curve[: end + 1]]


def _rounded(point: Point) -> Record:
    return {**point, "cpu": round(point["cpu"], 3)}


def _report(folder: Path, about: Mapping[str, Any], rows: Sequence[Record], curves: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the tables and what is ``about`` all runs."""
    budgets = {world: SHARES[world] * about["seconds"] for world in WORLDS if select(rows, world=world)}
    summary = {
        world: _summary(select(rows, world=world), select(curves, world=world), budget)
        for world, budget in budgets.items()
    }
    write_json(folder / "summary.json", {**about, "worlds": summary})
    write_text(
        folder / "table.md",
        page(*(part for world in budgets for part in _tables(world, summary[world], budgets[world]))),
    )


PARTS = (0.25, 0.5, 0.75, 1.0)  # of the budget, at which the best of both kinds are compared


def _summary(rows: Sequence[Record], curves: Sequence[Record], budget: float) -> dict[str, Any]:
    """Searches of a world, and the best of those with gradients beside the best without; the budget is CPU time [s]."""
    speeds = {name: column(select(rows, search=name), "speed") for name in ARMS if select(rows, search=name)}
    searches = {name: _search(speeds[name], select(rows, search=name)) for name in speeds}
    courses = {
        name: [_course(select(curves, search=name, seed=seed), budget) for seed in seeds]
        for name in speeds
        if (seeds := [row["seed"] for row in select(rows, search=name)])
    }
    for name, each in courses.items():
        searches[name]["course"] = [_finite(value) for value in np.median(np.array(each), axis=0)]
    best = {
        kind: max(of_kind(ARMS, speeds, kind), key=lambda n: searches[n]["median"], default="")
        for kind in (True, False)
    }
    found: dict[str, Any] = {"searches": searches}
    if best[True] and best[False]:
        free = of_kind(ARMS, speeds, False)
        tests = {name: mann_whitney(speeds[best[True]], speeds[name], "two-sided", "exact") for name in free}
        apart = effect(speeds[best[False]], speeds[best[True]])
        adjusted = dict(zip(tests, holm(list(tests.values())), strict=True))
        found |= {
            "best_with_gradients": best[True],
            "best_without": best[False],
            "difference": apart.difference,
            "interval": [apart.low, apart.high],
            "p_adjusted": adjusted,
        }
    return found


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _course(points: Sequence[Record], budget: float) -> list[float]:
    """The best score after parts of the budget; NaN before the first generation has ended."""
    return [
        next((_number(point["best"]) for point in reversed(points) if point["cpu"] <= part * budget), np.nan)
        for part in PARTS
    ]


def _search(speeds: Floats, rows: Sequence[Record]) -> dict[str, Any]:
    return {
        "label": ARMS[rows[0]["search"]].label,
        "seeds": len(speeds),
        "median": float(np.median(speeds)),
        **known_mean(speeds),
        "each": speeds.tolist(),
        "score": _finite(float(np.median(column(rows, "score")))),
        "evaluations": float(np.median(column(rows, "evaluations"))),
    }


def _tables(world: str, summary: Mapping[str, Any], seconds: float) -> list[str | list[str]]:
    """A table of the searches of a world, the fastest first, and what follows from it."""
    lines = []
    for name, each in sorted(summary["searches"].items(), key=lambda item: -item[1]["median"]):
        interval = f"{cell(each['low'], '.3f')} to {cell(each['high'], '.3f')}"
        course = ", ".join(cell(value, ".3f") for value in each["course"])
        told = ", ".join(f"{speed:.3f}" for speed in each["each"])
        mark = f"**{each['label']}**" if ARMS[name].gradients else each["label"]
        lines.append((mark, f"{each['evaluations']:.0f}", course, f"{each['median']:.3f}", interval, told))
    parts = ", ".join(f"{part:.0%}".replace("%", " %") for part in PARTS)
    header = ("search", "evaluations", f"score after {parts}", "median", "95 % interval of the mean", "each seed")
    found: list[str | list[str]] = [f"{world}, {seconds:g} s of CPU time a run:", markdown(header, "lrrrrr", lines)]
    if "difference" in summary:
        labels = {name: each["label"] for name, each in summary["searches"].items()}
        low, high = summary["interval"]
        found.append(
            f"Best with gradients, {labels[summary['best_with_gradients']]}, less best without, "
            f"{labels[summary['best_without']]}: {summary['difference']:+.3f} BL/s in the mean, 95 % interval "
            f"{low:+.3f} to {high:+.3f}."
        )
    return found


STUDY = Study(
    title="the inflatable robot with a hundred variables: gradients and hybrids beside gradient-free searches",
    source="beyond chapter 5",
    scales={
        "small": Comparison(seconds=4.0, seeds=2, starts=2, columns=1, worlds=(FLAT,), arms=("random", "gradient")),
        "medium": Comparison(seconds=36.0, arms=("nes", "genetic", "hill-climb", "gradient", "memetic")),
        "full": Comparison(seconds=600.0, arms=tuple(ARMS)),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES[:4],
    cost="a day of one core; medium takes an hour",
)
