"""One snapshot of what a batch records, taken out of all of them or added to where the kernels run.

A decision in the loop feels one snapshot. Of a run with many decisions, all snapshots together are hundreds of times as
large, and would else travel between the device and NumPy at every decision.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.bundling import kernel_of
from taichi_sim.runtime import ti


@ti.func
def take_poses(slot: ti.template(), whole: ti.template(), part: ti.template()):
    """Copy the poses of a snapshot, shape (B, V, 7)."""
    for r, v, c in ti.ndrange(part.shape[0], part.shape[1], part.shape[2]):
        part[r, v, c] = whole[r, slot, v, c]


@ti.func
def take_strains(slot: ti.template(), whole: ti.template(), part: ti.template()):
    """Copy the strains of a snapshot, shape (B, L)."""
    for r, l in ti.ndrange(part.shape[0], part.shape[1]):
        part[r, l] = whole[r, slot, l]


@ti.func
def add_poses(slot: ti.template(), whole: ti.template(), part: ti.template()):
    """Add to the poses of a snapshot, shape (B, V, 7)."""
    for r, v, c in ti.ndrange(part.shape[0], part.shape[1], part.shape[2]):
        whole[r, slot, v, c] += part[r, v, c]


@ti.func
def add_strains(slot: ti.template(), whole: ti.template(), part: ti.template()):
    """Add to the strains of a snapshot, shape (B, L)."""
    for r, l in ti.ndrange(part.shape[0], part.shape[1]):
        whole[r, slot, l] += part[r, l]


@lru_cache
def snapshot_kernels(real: Real, dimensions: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Kernels that take a snapshot out of an array of so many dimensions, poses or strains, and that add to one."""
    bodies = {4: (take_poses, add_poses), 3: (take_strains, add_strains)}[dimensions]
    types = ti.i32, real.scalars(dimensions), real.scalars(dimensions - 1)
    take, add = (kernel_of(body, *types) for body in bodies)
    return take, add
