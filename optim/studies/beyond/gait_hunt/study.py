"""Which search finds a gait that climbs 15 degrees, without knowledge of one: five seeds each, at equal cost.

The dissertation's search did not find inching on the hill, "likely due to a lack of gradient between control policies"
(Powers 2021, ch. 5, "Discussion"). All searches may change orientation, shape and control. A run ends when it has
spent as many robot-steps as the published search takes for so many evaluations; a generation that ended beyond does not
count. When all have ended, the last few designs that each found best are played in full, with noise, under both
conditions of ``robots.inflatable.robustness``, and the best of them is what the run has found.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.comparison import differences, table_of_differences
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress, check_runs, write_json
from optim.experiments.study import Study
from optim.experiments.tables import Record, cell, column, distinct, markdown, page, select, write_records
from optim.measures.statistics import known_mean
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import History
from optim.studies.beyond.gait_hunt.finalists import (
    FOUND,
    Finalist,
    Finals,
    Seeds,
    best_of,
    cached_finalists,
    finalist_columns,
    hill_of,
    write_gaits,
)
from optim.studies.beyond.gait_hunt.searches import PUBLISHED_COST, SEARCHES, paid, read_spent, search_within
from robots.inflatable.robustness import LEAST_HARD_SPEED
from robots.robot import part_of
from taichi_sim.base.checks import nearest, positive
from taichi_sim.base.files import write_text

TABLES = ("table.csv", "generations.csv")  # what the summary, the page and the figure are made from
FILES = ("table.md", *TABLES, "hunt.png", "summary.json", "runs", "gaits")


@dataclass(frozen=True)
class Hunt(Finals):
    """How large the study is."""

    evaluations: float  # published evaluations that a run may cost
    seeds: Seeds  # of the runs of each search
    searches: tuple[str, ...] = tuple(SEARCHES)  # names in ``SEARCHES``

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.evaluations < math.inf:
            raise ValueError(f"evaluations: {self.evaluations!r} is not allowed; give a number above 0")
        if not self.searches or len(set(self.searches)) < len(self.searches):
            raise ValueError(f"searches: {', '.join(self.searches) or 'none'} given; give at least one, and none twice")
        for name in self.searches:
            if name not in SEARCHES:
                known = ", ".join(SEARCHES)
                raise ValueError(f"searches: {name!r} is unknown; choose of {known}{nearest(name, SEARCHES)}")

    @property
    def budget(self) -> float:
        """Robot-steps of a run."""
        return float(self.evaluations * PUBLISHED_COST)


Run = tuple[str, int]  # search and seed
Course = tuple[History, Sequence[float]]  # of a run, and what each generation has spent [robot-steps]


def study(folder: Path, settings: Hunt, progress: Progress = None, jobs: int = 1, **compute: Any) -> None:
    """Write runs, tables, ``summary.json``, ``hunt.png``, and the best gait of each run."""
    check_runs(folder, "gait-hunt", TABLES, FILES)
    searches, found, bests = settings.searches, dict[Run, Course](), dict[Run, Finalist | None]()
    parts = [(name, seed) for seed in settings.seeds for name in searches]
    tasks = [(f"{name}-{seed}", partial(search_once, folder, settings, name, seed)) for name, seed in parts]
    run_parallel(tasks, jobs, compute, part_of(progress, 0, 10, 9))
    judged = {name: folder / "runs" / f"{name}.json" for name in searches}
    for number, ((name, seed), (_, search)) in enumerate(zip(parts, tasks, strict=True)):
        found[name, seed] = search(compute, part_of(progress, 9 * number, 10 * len(parts), 9))
        if name == searches[-1] and jobs == 1 and not any(path.exists() for path in judged.values()):
            report(folder, settings, found, bests)  # what there is so far is of use
    for number, (name, path) in enumerate(judged.items()):
        runs = [(name, seed) for seed in settings.seeds]
        histories, problem = [found[run][0] for run in runs], _problem(settings, name, compute)
        share = part_of(progress, 9 * len(searches) + number, 10 * len(searches))
        finalists = cached_finalists(path, histories, problem, settings, share, **compute)
        bests |= {run: best_of(known) for run, known in zip(runs, finalists, strict=True)}
        report(folder, settings, found, bests)
    if progress:
        progress(1.0)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json``, ``table.md`` and ``hunt.png`` from the tables of runs and generations."""
    about: dict[str, Kind] = {"search": tuple(SEARCHES), "seed": int, "robot_steps": float}
    rows = data.records(TABLES[0], {**about, "evaluations": int, **FOUND})
    generations = data.records(TABLES[1], {**about, "generation": int, **dict.fromkeys(("mean", "best"), float | None)})
    searches, seeds = (tuple(distinct(rows, name)) for name in ("search", "seed"))

    def settings(summary: Mapping[str, Any]) -> Hunt:
        return Hunt(positive("budget", summary["budget"]) / PUBLISHED_COST, seeds, searches, **hill_of(summary))

    write_reports(folder, data.from_summary(settings), rows, generations)


def _problem(hunt: Hunt, name: str, compute: Mapping[str, Any]) -> GaitProblem:
    return SEARCHES[name].problem_on(hunt.terrain, geometry=hunt.geometry, **compute)


def search_once(
    folder: Path, hunt: Hunt, name: str, seed: int, compute: Mapping[str, Any], progress: Progress
) -> Course:
    """One run; its finalists come later."""
    path, problem = folder / "runs" / f"{name}-{seed}", _problem(hunt, name, compute)
    settings = {**SEARCHES[name].settings, "seed": seed}
    history = search_within(problem, SEARCHES[name].method, settings, path, hunt.budget, progress)
    spent = read_spent(path)
    history = paid(history, spent, hunt.budget)
    return history, spent[: len(history.generations)]


