"""Success of all controllers in the canonical and the best body of chapter 3, in both of its models.

Source: dissertation, chapter 3, figures "landscape" (D to F) and section "Empirical results", and the theoretical model
of the same bodies (``robots.braitenberg``). With left and right exchanged a vehicle meets the same four environments in
another order, so two bodies of the published grid of sensors' places share a sweep of all controllers on a grid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data
from optim.experiments.figures import COLUMN, caption, figure, save_arrays
from optim.experiments.results import Progress, check_folder, computed, write_json
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import write_records
from optim.measures.overlap import learnability, resistance
from optim.studies.chapter3.examples import save_landscape
from optim.studies.chapter3.sweep_table import overlaps_of
from robots.braitenberg import Sweep, VehicleBody, weight_grid
from robots.braitenberg.sweeps import Overlap
from robots.robot import part_of
from robots.rover import BEST, CANONICAL, STEPS, Rover, simulate
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

MODELS = ("rigid bodies", "theoretical")
MIRRORED_LIGHTS = [1, 0, 3, 2]  # those that lie where each lies in a mirror


@dataclass(frozen=True)
class RoverGrid(Settings):
    """A grid of controllers, and how each is simulated."""

    weights: Several = 121  # values of each of the two weights, from -1 to 1
    steps: Count = STEPS  # looks at the light in every rollout
    precision: Literal["f32", "f64"] = "f32"

    @property
    def pairs(self) -> Floats:
        """All weights w1 and w2, w2 changing fastest, (n n, 2)."""
        grid = weight_grid(self.weights)
        return np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)


def successes(
    designs: Sequence[int], settings: RoverGrid, folder: Path | None = None, progress: Progress = None, **compute: Any
) -> Bools:
    """Which lights each controller reaches in bodies of the published grid.

    The folder takes a file a body as they come. A sweep of the same settings that finds it goes on from there, also for
    other bodies; killed at any moment, it loses the body at hand. Designs are D numbers, from 1 to 6561, see
    ``Rover.published``; ``compute`` are device and threads.

    Returns:
        S, shape (D, n, n, 4): whether body d reaches light k with the weights grid[i] and grid[j].

    Raises:
        ValueError: for a number that is no body's, or a folder of other settings.
    """
    stand_ins = [_stand_in(design) for design in designs]
    results = ResultsFolder(folder, "rover-grid", {**settings.describe(), "base": asdict(Rover())}) if folder else None

    def reached(design: int, _: Progress) -> Arrays:
        how: dict[str, Any] = {"steps": settings.steps, "precision": settings.precision, **compute}
        done = simulate(Rover.published(design), settings.pairs, **how)
        return {"success": done.success.reshape(settings.weights, settings.weights, -1)}

    parts = {design: partial(reached, design) for design in sorted({design for design, _ in stand_ins})}
    reaches = Allowed((settings.weights, settings.weights, len(MIRRORED_LIGHTS)), kind="b")
    found = computed(results, parts, progress, "design_{}", partial(check_arrays, {"success": reaches}))
    known = [(found[design]["success"], mirrored) for design, mirrored in stand_ins]
    return np.array([s.transpose(1, 0, 2)[..., MIRRORED_LIGHTS] if mirrored else s for s, mirrored in known])


def _stand_in(design: int) -> tuple[int, bool]:
    """The body that is simulated for another: the smaller number of it and its mirror image; and which of them."""
    image = Rover.published(design).mirrored.vehicle.design
    assert image is not None  # the grid is symmetric
    return min(design, image), image < design


def both_models(
    bodies: Sequence[VehicleBody],
    settings: RoverGrid,
    theory: Sweep,
    folder: Path,
    progress: Progress = None,
    **compute: Any,
) -> tuple[Bools, dict[str, Overlap]]:
    """Sweep the same bodies as rigid bodies and in the theoretical model, each in a folder of its own.

    Returns:
        Which lights each rigid body reaches, see :func:`successes`; and by model, how many lights each controller
        reaches, shape (D, n, n).
    """
    designs = [body.design for body in bodies if body.design is not None]  # all are of the grid
    # Theory first: it is short, and refuses a folder of another one before the hours of rigid bodies.
    expected = overlaps_of(bodies, theory, folder / "theory", **compute, progress=part_of(progress, 0, 2))
    reached = successes(designs, settings, folder / "success", part_of(progress, 1, 2), **compute)
    return reached, dict(zip(MODELS, (reached.sum(-1, dtype=np.uint8), expected), strict=True))


BODIES = {"canonical": Rover(CANONICAL), "best": Rover(BEST)}
# Of 121 x 121 controllers: those that solve all environments, M_L and M_CF.
PUBLISHED = {"canonical": (1, 0.000068, 0.00052), "best": (57, 0.0039, 0.038)}
LANDSCAPE = "landscape.png"  # as published, rigid bodies only
FILES = (*(f"rover-success.{end}" for end in ("csv", "npz", "png")), LANDSCAPE)
NUMBERS = "rover-success.npz"  # of the figure
ENVIRONMENTS = 4


@dataclass(frozen=True)
class RoverSuccess:
    """Sweeps of two bodies in both models."""

    grid: RoverGrid = field(default_factory=RoverGrid)  # of weights, of the rigid bodies
    theory: Sweep = field(default_factory=Sweep)  # of the theoretical model


def study(folder: Path, settings: RoverSuccess, progress: Progress = None) -> None:
    """Write ``summary.json``, a table and a figure, its numbers beside it."""
    check_folder(folder, ("success", "theory", "summary.json", *FILES))
    bodies = [rover.vehicle for rover in BODIES.values()]
    reached, found = both_models(bodies, settings.grid, settings.theory, folder, progress)
    overlaps = {(body, model): overlap for model in MODELS for body, overlap in zip(BODIES, found[model], strict=True)}
    lights = {body: found.sum((0, 1)).tolist() for body, found in zip(BODIES, reached, strict=True)}
    _report(folder, overlaps, lights)


def rewrite(data: Data, folder: Path) -> None:
    """Write what :func:`study` does from the figure's numbers, and from counts that ``summary.json`` has."""
    places = {(body, model): _named(body, model) for model in MODELS for body in BODIES}
    found = data.arrays(NUMBERS, places.values())
    for name, overlap in found.items():
        if overlap.dtype != np.uint8 or overlap.ndim != 2 or min(overlap.shape) < 2 or overlap.max() > ENVIRONMENTS:
            raise ValueError(
                f"{data.folder / NUMBERS}: {name} is no success matrix; it must have bytes up to {ENVIRONMENTS}, of at "
                "least 2 x 2 controllers"
            )
    lights = data.from_summary(_lights)
    _report(folder, {place: found[name] for place, name in places.items()}, lights)


