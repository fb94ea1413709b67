"""Derivatives that forget: what a robot's shape and speed do to what it does much later fades on the way back.

A robot that feels may be chaotic: its exact derivatives grow by the step, point nowhere after some tenths of a second,
and overflow after some more, though what it does changes little on average. What it does in the next moments can still
be improved, so on the way back derivatives fade, at every snapshot, towards what follows from where a robot *is*
alone: that whatever is recorded later moves along the ground and turns about the vertical with it, as on level ground
without feedback; bodies that are linked to nothing else move along, too. The longer the horizon, the closer are they to
the exact ones; the shorter, the smoother, and the more biased.

Sources: Metz et al., Gradients are not all you need, arXiv:2111.05803, 2021 (chaos, and shortened ways back); Xu et
al., Accelerated policy learning with parallel differentiable simulation, ICLR 2022 (short windows, and a learned value
beyond them in place of the symmetry of the ground).
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.program import LatticeProgram

if TYPE_CHECKING:
    from taichi_sim.lattice.drivers.driver import Reverse

SMALLEST = 1e-30  # squared radius [m2] below which nothing can be turned


def fade(reverse: "Reverse", program: LatticeProgram, time_step: float, horizon: float) -> None:
    """Have a way back forget, by a factor of e in each horizon [s], at every step at which robots are recorded.

    Raises:
        ValueError: if they are recorded at different steps, or run for different times.
    """
    snapshots = program.snapshots
    if (snapshots != snapshots[:1]).any() or len(set(program.lengths.tolist())) > 1:
        raise ValueError("horizon: robots are recorded at different steps, or run for different times; give None")
    fading = _Fading(reverse, snapshots)
    steps = {int(step): slot for slot, step in enumerate(snapshots[0]) if step >= 0}
    order = sorted(steps)
    ends = [*order[1:], int(program.lengths[0])]
    factors = {step: math.exp(-(end - step) * time_step / horizon) for step, end in zip(order, ends, strict=True)}
    stops = [step + 1 for step in order]  # what a snapshot itself is worth, or what is decided by it, does not fade
    reverse.stop_at(stops, lambda stop: fading.meet(steps[stop - 1], factors[stop - 1]))


class _Fading:
    """What a way back fades towards."""

    def __init__(self, reverse: "Reverse", snapshots: np.ndarray) -> None:
        self._reverse, self._snapshots = reverse, snapshots
        slots = range(snapshots.shape[1])
        found = [_moved_and_turned(self._poses(slot), reverse.seeds(slot)) for slot in slots]
        self._by_place = np.stack([moved for moved, _ in found], axis=1)
        self._by_angle = np.stack([turned for _, turned in found], axis=1)

    def _poses(self, slot: int) -> Floats:
        run = self._reverse.run
        return np.nan_to_num(run.driver.snapshot(run.marks.poses, slot).astype(float))

    def meet(self, slot: int, factor: float) -> None:
        """Fade at a snapshot."""
        later = self._snapshots > self._snapshots[:, slot, None]
        by_place = (self._by_place * later[..., None]).sum(axis=1)
        centres = self._poses(slot)[..., :3]
        middle = centres.mean(axis=1)
        by_angle = (self._by_angle * later).sum(axis=1) - (_turned(middle) * by_place).sum(axis=1)
        arms = _turned(centres - middle[:, None])
        turning = by_angle / np.maximum((arms**2).sum(axis=(1, 2)), SMALLEST)
        self._reverse.fade(factor, by_place[:, None] / centres.shape[1] + turning[:, None, None] * arms)


def _moved_and_turned(poses: Floats, seeds: Floats) -> tuple[Floats, Floats]:
    """Derivatives by a level shift of all voxels, shape (B, 3), and by a turn about the vertical through 0, (B,).

    Args:
        poses: of voxels, shape (B, V, 7).
        seeds: derivatives by them.
    """
    by_angle = (_turned(poses[..., :3]) * seeds[..., :3]).sum(axis=(1, 2))
    w, x, y, z = np.moveaxis(poses[..., 3:], -1, 0)
    by_angle += (0.5 * np.stack([-z, -y, x, w], axis=-1) * seeds[..., 3:]).sum(axis=(1, 2))
    return seeds[..., :3].sum(axis=1) * (1.0, 1.0, 0.0), by_angle


def _turned(vectors: Floats) -> Floats:
    """How vectors, shape (..., 3), change with the angle of a turn about the vertical."""
    return np.stack([-vectors[..., 1], vectors[..., 0], np.zeros(vectors.shape[:-1])], axis=-1)
