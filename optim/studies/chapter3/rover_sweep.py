"""A sweep of random bodies of the two-wheel vehicle, beside the theoretical model of the same bodies.

Source: dissertation, chapter 3, figure "histogram": the distributions of both metrics in both models.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, caption, figure
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Settings, Study, Whole
from optim.experiments.tables import column, write_columns
from optim.measures.overlap import learnability_of, resistance_of
from optim.measures.statistics import spearman
from optim.studies.chapter3.rover_success import BODIES, MODELS, RoverGrid, both_models
from optim.studies.chapter3.sensor_placement import distribution
from optim.studies.chapter3.sweep_table import sample_designs
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.compute import Device, Threads


def _short(model: str) -> str:
    """The first word of a model, with which the names of its columns begin."""
    return model.split()[0]


TABLE = "rover-sweep.csv"
FILES = ("summary.json", TABLE, "rover-sweep.png")
METRICS = ("M_L", "M_CF")
# By model, columns of how many controllers solve all environments, and any.
COUNTS = {model: (f"{_short(model)}_all", f"{_short(model)}_any") for model in MODELS}
COLUMNS: dict[str, Kind] = dict.fromkeys(("design", *chain(*COUNTS.values())), int)
MEANINGS = {"M_L": "learnability $M_L$", "M_CF": "resistance to forgetting $M_{CF}$"}
BINS = 30
SHARES = (0.5, 0.9, 0.99)  # quantiles reported


@dataclass(frozen=True)
class RoverSweep(Settings):
    """Bodies that are drawn, and their sweeps in both models."""

    bodies: Annotated[int, partial(checks.integer, low=2, high=DESIGNS)] = 500  # of the published grid, drawn
    seed: Whole = 1  # of the draw
    grid: RoverGrid = field(default_factory=lambda: RoverGrid(31))  # of weights
    theory: Sweep = field(default_factory=lambda: Sweep(31))  # of the theoretical model, with as many weights
    device: Device = "cpu"  # ``"cpu"``, ``"cuda"``, .
    threads: Threads = None  # of the CPU; changes no result

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.grid.weights != self.theory.weights:
            raise ValueError(f"theory: {self.theory.weights} weights are not allowed beside {self.grid.weights}")

    @property
    def designs(self) -> list[int]:
        """Numbers of the bodies, ascending."""
        return sample_designs(self.bodies, self.seed)


def study(folder: Path, settings: RoverSweep, progress: Progress = None) -> None:
    """Write ``summary.json``, a table and a figure."""
    check_folder(folder, ("success", "theory", *FILES))
    bodies = [*(rover.vehicle for rover in BODIES.values()), *map(VehicleBody.published, settings.designs)]
    compute: dict[str, Any] = {"device": settings.device, "threads": settings.threads}
    _, overlaps = both_models(bodies, settings.grid, settings.theory, folder, progress, **compute)
    counts = {
        name: np.asarray(np.count_nonzero(found >= least, axis=(1, 2)))
        for model, found in overlaps.items()
        for name, least in zip(COUNTS[model], (4, 1), strict=True)
    }
    weights, first = settings.grid.weights, len(BODIES)
    known = {place: dict(zip(BODIES, values.tolist(), strict=False)) for place, values in _metrics(counts, weights)}
    drawn = {"design": np.array(settings.designs), **{name: values[first:] for name, values in counts.items()}}
    _report(folder, {"seed": settings.seed, "weights": weights}, drawn, known)


def rewrite(data: Data, folder: Path) -> None:
    """Write what :func:`study` does from its table, and from metrics of known bodies that ``summary.json`` has."""
    rows = data.records(TABLE, COLUMNS)
    about, known = data.from_summary(_known)
    controllers = about["weights"] ** 2
    for number, row in enumerate(rows, 2):
        for every, some in COUNTS.values():
            if not 0 <= row[every] <= row[some] <= controllers:
                raise ValueError(
                    f"{data.path(TABLE)}: row {number} has {row[every]} as {every} and {row[some]} as {some}; they "
                    f"must be 0 to {controllers} controllers, no more that solve all than any"
                )
    _report(folder, about, {name: column(rows, name).astype(int) for name in COLUMNS}, known)


def _known(found: Mapping[str, Any]) -> tuple[dict[str, int], dict[tuple[str, str], dict[str, float]]]:
    """Settings, and by model and metric those of known bodies, from ``summary.json``."""
    about = {name: checks.integer(name, found[name], low) for name, low in (("seed", 0), ("weights", 2))}
    known = {}
    for model, name in product(MODELS, METRICS):
        place = f"{name}, {model}"
        bodies = checks.table(place, found[place])["known_bodies"]
        known[model, name] = {body: checks.number(body, bodies[body]["value"], 0.0, 1.0) for body in BODIES}
    return about, known


def _metrics(counts: Mapping[str, Ints], weights: int) -> Iterator[tuple[tuple[str, str], Floats]]:
    """By model and name, the metrics of bodies, from counts of their controllers."""
    for model, (every, some) in COUNTS.items():
        yield (model, "M_L"), learnability_of(counts[every], weights**2)
        yield (model, "M_CF"), resistance_of(counts[every], counts[some])


def _report(
    folder: Path,
    about: Mapping[str, int],
    counts: Mapping[str, Ints],
    known: Mapping[tuple[str, str], Mapping[str, float]],
) -> None:
    """Write all from the counts of drawn bodies, as the table has them, and from metrics of known bodies."""
    metrics = dict(_metrics(counts, about["weights"]))
    columns: dict[str, Ints | Floats] = {"design": counts["design"]}
    for model, names in COUNTS.items():
        columns |= {name: counts[name] for name in names}
        columns |= {f"{_short(model)}_{name}": metrics[model, name] for name in METRICS}
    write_columns(folder / TABLE, columns)
    write_json(folder / "summary.json", summary(about, counts["design"], metrics, known))
    draw(metrics, known, folder / "rover-sweep.png")


def summary(
    about: Mapping[str, int],
    designs: Ints,
    metrics: Mapping[tuple[str, str], Floats],
    known: Mapping[tuple[str, str], Mapping[str, float]],
) -> dict[str, Any]:
    """Distributions, ranks of the canonical and the best body, and how the models' orders of bodies agree."""
    found: dict[str, Any] = {"bodies": len(designs), **about}
    for (model, name), values in metrics.items():
        best = int(np.argmax(values))
        found[f"{name}, {model}"] = {
            "mean": float(values.mean()),
            "quantiles": dict(zip(map(str, SHARES), np.quantile(values, SHARES).tolist(), strict=True)),
            "largest": {"value": float(values[best]), "design": int(designs[best])},
            "zeros": int(np.count_nonzero(values == 0)),
            "known_bodies": {
                body: {"value": value, "share_of_bodies_above": float(np.mean(values > value))}
                for body, value in known[model, name].items()
            },
        }
    rigid, theoretical = MODELS
    found["rank_correlation_between_models"] = {
        name: asdict(spearman(metrics[rigid, name], metrics[theoretical, name], "two-sided")) for name in METRICS
    }
    return found


