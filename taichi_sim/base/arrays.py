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


def copied(values: Any, field: str = "values") -> Floats:
    """Values as an array of its own, with NaN where a masked array hides them.

    Raises:
        ValueError: names the field, if they are complex numbers, whose real part alone would be left.
    """
    given = np.asarray(values)
    if given.dtype.kind in "cO" and (found := [each for each in given.flat if np.iscomplexobj(each)]):
        shown = next((each for each in found if np.any(np.imag(each))), found[0])  # beside it others may be real
        raise ValueError(f"{field}: {shown} is not allowed; give real numbers")
    own = np.array(values, float)
    if isinstance(values, np.ma.MaskedArray):
        own[np.ma.getmaskarray(values)] = np.nan
    return own


def mean_of(values: Floats, axis: int | None = None) -> Floats:
    """Mean of values, as NumPy's, but finite wherever they are, also where their sum is too large for a float."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        plain = np.asarray(values.mean(axis=axis))
        if not values.size or np.isfinite(plain).all():
            return plain
        largest = np.abs(values).max(axis=axis, keepdims=True)
        scaled = (values / largest).mean(axis=axis) * largest.reshape(plain.shape)
    return np.where(~np.isfinite(plain) & np.isfinite(scaled), scaled, plain)


def median_of(values: Floats) -> float:
    """Median of values, as NumPy's, but finite if they are, also where the sum of the middle two is too large."""
    with np.errstate(over="ignore"):
        plain = float(np.median(values))
    if np.isfinite(plain) or not values.size:
        return plain
    return float(mean_of(np.sort(values, axis=None)[(values.size - 1) // 2 : values.size // 2 + 1]))


def fixed(values: NDArray[T]) -> NDArray[T]:
    """An array that can no longer be changed."""
    values.setflags(write=False)
    return values


def aligned(shape: tuple[int, ...], dtype: type, fill: float = 0) -> np.ndarray:
    """A NumPy array on a 64-byte boundary, as native vectors of 512 bits require."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + 64, np.uint8)
    offset = -raw.ctypes.data % 64
    array: np.ndarray = raw[offset : offset + size].view(dtype).reshape(shape)
    if fill:
        array[...] = fill
    return array
