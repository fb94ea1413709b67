"""A sweep of random bodies of the two-wheel vehicle, beside the theoretical model of the same bodies.

Source: dissertation, chapter 3, figure "histogram": the distributions of both metrics in both models.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure, letter
from optim.experiments.results import Budget, Progress, check_folder, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.measures.overlap import interference, learnability
from optim.measures.statistics import spearman
from optim.studies.chapter3.rover_grid import RoverGrid, successes
from optim.studies.chapter3.rover_success import BODIES, MODELS
from optim.studies.chapter3.sweep_table import overlaps_of
from optim.studies.chapter4.training import sample_designs
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

METRICS = {"M_L": learnability, "M_CF": interference}
MEANINGS = {"M_L": "learnability $M_L$", "M_CF": "resistance to forgetting $M_{CF}$"}
BINS = 30
SHARES = (0.5, 0.9, 0.99)  # quantiles reported


@dataclass(frozen=True)
class RoverSweep:
    """Settings.

    Attributes:
        bodies: how many of the 6561 of the published grid, drawn at random.
        seed: of the draw.
        grid: of weights.
        theory: of the theoretical model, with as many weights.
        device: ``"cpu"``, ``"cuda"``, ...
        threads: CPU threads, all available if None; changes no result.
    """

    bodies: int = 500
    seed: int = 1
    grid: RoverGrid = field(default_factory=lambda: RoverGrid(31))
    theory: Sweep = field(default_factory=lambda: Sweep(31))
    device: str = "cpu"
    threads: int | None = None

    def __post_init__(self) -> None:
        checks.integer("bodies", self.bodies, 2, DESIGNS)
        checks.integer("seed", self.seed, 0)
        if self.grid.weights != self.theory.weights:
            raise ValueError(f"theory: {self.theory.weights} weights are not allowed beside {self.grid.weights}")

    @property
    def designs(self) -> list[int]:
        """Numbers of the bodies, ascending."""
        return sample_designs(self.bodies, self.seed)


SCALES: Mapping[Budget, RoverSweep] = {
    "small": RoverSweep(12, grid=RoverGrid(11), theory=Sweep(11)),
    "medium": RoverSweep(),  # 0.5 % of the published grid; what has been run
    "full": RoverSweep(DESIGNS, grid=RoverGrid(), theory=Sweep()),  # the published grid: 31 h of CPU time
}


def study(folder: Path, settings: RoverSweep, progress: Progress = None) -> None:
    """Write ``summary.json``, a table and a figure.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    check_folder(folder, ("success", "theory", "summary.json", "rover-sweep.csv", "rover-sweep.png"))
    named = {name: rover.vehicle for name, rover in BODIES.items()}
    vehicles = [*named.values(), *map(VehicleBody.published, settings.designs)]
    designs = [vehicle.design for vehicle in vehicles if vehicle.design is not None]  # all are of the grid
    where: dict[str, Any] = {"device": settings.device, "threads": settings.threads}
    reached = successes(designs, settings.grid, folder / "success", **where, progress=part_of(progress, 0, 2))
    overlaps = {
        MODELS[0]: reached.sum(-1, dtype=np.uint8),
        MODELS[1]: overlaps_of(vehicles, settings.theory, folder / "theory", **where, progress=part_of(progress, 1, 2)),
    }
    metrics = {(model, name): metric(found) for model, found in overlaps.items() for name, metric in METRICS.items()}
    known = {key: dict(zip(named, values[: len(named)].tolist(), strict=True)) for key, values in metrics.items()}
    metrics = {key: values[len(named) :] for key, values in metrics.items()}
    columns: dict[str, list[Any]] = {"design": list(settings.designs)}
    for model, found in overlaps.items():
        counts = (np.count_nonzero(found[len(named) :] >= least, axis=(1, 2)) for least in (4, 1))
        each = zip(("all", "any", *METRICS), (*counts, *(metrics[model, name] for name in METRICS)), strict=True)
        columns |= {f"{model.split()[0]}_{name}": values.tolist() for name, values in each}
    write_table(folder / "rover-sweep.csv", list(columns), zip(*columns.values(), strict=True))
    write_json(folder / "summary.json", summary(settings, metrics, known))
    draw(metrics, known, folder / "rover-sweep.png")


def summary(
    settings: RoverSweep, metrics: dict[tuple[str, str], Floats], known: dict[tuple[str, str], dict[str, float]]
) -> dict[str, Any]:
    """Distributions, ranks of the canonical and the best body, and how the models' orders of bodies agree."""
    found: dict[str, Any] = {"bodies": settings.bodies, "seed": settings.seed, "weights": settings.grid.weights}
    for (model, name), values in metrics.items():
        best = int(np.argmax(values))
        found[f"{name}, {model}"] = {
            "mean": float(values.mean()),
            "quantiles": dict(zip(map(str, SHARES), np.quantile(values, SHARES).tolist(), strict=True)),
            "largest": {"value": float(values[best]), "design": settings.designs[best]},
            "zeros": int(np.count_nonzero(values == 0)),
            "known_bodies": {
                body: {"value": value, "share_of_bodies_above": float(np.mean(values > value))}
                for body, value in known[model, name].items()
            },
        }
    found["rank_correlation_between_models"] = {
        name: asdict(spearman(metrics[MODELS[0], name], metrics[MODELS[1], name], "two-sided")) for name in METRICS
    }
    return found


def draw(metrics: dict[tuple[str, str], Floats], known: dict[tuple[str, str], dict[str, float]], path: Path) -> None:
    """Histograms of both metrics, a row a model, with the canonical and the best body."""
    with figure(path, PAGE, 4.2, nrows=len(MODELS), ncols=len(METRICS), sharey=True) as (_, panels):
        for axes, ((model, name), values) in zip(panels.flat, metrics.items(), strict=True):
            lines = known[model, name]
            counts, edges = np.histogram(values, BINS, (0.0, max(values.max(), *lines.values()) or 1.0))
            axes.stairs(counts, edges, fill=True, color=COLOURS[0])
            for (body, value), colour in zip(lines.items(), COLOURS[1:], strict=False):
                axes.axvline(value, color=colour, linestyle="--", label=f"{body} body")
            axes.set(xlabel=f"{MEANINGS[name]}, {model}", yscale="log", ylim=(0.7, 2 * len(values)))
            caption(axes, f"{np.count_nonzero(values == 0)} of {len(values)} bodies at 0")
        for axes in panels[:, 0]:
            axes.set_ylabel("bodies")
        panels[1, 0].legend(loc="upper right")
        letter(panels)


STUDY = Study(
    title="learnability of random bodies of the two-wheel vehicle, as rigid bodies and in theory",
    source="chapter 3, figure of distributions, empirical model",
    scales=SCALES,
    run=study,
    writes=("summary.json", "rover-sweep.csv", "rover-sweep.png"),
    cost="31 h of CPU time",
)
