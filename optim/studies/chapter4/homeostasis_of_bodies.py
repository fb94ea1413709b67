"""Whether bodies in which controllers are easily found are also homeostatic: correlations over bodies.

Source: dissertation, chapter 4, which saw designs become more homeostatic as they became better, and chapter 6, which
proposes signal similarity as a proxy of learnability. Bodies are drawn from the published grid among those with a
controller that solves all environments; a body's homeostasis is the mean over such controllers, drawn from its sweep.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, letter, logarithmic
from optim.experiments.results import Budget, Progress, cached, check_counts, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import read_table, write_table
from optim.measures import interference, learnability
from optim.measures.statistics import pearson, spearman
from optim.studies.chapter3.sensor_placement import some_solving_controllers
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4.sensor_homeostasis import MEASURES, decimation, sensor_distances
from robots.braitenberg import DESIGNS, Sweep, VehicleBody, contralateral
from robots.braitenberg.sweeps import Overlap
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

METRICS = ("M_L", "M_CI")
BODIES_PER_PART = 50
HEADER = ("design", *METRICS, "controllers", *MEASURES)


@dataclass(frozen=True)
class BodyHomeostasis:
    """Settings.

    Attributes:
        bodies: how many, of those with a controller that solves all environments.
        controllers: of each body, at most.
        seed: with which bodies and controllers are drawn.
        sweep: settings of the sweep.
        samples: of a decimated trace, at most.
        threads: CPU threads, all available if None; changes no result.
    """

    bodies: int = 500
    controllers: int = 5
    seed: int = 1
    sweep: Sweep = field(default_factory=Sweep)
    samples: int = 5000
    threads: int | None = None

    def __post_init__(self) -> None:
        check_counts(self, bodies=3, controllers=1, seed=0, samples=1)

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
        return {name: value for name, value in asdict(self).items() if name != "threads"}


SCALES: Mapping[Budget, BodyHomeostasis] = {
    "small": BodyHomeostasis(bodies=10, controllers=3, sweep=Sweep(weights=31)),
    "full": BodyHomeostasis(),
}


def chosen_bodies(
    settings: BodyHomeostasis, sweep_folder: Path | None, progress: Progress = None
) -> dict[int, Overlap]:
    """Bodies and their overlap matrices, by number, drawn one after the other until there are enough."""
    order = (np.random.default_rng(settings.seed).permutation(DESIGNS) + 1).tolist()
    found: dict[int, Overlap] = {}
    while len(found) < settings.bodies and order:
        missing = settings.bodies - len(found)
        drawn, order = order[:missing], order[missing:]
        bodies = list(map(VehicleBody.published, drawn))
        overlaps = overlaps_of(bodies, settings.sweep, sweep_folder, threads=settings.threads)
        found |= {n: overlap for n, overlap in zip(drawn, overlaps, strict=True) if (overlap == 4).any()}
        if progress:
            progress(min(1.0, len(found) / settings.bodies))
    return found


def measure(settings: BodyHomeostasis, bodies: dict[int, Overlap]) -> Arrays:
    """Metrics, number of controllers measured, and mean distances of each body, by the names in ``HEADER``."""
    task, sites, controllers, owners = settings.sweep.task, [], [], []
    for n, (design, overlap) in enumerate(bodies.items()):
        drawn = some_solving_controllers(overlap, settings.controllers, (settings.seed, design))
        controllers.append(contralateral(drawn))
        sites.append(np.broadcast_to(VehicleBody.published(design).sensors, (len(drawn), 2, 2)))
        owners += [n] * len(drawn)
    every = decimation(task, settings.samples)
    found = sensor_distances(np.concatenate(sites), np.concatenate(controllers), task, every, settings.threads)
    overlaps, counts = np.stack(list(bodies.values())), np.bincount(owners)
    means = [np.bincount(owners, values) / counts for values in found]
    columns = np.array(list(bodies)), learnability(overlaps), interference(overlaps), counts, *means
    return dict(zip(HEADER, columns, strict=True))


def correlate(arrays: Arrays) -> dict[str, Any]:
    """Rank and product-moment correlations of both measures with both metrics, two-sided, with 95 % intervals."""
    found: dict[str, Any] = {}
    for measure_name in MEASURES:
        values = arrays[measure_name]
        there = np.isfinite(values)
        for metric in METRICS:
            pair = arrays[metric][there], values[there]
            found[f"{measure_name} with {metric}"] = {
                "spearman": asdict(spearman(*pair, "two-sided")),
                "pearson": asdict(pearson(*pair, "two-sided")),
                "pearson_of_logarithms": asdict(pearson(np.log(pair[0]), np.log(pair[1]), "two-sided")),
            }
    return found


def study(folder: Path, settings: BodyHomeostasis, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``summary.json``, ``bodies.csv`` and ``homeostasis-of-bodies.png``.

    Args:
        folder, settings, progress: see :class:`optim.experiments.study.Study`.
        sweep_folder: of the sweep of the same weights, which knows bodies or will; one beside the results if None.
    """
    results = ResultsFolder(folder, "homeostasis-of-bodies", settings.describe())
    bodies = chosen_bodies(settings, sweep_folder or folder / "sweep", part_of(progress, 0, 2))
    designs, parts = list(bodies), []
    for first in range(0, len(designs), BODIES_PER_PART):
        chosen = {design: bodies[design] for design in designs[first : first + BODIES_PER_PART]}
        parts.append(cached(results, f"bodies_{first}", partial(measure, settings, chosen)))
        if progress:
            progress(0.5 + 0.5 * min(1.0, (first + BODIES_PER_PART) / len(designs)))
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in HEADER}
    rows = zip(*(arrays[name].tolist() for name in HEADER), strict=True)
    write_table(folder / "bodies.csv", HEADER, rows)
    numbers = {"bodies": len(designs), "steps_between_samples": decimation(settings.sweep.task, settings.samples)}
    write_json(folder / "summary.json", {**numbers, "correlations": correlate(arrays)})
    draw(folder)


def draw(folder: Path) -> None:
    """Draw both measures against both metrics from the table: ``homeostasis-of-bodies.png``."""
    header, rows = read_table(folder / "bodies.csv")
    table = dict(zip(header, np.array(rows, float).T, strict=True))
    path = folder / "homeostasis-of-bodies.png"
    with figure(path, PAGE, 4.4, nrows=2, ncols=2, sharex="col", sharey="row") as (_, panels):
        for row, name in zip(panels, MEASURES, strict=True):
            for axes, metric in zip(row, METRICS, strict=True):
                axes.plot(table[metric], table[name], ".", color=COLOURS[0], markersize=2, alpha=0.6)
                axes.set_xscale("log")
                logarithmic(axes, "y")
            row[0].set_ylabel("DTW distance" + (" [1/m$^2$]" if name == "raw" else ", normalised"))
        for axes, metric in zip(panels[1], ("$M_L$", "$M_{CI}$"), strict=True):
            axes.set_xlabel(metric)
        letter(panels)


STUDY = Study(
    title="whether bodies in which controllers are easily found are homeostatic",
    source="chapters 4 and 6",
    scales=SCALES,
    run=study,
    writes=("summary.json", "bodies.csv", "homeostasis-of-bodies.png"),
)