def report(folder: Path, hunt: Hunt, found: Mapping[Run, Course], bests: Mapping[Run, Finalist | None]) -> None:
    """Write what some runs have found: tables, what follows from them, and gaits, of those that were judged."""
    rows, generations = [], []
    for run, (history, spent) in found.items():
        about, last = dict(zip(("search", "seed"), run, strict=True)), history.generations[-1]
        wall = float(np.nansum(history.seconds))
        effort = {"evaluations": last.evaluations, "robot_steps": float(np.sum(spent)), "wall_s": wall}
        rows.append({**about, **effort, "score": last.best, **finalist_columns(bests.get(run))})
        for each, steps in zip(history.generations, spent, strict=True):
            effort = {"generation": each.generation, "evaluations": each.evaluations, "robot_steps": steps}
            generations.append({**about, **effort, "mean": each.mean, "best": each.best})
    write_records(folder / TABLES[0], rows)
    write_records(folder / TABLES[1], generations)
    write_reports(folder, hunt, rows, generations)
    write_gaits(folder / "gaits", {f"{name}-{seed}": bests.get((name, seed)) for name, seed in found})


def write_reports(folder: Path, hunt: Hunt, rows: Sequence[Record], generations: Sequence[Record]) -> None:
    """Write ``summary.json``, ``table.md`` and ``hunt.png``, all that follows from the records of both tables."""
    every = {name: select(rows, search=name) for name in hunt.searches}
    groups = {name: group for name, group in every.items() if group}
    summary = {name: _group(name, group) for name, group in groups.items()}
    starts = {name: [row["mean"] for row in select(generations, search=name, generation=0)] for name in groups}
    apart = differences({name: column(group, "speed") for name, group in groups.items()}, starts)
    found = {"searches": summary, "differences": apart, "runs": rows}
    write_json(folder / "summary.json", {"budget": hunt.budget, **hunt.about_hill, **found})
    labels = {name: row["label"] for name, row in summary.items()}
    write_text(folder / "table.md", text_of(summary) + ("\n" + table_of_differences(apart, labels) if apart else ""))
    _draw(groups, generations, folder / "hunt.png")


def _group(name: str, group: Sequence[Record]) -> dict[str, Any]:
    """Runs of a search: mean speed of what they have found with its 95 % interval by Student's t, and the best."""
    known = [row for row in group if row["speed"] is not None]
    speeds, hard = (column(known, name) for name in ("speed", "hard_speed"))
    return {
        "label": SEARCHES[name].label,
        "runs": len(group),
        "judged": len(known),
        "evaluations": int(np.median(column(group, "evaluations"))),
        "robot_steps": float(np.median(column(group, "robot_steps"))),
        **known_mean(speeds, "speed"),
        "best": float(speeds.max()) if known else None,
        "hard_speed": float(hard.mean()) if known else None,
        "staying": int((hard >= LEAST_HARD_SPEED).sum()) if known else None,
    }


def text_of(summary: Mapping[str, Record]) -> str:
    """The searches in Markdown; evaluations and robot-steps are medians of runs, speeds those of runs with a gait."""
    cells = []
    for row in summary.values():
        speed, low, high, *others = (cell(row[n], missing="") for n in ("speed", "low", "high", "best", "hard_speed"))
        runs = str(row["runs"]) if row["judged"] in (0, row["runs"]) else f"{row['judged']} of {row['runs']}"
        effort = row["label"], row["evaluations"], f"{row['robot_steps'] / 1e6:.1f}", runs
        staying = cell(row["staying"], "d", missing="")
        cells.append((*effort, speed, f"{low} to {high}" if low else "", *others, staying))
    header = ("search", "evaluations", "million robot-steps", "runs", "speed, mean", "interval", "best", "harder")
    return page(markdown((*header, "these, stay"), "lrrrrrrrr", cells))


LINEAR = 0.01  # speeds up to which the figure's axis is linear [BL/s]


def _draw(groups: Mapping[str, Sequence[Record]], generations: Sequence[Record], path: Path) -> None:
    """Best scores over what was spent, each by its search's own rule, and what the runs have found in the end."""
    with figure(path, PAGE, 3.0, ncols=2) as (_, panels):
        over, end = panels[0]
        for place, ((name, group), colour) in enumerate(zip(groups.items(), COLOURS, strict=False)):
            style = "--" if SEARCHES[name].rungs else "-"  # scores of ladders count easier slopes
            for seed in distinct(group, "seed"):
                mine = select(generations, search=name, seed=seed)
                spent = np.cumsum(column(mine, "robot_steps")) / 1e6
                over.step(spent, column(mine, "best"), where="post", color=colour, lw=0.8, ls=style)
            known = [row for row in group if row["speed"] is not None]
            for value, marker in (("speed", "o"), ("hard_speed", "x")):
                end.plot(
                    column(known, value),
                    [place] * len(known),
                    marker,
                    color=colour,
                    ms=5,
                    fillstyle="none",
                    clip_on=False,
                )
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


FEW = ("hill-climb", "genetic", "gradient", "ladder")
STUDY = Study(
    title="evolution as published, on cycles, along gradients and both: gaits that climb 15 degrees, at equal cost",
    source="chapter 5, discussion: why the search did not find inching on the hill",
    scales={
        "small": Hunt(20, (0, 1), FEW, geometry="small", finalists=2, runs=2),
        "medium": Hunt(160, (0, 1, 2, 3, 4), finalists=2, runs=3),
        "full": Hunt(300, (0, 1, 2, 3, 4)),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="20 h of CPU time",
)
