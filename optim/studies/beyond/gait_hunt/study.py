"""Which search finds a gait that climbs 15 degrees, without knowledge of one: five seeds each, at equal cost.

The dissertation's search did not find inching on the hill, "likely due to a lack of gradient between control policies"
(Powers 2021, ch. 5, "Discussion"). All searches may change orientation, shape and control. A run ends when it has
spent as many robot-steps as the published search takes for so many evaluations; a generation that ended beyond does not
count. When all have ended, the last few designs that each found best are played in full, with noise, under both
conditions of ``robots.inflatable.robustness``, and the best of them is what the run has found.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.comparison import differences, table_of_differences
from optim.experiments.figures import COLOURS, PAGE, figure, letter
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Budget, Progress, check_folder, check_tables, part_of, tables_alone, write_json
from optim.experiments.study import Study
from optim.experiments.tables import markdown, read_records, write_records
from optim.measures.statistics import mean_interval
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import History
from optim.studies.beyond.gait_hunt.finalists import (
    Finalist,
    Finals,
    best_of,
    cached_finalists,
    check_seeds,
    columns_of,
    write_gaits,
)
from optim.studies.beyond.gait_hunt.searches import SEARCHES
from optim.studies.beyond.gait_hunt.spending import PUBLISHED_COST, paid, read_spent, search_within
from robots.inflatable.robustness import LEAST_HARD_SPEED
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import nearest
from taichi_sim.base.files import write_text

Record = Mapping[str, Any]
TABLES = ("table.csv", "generations.csv")  # what the summary, the page and the figure are made from
FILES = (*TABLES, "runs", "gaits", "summary.json", "table.md", "hunt.png")


@dataclass(frozen=True)
class Hunt(Finals):
    """How large the study is.

    Attributes:
        evaluations: published evaluations that a run may cost.
        seeds: of the runs of each search.
        searches: names in ``SEARCHES``.
    """

    evaluations: float
    seeds: tuple[int, ...]
    searches: tuple[str, ...] = tuple(SEARCHES)

    def __post_init__(self) -> None:
        if not 0 < self.evaluations < math.inf:
            raise ValueError(f"evaluations: {self.evaluations!r} is not allowed; give a number above 0")
        if not self.searches or len(set(self.searches)) < len(self.searches):
            raise ValueError(f"searches: {', '.join(self.searches) or 'none'} given; give at least one, and none twice")
        for name in self.searches:
            if name not in SEARCHES:
                known = ", ".join(SEARCHES)
                raise ValueError(f"searches: {name!r} is unknown; choose of {known}{nearest(name, SEARCHES)}")
        check_seeds(self.seeds)
        super().__post_init__()

    @property
    def budget(self) -> float:
        """Robot-steps of a run."""
        return self.evaluations * PUBLISHED_COST


SCALES: Mapping[Budget, Hunt] = {
    "small": Hunt(20, (0, 1), ("hill-climb", "genetic", "gradient", "ladder"), geometry="small", finalists=2, runs=2),
    "medium": Hunt(160, (0, 1, 2, 3, 4), finalists=2, runs=3),
    "full": Hunt(300, (0, 1, 2, 3, 4)),
}


@dataclass(frozen=True, eq=False)
class Found:
    """The course of a run, and the best gait that it found.

    Attributes:
        search: its name.
        seed: of the run.
        history: of the run.
        spent: by each generation [robot-steps], shape (G,).
        best: the best of its finalists; None before they are judged, and if all failed.
    """

    search: str
    seed: int
    history: History
    spent: Floats
    best: Finalist | None = None


def study(folder: Path, settings: Hunt, progress: Progress = None, jobs: int = 1, **where: Any) -> None:
    """Write runs, tables, ``summary.json``, ``hunt.png``, and the best gait of each run.

    Where the folder holds the tables alone, the rest is made from them.

    Args:
        folder, settings, progress: see :class:`optim.experiments.study.Study`.
        jobs: runs that go on at the same time, each in a process of its own.
        where: precision, device and threads of the simulations.
    """
    check_folder(folder, FILES, "gait-hunt")
    searches = settings.searches
    if tables_alone(folder, "runs", TABLES):
        check_tables(folder, {"budget": settings.budget, "slope": settings.slope})
        write_reports(folder, settings, *(read_records(folder / name) for name in TABLES))
        return
    parts, found = [(name, seed) for seed in settings.seeds for name in searches], {}
    tasks = [(f"{name}-{seed}", partial(_search, folder, settings, name, seed)) for name, seed in parts]
    run_parallel(tasks, jobs, where, part_of(progress, 0, 10, 9))
    judged = [folder / "runs" / f"{name}.json" for name in searches]
    for number, (name, seed) in enumerate(parts):
        share = part_of(progress, 9 * number, 10 * len(parts), 9)
        found[name, seed] = _search(folder, settings, name, seed, where, share)
        if name == searches[-1] and jobs == 1 and not any(path.exists() for path in judged):
            report(folder, settings, list(found.values()))  # what there is so far is of use
    for number, (name, path) in enumerate(zip(searches, judged, strict=True)):
        of = [(name, seed) for seed in settings.seeds]
        histories, problem = [found[part].history for part in of], _problem(settings, name, where)
        share = part_of(progress, 9 * len(searches) + number, 10 * len(searches))
        finalists = cached_finalists(path, histories, problem, settings, share, **where)
        found |= {part: replace(found[part], best=best_of(known)) for part, known in zip(of, finalists, strict=True)}
        report(folder, settings, list(found.values()))
    if progress:
        progress(1.0)


def _problem(hunt: Hunt, name: str, where: Mapping[str, Any]) -> GaitProblem:
    return SEARCHES[name].problem_on(hunt.terrain, geometry=hunt.geometry, **where)


def _search(folder: Path, hunt: Hunt, name: str, seed: int, where: Mapping[str, Any], progress: Progress) -> Found:
    """One run; its finalists come later."""
    path, problem = folder / "runs" / f"{name}-{seed}", _problem(hunt, name, where)
    settings = {**SEARCHES[name].settings, "seed": seed}
    history = search_within(problem, SEARCHES[name].method, settings, path, hunt.budget, progress)
    spent = read_spent(path)
    history = paid(history, spent, hunt.budget)
    return Found(name, seed, history, np.array(spent[: len(history.generations)]))


def report(folder: Path, hunt: Hunt, found: Sequence[Found]) -> None:
    """Write what some runs have found: tables, what follows from them, and gaits."""
    rows, generations = [_row(one) for one in found], [row for one in found for row in _generations(one)]
    for name, records in zip(TABLES, (rows, generations), strict=True):
        write_records(folder / name, records)
    write_reports(folder, hunt, rows, generations)
    write_gaits(folder / "gaits", {f"{one.search}-{one.seed}": one.best for one in found})


def write_reports(folder: Path, hunt: Hunt, rows: Sequence[Record], generations: Sequence[Record]) -> None:
    """Write ``summary.json``, ``table.md`` and ``hunt.png``, all that follows from the tables.

    Args:
        folder: takes the files.
        hunt: the settings of the study.
        rows: the records of ``table.csv``, one of each run.
        generations: the records of ``generations.csv``, one of each generation of each run.
    """
    every = {name: [row for row in rows if row["search"] == name] for name in hunt.searches}
    groups = {name: group for name, group in every.items() if group}
    summary = {name: _group(name, group) for name, group in groups.items()}
    first = [row for row in generations if row["generation"] == 0]
    starts = {name: [row["mean"] for row in first if row["search"] == name] for name in groups}
    apart = differences({name: _speeds(group) for name, group in groups.items()}, starts)
    found = {"searches": summary, "differences": apart, "runs": rows}
    write_json(folder / "summary.json", {"budget": hunt.budget, "slope": hunt.slope, **found})
    labels = {name: row["label"] for name, row in summary.items()}
    write_text(folder / "table.md", _table(summary) + ("\n" + table_of_differences(apart, labels) if apart else ""))
    _draw(groups, generations, folder / "hunt.png")


def _row(one: Found) -> dict[str, Any]:
    """The row of a run in ``table.csv``."""
    last = one.history.generations[-1]
    return {
        "search": one.search,
        "seed": one.seed,
        "evaluations": last.evaluations,
        "robot_steps": float(one.spent.sum()),
        "wall_s": float(np.nansum(one.history.seconds)),
        "score": last.best,
        **columns_of(one.best),
    }


def _generations(one: Found) -> list[dict[str, Any]]:
    """The generations of a run, rows of ``generations.csv``."""
    rows = []
    for each, spent in zip(one.history.generations, one.spent.tolist(), strict=True):
        effort = {"generation": each.generation, "evaluations": each.evaluations, "robot_steps": spent}
        rows.append({"search": one.search, "seed": one.seed, **effort, "mean": each.mean, "best": each.best})
    return rows


def _speeds(group: Sequence[Record], name: str = "speed") -> Floats:
    """Speeds of what the runs have found; NaN where that is nothing."""
    return np.array([row[name] for row in group], float)


def _group(name: str, group: Sequence[Record]) -> dict[str, Any]:
    """Runs of a search: mean speed of what they have found with its 95 % interval by Student's t, and the best."""
    known = [row for row in group if row["speed"] is not None]
    speeds, hard = (_speeds(known, name) for name in ("speed", "hard_speed"))
    low, high = mean_interval(speeds) if len(speeds) > 1 else (None, None)
    return {
        "label": SEARCHES[name].label,
        "runs": len(group),
        "judged": len(known),
        "evaluations": int(np.median([row["evaluations"] for row in group])),
        "robot_steps": float(np.median([row["robot_steps"] for row in group])),
        "speed": float(speeds.mean()) if len(speeds) else None,
        "low": low,
        "high": high,
        "best": float(speeds.max()) if len(speeds) else None,
        "hard_speed": float(hard.mean()) if len(hard) else None,
        "staying": int((hard >= LEAST_HARD_SPEED).sum()) if known else None,
    }


