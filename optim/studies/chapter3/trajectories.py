"""Paths of the controllers that chapter 3 shows, in the canonical body and in its best one.

Source: dissertation, chapter 3, figures "canonical_trajectories" and "best_trajectories". Its paths are those of an
integrator that chooses its steps; steps of 0.1 s jump over the light with two of its controllers, these do not.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data
from optim.experiments.figures import PAGE, caption, figure, save_arrays
from robots.braitenberg import BASELINE, PUBLISHED, VehicleBody, contralateral, simulate, trace
from robots.view.vehicle_charts import draw_paths
from taichi_sim.base.arrays import Arrays, Floats

Shown = tuple[int, tuple[tuple[float, float], ...]]  # a design, and the weights of its controllers
SHOWN: dict[str, Shown] = {
    "canonical": (BASELINE.design or 0, ((0.6, 0.98), (0.77, 0.77))),
    "best": (241, ((-0.85, 0.82), (-0.8, 0.6), (-0.28, 0.37))),
}
FINE = replace(PUBLISHED, radius=0.2, time_step=0.01, steps=50_000)
EVERY = 10  # steps between samples
TOLERANCE = 0.01  # m, between a path and its thinned one
MOST_POINTS = 2000  # of a thinned path
FARTHEST = 1e6  # m
SIDE = 5.0  # m, from the light to the sides of a panel
NUMBERS = "trajectories.npz"
PICTURES = tuple(f"trajectories-{name}.png" for name in SHOWN)


def thinned(path: Floats, tolerance: float = TOLERANCE) -> Floats:
    """Leave out points of a path, shape (T, 2), that lie within a tolerance [m] of the line through the others.

    By Ramer, Douglas and Peucker. A path of more than ``MOST_POINTS`` is thinned with twice the tolerance, and so on.
    It ends before the first point that is not finite.
    """
    bad = ~np.isfinite(path).all(axis=1)
    path = path[: int(np.argmax(bad))] if bad.any() else path
    kept = np.zeros(len(path), bool)
    kept[[0, -1]] = True
    spans = [(0, len(path) - 1)]
    while spans:
        first, last = spans.pop()
        middle, distance = _farthest(path[first : last + 1])
        if distance > tolerance:
            kept[first + middle] = True
            spans += [(first, first + middle), (first + middle, last)]
    return path[kept] if kept.sum() <= MOST_POINTS else thinned(path, 2 * tolerance)


def _farthest(path: Floats) -> tuple[int, float]:
    """The point of a path that is farthest from the line between its ends, by number, and how far that is [m]."""
    off, along = path - path[0], path[-1] - path[0]
    share = np.clip(off @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    distances = np.linalg.norm(off - share[:, None] * along, axis=1)
    return int(np.argmax(distances)), float(distances.max())


def packed(paths: Floats) -> NDArray[np.float32]:
    """Thin paths, shape (..., T, 2); NaN after their ends, in single precision, shape (..., F, 2)."""
    each = [thinned(path) for path in paths.reshape(-1, *paths.shape[-2:])]
    found = np.full((len(each), max(map(len, each)), 2), np.nan, np.float32)
    for row, path in zip(found, each, strict=True):
        row[: len(path)] = path
    return found.reshape(*paths.shape[:-2], -1, 2)


def check_paths(name: str, found: NDArray[Any], shape: tuple[int, ...]) -> None:
    """Refuse an array that holds no packed paths, which have this shape before points and coordinates."""
    points = found.shape[-2] if found.ndim > 1 else 0
    if points > MOST_POINTS:
        raise ValueError(f"{name}: {points} points of a path are not allowed; give at most {MOST_POINTS}")
    Allowed((*shape, points, 2), -FARTHEST, FARTHEST, failed=np.nan).check(name, found)
    if not points or np.isnan(found[..., 0, :]).any():
        raise ValueError(f"{name}: paths without a first point are not allowed")


def trajectories() -> Arrays:
    """Compute the paths of all controllers that are shown, (C, E, F, 2), and which lights they reach, (C, E)."""
    found = {}
    for name, (design, weights) in SHOWN.items():
        body, controllers = [VehicleBody.published(design)], contralateral(weights)[None]
        found[f"paths_{name}"] = packed(trace(body, controllers, FINE, every=EVERY).poses[0, ..., :2])
        found[f"reached_{name}"] = simulate(body, controllers, FINE).reached[0]
    return found


def read_trajectories(data: Data, file: str) -> Arrays:
    """Read what :func:`trajectories` computed, from a file of ``data``; raises ValueError if it is anything else."""
    found = data.arrays(file, [f"{kind}_{name}" for name in SHOWN for kind in ("paths", "reached")])
    environments = len(FINE.starts)
    try:
        for name, (_, weights) in SHOWN.items():
            check_paths(f"paths_{name}", found[f"paths_{name}"], (len(weights), environments))
            check_arrays({f"reached_{name}": Allowed((len(weights), environments), kind="b")}, found)
    except ValueError as error:
        raise ValueError(f"{data.folder / file}: {error}") from None
    return found


def save_trajectories(found: Mapping[str, Any], folder: Path) -> None:
    """Draw a figure for each body, a panel for each controller, all of one scale; their numbers beside them."""
    lights = np.unique(FINE.lights, axis=0)
    for name, picture in zip(SHOWN, PICTURES, strict=True):
        design, weights = SHOWN[name]
        count = len(weights)
        with figure(folder / picture, PAGE * count / 3, 2.75, "A", ncols=count, sharey=True) as (_, panels):
            each = zip(panels[0], weights, found[f"paths_{name}"], found[f"reached_{name}"], strict=True)
            for axes, (first, second), paths, reached in each:
                draw_paths(axes, paths, lights, SIDE)
                caption(axes, f"$w_1 = {first:g}$, $w_2 = {second:g}$: {reached.sum()} of {len(reached)} reached")
                axes.set_ylabel("")
            panels[0, 0].set_ylabel(f"design {design}: y [m]")
    save_arrays(folder / NUMBERS, dict(found))
