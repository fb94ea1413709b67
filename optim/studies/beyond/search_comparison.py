"""Gradients beside gradient-free searches: evaluations until one point solves all environments.

Bodies and controllers of Braitenberg vehicles together (six variables), and controllers of the baseline body (two).
Gradient ascent starts at the best of ten random points and follows Adam; the gradient of each environment is clipped to
length 1, and those that are solved add nothing. A gradient counts as one evaluation; its cost is that and as many more
as there are variables, the price of forward mode. CMA-ES begins in the middle of the ranges, where a vehicle hardly
moves, and beside that at random. The settings were chosen on other seeds.
"""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from optim.experiments.comparison import compare, describe_times, ranked
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.results import Progress, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.experiments.trials import Trials, computed_trials, record_trials
from optim.plots.curves import draw_share_solved
from optim.studies.chapter4 import co_optimisation
from optim.studies.chapter4.co_optimisation import BORG, CoOptimisation
from robots.braitenberg import BASELINE
from taichi_sim.base.arrays import Ints
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
Times = Mapping[tuple[str, str], Mapping[str, Ints]]  # by problem and method: counts of trials, by kind


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
            trial = problem, method, own, settings.seeds, settings.budget
            arms[f"{name}_{label}"] = partial(record_trials, *trial, until_solved=True)
    found = computed_trials(results, arms, progress)
    trials = {(name, label): found[f"{name}_{label}"] for name in PROBLEMS for label in methods[name]}
    write_json(folder / "summary.json", report(settings, trials, folder))


def report(settings: CoOptimisation, found: Mapping[tuple[str, str], Trials], out: Path) -> dict[str, Any]:
    """Write raw times as CSV, draw them, and return their numbers."""
    environments = len(settings.task.starts)
    times = {
        each: {"evaluations": trials.first(environments), "cost": trials.cost(environments)}
        for each, trials in found.items()
    }
    summary: dict[str, Any] = {"evaluations": {}, "cost": {}, "tests": {}}
    for name in PROBLEMS:
        for kind in ("evaluations", "cost"):
            each = {m: describe_times(times[name, m][kind], settings.budget) for m in LABELS}
            if kind == "cost":  # trials that failed cost more than the budget of evaluations
                each = {m: {k: v for k, v in row.items() if not k.startswith("mean")} for m, row in each.items()}
            summary[kind][name] = each
        ranks = {m: ranked(times[name, m]["evaluations"], settings.budget) for m in LABELS}
        summary["tests"][name] = compare(ranks, PAIRS, "less")
    rows = [
        (*each, seed, *counts)
        for each, kinds in times.items()
        for seed, *counts in zip(settings.seeds, *kinds.values(), strict=True)
    ]
    write_table(out / "evaluations-until-all-solved.csv", ("problem", "method", "seed", "evaluations", "cost"), rows)
    _draw(times, settings.budget, out / "search-comparison.png")
    return summary


def _draw(times: Times, budget: int, path: Path) -> None:
    """Share of the trials that have solved all, against evaluations; dotted, of gradients, against their cost."""
    with figure(path, PAGE, 2.8, ncols=len(PROBLEMS), sharey=True) as (drawn, panels):
        for axes, (name, (title, _, _)) in zip(panels[0], PROBLEMS.items(), strict=True):
            for (method, label), colour in zip(LABELS.items(), (*COLOURS[:4], COLOURS[-1]), strict=True):
                for kind, style in (("evaluations", "-"), ("cost", ":"))[: 2 if method == "gradient" else 1]:
                    values = times[name, method][kind]
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
    writes=("summary.json", "evaluations-until-all-solved.csv", "search-comparison.png"),
)
