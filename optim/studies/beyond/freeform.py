"""Freeform robots: gradients beside gradient-free searches, at equal CPU time, from 48 to 3,000 variables.

Blocks whose cells each have a muscle of their own amplitude and phase; grids whose cells may also be missing or of
another tissue. All searches begin at random. A run counts the design that was best when its CPU time was used up: it is
written as a file, read again, and moves in double precision from several noisy starts; its speed is their median, in
lengths of the grid per second. Settings of all methods were chosen on another block, ``"tuning"``, with equal CPU time
(``benchmarks/freeform_tuning.py``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Contest, Entry, Point, of_kind
from optim.experiments.figures import COLOURS, COLUMN, figure, logarithmic
from optim.experiments.jobs import run_parallel
from optim.experiments.judged_runs import warm_up
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Count, Settings, Study, some_of
from optim.experiments.tables import Record, between, cell, column, distinct, markdown, page, select, write_records
from optim.measures.statistics import known_mean, ratio_of_means
from optim.problems.robot import RobotProblem
from optim.runs.history import read_history
from optim.studies.beyond.freeform_kept import kept_speeds, kept_table
from optim.studies.beyond.freeform_problems import ARMS, PROBLEMS
from robots.lattice_robot import load_robot
from robots.lattice_robot.robustness import trust_in
from robots.robot import part_of
from taichi_sim.base.checks import positive, shown
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text

NAME = "freeform"
TABLES = {"run": "runs.csv", "curve": "curves.csv", "trials": "trials.csv"}  # by what they hold of each run
COLUMNS: dict[str, dict[str, Kind]] = {  # of each, beside those that tell the run
    "run": {"seconds": float, "evaluations": int, "score": float | None, "speed": float, "kept": float | None},
    "curve": {"cpu_s": float, "evaluations": int, "best": float | None},
    "trials": {"seconds": float, "trial": str, "speed": float},
}
FIGURE = "advantage.png"
FILES = ("table.md", *TABLES.values(), "summary.json", FIGURE, "runs", "designs")
EXACT = Compute(precision="f64", threads=1)
CURVE = 40  # points of a curve in the table, at most


FIRST_ARMS = ("race", "race-quick", "genetic", "hill-climb", "nes", "cma")


def _times(field_name: str, value: Any) -> tuple[float, ...]:
    """Ascending multiples of the time of a run."""
    times = tuple(positive(field_name, each) for each in value) if isinstance(value, list | tuple) else ()
    if not times or list(times) != sorted(set(times)):
        raise ValueError(f"{field_name}: {shown(value)} is not allowed; give ascending numbers, one or more")
    return times


@dataclass(frozen=True)
class Comparison(Settings):
    """How large the comparison is.

    Attributes:
        share: of the CPU time of each problem.
        times: multiples of that time at which designs are judged, ascending.
        seeds: runs of every search.
        problems: of ``PROBLEMS``.
        arms: of ``ARMS``.
    """

    share: Annotated[float, positive] = 1.0
    times: Annotated[tuple[float, ...], _times] = (1.0, 4.0)
    seeds: Count = 5
    problems: Annotated[tuple[str, ...], partial(some_of, names=PROBLEMS)] = ("ground-288", "ground-960", "water-288")
    arms: Annotated[tuple[str, ...], partial(some_of, names=ARMS)] = FIRST_ARMS

    @property
    def runs(self) -> list[tuple[str, str, int]]:
        """Problem, search and seed of every run, seed by seed."""
        return [(p, arm, seed) for seed in range(self.seeds) for p in self.problems for arm in self.arms]

    def marks(self, problem: str) -> list[float]:
        """CPU times at which designs are judged [s]."""
        return [self.share * times * PROBLEMS[problem].seconds for times in self.times]

    def has_rows(self, run: tuple[str, str, int], rows: Sequence[Record]) -> bool:
        """Whether rows tell what a run had found at every time."""
        problem, arm, seed = run
        known = {row["seconds"] for row in select(rows, problem=problem, search=arm, seed=seed)}
        return known >= set(self.marks(problem))

    def contest(self, problem: str, folder: Path) -> Contest:
        """The searches of a problem, up to the last time."""
        entries = {
            name: Entry(partial(designed, problem), ARMS[name].method, ARMS[name].settings) for name in self.arms
        }
        seconds = self.share * self.times[-1] * PROBLEMS[problem].seconds
        return Contest(entries, "cpu", seconds, folder / "runs" / problem, lambda line: None)


def designed(name: str) -> RobotProblem:
    """A problem by its name, for one thread in single precision."""
    problem = PROBLEMS[name]
    return RobotProblem(problem.robot, (problem.terrain,), precision="f32", threads=1)


def study(folder: Path, settings: Comparison, progress: Progress = None, jobs: int = 1, **compute: Any) -> None:
    """Write what runs have found, tables, and what follows from them; runs go on where they ended.

    Runs that are whole in the tables of the folder are not run again.
    """
    check_folder(folder, FILES, NAME)
    known = [_read(folder / name, what) if (folder / name).exists() else [] for what, name in TABLES.items()]
    missing = [run for run in settings.runs if not settings.has_rows(run, known[0])]
    tasks = [("-".join(map(str, run)), partial(_task, folder, settings, run)) for run in missing]
    run_parallel(tasks, jobs, compute, progress and part_of(progress, 0, 10, 9))
    for number, (run, (_, task)) in enumerate(zip(missing, tasks, strict=True)):
        task(compute, None)
        about = dict(zip(("problem", "search", "seed"), run, strict=True))
        for place, what in enumerate(TABLES):
            others = [row for row in known[place] if any(row[name] != value for name, value in about.items())]
            known[place] = others + _read(_kept(folder, *run, what), what)
        for name, records in zip(TABLES.values(), known, strict=True):  # what there is so far is of use
            write_records(folder / name, records)
        if progress:
            progress((number + 1) / len(tasks))
    _report(folder, settings.share, known[0], known[2])


def rewrite(data: Data, folder: Path) -> None:
    """Write the tables of all problems, and ``summary.json``, from the tables of runs and of trials."""
    share = data.from_summary(lambda summary: positive("share", summary["share"]))
    rows, trials = (_read(data.folder / TABLES[what], what) for what in ("run", "trials"))
    _report(folder, share, rows, trials)


def _read(path: Path, what: str) -> list[Record]:
    """Read a table of what runs have found; raises ValueError if it cannot be one."""
    about: dict[str, Kind] = {"problem": tuple(PROBLEMS), "search": tuple(ARMS), "seed": int}
    numbers = [name for name, kind in COLUMNS[what].items() if kind is not str]
    return Data(path.parent).records(path.name, about | COLUMNS[what], finite=numbers, may_be_empty=what == "curve")


def _kept(folder: Path, problem: str, arm: str, seed: int, what: str = "run") -> Path:
    """Where what follows from a run is kept."""
    return folder / "designs" / f"{problem}-{arm}-{seed}-{what}.csv"


def _task(
    folder: Path, settings: Comparison, run: tuple[str, str, int], compute: Mapping[str, Any], progress: Progress
) -> None:
    """Run a search, and judge what it had found at each time, if that is not done."""
    problem, name, seed = run
    kept, contest = _kept(folder, *run), settings.contest(problem, folder)
    if kept.exists() and settings.has_rows(run, _read(kept, "run")):
        return
    warm_up(contest.entries[name].problem(), ARMS[name].gradients)
    contest.run_one(name, seed)
    kept.parent.mkdir(parents=True, exist_ok=True)
    rows, trials = list[Record](), list[Record]()
    for seconds in settings.marks(problem):
        row, found = _found(folder, contest, run, seconds)
        rows.append(row)
        trials += found
    write_records(_kept(folder, *run, "trials"), trials)
    write_records(_kept(folder, *run, "curve"), _curve(contest, *run))
    write_records(kept, rows)


def _found(folder: Path, contest: Contest, run: tuple[str, str, int], seconds: float) -> tuple[Record, list[Record]]:
    """What a run had found when its CPU time was used up, judged, and the single trials of the judgement."""
    problem, name, seed = run
    points, last = contest.curve(name, seed), contest.last_within(name, seed, seconds)
    about: Record = {"problem": problem, "search": name, "seed": seed, "seconds": seconds}
    row = {
        **about,
        "evaluations": 0 if last is None else points[last]["evaluations"],
        "score": None if last is None else points[last]["best"],
    }
    best = None if last is None else read_history(contest.folder(name, seed)).generations[last].best_point
    if best is None:
        return {**row, "speed": 0.0, "kept": None}, [{**about, "trial": "none", "speed": 0.0}]
    path = folder / "designs" / f"{problem}-{name}-{seed}-{seconds:g}.json"
    made = designed(problem)
    made.save(made.space.from_dict(best), path)
    trust = trust_in(load_robot(path), PROBLEMS[problem].terrain, compute=EXACT)
    trials = [*(("start", speed) for speed in trust.speeds.tolist()), *trust.changed.items()]
    kept = trust.kept if trust.speed > 0 else None
    return {**row, "speed": trust.speed, "kept": kept}, [{**about, "trial": k, "speed": speed} for k, speed in trials]


def _curve(contest: Contest, problem: str, name: str, seed: int) -> list[Record]:
    """The course of a run: some of its generations, evenly, and the last."""
    points = contest.curve(name, seed)
    every = max(1, -(-len(points) // CURVE))
    chosen: list[Point] = [p for n, p in enumerate(points) if n % every == 0 or n == len(points) - 1]
    about = {"problem": problem, "search": name, "seed": seed}
    return [{**about, "cpu_s": round(p["cpu"], 2), "evaluations": p["evaluations"], "best": p["best"]} for p in chosen]


def _report(folder: Path, share: float, rows: Sequence[Record], trials: Sequence[Record]) -> None:
    """Write ``summary.json``, ``table.md`` and a figure, which follow from the tables of runs and of trials."""
    found = {
        f"{problem}-{seconds:g}": _summary(select(rows, problem=problem, seconds=seconds))
        for problem in distinct(rows, "problem")
        for seconds in distinct(select(rows, problem=problem), "seconds")
    }
    kept = kept_speeds(rows, trials, of_kind(ARMS, ARMS, True))
    write_json(folder / "summary.json", {"share": share, "problems": found, "kept": kept})
    advantages = sorted((each for each in found.values() if "ratio" in each), key=_size)
    parts = [_overview(advantages)] if len(advantages) > 1 else []
    tables = (part for each in found.values() for part in _table(each))
    write_text(folder / "table.md", page(*parts, *tables, *kept_table(kept)))
    _draw(advantages, folder / FIGURE)


def _summary(rows: Sequence[Record]) -> dict[str, Any]:
    """Searches of a problem after one time, and the best with gradients over the best without."""
    problem, seconds = rows[0]["problem"], rows[0]["seconds"]
    speeds = {name: column(select(rows, search=name), "speed") for name in distinct(rows, "search")}
    searches = {name: _search(values, select(rows, search=name)) for name, values in speeds.items()}
    best = {
        kind: max(of_kind(ARMS, speeds, kind), key=lambda n: searches[n]["mean"], default="") for kind in (True, False)
    }
    found: dict[str, Any] = {"problem": problem, "seconds": seconds, "searches": searches}
    if best[True] and best[False] and len(speeds[best[False]]) > 1 and searches[best[False]]["mean"] > 0:
        ratio = ratio_of_means(speeds[best[True]], speeds[best[False]])
        found |= {"best_with_gradients": best[True], "best_without": best[False], "ratio": ratio[0]}
        found["interval"] = list(ratio[1:])
    return found


def _search(speeds: Any, rows: Sequence[Record]) -> dict[str, Any]:
    kept = [row["kept"] for row in rows if row["kept"] is not None]
    return {
        "label": ARMS[rows[0]["search"]].label,
        "seeds": len(speeds),
        **known_mean(speeds),
        "each": speeds.tolist(),
        "evaluations": float(np.median(column(rows, "evaluations"))),
        "kept": float(np.median(kept)) if kept else None,
    }


def _size(found: Mapping[str, Any]) -> tuple[bool, bool, int, float]:
    """Unusual or not, in water or not, how many variables, and how much time: the order in which problems stand."""
    problem = PROBLEMS[found["problem"]]
    return bool(problem.condition), problem.terrain.is_fluid, problem.variables, found["seconds"]


def _overview(advantages: Sequence[Mapping[str, Any]]) -> list[str]:
    """A table of the advantage of gradients in all problems."""
    lines = []
    for found in advantages:
        problem = PROBLEMS[found["problem"]]
        best = [found["searches"][found[name]] for name in ("best_with_gradients", "best_without")]
        seeds, speeds = ([each[name] for each in best] for name in ("seeds", "mean"))
        lines.append(
            (
                problem.place,
                str(problem.variables),
                f"{found['seconds']:g}",
                *(f"{each['label']} {speed:.3f}" for each, speed in zip(best, speeds, strict=True)),
                ", ".join(map(str, seeds)),
                f"**{found['ratio']:.2f}** ({between(*found['interval'])})",
            )
        )
    header = ("where", "variables", "CPU time [s]", "best with gradients", "best without", "n", "times as fast")
    return markdown(header, "lrrlllr", lines)


def _draw(advantages: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw how many times as fast gradients are over the number of variables, in usual conditions, with intervals."""
    with figure(path, 1.3 * COLUMN, 2.8) as (_, ((axes,),)):
        axes.axhline(1.0, color="0.6", linewidth=0.8)
        for water, label, colour in ((False, "on ground", COLOURS[0]), (True, "in water", COLOURS[1])):
            shown = [each for each in advantages if _size(each)[:2] == (False, water)]
            variables, ratios = [_size(each)[2] for each in shown], np.array([each["ratio"] for each in shown])
            intervals = np.reshape(np.array([each["interval"] for each in shown], float), (-1, 2)).T
            axes.errorbar(variables, ratios, np.abs(intervals - ratios), fmt="o-", color=colour, label=label, capsize=3)
        logarithmic(axes, "x")
        logarithmic(axes, "y")
        axes.set(xlabel="variables", ylabel="speed with gradients / without")
        axes.legend(loc="upper left")


