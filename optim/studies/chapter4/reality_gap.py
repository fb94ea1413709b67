"""The reality gap: which controllers that solve all environments still do when vehicle or world are changed.

It is asked of single controllers, how many changes they survive, and of all of a body, how far its weight manifold
shifts and how much of it is left.

Source: dissertation, chapter 6 (figure of the two weight manifolds), which expects that bodies with more such
controllers lose fewer of them. Bodies are the baseline, and those with the highest metrics of the published sweep.
The model knows no noise over time; a reading that is wrong by a constant factor is exactly a weight that is, so sensors
that are wrongly calibrated are among what is tried, and sensors that flicker are not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.comparison import compare
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, letter, logarithmic
from optim.experiments.results import Progress, computed, write_json
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, distinct, select, write_records
from optim.measures.statistics import mean_band
from optim.studies.chapter3.sensor_placement import some_solving_controllers
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4 import weight_manifolds
from optim.studies.chapter4.perturbations import PERTURBATIONS, Perturbation
from robots.braitenberg import BASELINE, Sweep, VehicleBody, contralateral
from robots.braitenberg.sweeps import MOST_WEIGHTS
from robots.robot import part_of
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Threads
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.vehicle import VehicleBatch, VehicleTask, rollout


def survival(
    sites: ArrayLike,
    controllers: ArrayLike,
    task: VehicleTask,
    perturbation: Perturbation,
    draws: int,
    seed: int,
    threads: int | None = None,
) -> Floats:
    """The share of perturbed copies of each vehicle that solve all environments, shape (N,).

    Random perturbations have so many draws, whose seed makes all vehicles of a call start alike, and calls with equally
    many. Sites of the sensors have shape (N, S, 2) [m], controllers (N, 2, S).
    """
    vehicles = np.asarray(sites, float), np.asarray(controllers, float), task
    solved = []
    for draw in range(draws if perturbation.random else 1):
        rng = np.random.default_rng((seed, draw))
        places, changed, changed_task = perturbation.change(*vehicles, rng, perturbation.strength)
        done = rollout(VehicleBatch(places, changed[:, None]), changed_task, until="success", threads=threads)
        solved.append(done.reached[:, 0].all(axis=1))
    return np.asarray(np.mean(solved, axis=0))


DESIGNS = {BASELINE.design or 0: "baseline", 162: "best by both metrics", 5841: "sensors at opposite corners"}
TABLE = "controllers.csv.gz"
COLUMNS: dict[str, Kind] = {
    "design": int,
    "perturbation": tuple(dict.fromkeys(p.name for p in PERTURBATIONS)),
    **dict.fromkeys(("strength", "w1", "w2", "survival"), float),
}


@dataclass(frozen=True)
class RealityGap(Settings):
    """Controllers that are tried in changed vehicles and worlds."""

    controllers: Several = 200  # of each body, at most, drawn from those that solve all environments
    draws: Count = 10  # perturbed copies of each, where a perturbation is random
    seed: Whole = 1  # of all draws
    sweep: Sweep = field(default_factory=Sweep)  # settings of the sweep in which controllers are found
    threads: Threads = None  # of the CPU; changes no result
    manifold: Annotated[int, partial(whole_number, low=2, high=MOST_WEIGHTS)] = 121  # values of a weight in manifolds
    manifold_draws: Count = 3  # as ``draws``, of manifolds

    def describe(self) -> dict[str, Any]:
        """All that results depend on; parts of manifolds tell by name how they are measured, so older folders go on."""
        own = {name: value for name, value in super().describe().items() if not name.startswith("manifold")}
        return {**own, "perturbations": [[p.name, p.strength] for p in PERTURBATIONS]}


def measure(settings: RealityGap, design: int, sweep_folder: Path, _: Progress) -> Arrays:
    """Weights of the controllers drawn, shape (C, 2), and their survival of each perturbation, shape (P, C).

    Raises:
        ValueError: if none of the sweep solves all environments in this body.
    """
    body, sweep = VehicleBody.published(design), settings.sweep
    overlap = overlaps_of([body], sweep, sweep_folder, threads=settings.threads)[0]
    drawn = some_solving_controllers(overlap, settings.controllers, (settings.seed, design))
    if not len(drawn):
        tried = ", ".join(f"sweep.{name}={getattr(sweep, name)}" for name in ("weights", "radius", "steps"))
        told = f"no controller of design {design} solves all environments with {tried}"
        raise ValueError(f"sweep: {told}; give it more steps or weights, or a larger radius")
    vehicles = np.broadcast_to(body.sensors, (len(drawn), 2, 2)), contralateral(drawn), sweep.task
    effort = settings.draws, settings.seed, settings.threads
    after = [survival(*vehicles, p, *effort) for p in PERTURBATIONS]
    return {"weights": drawn, "survival": np.array(after).reshape(len(PERTURBATIONS), len(drawn))}


def study(folder: Path, settings: RealityGap, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``summary.json``, tables as CSV and ``reality-gap.png``; a folder without manifolds gets them, too."""
    results = ResultsFolder(folder, "reality-gap", settings.describe())
    swept = sweep_folder or folder / "sweep"
    parts = {design: partial(measure, settings, design, swept) for design in DESIGNS}
    allowed = {"weights": Allowed(("C", 2)), "survival": Allowed((len(PERTURBATIONS), "C"), 0.0, 1.0)}
    found = computed(results, parts, part_of(progress, 0, 2), "design_{}", partial(check_arrays, allowed))
    rows = [
        dict(zip(COLUMNS, (design, perturbation.name, perturbation.strength, *weights, share), strict=True))
        for design, arrays in found.items()
        for perturbation, shares in zip(PERTURBATIONS, arrays["survival"], strict=True)
        for weights, share in zip(arrays["weights"].tolist(), shares.tolist(), strict=True)
    ]
    write_records(folder / TABLE, rows)
    manifolds = _manifolds(results, settings, part_of(progress, 1, 2))
    write_records(folder / weight_manifolds.TABLE, manifolds)
    _report(folder, rows, manifolds)


