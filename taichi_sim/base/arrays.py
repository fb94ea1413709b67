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
