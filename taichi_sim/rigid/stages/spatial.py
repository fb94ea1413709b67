"""Spatial algebra over reals, about one common point, in the axes of the world.

A spatial vector is three angular, then three linear components: of a motion, the angular velocity and the velocity of
the body's point at the common point; of an impulse, its moment about the common point, and itself. A symmetric matrix
is its lower triangle, row by row. Since all share point and axes, nothing is ever transformed: inertias of bodies and
momenta simply add. (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 2, in world coordinates.)
"""

from collections.abc import Sequence
from typing import Any

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import primitive, sqrt
from taichi_sim.ground.laws import out_of_plane
from taichi_sim.runtime import emit

Reals = Sequence[Any]
Axes = tuple[Reals, Reals] | None  # None for x and y


def _at(i: int, j: int) -> int:
    """Place of an entry of a symmetric matrix in its triangle."""
    return i * (i + 1) // 2 + j if i >= j else j * (j + 1) // 2 + i


def cut(values: Reals, *widths: int) -> list[list[Any]]:
    """Values, cut into pieces."""
    found, first = [], 0
    for width in widths:
        found.append(list(values[first : first + width]))
        first += width
    return found


@primitive
def joined(*parts: Any) -> list[Any]:
    """Reals, and sequences of them, one after the other."""
    return [x for part in parts for x in (part if isinstance(part, list | tuple) else (part,))]


@primitive
def cross(a: Reals, b: Reals) -> list[Any]:
    """a x b."""
    return [emit(a[i] * b[j] - a[j] * b[i]) for i, j in ((1, 2), (2, 0), (0, 1))]


@primitive
def dot(a: Reals, b: Reals) -> Any:
    """Sum of products."""
    result = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        result = result + x * y
    return emit(result)


@primitive
def sum_of_sizes(a: Reals, b: Reals) -> Any:
    """Sum of the sizes of products, to which the rounding of ``dot`` is proportional."""
    result = None
    for x, y in zip(a, b, strict=True):
        product = emit(x * y)
        size = larger(product, 0.0 - product)
        result = size if result is None else result + size
    return emit(result)


@primitive
def length(a: Reals) -> Any:
    """|a|."""
    return emit(sqrt(dot(a, a)))


@primitive
def plus(a: Reals, b: Reals) -> list[Any]:
    """a + b."""
    return [emit(x + y) for x, y in zip(a, b, strict=True)]


@primitive
def plus_times(a: Reals, b: Reals, factor: Any) -> list[Any]:
    """a + factor b."""
    return [emit(x + y * factor) for x, y in zip(a, b, strict=True)]


@primitive
def minus_times(a: Reals, b: Reals, factor: Any) -> list[Any]:
    """a - factor b."""
    return [emit(x - y * factor) for x, y in zip(a, b, strict=True)]


@primitive
def turned(rotation: Reals, v: Reals) -> list[Any]:
    """Rotation matrix (row by row) times vector."""
    return [dot(rotation[3 * i : 3 * i + 3], v) for i in range(3)]


@primitive
def times_triangle(matrix: Reals, v: Reals) -> list[Any]:
    """Symmetric 3 x 3 matrix, a triangle, times vector."""
    return [dot([matrix[_at(i, j)] for j in range(3)], v) for i in range(3)]


@primitive
def product(a: Reals, b: Reals) -> list[Any]:
    """Product of two 3 x 3 matrices, row by row."""
    return [dot(a[3 * i : 3 * i + 3], b[j::3]) for i in range(3) for j in range(3)]


@primitive
def about_axis(axis: Reals, sine: Any, cosine: Any) -> list[Any]:
    """Rotation matrix about a unit vector (Rodrigues)."""
    x, y, z = axis
    rest = emit(1.0 - cosine)
    xr, yr, zr = (emit(each * rest) for each in (x, y, z))
    xs, ys, zs = (emit(each * sine) for each in (x, y, z))
    first = cosine + x * xr, x * yr - zs, x * zr + ys
    second = x * yr + zs, cosine + y * yr, y * zr - xs
    third = x * zr - ys, y * zr + xs, cosine + z * zr
    return [emit(entry) for entry in (*first, *second, *third)]


@primitive
def turned_inertia(rotation: Reals, inertia: Reals) -> list[Any]:
    """R I R^T, triangles."""
    full = [inertia[_at(i, j)] for i in range(3) for j in range(3)]
    half = product(rotation, full)
    return [dot(half[3 * i : 3 * i + 3], rotation[3 * j : 3 * j + 3]) for i in range(3) for j in range(i + 1)]


@primitive
def moved_inertia(inertia: Reals, mass: Any, place: Reals) -> list[Any]:
    """Inertia about the common point, of a mass at ``place`` with this inertia about its centre (Steiner)."""
    x, y, z = place
    mx, my, mz = emit(mass * x), emit(mass * y), emit(mass * z)
    steiner = (my * y + mz * z, 0.0 - mx * y, mx * x + mz * z, 0.0 - mx * z, 0.0 - my * z, mx * x + my * y)
    return [emit(a + b) for a, b in zip(inertia, steiner, strict=True)]


