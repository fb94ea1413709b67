"""Slots of a batch of robots: in native lanes block by block (CPU), or slot by slot, robots side by side (GPU)."""

import numpy as np

from taichi_sim.autodiff.lanes import Real


class Store:
    """Memory for so many slots a robot, zero at first."""

    def __init__(self, real: Real, slots: int, blocks: int, on_cpu: bool) -> None:
        """Allocate for ``blocks`` reals."""
        self._real, self._on_cpu = real, on_cpu
        self._array = real.array((blocks, slots)) if on_cpu else np.zeros((slots, blocks), real.numpy)

    @property
    def argument(self) -> np.ndarray:
        """The memory as a kernel argument."""
        return self._real.reals(self._array.reshape(-1, self._real.width)) if self._on_cpu else self._array

    def write(self, values: np.ndarray) -> None:
        """Set all slots, (slots, robots)."""
        if self._on_cpu:
            blocks, slots, width = self._array.shape
            self._array[:] = values.reshape(slots, blocks, width).transpose(1, 0, 2)
        else:
            self._array[:] = values

    def read(self) -> np.ndarray:
        """All slots, (slots, robots), in double precision."""
        if not self._on_cpu:
            return self._array.astype(float)
        blocks, slots, width = self._array.shape
        return self._array.transpose(1, 0, 2).reshape(slots, blocks * width).astype(float)
