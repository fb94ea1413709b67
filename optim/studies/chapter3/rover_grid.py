"""Which lights a two-wheel vehicle reaches with every controller on a grid of weights, kept in a folder.

Source: dissertation, chapter 3, "The empirical model". With left and right exchanged a vehicle meets the same four
environments in another order, so two bodies of the published grid of sensors' places share a sweep.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from optim.experiments.results import Progress, computed, part_of
from optim.experiments.study import Count, Settings, Several
from optim.studies.chapter3.sweep_table import overlaps_of
from robots.braitenberg import Sweep, VehicleBody, weight_grid
from robots.braitenberg.sweeps import Overlap
from robots.rover import STEPS, Rover, simulate
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

MODELS = ("rigid bodies", "theoretical")
KIND = "rover-grid"  # of folders
MIRRORED_LIGHTS = [1, 0, 3, 2]  # those that lie where each lies in a mirror


@dataclass(frozen=True)
class RoverGrid(Settings):
    """A grid of controllers, and how each is simulated."""

    weights: Several = 121  # values of each of the two weights, from -1 to 1
    steps: Count = STEPS  # looks at the light in every rollout
    precision: Literal["f32", "f64"] = "f32"  # ``"f32"`` or ``"f64"``

    @property
    def pairs(self) -> Floats:
        """All weights w1 and w2, w2 changing fastest, (n n, 2)."""
        grid = weight_grid(self.weights)
        return np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)


def successes(
    designs: Sequence[int],
    settings: RoverGrid,
    folder: Path | None = None,
    *,
    device: str = "cpu",
    threads: int | None = None,
    progress: Progress = None,
) -> Bools:
    """Which lights each controller reaches in bodies of the published grid.

    Args:
        designs: numbers of the bodies, D of them, from 1 to 6561; see ``Rover.published``.
        folder: takes a file a body as they come. A sweep of the same settings that finds it goes on from there, also
            for other bodies; killed at any moment, it loses the body at hand.
        device: ``"cpu"``, ``"cuda"``, ...

    Returns:
        S, shape (D, n, n, 4): whether body d reaches light k with the weights grid[i] and grid[j].

    Raises:
        ValueError: for a number that is no body's, or a folder of other settings.
    """
    stand_ins = [_stand_in(design) for design in designs]
    results = ResultsFolder(folder, KIND, {**settings.describe(), "base": asdict(Rover())}) if folder else None

    def reached(design: int, _: Progress) -> Arrays:
        where: dict[str, Any] = {"precision": settings.precision, "device": device, "threads": threads}
        done = simulate(Rover.published(design), settings.pairs, steps=settings.steps, **where)
        return {"success": done.success.reshape(settings.weights, settings.weights, -1)}

    parts = {f"design_{design}": partial(reached, design) for design in sorted({design for design, _ in stand_ins})}
    found = computed(results, parts, progress)
    known = [(found[f"design_{design}"]["success"], mirrored) for design, mirrored in stand_ins]
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
    **where: Any,
) -> tuple[Bools, dict[str, Overlap]]:
    """Sweep the same bodies as rigid bodies and in the theoretical model.

    Args:
        folder: takes both, in folders of their own.

    Returns:
        Which lights each rigid body reaches, see :func:`successes`; and by model, how many lights each controller
        reaches, shape (D, n, n).
    """
    designs = [body.design for body in bodies if body.design is not None]  # all are of the grid
    reached = successes(designs, settings, folder / "success", **where, progress=part_of(progress, 0, 2))
    expected = overlaps_of(bodies, theory, folder / "theory", **where, progress=part_of(progress, 1, 2))
    return reached, dict(zip(MODELS, (reached.sum(-1, dtype=np.uint8), expected), strict=True))
