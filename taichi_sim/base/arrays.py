"""Types of NumPy arrays, for annotations, whose docstrings give the shapes; and arrays that nobody else changes."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Arrays = dict[str, NDArray[Any]]  # by name, as an .npz file holds them


def along(ways: Floats, direction: Floats) -> Floats:
    """How far each of N ways, shape (N, D), leads along a direction, shape (N,): the bits that it has alone.

    A product of all at once would sum in an order that depends on how many there are.
    """
    found: Floats = (ways[:, None] @ direction)[:, 0]
    return found


def copied(values: Any) -> Floats:
    """Values as an array of its own, with NaN where a masked array hides them."""
    own = np.array(values, float)
    if isinstance(values, np.ma.MaskedArray):
        own[np.ma.getmaskarray(values)] = np.nan
    return own


def fixed(values: NDArray[T]) -> NDArray[T]:
    """An array that can no longer be changed."""
    values.setflags(write=False)
    return values