@primitive
def rigid_matrix(inertia: Reals, mass: Any, place: Reals) -> list[Any]:
    """Spatial inertia of a rigid body from its inertia about the common point."""
    mx, my, mz = (emit(mass * x) for x in place)
    zero = emit(0.0 * mass)
    linear = (zero, mz, emit(0.0 - my), mass), (emit(0.0 - mz), zero, mx, zero, mass)
    return [*inertia, *linear[0], *linear[1], my, emit(0.0 - mx), zero, zero, zero, mass]


@primitive
def times(matrix: Reals, v: Reals) -> list[Any]:
    """Symmetric matrix times vector."""
    return [dot([matrix[_at(i, j)] for j in range(6)], v) for i in range(6)]


@primitive
def less_outer(matrix: Reals, v: Reals, factor: Any) -> list[Any]:
    """matrix - factor v v^T."""
    scaled = [emit(x * factor) for x in v]
    return [emit(matrix[_at(i, j)] - scaled[i] * v[j]) for i in range(6) for j in range(i + 1)]


@primitive
def drag(place: Reals, strength: Any, axes: Axes = None) -> list[tuple[int, Any]]:
    """Entries that friction against motion of a point along two axes adds to a spatial matrix: (place, addend)."""
    if axes is not None:
        a, b = (joined(cross(place, axis), axis) for axis in axes)
        sa, sb = ([emit(strength * x) for x in row] for row in (a, b))
        return [(_at(i, j), emit(sa[i] * a[j] + sb[i] * b[j])) for i in range(6) for j in range(i + 1)]
    x, y, z = place
    sx, sy, sz = emit(strength * x), emit(strength * y), emit(strength * z)
    moments = {(0, 0): sz * z, (1, 1): sz * z, (2, 0): 0.0 - sx * z, (2, 1): 0.0 - sy * z, (2, 2): sx * x + sy * y}
    mixed = {(3, 1): sz, (3, 2): 0.0 - sy, (4, 0): 0.0 - sz, (4, 2): sx}
    entries = moments | mixed | {(3, 3): strength, (4, 4): strength}
    return [(_at(i, j), emit(value)) for (i, j), value in entries.items()]


@primitive
def at_point(place: Reals, matrix: Reals) -> list[Any]:
    """Spatial matrix of a symmetric 3 x 3 one, triangles, that turns the velocity of a point into an impulse there."""
    rows = [[matrix[_at(i, j)] for j in range(3)] for i in range(3)]
    moments = [cross(place, row) for row in rows]  # of the impulses that velocities along the axes have
    turning = [cross(place, column) for column in zip(*moments, strict=True)]
    angular = [turning[j][i] for i in range(3) for j in range(i + 1)]
    return joined(angular, *(joined(moments[i], rows[i][: i + 1]) for i in range(3)))


@primitive
def tangents(n: Reals) -> tuple[Reals, Reals]:
    """Two unit vectors at right angles to a unit vector and each other: x and y, turned as z is onto it."""
    zero = emit(0.0 * n[2])
    one = emit(zero + 1.0)
    first, second = ([emit(x) for x in out_of_plane(*x_and_y, zero, *n)] for x_and_y in ((one, zero), (zero, one)))
    return first, second


@primitive
def along(axes: Axes, v: Reals) -> list[Any]:
    """Components of a vector along two axes."""
    return [v[0], v[1]] if axes is None else [dot(axis, v) for axis in axes]


@primitive
def back_along(axes: Axes, x: Any, y: Any) -> list[Any]:
    """The vector that has these components along two axes, and none across them."""
    return [x, y, 0.0 * x] if axes is None else [emit(a * x + b * y) for a, b in zip(*axes, strict=True)]


@primitive
def cholesky(matrix: Reals) -> list[Any]:
    """Cholesky factor; its diagonal inverted."""
    factor: list[Any] = []
    for i in range(6):
        for j in range(i + 1):
            value = matrix[_at(i, j)]
            for l in range(j):
                value = value - factor[_at(i, l)] * factor[_at(j, l)]
            factor.append(emit(1.0 / sqrt(emit(value))) if i == j else emit(emit(value) * factor[_at(j, j)]))
    return factor


@primitive
def forward(factor: Reals, v: Reals) -> list[Any]:
    """Solve L x = v."""
    found: list[Any] = []
    for i in range(6):
        value = v[i]
        for j in range(i):
            value = value - factor[_at(i, j)] * found[j]
        found.append(emit(value * factor[_at(i, i)]))
    return found


@primitive
def backward(factor: Reals, v: Reals) -> list[Any]:
    """Solve L^T x = v."""
    found: list[Any] = [None] * 6
    for i in reversed(range(6)):
        value = v[i]
        for j in range(i + 1, 6):
            value = value - factor[_at(j, i)] * found[j]
        found[i] = emit(value * factor[_at(i, i)])
    return found
