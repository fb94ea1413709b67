"""Memory of a batch as NumPy arrays that kernels take: lanes block by block, or all side by side on a GPU."""

import numpy as np

from taichi_sim.autodiff.lanes import Real


class Store:
    """Memory of ``count`` slots a robot, zero at first: lanes block by block (CPU), or robots side by side (GPU)."""

    def __init__(self, real: Real, count: int, blocks: int, on_cpu: bool) -> None:
        """Allocate ``count`` slots for each of ``blocks`` reals."""
        self._real, self._on_cpu = real, on_cpu
        self._array = real.array((blocks, count)) if on_cpu else np.zeros((count, blocks), real.numpy)

    @property
    def argument(self) -> np.ndarray:
        """The memory as a kernel argument."""
        return self._real.reals(self._array.reshape(-1, self._real.width)) if self._on_cpu else self._array

    def write(self, values: np.ndarray) -> None:
        """Set all slots, (slots, robots)."""
        if self._on_cpu:
            blocks, count, width = self._array.shape
            self._array[:] = values.reshape(count, blocks, width).transpose(1, 0, 2)
        else:
            self._array[:] = values

    def read(self) -> np.ndarray:
        """All slots, (slots, robots), in double precision."""
        if not self._on_cpu:
            return self._array.astype(float)
        blocks, count, width = self._array.shape
        return self._array.transpose(1, 0, 2).reshape(count, blocks * width).astype(float)
