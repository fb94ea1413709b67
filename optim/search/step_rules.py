"""Step rules of gradient ascent (Adam, L-BFGS), for C climbers side by side, in ranges of the variables.

Sources: Kingma & Ba, Adam: a method for stochastic optimization, ICLR 2015, algorithm 1; Nocedal & Wright,
Numerical Optimization, 2nd ed. 2006, algorithm 7.4 (two-loop recursion of L-BFGS), eq. 7.20 (its scaling), and
Bertsekas, SIAM J. Control Optim. 20, 1982 (second-order steps among the variables that no bound holds).
"""

from typing import Protocol

import numpy as np

from optim.space import Space
from taichi_sim.base.arrays import Arrays, Bools, Floats

LONGEST = 0.25  # of a range: no coordinate takes a longer step of L-BFGS
MEMORY = 8  # pairs that L-BFGS remembers
MOMENTUM, SQUARES, SMALL = 0.9, 0.999, 1e-8  # beta_1, beta_2 and epsilon of Adam


class StepRule(Protocol):
    """Base class of step rules of gradient ascent. Everything that changes is in ``arrays``, each of shape (C, ...)."""

    arrays: Arrays

    @property
    def monotone(self) -> bool:
        """Whether a step that does not increase the objective enough is undone and tried again, shorter."""

    def learn(self, climbers: Bools, moved: Floats, change: Floats) -> None:
        """Take in by how much gradients changed as some climbers moved, both of shape (C, D); ignored by default."""
        return

    def steps(self, climbers: Bools, gradients: Floats, free: Bools) -> Floats:
        """Steps, shape (C, D), of which those of ``climbers`` count; zero where a bound holds (not ``free``)."""

    def forget(self, climbers: Bools) -> None:
        """Let some climbers begin anew."""
        for values in self.arrays.values():
            values[climbers] = 0


class Adam(StepRule):
    """Steps of about ``rate`` in every coordinate, whatever the length of the gradient.

    Longer gradients than ``clip`` [objective per range] are shortened to it first, so that a single huge one, as
    chaotic contact brings forth, does not outweigh all others for long.
    """

    monotone = False

    def __init__(self, climbers: int, size: int, rate: float, clip: float, squares: float = SQUARES) -> None:
        """For C climbers; ``squares`` is beta_2, by which the mean of squares forgets."""
        self.rate, self.clip, self.squares = rate, clip, squares
        shape = (climbers, size)
        self.arrays = {"mean": np.zeros(shape), "square": np.zeros(shape), "count": np.zeros((climbers, 1))}

    def steps(self, climbers: Bools, gradients: Floats, free: Bools) -> Floats:
        """Mean gradient over its root mean square, both of the past, corrected for their start at zero."""
        slope = np.where(free, gradients, 0.0)
        slope = slope * (self.clip / np.maximum(_length(slope), self.clip))
        new = {
            "mean": MOMENTUM * self.arrays["mean"] + (1 - MOMENTUM) * slope,
            "square": self.squares * self.arrays["square"] + (1 - self.squares) * slope**2,
            "count": self.arrays["count"] + 1,
        }
        for name, values in new.items():
            self.arrays[name] = np.where(climbers[:, None], values, self.arrays[name])
        count = np.maximum(self.arrays["count"], 1.0)
        mean = self.arrays["mean"] / (1 - MOMENTUM**count)
        square = self.arrays["square"] / (1 - self.squares**count)
        return np.where(free, self.rate * mean / (np.sqrt(square) + SMALL), 0.0)


class LBFGS(StepRule):
    """Quasi-Newton steps; the first goes along the gradient, ``rate`` long in its longest coordinate."""

    monotone = True

    def __init__(self, climbers: int, size: int, rate: float) -> None:
        self.rate = rate
        shape = (climbers, MEMORY, size)  # the newest last
        self.arrays = {"moved": np.zeros(shape), "change": np.zeros(shape)}

    def learn(self, climbers: Bools, moved: Floats, change: Floats) -> None:
        """Remember a pair; ``change`` is that of an ascent, so minus it goes with ``moved`` near a summit."""
        for name, new in (("moved", moved), ("change", -change)):
            old = self.arrays[name]
            shifted = np.concatenate([old[:, 1:], new[:, None]], axis=1)
            self.arrays[name] = np.where(climbers[:, None, None], shifted, old)

    @np.errstate(all="ignore")  # what overflows goes along the gradient instead
    def steps(self, climbers: Bools, gradients: Floats, free: Bools) -> Floats:
        """The two-loop recursion among the free variables."""
        slope = np.where(free, gradients, 0.0)
        moved, change = (np.where(free[:, None], self.arrays[name], 0.0) for name in ("moved", "change"))
        curvature = (moved * change).sum(axis=2, keepdims=True)
        used = curvature > 1e-12 * _length(moved) * _length(change)
        inverse = np.where(used, 1 / curvature, 0.0)
        steepest = slope * (self.rate / np.maximum(abs(slope).max(axis=1, keepdims=True), np.finfo(float).tiny))
        step, weights, scaled = slope.copy(), np.zeros_like(curvature), np.zeros_like(used[:, 0])
        for i in reversed(range(MEMORY)):
            weights[:, i] = inverse[:, i] * (moved[:, i] * step).sum(axis=1, keepdims=True)
            step = step - weights[:, i] * change[:, i]
        for i in reversed(range(MEMORY)):  # scaled by the newest pair that is used
            newest = used[:, i] & ~scaled
            step = np.where(newest, step * curvature[:, i] / _length(change[:, i]) ** 2, step)
            scaled |= newest
        for i in range(MEMORY):
            back = inverse[:, i] * (change[:, i] * step).sum(axis=1, keepdims=True)
            step = step + (weights[:, i] - back) * moved[:, i]
        upwards = (step * slope).sum(axis=1, keepdims=True) > 0
        step = np.where(scaled & upwards & np.isfinite(step).all(axis=1, keepdims=True), step, steepest)
        return step * (LONGEST / np.maximum(abs(step).max(axis=1, keepdims=True), LONGEST))


def free_variables(space: Space, points: Floats, gradients: Floats) -> Bools:
    """Which variables a gradient does not push against a bound that they are at, shape (C, D)."""
    held = (points <= space.low) & (gradients < 0) | (points >= space.high) & (gradients > 0)
    return ~held | space.angles


def _length(vectors: Floats) -> Floats:
    """Euclidean lengths along the last axis, kept; overflow is an infinite length."""
    with np.errstate(over="ignore"):
        return np.sqrt((vectors**2).sum(axis=-1, keepdims=True))
