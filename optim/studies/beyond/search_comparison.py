"""Gradients beside gradient-free searches: evaluations until one point solves all environments.

Bodies and controllers of Braitenberg vehicles together (six variables), and controllers of the baseline body (two).
Gradient ascent starts at the best of ten random points and follows Adam; the gradient of each environment is clipped to
length 1, and those that are solved add nothing. A gradient counts as one evaluation; its cost is that and as many more
as there are variables, the price of forward mode. CMA-ES begins in the middle of the ranges, where a vehicle hardly
moves, and beside that at random. The settings were chosen on other seeds.
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from optim.experiments.comparison import compare, describe_times, ranked
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.results import Progress, write_json
from optim.experiments.search_evaluations import computed_searches, record_searches
from optim.experiments.study import Study
from optim.experiments.tables import Record, column, select, write_records
from optim.plots.curves import draw_share_solved
from optim.studies.chapter4 import co_optimisation
from optim.studies.chapter4.co_optimisation import BORG, CoOptimisation
from robots.braitenberg import BASELINE
from taichi_sim.base.results_folder import ResultsFolder

PROBLEMS: dict[str, tuple[str, dict[str, Any], int]] = {
    "co_design": ("body and controller", {}, 6),
    "baseline": ("baseline body", {"body": BASELINE}, 2),
}
LABELS = {
    **{"random": "random", "borg": "Borg", "cma": "CMA-ES", "cma_random": "CMA-ES, random mean"},
    "gradient": "gradient (Adam)",
}
PAIRS = (
    *(("gradient", other) for other in LABELS if other != "gradient"),
    ("cma_random", "random"),
    ("borg", "random"),
)
TABLE = "evaluations-until-all-solved.csv"
COLUMNS: dict[str, Kind] = {
    "problem": tuple(PROBLEMS),
    "method": tuple(LABELS),
    "seed": int,
    "evaluations": int,  # -1 of searches that failed
    "cost": int,
}


def searches(variables: int) -> dict[str, tuple[str, dict[str, Any]]]:
    """Methods and their settings for so many variables, beside their defaults."""
    usual = {"population": 4 + math.floor(3 * math.log(variables))}  # of CMA-ES
    return {
        "random": ("random", {"climbers": 10}),  # ten points at a time, for speed
        "borg": ("borg", BORG),
        "cma": ("cma", usual),
        "cma_random": ("cma", {**usual, "random_mean": True}),
        "gradient": ("gradient", {"climbers": 1, "candidates": 10, "learning_rate": 0.1}),
    }


def study(folder: Path, settings: CoOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, raw data as CSV and a figure."""
    methods = {name: searches(variables) for name, (_, _, variables) in PROBLEMS.items()}
    results = ResultsFolder(folder, "search-comparison", {**settings.describe(), "methods": methods})
    arms = {}
    for name, (_, given, _) in PROBLEMS.items():
        for label, (method, own) in methods[name].items():
            problem = settings.problem("environments" if method == "borg" else "total", **given)
            search = problem, method, own, settings.seeds, settings.budget
            arms[f"{name}_{label}"] = partial(record_searches, *search, until_solved=True)
    found = computed_searches(results, arms, progress)
    environments, rows = len(settings.task.starts), list[Record]()
    for name in PROBLEMS:
        for label in methods[name]:
            recorded = found[f"{name}_{label}"]
            each = zip(settings.seeds, recorded.first(environments), recorded.cost(environments), strict=True)
            rows += [dict(zip(COLUMNS, (name, label, *row), strict=True)) for row in each]
    write_records(folder / TABLE, rows)
    _report(folder, settings.budget, rows)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and the figure from the table of searches."""
    _report(folder, data.count("budget"), data.records(TABLE, COLUMNS, "problem", "method"))


def _report(folder: Path, budget: int, rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and the figure, which follow from the table of searches."""
    summary: dict[str, Any] = {"budget": budget, "evaluations": {}, "cost": {}, "tests": {}}
    for name in PROBLEMS:
        own = {method: select(rows, problem=name, method=method) for method in LABELS}
        for kind in ("evaluations", "cost"):
            each = {method: describe_times(column(runs, kind), budget) for method, runs in own.items()}
            if kind == "cost":  # searches that failed cost more than the budget of evaluations
                each = {m: {k: v for k, v in row.items() if not k.startswith("mean")} for m, row in each.items()}
            summary[kind][name] = each
        ranks = {method: ranked(column(runs, "evaluations"), budget) for method, runs in own.items()}
        summary["tests"][name] = compare(ranks, PAIRS, "less")
    write_json(folder / "summary.json", summary)
    _draw(rows, budget, folder / "search-comparison.png")


def _draw(rows: Sequence[Record], budget: int, path: Path) -> None:
    """Share of the searches that have solved all, against evaluations; dotted, of gradients, against their cost."""
    with figure(path, PAGE, 2.8, ncols=len(PROBLEMS), sharey=True) as (drawn, panels):
        for axes, (name, (title, _, _)) in zip(panels[0], PROBLEMS.items(), strict=True):
            for (method, label), colour in zip(LABELS.items(), (*COLOURS[:4], COLOURS[-1]), strict=True):
                for kind, style in (("evaluations", "-"), ("cost", ":"))[: 2 if method == "gradient" else 1]:
                    values = column(select(rows, problem=name, method=method), kind)
                    line: Any = {"ls": style, "color": colour, "label": label + ", by cost" * (kind == "cost")}
                    draw_share_solved(axes, values[values > 0], len(values), budget, **line)
            axes.set_title(title)
        panels[0, 0].set_ylabel("share of trials with all solved")
        legend_above(drawn, panels[0, 0].get_legend_handles_labels()[0])


STUDY = Study(
    title="gradients beside gradient-free searches: evaluations until all environments are solved",
    source="beyond chapter 4",
    scales=co_optimisation.STUDY.scales,
    run=study,
    rewrite=rewrite,
    writes=("summary.json", TABLE, "search-comparison.png"),
)