def _manifolds(results: ResultsFolder, settings: RealityGap, progress: Progress) -> list[Record]:
    """What changes do to the weight manifold of each body: a row for each change of each."""
    effort = settings.manifold, settings.manifold_draws

    def measured(design: int, progress: Progress) -> Arrays:
        body, task, (weights, draws) = VehicleBody.published(design), settings.sweep.task, effort
        return weight_manifolds.measure(body, task, weights, draws, settings.seed, settings.threads, progress)

    parts = {design: partial(measured, design) for design in DESIGNS}
    name, check = (
        f"manifold_{settings.manifold}_{settings.manifold_draws}_{{}}",
        partial(weight_manifolds.check, *effort),
    )
    found = computed(results, parts, progress, name, check)
    rows = (weight_manifolds.rows_of(design, settings.manifold_draws, arrays) for design, arrays in found.items())
    return list(chain.from_iterable(rows))


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json``, ``survival.csv`` and the figure from the table of controllers, and that of manifolds.

    Data of earlier versions have no manifolds.
    """
    rows = data.records(TABLE, COLUMNS)
    for design in distinct(rows, "design"):
        if len(counts := set(map(len, _survival(rows, design)))) > 1 or 0 in counts:
            raise ValueError(
                f"{data.path(TABLE)}: design {design} has {sorted(counts)} controllers in the perturbations of the "
                "study; give as many in each, at least 1"
            )
    _report(folder, rows, _kept_manifolds(data))


def _kept_manifolds(data: Data) -> list[Record]:
    """The rows of the table of manifolds, if there is one."""
    name = weight_manifolds.TABLE
    rows = data.records(name, weight_manifolds.COLUMNS) if data.has(name) else []
    for design in distinct(rows, "design"):
        if len(sizes := set(distinct(select(rows, design=design), "before"))) > 1:
            raise ValueError(f"{data.path(name)}: design {design} has {sorted(sizes)} as before; it must be one number")
    return rows


def _survival(rows: Sequence[Record], design: int) -> list[Floats]:
    """Shares that survive each perturbation, by controller."""
    own = select(rows, design=design)
    return [column(select(own, perturbation=p.name, strength=p.strength), "survival") for p in PERTURBATIONS]


def _report(folder: Path, rows: Sequence[Record], manifolds: Sequence[Record]) -> None:
    """Write ``summary.json``, ``survival.csv`` and the figure, which follow from the tables."""
    found = {design: np.array(_survival(rows, design)) for design in distinct(rows, "design")}
    means: list[Record] = []
    for design, survivals in found.items():
        for perturbation, shares in zip(PERTURBATIONS, survivals, strict=True):
            mean, low, high = map(float, (shares.mean(), *mean_band(shares)))
            about = {"design": design, "perturbation": perturbation.name, "strength": perturbation.strength}
            means.append({**about, "controllers": len(shares), "mean": mean, "low": low, "high": high})
    write_records(folder / "survival.csv", means)
    summary = _tests({str(design): each.mean(axis=0) for design, each in found.items()})
    if manifolds:
        summary["manifolds"] = weight_manifolds.summary(manifolds)
    write_json(folder / "summary.json", summary)
    draw(means, folder / "reality-gap.png")


def _tests(means: Mapping[str, Floats]) -> dict[str, Any]:
    """Mann-Whitney tests of every controller's mean survival over all perturbations: the baseline's are less."""
    first, *others = map(str, DESIGNS)
    pairs = [(first, other) for other in others if first in means and other in means]
    overall = {design: {"controllers": len(m), "mean": float(m.mean())} for design, m in means.items()}
    return {"mean_over_perturbations": overall, "tests": compare(means, pairs, "less")}


def draw(rows: Sequence[Record], path: Path) -> None:
    """Survival against strength, a panel for each kind."""
    kinds = list(dict.fromkeys(p.name for p in PERTURBATIONS))
    with figure(path, PAGE, 4.2, letters="", nrows=2, ncols=4, sharey=True) as (_, panels):
        for axes, kind in zip(panels.flat, kinds, strict=False):
            for (design, label), colour in zip(DESIGNS.items(), COLOURS, strict=False):
                if here := select(rows, design=design, perturbation=kind):
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
    scales={"small": RealityGap(controllers=10, draws=2, manifold=41, manifold_draws=1), "full": RealityGap()},
    run=study,
    rewrite=rewrite,
    writes=("summary.json", TABLE, weight_manifolds.TABLE, "survival.csv", "reality-gap.png"),
)
