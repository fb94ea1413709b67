"""What the places of two light sensors do to a vehicle: metrics, controllers that succeed, and how they move.

Source: dissertation, chapters 3 and 4: distributions and correlation of the metrics; examples of bodies with traces and
success matrices; persistent phototaxis.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import Correlation, pearson
from optim.studies.chapter3.sweep_table import SweepTable
from robots.braitenberg import BASELINE, VehicleBody, VehicleTask, contralateral, simulate, trace, weight_grid
from taichi_sim.base.arrays import Bools, Bytes, Floats, Ints

NEAR = 0.5  # m, half a side of the body: the light remains under it
EVERY = 5  # steps between samples
AT_ONCE = 100  # controllers whose traces fit into memory


def distribution(values: ArrayLike, bins: int = 40, most: float = 0.0) -> tuple[Ints, Floats]:
    """The distribution of a metric over bodies, from 0 to its largest value, or to ``most`` if that is more.

    Returns:
        Bodies in each bin, shape (B,), of which the last has its upper edge, too; and the edges, shape (B + 1,).
    """
    return np.histogram(values, bins, (0.0, max(float(np.max(values)), most) or 1.0))


def correlation_of_metrics(table: SweepTable) -> Correlation:
    """Pearson's correlation of M_L with M_CI over bodies, its p two-sided."""
    return pearson(table.learnability, table.interference, "two-sided")


def notable_designs(table: SweepTable) -> dict[int, str]:
    """The baseline, if it is there, the best body by M_L and that by M_CI, with what they are; of equals the first."""
    found = {design: "baseline" for design in table.designs.tolist() if design == BASELINE.design}
    for name, values in table.metrics.items():
        design = int(table.designs[np.argmax(values)])
        found[design] = f"{found[design]}, best {name}" if design in found else f"best {name}"
    return found


def solving_controllers(overlap: Bytes, environments: int = 4) -> Floats:
    """Weights (w1, w2) of the controllers of a sweep that solve every environment, shape (C, 2)."""
    grid = weight_grid(len(overlap))
    first, second = np.nonzero(overlap == environments)
    return np.stack([grid[first], grid[second]], axis=1)


def some_solving_controllers(overlap: Bytes, count: int, seed: Sequence[int]) -> Floats:
    """At most so many solving controllers, drawn without replacement, in the order of the sweep, shape (C, 2)."""
    weights = solving_controllers(overlap)
    drawn = np.random.default_rng(seed).permutation(len(weights))[:count]
    return np.asarray(weights[np.sort(drawn)])


def central_controller(overlap: Bytes, environments: int = 4) -> Floats | None:
    """The solving controller with most of its kind around it, shape (2,), the first of equals; None without any.

    It is the farthest from all controllers that fail, those beyond the grid among them.
    """
    from scipy.ndimage import distance_transform_edt  # slow to import

    depth = distance_transform_edt(np.pad(overlap == environments, 1))[1:-1, 1:-1]
    if not depth.any():
        return None
    first, second = np.unravel_index(np.argmax(depth), depth.shape)
    grid = weight_grid(len(overlap))
    return np.array([grid[first], grid[second]])


def paths(body: VehicleBody, weights: ArrayLike, task: VehicleTask, every: int = EVERY) -> Floats:
    """Paths of a body with controllers of weights, shape (C, 2): x and y [m], shape (C, E, F, 2)."""
    return trace([body], contralateral(weights)[None], task, every=every).poses[0, ..., :2]


def persistent(body: VehicleBody, weights: ArrayLike, task: VehicleTask, near: float = NEAR) -> Bools:
    """Whether controllers, (C, 2), show persistent phototaxis: having reached the light, they stay by it to the end.

    The centre must stay within ``near`` [m] of the light, by samples every ``EVERY`` steps. Shape (C, E); False where a
    controller never reaches the light.
    """
    values = np.atleast_2d(np.asarray(weights, float))
    arrival = simulate([body], contralateral(values)[None], task).arrival[0]
    found = arrival >= 0
    for first in range(0, len(values), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        distances = np.linalg.norm(paths(body, values[part], task) - task.lights[:, None], axis=-1)
        before = np.arange(distances.shape[-1]) * EVERY < arrival[part, :, None]
        found[part] &= (before | (distances < near)).all(axis=-1)
    return found