def _table(found: Mapping[str, Any]) -> list[str | list[str]]:
    """A table of the searches of a problem, the fastest first, and the ratio."""
    problem = PROBLEMS[found["problem"]]
    lines = []
    for name, each in sorted(found["searches"].items(), key=lambda item: -item[1]["mean"]):
        interval = f"{cell(each['low'], '.3f')} to {cell(each['high'], '.3f')}"
        told = ", ".join(f"{speed:.3f}" for speed in each["each"])
        mark = f"**{each['label']}**" if ARMS[name].gradients else each["label"]
        kept = cell(each["kept"], ".2f")
        lines.append((mark, f"{each['evaluations']:.0f}", f"{each['mean']:.3f}", interval, told, kept))
    sides = " x ".join(map(str, problem.shape))
    header = ("search", "evaluations", "mean speed", "95 % interval", "each seed", "kept")
    how = ", ".join(filter(None, (problem.terrain.spoken, problem.condition)))
    told = f"{sides} cells {how}, {problem.variables} variables, {found['seconds']:g} s of CPU time a run:"
    parts: list[str | list[str]] = [told, markdown(header, "lrrrrr", lines)]
    if "ratio" in found:
        best = [found["searches"][found[name]] for name in ("best_with_gradients", "best_without")]
        seeds = " and ".join(str(each["seeds"]) for each in best)
        parts.append(
            f"{' over '.join(each['label'] for each in best)}: {found['ratio']:.2f} times, "
            f"95 % interval {between(*found['interval'])}, of {seeds} seeds."
        )
    return parts


STUDY = Study(
    title="freeform robots: gradients beside gradient-free searches, from 48 to 3,000 variables",
    source="beyond chapter 5",
    scales={
        "small": Comparison(
            share=0.2, times=(1.0,), seeds=2, problems=("ground-48",), arms=("race", "genetic", "hill-climb")
        ),
        "medium": Comparison(times=(1.0,)),
        "full": Comparison(problems=tuple(name for name in PROBLEMS if name != "tuning")),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES[:6],
    cost="two days of one core; medium takes three hours",
)
