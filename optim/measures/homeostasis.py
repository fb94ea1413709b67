"""Sensor homeostasis: how similar different environments appear to a robot's sensors.

Source: Powers, Grindle, Frati & Bongard, A good body is all you need, arXiv 2021 (chapter 4 of Powers' dissertation,
University of Vermont: dynamic time warping between the signals of each two environments, averaged).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats


def homeostasis(signals: ArrayLike, distances: Callable[[Floats, Floats], Floats]) -> Floats:
    """Mean distance between a sensor's signals in each pair of environments; low means homeostatic.

    Compare only controllers that solve every environment: the lowest values belong to controllers that fail because
    their sensors never see the light. As an objective, count it only once all environments are solved.

    Args:
        signals: signals of B controllers in E environments from S sensors at T times, shape (B, E, S, T). In the
            source: the light, 1 / distance squared, at both sensors, at the start and after each of 10,000 steps.
        distances: function of two stacks of signals, shape (P, T), that returns P distances. The source uses
            dynamic time warping, as ``taichi_sim.signals.warping_distances`` does; with ``normalise=True`` that
            function ignores differences in offset and amplitude. It is called once, with P = B S E (E - 1) / 2 pairs.

    Returns:
        Mean of each controller over pairs of environments and over sensors, shape (B,); NaN where a distance is NaN.

    Raises:
        ValueError: if signals do not have four axes with at least two environments and one sensor, or the number of
            distances is not that of the pairs.
    """
    signals = np.asarray(signals, float)
    if signals.ndim != 4 or signals.shape[1] < 2 or signals.shape[2] < 1:
        raise ValueError(
            f"signals: shape {signals.shape} is not allowed; give (controllers, environments, sensors, samples) "
            "of two environments or more"
        )
    controllers, environments, sensors, samples = signals.shape
    one, other = np.triu_indices(environments, k=1)
    ours, theirs = (signals[:, chosen].reshape(-1, samples) for chosen in (one, other))
    found = np.asarray(distances(ours, theirs), float)
    if found.shape != (len(ours),):
        raise ValueError(f"distances: shape {found.shape} is not allowed; give one for each of {len(ours)} pairs")
    return np.asarray(found.reshape(controllers, len(one), sensors).mean(axis=1).mean(axis=1))
