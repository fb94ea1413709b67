"""A sweep of random bodies of the two-wheel vehicle, beside the theoretical model of the same bodies.

Source: dissertation, chapter 3, figure "histogram": the distributions of both metrics in both models.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Settings, Study, Whole
from optim.experiments.tables import write_columns
from optim.measures.overlap import interference, learnability
from optim.measures.statistics import spearman
from optim.studies.chapter3.rover_success import BODIES, MODELS, RoverGrid, both_models
from optim.studies.chapter3.sensor_placement import distribution
from optim.studies.chapter3.sweep_table import sample_designs
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

METRICS = {"M_L": learnability, "M_CF": interference}
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
    device: str = "cpu"  # ``"cpu"``, ``"cuda"``, .
    threads: int | None = None  # CPU threads, all available if None; changes no result

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
    check_folder(folder, ("success", "theory", "summary.json", "rover-sweep.csv", "rover-sweep.png"))
    bodies = [*(rover.vehicle for rover in BODIES.values()), *map(VehicleBody.published, settings.designs)]
    where: dict[str, Any] = {"device": settings.device, "threads": settings.threads}
    _, overlaps = both_models(bodies, settings.grid, settings.theory, folder, progress, **where)
    columns: dict[str, Any] = {"design": settings.designs}
    metrics: dict[tuple[str, str], Floats] = {}
    known: dict[tuple[str, str], dict[str, float]] = {}
    for model, found in overlaps.items():
        short, drawn = model.split()[0], found[len(BODIES) :]
        columns |= {f"{short}_all": (drawn >= 4).sum((1, 2)), f"{short}_any": (drawn >= 1).sum((1, 2))}
        for name, metric in METRICS.items():
            values = metric(found)
            known[model, name] = dict(zip(BODIES, values.tolist(), strict=False))
            metrics[model, name] = columns[f"{short}_{name}"] = values[len(BODIES) :]
    write_columns(folder / "rover-sweep.csv", columns)
    write_json(folder / "summary.json", summary(settings, metrics, known))
    draw(metrics, known, folder / "rover-sweep.png")


def summary(
    settings: RoverSweep,
    metrics: Mapping[tuple[str, str], Floats],
    known: Mapping[tuple[str, str], Mapping[str, float]],
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
    rigid, theoretical = MODELS
    found["rank_correlation_between_models"] = {
        name: asdict(spearman(metrics[rigid, name], metrics[theoretical, name], "two-sided")) for name in METRICS
    }
    return found


def draw(
    metrics: Mapping[tuple[str, str], Floats], known: Mapping[tuple[str, str], Mapping[str, float]], path: Path
) -> None:
    """Histograms of both metrics, a row a model, with the canonical and the best body."""
    with figure(path, PAGE, 4.2, nrows=len(MODELS), ncols=len(METRICS), sharey=True) as (_, panels):
        for axes, ((model, name), values) in zip(panels.flat, metrics.items(), strict=True):
            lines = known[model, name]
            axes.stairs(*distribution(values, BINS, max(lines.values())), fill=True, color=COLOURS[0])
            for (body, value), colour in zip(lines.items(), COLOURS[1:], strict=False):
                axes.axvline(value, color=colour, linestyle="--", label=f"{body} body")
            axes.set(xlabel=f"{MEANINGS[name]}, {model}", yscale="log", ylim=(0.7, 2 * len(values)))
            caption(axes, f"{np.count_nonzero(values == 0)} of {len(values)} bodies at 0")
        for axes in panels[:, 0]:
            axes.set_ylabel("bodies")
        panels[1, 0].legend(loc="upper right")


STUDY = Study(
    title="learnability of random bodies of the two-wheel vehicle, as rigid bodies and in theory",
    source="chapter 3, figure of distributions, empirical model",
    scales={
        "small": RoverSweep(12, grid=RoverGrid(11), theory=Sweep(11)),
        "medium": RoverSweep(),  # 0.5 % of the published grid; what has been run
        "full": RoverSweep(DESIGNS, grid=RoverGrid(), theory=Sweep()),  # the published grid: 31 h of CPU time
    },
    run=study,
    writes=("summary.json", "rover-sweep.csv", "rover-sweep.png"),
    cost="31 h of CPU time",
)