def _table(summary: dict[str, dict[str, Any]]) -> str:
    """The searches in Markdown; evaluations and robot-steps are medians of runs, speeds those of runs with a gait."""
    cells = []
    for row in summary.values():
        values = (
            "" if row[name] is None else f"{row[name]:.4f}" for name in ("speed", "low", "high", "best", "hard_speed")
        )
        speed, low, high, *others = values
        runs = str(row["runs"]) if row["judged"] in (0, row["runs"]) else f"{row['judged']} of {row['runs']}"
        effort = row["label"], row["evaluations"], f"{row['robot_steps'] / 1e6:.1f}", runs
        staying = "" if row["staying"] is None else row["staying"]
        cells.append((*effort, speed, f"{low} to {high}" if low else "", *others, staying))
    header = ("search", "evaluations", "million robot-steps", "runs", "speed, mean", "interval", "best", "harder")
    return "\n".join(markdown((*header, "these, stay"), "lrrrrrrrr", cells)) + "\n"


LINEAR = 0.01  # speeds up to which the figure's axis is linear [BL/s]


def _draw(groups: Mapping[str, Sequence[Record]], generations: Sequence[Record], path: Path) -> None:
    """Best scores over what was spent, each by its search's own rule, and what the runs have found in the end."""
    with figure(path, PAGE, 3.0, ncols=2) as (_, panels):
        over, end = panels[0]
        for place, ((name, group), colour) in enumerate(zip(groups.items(), COLOURS, strict=False)):
            for seed in (row["seed"] for row in group):
                mine = [row for row in generations if (row["search"], row["seed"]) == (name, seed)]
                style = "--" if SEARCHES[name].rungs else "-"  # scores of ladders count easier slopes
                spent, scores = (np.array([row[key] for row in mine], float) for key in ("robot_steps", "best"))
                over.step(np.cumsum(spent) / 1e6, scores, where="post", color=colour, lw=0.8, ls=style)
            known = [row for row in group if row["speed"] is not None]
            for value, marker in (("speed", "o"), ("hard_speed", "x")):
                end.plot(_speeds(known, value), [place] * len(known), marker, color=colour, ms=5, fillstyle="none")
        over.set(xlabel="spent [million robot-steps]", ylabel="best so far, by own score [BL/s]")
        end.axvline(0.0, color="0.7", linewidth=0.6)
        # What slides down may be tens of times as fast as what climbs.
        end.set_xscale("symlog", linthresh=LINEAR, linscale=2)
        ticks = (-1, -0.1, -0.01, 0, 0.01)
        end.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        end.xaxis.minorticks_off()
        end.set_yticks(range(len(groups)), [SEARCHES[name].label for name in groups])
        end.set_xlabel("speed in full, o usual, x harder [BL/s]")
        for label, colour in zip(end.get_yticklabels(), COLOURS, strict=False):
            label.set_color(colour)  # they are the legend of both panels
        end.invert_yaxis()
        letter(panels)


STUDY = Study(
    title="evolution as published, on cycles, along gradients and both: gaits that climb 15 degrees, at equal cost",
    source="chapter 5, discussion: why the search did not find inching on the hill",
    scales=SCALES,
    run=study,
    writes=("table.md", "table.csv", "generations.csv", "hunt.png", "summary.json", "runs", "gaits"),
    cost="20 h of CPU time",
)