def draw(
    metrics: Mapping[tuple[str, str], Floats], known: Mapping[tuple[str, str], Mapping[str, float]], path: Path
) -> None:
    """Histograms of both metrics, a row a model as published, with the canonical and the best body."""
    with figure(path, PAGE, 4.2, "A", nrows=len(MODELS), ncols=len(METRICS), sharey=True) as (_, panels):
        for axes, (model, name) in zip(panels.flat, product(reversed(MODELS), METRICS), strict=True):
            values, lines = metrics[model, name], known[model, name]
            axes.stairs(*distribution(values, BINS, max(lines.values())), fill=True, color=COLOURS[0])
            for (body, value), colour in zip(lines.items(), COLOURS[1:], strict=False):
                axes.axvline(value, color=colour, linestyle="--", label=f"{body} body")
            axes.set(xlabel=f"{MEANINGS[name]}, {model}", yscale="log", ylim=(0.7, 2 * len(values)))
            caption(axes, f"{np.count_nonzero(values == 0)} of {len(values)} bodies at 0")
        for axes in panels[:, 0]:
            axes.set_ylabel("bodies")
        panels[0, 0].legend(loc="upper right")


STUDY = Study(
    title="learnability of random bodies of the two-wheel vehicle, as rigid bodies and in theory",
    source="chapter 3, figure of distributions, empirical model",
    scales={
        "small": RoverSweep(12, grid=RoverGrid(11), theory=Sweep(11)),
        "medium": RoverSweep(),  # 0.5 % of the published grid; what has been run
        "full": RoverSweep(DESIGNS, grid=RoverGrid(), theory=Sweep()),  # the published grid: 31 h of CPU time
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="31 h of CPU time",
)
