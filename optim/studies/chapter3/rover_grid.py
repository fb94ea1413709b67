"""Which lights a two-wheel vehicle reaches with every controller on a grid of weights, kept in a folder.

Source: dissertation, chapter 3, "The empirical model". With left and right exchanged a vehicle meets the same four
environments in another order, so two bodies of the published grid of sensors' places share a sweep.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import cached, check_counts
from robots.braitenberg import weight_grid
from robots.rover import STEPS, Rover, simulate
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

KIND = "rover-grid"  # of folders
MIRRORED_LIGHTS = [1, 0, 3, 2]  # those that lie where each lies in a mirror


@dataclass(frozen=True)
class RoverGrid:
    """Settings.

    Attributes:
        weights: values of each of the two weights, from -1 to 1.
        steps: looks at the light in every rollout.
        precision: ``"f32"`` or ``"f64"``.
    """

    weights: int = 121
    steps: int = STEPS
    precision: str = "f32"

    def __post_init__(self) -> None:
        check_counts(self, weights=2, steps=1)
        checks.choice("precision", self.precision, ("f32", "f64"))

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
    progress: Callable[[float], None] | None = None,
) -> Bools:
    """Which lights each controller reaches in bodies of the published grid.

    Args:
        designs: numbers of the bodies, D of them, from 1 to 6561; see ``Rover.published``.
        settings: of the grid.
        folder: takes a file a body as they come. A sweep of the same settings that finds it goes on from there, also
            for other bodies; killed at any moment, it loses the body at hand.
        device: ``"cpu"``, ``"cuda"``, ...
        threads: CPU threads, all available if None; changes no result.
        progress: called with the fraction done.

    Returns:
        S, shape (D, n, n, 4): whether body d reaches light k with the weights grid[i] and grid[j].

    Raises:
        ValueError: for a number that is no body's, or a folder of other settings.
    """
    stand_ins = [_stand_in(design) for design in designs]
    results = ResultsFolder(folder, KIND, {**asdict(settings), "base": asdict(Rover())}) if folder else None
    found = np.empty((len(stand_ins), settings.weights, settings.weights, 4), bool)
    wanted = sorted({design for design, _ in stand_ins})
    for n, design in enumerate(wanted):
        compute = partial(_one, design, settings, {"device": device, "threads": threads})
        known = cached(results, f"design_{design}", compute)["success"]
        for index, (own, mirrored) in enumerate(stand_ins):
            if own == design:
                found[index] = known.transpose(1, 0, 2)[..., MIRRORED_LIGHTS] if mirrored else known
        if progress:
            progress((n + 1) / len(wanted))
    return found


def _stand_in(design: int) -> tuple[int, bool]:
    """The body that is simulated for another: the smaller number of it and its mirror image; and which of them."""
    image = Rover.published(design).mirrored.vehicle.design
    assert image is not None  # the grid is symmetric
    return min(design, image), image < design


def _one(design: int, settings: RoverGrid, where: dict[str, Any]) -> Arrays:
    """Success in one body, (n, n, 4)."""
    options = {"steps": settings.steps, "precision": settings.precision, **where}
    done = simulate(Rover.published(design), settings.pairs, **options)
    return {"success": done.success.reshape(settings.weights, settings.weights, -1)}
