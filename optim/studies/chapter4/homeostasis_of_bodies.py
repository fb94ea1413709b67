"""Whether bodies in which controllers are easily found are also homeostatic: correlations over bodies.

Source: dissertation, chapter 4, which saw designs become more homeostatic as they became better, and chapter 6, which
proposes signal similarity as a proxy of learnability. Bodies are drawn from the published grid among those with a
controller that solves all environments; a body's homeostasis is the mean over such controllers, drawn from its sweep.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, logarithmic
from optim.experiments.results import Progress, computed, write_json
from optim.experiments.study import Count, Settings, Study, Whole
from optim.experiments.tables import column, write_columns
from optim.measures import learnability, resistance
from optim.measures.statistics import pearson, spearman
from optim.studies.chapter3.sensor_placement import some_solving_controllers
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4.sensor_homeostasis import MEASURES, decimation, sensor_distances
from robots.braitenberg import DESIGNS, Sweep, VehicleBody, contralateral
from robots.braitenberg.sweeps import Overlap
from robots.robot import part_of
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.compute import Threads
from taichi_sim.base.results_folder import ResultsFolder

TABLE = "bodies.csv"
METRICS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$"}
COLUMNS: dict[str, Kind] = dict.fromkeys(("M_L", "M_CI", "raw", "normalised"), float)
BODIES_PER_PART = 50


@dataclass(frozen=True)
class BodyHomeostasis(Settings):
    """Bodies and controllers whose homeostasis is measured."""

    bodies: Annotated[int, partial(checks.integer, low=3)] = 500  # with a controller that solves all
    controllers: Count = 5  # of each body, at most
    seed: Whole = 1  # with which bodies and controllers are drawn
    sweep: Sweep = field(default_factory=Sweep)  # settings of the sweep
    samples: Count = 5000  # of a decimated trace, at most
    threads: Threads = None  # of the CPU; changes no result


def chosen_bodies(settings: BodyHomeostasis, sweep_folder: Path, progress: Progress = None) -> dict[int, Overlap]:
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


def measure(settings: BodyHomeostasis, bodies: Mapping[int, Overlap], _: Progress) -> Arrays:
    """Metrics, number of controllers measured, and mean distances of each body, by number."""
    task = settings.sweep.task
    drawn = [
        some_solving_controllers(overlap, settings.controllers, (settings.seed, design))
        for design, overlap in bodies.items()
    ]
    counts, overlaps = np.array([len(weights) for weights in drawn]), np.stack(list(bodies.values()))
    sites = np.repeat([VehicleBody.published(design).sensors for design in bodies], counts, axis=0)
    owners = np.repeat(np.arange(len(bodies)), counts)
    every = decimation(task, settings.samples)
    found = sensor_distances(sites, contralateral(np.concatenate(drawn)), task, every, settings.threads)
    metrics = {"design": np.array(list(bodies)), "M_L": learnability(overlaps), "M_CI": resistance(overlaps)}
    means = [np.bincount(owners, values) / counts for values in found]
    return {**metrics, "controllers": counts, **dict(zip(MEASURES, means, strict=True))}


def check_measured(bodies: int, arrays: Arrays) -> None:
    """Refuse a file that does not hold what :func:`measure` gives of so many bodies, by a ValueError."""
    allowed = dict.fromkeys(METRICS, Allowed((bodies,), 0.0, 1.0))
    allowed |= dict.fromkeys(MEASURES, Allowed((bodies,), 0.0, failed=np.nan))
    allowed |= dict.fromkeys(("design", "controllers"), Allowed((bodies,), 0, kind="i"))
    check_arrays(allowed, arrays)


def correlate(arrays: Arrays) -> dict[str, Any]:
    """Rank and product-moment correlations of both measures with both metrics, two-sided, with 95 % intervals."""
    found: dict[str, Any] = {}
    for name in MEASURES:
        there = np.isfinite(arrays[name])
        for metric in METRICS:
            pair = arrays[metric][there], arrays[name][there]
            found[f"{name} with {metric}"] = {
                "spearman": asdict(spearman(*pair, "two-sided")),
                "pearson": asdict(pearson(*pair, "two-sided")),
                "pearson_of_logarithms": asdict(pearson(np.log(pair[0]), np.log(pair[1]), "two-sided")),
            }
    return found


def study(folder: Path, settings: BodyHomeostasis, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``summary.json``, ``bodies.csv`` and ``homeostasis-of-bodies.png``."""
    results = ResultsFolder(folder, "homeostasis-of-bodies", settings.describe())
    bodies = list(chosen_bodies(settings, sweep_folder or folder / "sweep", part_of(progress, 0, 2)).items())
    if not bodies:
        raise ValueError("sweep: no body succeeds from everywhere; give it more steps, or a larger radius")
    parts = {
        first: partial(measure, settings, dict(bodies[first : first + BODIES_PER_PART]))
        for first in range(0, len(bodies), BODIES_PER_PART)
    }
    check = {first: partial(check_measured, len(bodies[first : first + BODIES_PER_PART])) for first in parts}
    found = list(computed(results, parts, part_of(progress, 1, 2), "bodies_{}", check).values())
    table = {name: np.concatenate([part[name] for part in found]) for name in found[0]}
    write_columns(folder / TABLE, table)
    _report(folder, table, decimation(settings.sweep.task, settings.samples))


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and the figure from the table of bodies."""
    rows = data.records(TABLE, COLUMNS)
    _report(folder, {name: column(rows, name) for name in COLUMNS}, data.count("steps_between_samples"))


def _report(folder: Path, table: Arrays, every: int) -> None:
    """Write ``summary.json`` and the figure, which follow from the table of bodies and the steps between samples."""
    numbers = {"bodies": len(table["M_L"]), "steps_between_samples": every}
    write_json(folder / "summary.json", {**numbers, "correlations": correlate(table)})
    draw(table, folder / "homeostasis-of-bodies.png")


def draw(table: Arrays, path: Path) -> None:
    """Draw both measures against both metrics."""
    with figure(path, PAGE, 4.4, nrows=2, ncols=2, sharex="col", sharey="row") as (_, panels):
        for row, name in zip(panels, MEASURES, strict=True):
            for axes, (metric, label) in zip(row, METRICS.items(), strict=True):
                axes.plot(table[metric], table[name], ".", color=COLOURS[0], markersize=2, alpha=0.6)
                axes.set(xscale="log", xlabel=label if name == MEASURES[-1] else "")
                logarithmic(axes, "y")
            row[0].set_ylabel("DTW distance" + (" [1/m$^2$]" if name == "raw" else ", normalised"))


STUDY = Study(
    title="whether bodies in which controllers are easily found are homeostatic",
    source="chapters 4 and 6",
    scales={
        "small": BodyHomeostasis(bodies=10, controllers=3, sweep=Sweep(weights=31)),
        "full": BodyHomeostasis(),
    },
    run=study,
    rewrite=rewrite,
    writes=("summary.json", TABLE, "homeostasis-of-bodies.png"),
)
