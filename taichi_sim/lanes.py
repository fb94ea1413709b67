"""What a "real" is: a scalar, or a native vector that holds the same quantity of many robots.

The laws of the package are written once, over reals. With ``width == 1`` a real is a scalar (one robot per
thread: GPU, gradients, a single robot); else it is a vector of ``width`` robots, which LLVM keeps as one
machine vector. Only the operations below may touch a real: arithmetic, comparisons, ``&`` and ``|``,
``ti.sqrt``, ``ti.min``, ``ti.max``, ``ti.select`` and the functions of this file. Unary minus, ``abs``,
``-=``, trigonometry and casts do not compile on native vectors.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sim.runtime import aligned, ti

NATIVE_WIDTH = {"f32": 16, "f64": 8}  # 512 bits; LLVM splits them where the machine has less


@dataclass(frozen=True)
class Real:
    """A kind of real: precision and number of robots side by side.

    Attributes:
        precision: ``"f32"`` or ``"f64"``.
        width: robots per real.
    """

    precision: str
    width: int

    @property
    def scalar(self) -> Any:
        """Taichi type of one element."""
        return ti.f32 if self.precision == "f32" else ti.f64

    @property
    def numpy(self) -> type:
        """NumPy type of one element."""
        return np.float32 if self.precision == "f32" else np.float64

    @property
    def type(self) -> Any:
        """Taichi type of a real."""
        return self.scalar if self.width == 1 else ti.types.vector(self.width, self.scalar)

    def array(self, shape: tuple[int, ...], fill: float = 0) -> np.ndarray:
        """Memory for reals, shape ``shape + (width,)``."""
        return aligned((*shape, self.width), self.numpy, fill)

    def reals(self, array: np.ndarray) -> np.ndarray:
        """The array as a kernel argument whose elements are reals (drops the lane axis of a scalar)."""
        return array[..., 0] if self.width == 1 else array


def _is_vector(x: Any) -> bool:
    return hasattr(x, "is_tensor") and x.is_tensor()


@ti.func
def any_lane(condition):
    """True if the condition holds for any robot of the real."""
    count = 0
    if ti.static(_is_vector(condition)):
        count = ti.select(condition, 1, 0).sum()  # LLVM folds this to a test of the mask
    else:
        count = ti.select(condition, 1, 0)
    return count != 0


@ti.func
def all_lanes(condition):
    """True if the condition holds for every robot of the real (a NaN fails every comparison)."""
    count = 0
    if ti.static(_is_vector(condition)):
        count = ti.select(condition, 0, 1).sum()
    else:
        count = ti.select(condition, 0, 1)
    return count == 0


@ti.func
def load(a: ti.template(), b, i, c):
    """Component c of item i in block b.

    Blocks of lanes are laid out [block][item][component] with the lanes inside a real; scalars of a GPU
    [item][component][robot][0], so that neighbouring threads read neighbouring memory. The number of axes tells.
    """
    if ti.static(len(a.shape) == 4):
        return a[i, c, b, 0]
    else:
        return a[b, i, c]


@ti.func
def store(a: ti.template(), b, i, c, value):
    """Write component c of item i in block b; layouts as for :func:`load`."""
    if ti.static(len(a.shape) == 4):
        a[i, c, b, 0] = value
    else:
        a[b, i, c] = value


@ti.func
def absolute(x):
    """|x|."""
    return ti.max(x, 0.0 - x)
