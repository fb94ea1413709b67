"""Controllers of rigid robots: weights from each sensor to each motor neuron."""

import numpy as np

from taichi_sim.base.arrays import Floats


def check_weights(weights: object, sensors: int, motors: int) -> Floats:
    """Weights as an array (N, sensors, motors); a single controller's become the first of one.

    Raises:
        ValueError: in one line, for other shapes or numbers that are not finite.
    """
    try:
        found = np.asarray(weights, float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.ndim == 2:
        found = found[None]
    if found.ndim != 3 or found.shape[1:] != (sensors, motors) or len(found) == 0:
        raise ValueError(
            f"weights: shape {found.shape} is not allowed; give (N, {sensors}, {motors}): "
            "one row a sensor, one column a motor"
        )
    if not np.isfinite(found).all():
        raise ValueError("weights: numbers that are not finite are not allowed")
    return found


def random_weights(count: int, sensors: int, motors: int, generator: np.random.Generator) -> Floats:
    """Weights drawn evenly between -1 and 1, (count, sensors, motors)."""
    return generator.uniform(-1, 1, (count, sensors, motors))