def _lights(summary: Mapping[str, Any]) -> dict[str, list[int]]:
    """By body, how many controllers reach each light, from ``summary.json``."""
    counts = checks.table("reaching_each_light", summary["reaching_each_light"])
    return {body: [checks.integer(f"reaching_each_light {body}", each, 0) for each in counts[body]] for body in BODIES}


def _report(folder: Path, overlaps: Mapping[tuple[str, str], Overlap], lights: Mapping[str, list[int]]) -> None:
    """Write all from success matrices, and from how many controllers reach each light as rigid bodies."""
    rows = [_row(body, model, overlap) for (body, model), overlap in overlaps.items()]
    write_records(folder / "rover-success.csv", rows)
    write_json(folder / "summary.json", {"rows": rows, "reaching_each_light": lights})
    draw(overlaps, folder / "rover-success.png")
    names = {"canonical body": "canonical", "best $M_L$": "best", "best $M_{CF}$, the same body": "best"}
    save_landscape({name: overlaps[body, MODELS[0]] for name, body in names.items()}, folder / LANDSCAPE, "D")


def _row(body: str, model: str, overlap: Overlap) -> dict[str, Any]:
    counts = np.bincount(overlap.ravel(), minlength=1 + ENVIRONMENTS).tolist()
    row = {"body": body, "model": model, "controllers": overlap.size}
    row |= {f"solving_{lights}": count for lights, count in enumerate(counts)}
    row |= {"M_L": float(learnability(overlap)), "M_CF": float(resistance(overlap))}
    published = PUBLISHED[body] if model == MODELS[0] else (None,) * 3
    return row | {f"published_{name}": one for name, one in zip(("solving_4", "M_L", "M_CF"), published, strict=True)}


def draw(overlaps: Mapping[tuple[str, str], Overlap], path: Path) -> None:
    """Success matrices, a column a body and a row a model; their numbers beside it as ``.npz``."""
    with figure(path, 2 * COLUMN, 5.6, nrows=len(MODELS), ncols=len(BODIES)) as (drawn, panels):
        for axes, ((body, model), overlap) in zip(panels.flat, overlaps.items(), strict=True):
            image = draw_overlap(axes, overlap)
            caption(axes, f"{body} body, {model}: {np.count_nonzero(overlap == 4)} solve all")
        add_overlap_bar(drawn, image, panels.ravel().tolist())
    save_arrays(path.with_suffix(".npz"), {_named(*place): found for place, found in overlaps.items()})


def _named(body: str, model: str) -> str:
    return f"{body}, {model}"


STUDY = Study(
    title="all controllers in the canonical and the best body of the two-wheel vehicle, as rigid bodies",
    source="chapter 3, figure of landscapes, empirical model",
    scales={"small": RoverSuccess(RoverGrid(31), Sweep(31)), "full": RoverSuccess()},
    run=study,
    rewrite=rewrite,
    writes=("summary.json", "rover-success.csv", "rover-success.png", LANDSCAPE),
)
