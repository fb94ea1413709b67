"""What a "real" is: a scalar, or a native vector that holds one quantity of many voxels or robots.

The laws of the package are written once, over reals (see ``tracing``). With ``width == 1`` a real is a scalar (one
robot per thread: GPU, a single robot); else it is a vector of ``width`` lanes, which LLVM keeps as one machine
vector. Only these may touch a real: arithmetic, comparisons, ``&`` and ``|``, ``sqrt``, ``select`` and the functions
of this file. Unary minus, ``abs``, ``-=``, trigonometry and casts do not compile on native vectors.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sim.autodiff.tracing import Condition, law, primitive, select
from taichi_sim.base.arrays import aligned
from taichi_sim.runtime import element, emit, inside_kernel, ti, variable_of

NATIVE_WIDTH = {"f32": 16, "f64": 8}  # 512 bits; LLVM splits them where the machine has less
WIDTHS = (1, 2, 4, 8, 16, 32)  # LLVM lays out no others without gaps


@dataclass(frozen=True)
class Real:
    """A kind of real: precision and number of lanes.

    Attributes:
        precision: ``"f32"`` or ``"f64"``.
        width: lanes: voxels of one lattice robot, or several vehicles or rigid robots.

    Raises:
        ValueError: for a width that is none of ``WIDTHS``.
    """

    precision: str
    width: int

    def __post_init__(self) -> None:
        if self.width not in WIDTHS:
            raise ValueError(f"width: {self.width!r} is not allowed; give one of {', '.join(map(str, WIDTHS))}")

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

    @property
    def memory(self) -> Any:
        """Taichi type of an array of reals, one after the other."""
        return ti.types.ndarray(dtype=self.type, ndim=1)

    def scalars(self, ndim: int) -> Any:
        """Taichi type of an array of single elements."""
        return ti.types.ndarray(dtype=self.scalar, ndim=ndim)

    def array(self, shape: tuple[int, ...], fill: float = 0) -> np.ndarray:
        """Memory for reals, shape ``shape + (width,)``."""
        return aligned((*shape, self.width), self.numpy, fill)

    def reals(self, array: np.ndarray) -> np.ndarray:
        """The array as a kernel argument whose elements are reals (drops the lane axis of a scalar)."""
        return array[..., 0] if self.width == 1 else array


def ints(ndim: int, width: int = 1) -> Any:
    """Taichi type of an array of whole numbers, or of native vectors of so many."""
    return ti.types.ndarray(dtype=ti.i32 if width == 1 else ti.types.vector(width, ti.i32), ndim=ndim)


def choose_width(batch: int, precision: str, threads: int, block_cost: float) -> int:
    """Robots (or whatever is computed side by side) per real that finish a batch soonest; results do not depend on it.

    Args:
        batch: their number.
        precision: ``"f32"`` or ``"f64"``.
        threads: CPU threads that share the batch.
        block_cost: how many times as long a native vector takes as a single scalar (measured).
    """
    native = NATIVE_WIDTH[precision]
    blocks = -(-batch // native)
    return native if -(-blocks // threads) * block_cost < -(-batch // threads) else 1


def _is_vector(x: Any) -> bool:
    return hasattr(x, "is_tensor") and x.is_tensor()


@primitive
def any_lane(condition: Any) -> Any:
    """True if the condition holds for any robot of the real; a law that is being traced must take both ways."""
    if isinstance(condition, Condition):
        return True
    return _any_lane(condition) if inside_kernel() else np.any(condition)


@ti.func
def _any_lane(condition):
    flag = 0
    if ti.static(_is_vector(condition)):
        flag = ti.select(condition, 1, 0).max()  # LLVM makes this one test of the mask; a sum it would really sum
    else:
        flag = ti.select(condition, 1, 0)
    return flag > 0


@ti.func
def all_lanes(condition):
    """True if the condition holds for every robot of the real (a NaN fails every comparison)."""
    flag = 0
    if ti.static(_is_vector(condition)):
        flag = ti.select(condition, 0, 1).max()
    else:
        flag = ti.select(condition, 0, 1)
    return flag == 0


@law
def absolute(x):
    """|x|."""
    return select(x < 0.0, 0.0 - x, x)


@law
def larger(x, y):
    """The larger of two reals; y if x is not a number. (``ti.max`` spends two more operations on NaN.)"""
    return select(x > y, x, y)


@law
def smaller(x, y):
    """The smaller of two reals; y if x is not a number."""
    return select(x < y, x, y)


@primitive
def load(memory: Any, k: Any, slot: Any) -> Any:
    """Read a slot of a robot's or block's memory.

    Lanes lie block by block and k is the first slot of the block; on a GPU slots lie one after the other with the
    robots side by side, so that neighbouring threads read neighbouring numbers, and k is the robot.
    """
    return element(memory, k + slot) if len(memory.shape) == 1 else element(memory, slot, k)


@primitive
def store(memory: Any, k: Any, slot: Any, value: Any) -> None:
    """Write a slot of a robot's or block's memory."""
    load(memory, k, slot)._assign(value)


@primitive
def accumulate(memory: Any, k: Any, slot: Any, value: Any) -> None:
    """Add to a slot; where threads share a robot's memory, they take turns."""
    if len(memory.shape) == 1:
        store(memory, k, slot, load(memory, k, slot) + value)
    else:
        ti.atomic_add(load(memory, k, slot), value)


@primitive
def consecutive(first: Any, count: int) -> tuple[Any, ...]:
    """A slot and those after it, ``count`` in all."""
    return slots_at(first, range(count))


@primitive
def slots_at(first: Any, offsets: Iterable[int]) -> tuple[Any, ...]:
    """The slots at these offsets from a first one."""
    start = emit(first)
    return tuple(start + offset for offset in offsets)


@primitive
def load_all(memory: Any, k: Any, slots: Sequence[Any]) -> tuple[Any, ...]:
    """Read several slots."""
    return tuple(load(memory, k, slot) for slot in slots)


@primitive
def select_all(condition: Any, x: Sequence[Any], y: Sequence[Any]) -> tuple[Any, ...]:
    """For each of several reals, x where the condition holds, else y."""
    mask = emit(condition)
    return tuple(select(mask, a, b) for a, b in zip(x, y, strict=True))


@primitive
def store_all(memory: Any, k: Any, slots: Sequence[Any], values: Sequence[Any]) -> None:
    """Write several slots."""
    for slot, value in zip(slots, values, strict=True):
        store(memory, k, slot, value)


@primitive
def accumulate_all(memory: Any, k: Any, slots: Sequence[Any], values: Sequence[Any]) -> None:
    """Add to several slots."""
    for slot, value in zip(slots, values, strict=True):
        accumulate(memory, k, slot, value)


@primitive
def variables(values: Sequence[Any]) -> list[Any]:
    """New variables of the kernel that hold these values, to be changed by ``assign_all``."""
    return [variable_of(value) for value in values]


@primitive
def assign_all(targets: Sequence[Any], values: Sequence[Any]) -> None:
    """Give variables new values."""
    for target, value in zip(targets, values, strict=True):
        target._assign(value)


@primitive
def vector(values: Sequence[Any]) -> Any:
    """A native vector of so many scalars."""
    return emit(ti.lang.matrix.make_matrix([emit(value) for value in values]))
