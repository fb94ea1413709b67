"""The reality gap: how many controllers that solve all environments still do when vehicle or world are changed.

Source: dissertation, chapter 6 (figure of the two weight manifolds), which expects that bodies with more such
controllers lose fewer of them. Bodies are the baseline, and those with the highest metrics of the published sweep.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.comparison import compare
from optim.experiments.figures import COLOURS, PAGE, figure, letter, logarithmic
from optim.experiments.results import Budget, Progress, cached, check_counts, write_json
from optim.experiments.study import Study
from optim.experiments.tables import read_table, write_table
from optim.measures.statistics import mean_band
from optim.studies.chapter3.sensor_placement import some_solving_controllers
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4.perturbations import PERTURBATIONS, survival
from robots.braitenberg import BASELINE, Sweep, VehicleBody, contralateral
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

DESIGNS = {BASELINE.design or 0: "baseline", 162: "best by both metrics", 5841: "sensors at opposite corners"}
HEADER = ("design", "perturbation", "strength", "controllers", "mean", "low", "high")


@dataclass(frozen=True)
class RealityGap:
    """Settings.

    Attributes:
        controllers: of each body, at most, drawn from those that solve all environments.
        draws: perturbed copies of each, where a perturbation is random.
        seed: of all draws.
        sweep: settings of the sweep in which controllers are found.
        threads: CPU threads, all available if None; changes no result.
    """

    controllers: int = 200
    draws: int = 10
    seed: int = 1
    sweep: Sweep = field(default_factory=Sweep)
    threads: int | None = None

    def __post_init__(self) -> None:
        check_counts(self, controllers=2, draws=1, seed=0)

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
        kinds = [[p.name, p.strength] for p in PERTURBATIONS]
        return {**{n: v for n, v in asdict(self).items() if n != "threads"}, "perturbations": kinds}


SCALES: Mapping[Budget, RealityGap] = {"small": RealityGap(controllers=10, draws=2), "full": RealityGap()}


def measure(settings: RealityGap, design: int, sweep_folder: Path) -> Arrays:
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
        folder, settings, progress: see :class:`optim.experiments.study.Study`.
        sweep_folder: of the sweep of the same weights, which knows bodies or will; one beside the results if None.
    """
    results = ResultsFolder(folder, "reality-gap", settings.describe())
    found: dict[int, Arrays] = {}
    for design in DESIGNS:
        work = partial(measure, settings, design, sweep_folder or folder / "sweep")
        found[design] = cached(results, f"design_{design}", work)
        if progress:
            progress(len(found) / len(DESIGNS))
    rows: list[tuple[Any, ...]] = []
    for design, arrays in found.items():
        for perturbation, shares in zip(PERTURBATIONS, arrays["survival"], strict=True):
            if len(shares):
                low, high = (float(x) for x in mean_band(shares))
                numbers = (len(shares), float(shares.mean()), low, high)
                rows.append((design, perturbation.name, perturbation.strength, *numbers))
    write_table(folder / "survival.csv", HEADER, rows)
    write_json(folder / "summary.json", _tests(found))
    draw(folder)


def _tests(found: dict[int, Arrays]) -> dict[str, Any]:
    """Mann-Whitney tests of every controller's mean survival over all perturbations: the baseline's are less."""
    means = {str(design): a["survival"].mean(axis=0) for design, a in found.items() if a["survival"].size}
    first, *others = (str(design) for design in DESIGNS)
    pairs = [(first, other) for other in others if first in means and other in means]
    overall = {design: {"controllers": len(m), "mean": float(m.mean())} for design, m in means.items()}
    return {"mean_over_perturbations": overall, "tests": compare(means, pairs, "less")}


def draw(folder: Path) -> None:
    """Survival against strength, a panel for each kind, from the table: ``reality-gap.png``."""
    _, rows = read_table(folder / "survival.csv")
    kinds = list(dict.fromkeys(p.name for p in PERTURBATIONS))
    with figure(folder / "reality-gap.png", PAGE, 4.2, nrows=2, ncols=4, sharey=True) as (_, panels):
        for axes, kind in zip(panels.flat, kinds, strict=False):
            for (design, label), colour in zip(DESIGNS.items(), COLOURS, strict=False):
                values = np.array([row[2:] for row in rows if row[:2] == [str(design), kind]], float)
                if len(values):
                    ends = np.abs(values[:, [3, 4]].T - values[:, 2])
                    axes.errorbar(values[:, 0], values[:, 2], ends, fmt="o-", color=colour, markersize=2.5, label=label)
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
    scales=SCALES,
    run=study,
    writes=("summary.json", "survival.csv", "reality-gap.png"),
)
