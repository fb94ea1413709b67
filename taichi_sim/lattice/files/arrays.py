"""Convert arrays of materials to bodies, and bodies to arrays."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_sim.base.arrays import Ints
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.materials import Material

Palette = Material | Sequence[Material] | Mapping[int, Material]


def body_from_array(
    array: ArrayLike,
    materials: Palette,
    voxel_size: float,
    *,
    regions: ArrayLike | None = None,
    fixed: ArrayLike | None = None,
    pressure_normals: ArrayLike | None = None,
) -> LatticeBody:
    """Build a body from an array of numbers: 0 is empty, any other number a material.

    Args:
        array: numbers or truth values, shape (X, Y, Z); x, y and z are the axes of the world, and z is up.
        materials: by number; a sequence is numbered from 1, and a material alone is 1.
        voxel_size: edge h [m].
        regions: labels of the groups that programs address, shape (X, Y, Z), 0 to R-1 where there are voxels; by
            default voxels of one material are one, in the order of ``materials``.
        fixed: voxels that the world holds in all six degrees of freedom, shape (X, Y, Z), or which of the six it
            holds, shape (X, Y, Z, 6).
        pressure_normals: which way pressure pushes, as in ``LatticeBody``, for each place, shape (X, Y, Z, 3).

    Returns:
        The body; its voxels in the order of ``numpy.argwhere(array)``, at their places in the array.

    Raises:
        ValueError: for an argument that is not allowed.

    Example:
        >>> rubber, foam = Material(1e6, 1e3), Material(1e5, 2e2)
        >>> body_from_array([[[1, 2]], [[1, 0]]], (rubber, foam), 0.01).voxels.tolist()
        [[0, 0, 0], [0, 0, 1], [1, 0, 0]]
    """
    given = np.asarray(array)
    if given.ndim != 3 or given.dtype.kind not in "biuf":
        raise ValueError(f"array: shape {given.shape} of {given.dtype} is not allowed; give numbers of (X, Y, Z)")
    palette = _numbered(materials)
    places = np.argwhere(given)
    if not len(places):
        raise ValueError("array: it is empty; give at least one voxel that is not 0")
    numbers = given[tuple(places.T)]
    unknown = np.flatnonzero(~np.isin(numbers, list(palette)))
    if len(unknown):
        place = tuple(places[unknown[0]].tolist())
        known = ", ".join(map(str, palette))
        raise ValueError(f"array: material {numbers[unknown[0]]} of voxel {place} is unknown; give 0 or {known}")
    kinds = list(palette)
    held = _of_voxels("fixed", fixed, given.shape, places, 6)
    return LatticeBody(
        voxels=places,
        materials=tuple(palette.values()),
        material_index=np.array([kinds.index(int(n)) for n in numbers]),
        voxel_size=voxel_size,
        regions=_of_voxels("regions", regions, given.shape, places, 0),
        fixed=held if held is None or held.ndim == 2 else np.repeat(held[:, None], 6, axis=1),
        pressure_normals=_of_voxels("pressure_normals", pressure_normals, given.shape, places, 3),
    )


def array_of_body(body: LatticeBody) -> Ints:
    """Make the array of a body's materials, counted from 1, with 0 for empty places, shape (X, Y, Z).

    The body's lowest place is (0, 0, 0).

    Raises:
        ValueError: if the array would have more than 2^28 places.
    """
    places = body.voxels - body.voxels.min(axis=0)
    shape = (places.max(axis=0) + 1).tolist()
    if np.prod(shape, dtype=float) > 2**28:
        raise ValueError(f"body: an array of {' x '.join(map(str, shape))} places is not allowed; the most is 2^28")
    array = np.zeros(shape, np.int64)
    array[tuple(places.T)] = body.material_index + 1
    return array


def labels(*columns: ArrayLike) -> Ints:
    """Label equal rows 0, 1, ... in sorted order: voxels with all columns in common make one region.

    Args:
        columns: numbers of each voxel, shape (V,) or (V, N) each.
    """
    table = np.column_stack([np.asarray(column, float) for column in columns])
    found: Ints = np.unique(table, axis=0, return_inverse=True)[1].reshape(-1)
    return found


def _numbered(materials: Palette) -> dict[int, Material]:
    """Materials by the numbers that stand for them in arrays."""
    if isinstance(materials, Material):
        materials = (materials,)
    palette = dict(materials) if isinstance(materials, Mapping) else dict(enumerate(materials, 1))
    wrong = [
        n
        for n, m in palette.items()
        if isinstance(n, bool) or not isinstance(n, int) or n == 0 or not isinstance(m, Material)
    ]
    if wrong or not palette:
        told = f"number {wrong[0]!r} is not allowed" if wrong else "there are none"
        raise ValueError(f"materials: {told}; give a Material for each whole number but 0")
    return palette


def _of_voxels(
    name: str, given: ArrayLike | None, shape: tuple[int, ...], places: NDArray[Any], width: int
) -> NDArray[Any] | None:
    """Check an array over all places, and return its values at the voxels."""
    if given is None:
        return None
    array = np.asarray(given)
    allowed = [shape] if name == "regions" else [(*shape, width)] + [shape] * (name == "fixed")
    if array.shape not in allowed:
        raise ValueError(f"{name}: shape {array.shape} is not allowed; give {' or '.join(map(str, allowed))}")
    return array[tuple(places.T)]
