"""Dynamic time warping: how far signals are apart when time may be stretched, many pairs of signals at once.

Sources: Sakoe & Chiba, IEEE Transactions on Acoustics, Speech, and Signal Processing 26(1), 1978 (table I, symmetric
form, P = 0); Giorgino, Journal of Statistical Software 31(7), 2009 (the same as step pattern *symmetric2*).
"""

from functools import lru_cache
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import Real, choose_width, larger, load, smaller, store
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.runtime import GRAIN, ti
from taichi_sim.store import Store

BLOCK_COST = 2.0  # a block of lanes takes as long as so many pairs in scalars (measured)
# Samples in a launch, for each CPU thread or for a whole GPU: they bound its memory, and on a CPU how long it takes.
SAMPLES_PER_THREAD, SAMPLES_PER_GPU = 2**21, 2**29


@runtime.exclusive
def warping_distances(
    first: ArrayLike,
    second: ArrayLike,
    *,
    normalise: bool = False,
    **compute: Unpack[ComputeOptions],
) -> Floats:
    """Distance of each pair of signals by dynamic time warping over their full lengths, without a window.

    A warping path runs through the cells (i, j) from the first pair of samples to the last, by steps (1, 0), (0, 1)
    and (1, 1). It costs |first[i] - second[j]| for each cell that it enters, twice that by a diagonal step. The
    distance is the cost of the cheapest path divided by N + M. The first cell counts once, as in the R and Python
    packages ``dtw`` of Giorgino (Sakoe & Chiba count it twice). It is symmetric, never negative, and zero for equal
    signals, also if samples of either are repeated.

    A pair takes memory for N + 2 M samples; its distance has the same bits in every batch and on any number of
    threads. In f32, rounding adds up along the path: expect four digits for signals of 10,000 samples.

    Args:
        first: P signals of N samples, shape (P, N), all in the same unit.
        second: the signals to compare them with, one by one, shape (P, M).
        normalise: shift and scale each signal to mean 0 and standard deviation 1 before, so that offset and
            amplitude do not matter. A constant signal becomes zeros, and so lies at distance 0 from other constants.
        **compute: device, precision and threads, as of :class:`Compute`.

    Returns:
        Distances in the unit of the samples (without unit if normalised), shape (P,); NaN for a pair with a sample
        that is not finite in this precision, or whose distance is not.

    Raises:
        ValueError: for wrong shapes, or a device or precision that is unknown or missing.
    """
    first, second = _checked("first", first), _checked("second", second)
    if len(first) != len(second):
        raise ValueError(
            f"second: shape {second.shape} is not allowed beside first of shape {first.shape}; give as many signals"
        )
    running = runtime.start(Compute.given(compute))
    precision, on_cpu, pairs, n, m = running.precision, running.device == "cpu", *first.shape, second.shape[1]
    threads, room = (running.thread_count, SAMPLES_PER_THREAD) if on_cpu else (1, SAMPLES_PER_GPU)
    real = Real(precision, choose_width(pairs, precision, threads, BLOCK_COST) if on_cpu else 1)
    blocks = max(room // (real.width * (n + 2 * m) + GRAIN), 1) * threads
    distances: Floats = np.full(pairs, np.nan)
    for begin in range(0, pairs, blocks * real.width):
        part = slice(begin, begin + blocks * real.width)
        ours, theirs = _prepared(first[part], normalise, real), _prepared(second[part], normalise, real)
        cost = _costs(real, on_cpu, ours, theirs)
        # A sample that is not finite makes a row or column of cells that is not, and every path crosses it.
        distances[part] = np.where(np.isfinite(cost), cost, np.nan) / (n + m)
    return distances


def _checked(field: str, signals: ArrayLike) -> Floats:
    """Signals as an array in C order, so that sums over a signal run in the same order in every batch."""
    allowed = "give signals of one length, shape (signals, samples), with at least one sample"
    try:
        array = np.asarray(signals, np.float64, order="C")
    except (TypeError, ValueError):
        raise ValueError(f"{field}: these signals are not allowed; {allowed}") from None
    if array.ndim != 2 or array.shape[1] < 1:
        raise ValueError(f"{field}: shape {array.shape} is not allowed; {allowed}")
    return array


def _prepared(signals: Floats, normalise: bool, real: Real) -> NDArray[Any]:
    """Signals in their precision, shape (P, N); if normalised, with mean 0 and deviation 1, constant ones as zeros."""
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite, or not in f32, makes its distance NaN
        if normalise:
            largest = np.abs(signals).max(axis=1, keepdims=True)
            signals = signals / np.where(largest > 0, largest, 1.0)  # no square overflows; constants deviate by 0.0
            deviation = signals.std(axis=1, keepdims=True)
            signals = (signals - signals.mean(axis=1, keepdims=True)) / np.where(deviation > 0, deviation, 1.0)
        return signals.astype(real.numpy)


def _costs(real: Real, on_cpu: bool, first: NDArray[Any], second: NDArray[Any]) -> Floats:
    """Costs of the cheapest paths, shape (P,): pairs side by side in reals, or a thread a pair on a GPU."""
    (pairs, n), m = first.shape, second.shape[1]
    blocks = -(-pairs // real.width)
    lanes = np.minimum(np.arange(blocks * real.width), pairs - 1)  # those without a pair repeat the last one
    stores = ours, theirs, _, cost = [Store(real, samples, blocks, on_cpu) for samples in (n, m, m, 1)]
    ours.write(first[lanes].T)
    theirs.write(second[lanes].T)
    _kernel(real, not on_cpu)(blocks, n, m, *(each.argument for each in stores))
    return cost.read()[0, :pairs]


@ti.func
def _cheapest(left, up, diagonal, a, b):
    """Cost of the cheapest path to a cell, from those to its neighbours: min(left + c, up + c, diagonal + 2 c)."""
    c = larger(a - b, b - a)
    return smaller(left, smaller(up, diagonal + c)) + c  # left is known last


@lru_cache
def _kernel(real: Real, side_by_side: bool) -> Any:
    """The kernel for one kind of real: a row of the path costs sweeps over the first signal, two samples at a time.

    So two chains of dependent minima run at once, and the row is loaded and stored half as often.
    """
    reals = ti.types.ndarray(dtype=real.type, ndim=2 if side_by_side else 1)
    grain = 1 if side_by_side else GRAIN

    @ti.kernel
    def warp(blocks: ti.i32, n: ti.i32, m: ti.i32, first: reals, second: reals, row: reals, cost: reals):
        for k in range(grain * blocks):
            if k % grain == 0:
                block = k // grain
                p, q = block, block  # where its signals lie, as lanes.load wants it
                if ti.static(not side_by_side):
                    p, q = block * n, block * m
                a0, b0 = load(first, p, 0), load(second, q, 0)
                infinity = 0.0 * a0 + np.inf
                for j in range(m):
                    store(row, q, j, infinity)
                corner = 0.0 - larger(a0 - b0, b0 - a0)  # lies before the first cell, which so counts once
                total = infinity
                for pair in range((n + 1) // 2):
                    i = 2 * pair
                    a, a_next = load(first, p, i), load(first, p, ti.min(i + 1, n - 1))
                    left, left_next, diagonal = infinity, infinity, corner
                    corner = infinity
                    for j in range(m):
                        b, up = load(second, q, j), load(row, q, j)
                        here = _cheapest(left, up, diagonal, a, b)
                        here_next = _cheapest(left_next, here, left, a_next, b)
                        diagonal, left, left_next = up, here, here_next
                        store(row, q, j, here_next)
                    total = left_next
                    if i + 1 == n:  # there was no second sample
                        total = left
                store(cost, block, 0, total)

    return warp
