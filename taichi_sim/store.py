"""Memory of a batch as NumPy arrays that kernels take: lanes block by block, or all side by side on a GPU."""

from typing import Any, NoReturn

import numpy as np

from taichi_sim.autodiff.lanes import Real

EVERY = slice(None)


class NeverCopied:
    """Something whose arrays are aligned, or share memory: copied one by one they would not be, and kernels crash."""

    def __reduce__(self) -> NoReturn:
        """Refuse to be copied or pickled."""
        raise TypeError(f"{type(self).__name__}: cannot be copied or pickled; copy the engine that it belongs to")


class Store:
    """Memory of ``count`` slots a robot, zero at first: lanes block by block (CPU), or robots side by side (GPU)."""

    def __init__(self, real: Real, count: int, blocks: int, on_cpu: bool) -> None:
        """Allocate ``count`` slots for each of ``blocks`` reals."""
        self._real, self._on_cpu = real, on_cpu
        self._array = real.array((blocks, count)) if on_cpu else np.zeros((count, blocks), real.numpy)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take copied or unpickled memory over to where kernels can read it: a copied array is not aligned."""
        self.__dict__.update(state)
        if self._on_cpu:
            self._array = self._real.array(self._array.shape[:-1])
            self._array[...] = state["_array"]

    @property
    def argument(self) -> np.ndarray:
        """The memory as a kernel argument."""
        return self._real.reals(self._array.reshape(-1, self._real.width)) if self._on_cpu else self._array

    def write(self, values: np.ndarray, places: slice | np.ndarray = EVERY) -> None:
        """Set slots, all or some, (slots, robots)."""
        if self._on_cpu:
            blocks, _, width = self._array.shape
            self._array[:, places] = values.reshape(-1, blocks, width).transpose(1, 0, 2)
        else:
            self._array[places] = values

    def read(self, places: slice | np.ndarray = EVERY) -> np.ndarray:
        """Slots, all or some, (slots, robots), in double precision."""
        if not self._on_cpu:
            return self._array[places].astype(float)
        blocks, _, width = self._array.shape
        return self._array[:, places].transpose(1, 0, 2).reshape(-1, blocks * width).astype(float)
