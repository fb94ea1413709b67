"""Some robots of a batch at a time: what kernels are called with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import Ints
from taichi_sim.base.compute import Compute
from taichi_sim.rigid import slots
from taichi_sim.rigid.batch import Given
from taichi_sim.rigid.kernels import gradient_kernel, rollout_kernel
from taichi_sim.rigid.memory import Store
from taichi_sim.rigid.model.settings import World
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.tables import Tables
from taichi_sim.runtime import GRAIN

VISCOUS_PHASES, COULOMB_PHASES = 2, 8  # solutions of a step; Coulomb's cone is found by repetition


@dataclass(frozen=True, eq=False)
class Setup:
    """What all parts of a run share.

    Attributes:
        trees: one for all robots, or one each.
        given: what the run is given.
        tables: integers of the tree.
        plan: places of sections.
        compute: where the run is computed.
        real: what a real is.
        described: whether robots start as their trees describe them.
        at_once: robots of a part.
    """

    trees: Sequence[Tree]
    given: Given
    tables: Tables
    plan: NDArray[np.int32]
    compute: Compute
    real: Real
    described: bool
    at_once: int

    def chunks(self) -> Iterator[Ints]:
        """The robots of each part."""
        for first in range(0, self.given.batch, self.at_once):
            yield np.arange(first, min(first + self.at_once, self.given.batch))


class Part:
    """Robots that run together: their memory, and the arguments that all kernels take.

    Args:
        setup: what all parts of the run share.
        blocks: number of reals.
        settings: numbers of the run.
        world: ground, gravity and time.
    """

    def __init__(self, setup: Setup, blocks: int, settings: np.ndarray, world: World) -> None:
        self.real, self.blocks, self.plan = setup.real, blocks, setup.plan
        self.on_cpu = setup.compute.device == "cpu"
        self.memory = self.store(int(self.plan[slots.SLOTS]))
        tables = setup.tables
        listed = np.zeros((blocks, max(1, tables.counts.points)), np.int32)
        self._phases = VISCOUS_PHASES if np.isinf(world.friction) else COULOMB_PHASES
        self._kind = setup.real, GRAIN if self.on_cpu else 1, world.integration == "velocity"
        self._shared = self.plan, tables.bodies, tables.points, tables.paths, tables.eyes, listed, settings

    def store(self, count: int) -> Store:
        """Memory for so many slots of each robot."""
        return Store(self.real, count, self.blocks, self.on_cpu)

    def run(self, recording: bool = False, tape: Store | None = None) -> np.ndarray:
        """Run to the end; what was recorded, (values, robots). States before steps go to the tape."""
        frames = self.store(int(self.plan[slots.FRAME] * self.plan[slots.FRAMES]) if recording else 1)
        kernel = rollout_kernel(*self._kind, recording, tape is not None)
        memories = (self.memory, frames, tape or self.store(1))
        kernel(self.blocks, self._phases, *(each.argument for each in memories), *self._shared)
        return frames.read()

    def go_back(self, tape: Store, cotangents: Store) -> None:
        """Turn cotangents of the end of a run into those of all that it was given."""
        adjoint = self.store(int(self.plan[slots.SLOTS]))
        memories = (self.memory, adjoint, cotangents, tape)
        gradient_kernel(*self._kind)(self.blocks, self._phases, *(each.argument for each in memories), *self._shared)
