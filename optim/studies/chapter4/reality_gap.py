"""The reality gap: how many controllers that solve all environments still do when vehicle or world are changed.

Source: dissertation, chapter 6 (figure of the two weight manifolds), which expects that bodies with more such
controllers lose fewer of them. Bodies are the baseline, and those with the highest metrics of the published sweep.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.comparison import compare
from optim.experiments.figures import COLOURS, PAGE, figure, letter, logarithmic
from optim.experiments.results import Progress, computed, write_json
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, where, write_records
from optim.measures.statistics import mean_band
from optim.studies.chapter3.sensor_placement import some_solving_controllers
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4.perturbations import PERTURBATIONS, survival
from robots.braitenberg import BASELINE, Sweep, VehicleBody, contralateral
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

DESIGNS = {BASELINE.design or 0: "baseline", 162: "best by both metrics", 5841: "sensors at opposite corners"}


@dataclass(frozen=True)
class RealityGap(Settings):
    """Controllers that are tried in changed vehicles and worlds."""

    controllers: Several = 200  # of each body, at most, drawn from those that solve all environments
    draws: Count = 10  # perturbed copies of each, where a perturbation is random
    seed: Whole = 1  # of all draws
    sweep: Sweep = field(default_factory=Sweep)  # settings of the sweep in which controllers are found
    threads: int | None = None  # CPU threads, all available if None; changes no result

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
        return {**super().describe(), "perturbations": [[p.name, p.strength] for p in PERTURBATIONS]}


def measure(settings: RealityGap, design: int, sweep_folder: Path, _: Progress) -> Arrays:
    """Weights of the controllers drawn, shape (C, 2), and their survival of each perturbation, shape (P, C)."""
    body = VehicleBody.published(design)
    overlap = overlaps_of([body], settings.sweep, sweep_folder, threads=settings.threads)[0]
    drawn = some_solving_controllers(overlap, settings.controllers, (settings.seed, design))
    vehicles = np.broadcast_to(body.sensors, (len(drawn), 2, 2)), contralateral(drawn), settings.sweep.task
    effort = settings.draws, settings.seed, settings.threads
    after = [survival(*vehicles, p, *effort) for p in PERTURBATIONS]
    return {"weights": drawn, "survival": np.array(after).reshape(len(PERTURBATIONS), len(drawn))}


def study(folder: Path, settings: RealityGap, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``summary.json``, ``survival.csv`` and ``reality-gap.png``.

    Args:
        sweep_folder: of the sweep of the same weights, which knows bodies or will; one beside the results if None.
    """
    results = ResultsFolder(folder, "reality-gap", settings.describe())
    swept = sweep_folder or folder / "sweep"
    parts = {f"design_{design}": partial(measure, settings, design, swept) for design in DESIGNS}
    found = dict(zip(DESIGNS, computed(results, parts, progress).values(), strict=True))
    rows: list[Record] = []
    for design, arrays in found.items():
        for perturbation, shares in zip(PERTURBATIONS, arrays["survival"], strict=True):
            if len(shares):
                mean, low, high = map(float, (shares.mean(), *mean_band(shares)))
                about = {"design": design, "perturbation": perturbation.name, "strength": perturbation.strength}
                rows.append({**about, "controllers": len(shares), "mean": mean, "low": low, "high": high})
    write_records(folder / "survival.csv", rows)
    write_json(folder / "summary.json", _tests(found))
    draw(rows, folder / "reality-gap.png")


def _tests(found: Mapping[int, Arrays]) -> dict[str, Any]:
    """Mann-Whitney tests of every controller's mean survival over all perturbations: the baseline's are less."""
    means = {str(design): a["survival"].mean(axis=0) for design, a in found.items() if a["survival"].size}
    first, *others = map(str, DESIGNS)
    pairs = [(first, other) for other in others if first in means and other in means]
    overall = {design: {"controllers": len(m), "mean": float(m.mean())} for design, m in means.items()}
    return {"mean_over_perturbations": overall, "tests": compare(means, pairs, "less")}


def draw(rows: Sequence[Record], path: Path) -> None:
    """Survival against strength, a panel for each kind."""
    kinds = list(dict.fromkeys(p.name for p in PERTURBATIONS))
    with figure(path, PAGE, 4.2, letters=False, nrows=2, ncols=4, sharey=True) as (_, panels):
        for axes, kind in zip(panels.flat, kinds, strict=False):
            for (design, label), colour in zip(DESIGNS.items(), COLOURS, strict=False):
                if here := where(rows, design=design, perturbation=kind):
                    strength, mean, low, high = (column(here, name) for name in ("strength", "mean", "low", "high"))
                    line: Any = {"fmt": "o-", "color": colour, "markersize": 2.5, "label": label}
                    axes.errorbar(strength, mean, np.abs([low - mean, high - mean]), **line)
            axes.set(xlabel=kind.replace(" [", "\n["), ylim=(-0.03, 1.03))
            logarithmic(axes, "x", [p.strength for p in PERTURBATIONS if p.name == kind])
        for row in panels:
            row[0].set_ylabel("share that still solves all")
        panels.flat[-1].axis("off")
        panels.flat[-1].legend(*panels.flat[0].get_legend_handles_labels(), loc="center")
        letter(panels.ravel()[: len(kinds)])


STUDY = Study(
    title="controllers that still succeed when vehicle or world are changed",
    source="chapter 6, figure of weight manifolds",
    scales={"small": RealityGap(controllers=10, draws=2), "full": RealityGap()},
    run=study,
    writes=("summary.json", "survival.csv", "reality-gap.png"),
)
