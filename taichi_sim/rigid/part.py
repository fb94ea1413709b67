"""Some robots of a batch at a time: what kernels are called with."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import Ints
from taichi_sim.base.compute import Compute
from taichi_sim.rigid import memory
from taichi_sim.rigid.batch import Given
from taichi_sim.rigid.gradient_kernel import gradient_kernel
from taichi_sim.rigid.model.settings import World
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.rollout_kernel import rollout_kernel
from taichi_sim.rigid.store import Store
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
        running: what Taichi was started with.
        real: what a real is.
        described: whether robots start as their trees describe them.
        at_once: robots of a part.
    """

    trees: Sequence[Tree]
    given: Given
    tables: Tables
    plan: NDArray[np.int32]
    running: Compute
    real: Real
    described: bool
    at_once: int

    def chunks(self) -> Iterator[Ints]:
        """The robots of each part."""
        for first in range(0, self.given.batch, self.at_once):
            yield np.arange(first, min(first + self.at_once, self.given.batch))


class Part:
    """Robots that run together.

    Args:
        real: what a real is.
        blocks: how many.
        plan: places of sections.
        tables: integers of the tree.
        settings: numbers of the run.
        world: ground, gravity and time.
        on_cpu: whether slots lie block by block.
    """

    def __init__(
        self,
        real: Real,
        blocks: int,
        plan: NDArray[np.int32],
        tables: Tables,
        settings: np.ndarray,
        world: World,
        on_cpu: bool,
    ) -> None:
        self.real, self.blocks, self.plan, self.on_cpu = real, blocks, plan, on_cpu
        self.memory = self.store(int(plan[memory.SLOTS]))
        self.drifting = world.integration == "velocity"
        self._phases = VISCOUS_PHASES if np.isinf(world.friction) else COULOMB_PHASES
        listed = np.zeros((blocks, max(1, tables.counts.points)), np.int32)
        self.shared = (plan, tables.bodies, tables.points, tables.paths, tables.eyes, listed, settings)

    def store(self, slots: int) -> Store:
        """Memory for so many slots of each robot."""
        return Store(self.real, slots, self.blocks, self.on_cpu)

    @property
    def grain(self) -> int:
        """Iterations of the kernel's outer loop for each block."""
        return GRAIN if self.on_cpu else 1

    def run(self, recording: bool = False, tape: Store | None = None) -> np.ndarray:
        """Run to the end; what was recorded, (values, robots). States before steps go to the tape."""
        frames = self.store(int(self.plan[memory.FRAME] * self.plan[memory.FRAMES]) if recording else 1)
        kernel = rollout_kernel(self.real, self.grain, self.drifting, not self.drifting, recording, tape is not None)
        kernel(
            self.blocks,
            self._phases,
            self.memory.argument,
            frames.argument,
            (tape or self.store(1)).argument,
            *self.shared,
        )
        return frames.read()

    def go_back(self, tape: Store, cotangents: Store) -> None:
        """Turn cotangents of the end of a run into those of all that it was given."""
        kernel = gradient_kernel(self.real, self.grain, self.drifting, not self.drifting)
        adjoint = self.store(int(self.plan[memory.SLOTS]))
        kernel(
            self.blocks,
            self._phases,
            self.memory.argument,
            adjoint.argument,
            cotangents.argument,
            tape.argument,
            *self.shared,
        )
