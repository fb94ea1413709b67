"""Quaternions (w, x, y, z) as functions over reals or NumPy arrays.

Components, never ``ti.Vector``: a real may be a vector already.
A quaternion maps a vector from the body frame to the world frame.
"""

import numpy as np

from taichi_sim.autodiff.elementary import polynomial
from taichi_sim.autodiff.lanes import absolute, any_lane, larger
from taichi_sim.autodiff.tracing import law, law_with_derivative, select, sqrt
from taichi_sim.runtime import ti

# Below this 1 - w^2 the engine that the lattice reproduces replaces the rotation vector by an approximation.
SMALL_SINE_SQUARED = 2.4e-3
_NEAR = 0.1  # 1 - w up to which the short polynomial is exact: rotations below 51 degrees


def _arc_coefficients(reach: float, degree: int) -> list[float]:
    """Coefficients of acos(w)/sqrt(1 - w^2) in u = 1 - w on [0, reach], lowest first (Chebyshev interpolation)."""
    nodes = reach / 2 * (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400))
    values = 2 * np.arcsin(np.sqrt(nodes / 2)) / np.sqrt(nodes * (2 - nodes))  # acos without cancellation
    fit = np.polynomial.Chebyshev.fit(nodes, values, degree, domain=[0, reach])
    return [float(c) for c in fit.convert(kind=np.polynomial.Polynomial).coef]


def _derivative(coefficients: list[float]) -> list[float]:
    return [k * c for k, c in enumerate(coefficients)][1:]


_SHORT = {True: _arc_coefficients(_NEAR, 4), False: _arc_coefficients(_NEAR, 9)}
_LONG = {True: _arc_coefficients(1.0, 10), False: _arc_coefficients(1.0, 20)}
_SHORT_SLOPE = {single: _derivative(c) for single, c in _SHORT.items()}


@law
def multiply(aw, ax, ay, az, bw, bx, by, bz):
    """Quaternion product a b."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@law
def multiply_conjugate(aw, ax, ay, az, bw, bx, by, bz):
    """Quaternion product conj(a) b."""
    return (
        aw * bw + ax * bx + ay * by + az * bz,
        aw * bx - ax * bw - ay * bz + az * by,
        aw * by + ax * bz - ay * bw - az * bx,
        aw * bz - ax * by + ay * bx - az * bw,
    )


@law
def rotate(w, x, y, z, fx, fy, fz):
    """q f conj(q): body frame to world frame."""
    tx = 2.0 * (y * fz - z * fy)
    ty = 2.0 * (z * fx - x * fz)
    tz = 2.0 * (x * fy - y * fx)
    return fx + w * tx + (y * tz - z * ty), fy + w * ty + (z * tx - x * tz), fz + w * tz + (x * ty - y * tx)


@law
def rotate_back(w, x, y, z, fx, fy, fz):
    """conj(q) f q: world frame to body frame."""
    tx = 2.0 * (y * fz - z * fy)
    ty = 2.0 * (z * fx - x * fz)
    tz = 2.0 * (x * fy - y * fx)
    return fx - w * tx + (y * tz - z * ty), fy - w * ty + (z * tx - x * tz), fz - w * tz + (x * ty - y * tx)


@law
def multiply_turn(w, y, z, bw, bx, by, bz):
    """Quaternion product a b of a = (w, 0, y, z), which turns about an axis across x."""
    return w * bw - y * by - z * bz, w * bx + y * bz - z * by, w * by + y * bw + z * bx, w * bz - y * bx + z * bw


@law
def turn_back(w, y, z, fx, fy, fz):
    """:func:`rotate_back` of a quaternion (w, 0, y, z)."""
    tx = 2.0 * (y * fz - z * fy)
    ty = 2.0 * (z * fx)
    tz = 0.0 - 2.0 * (y * fx)
    return fx - w * tx + (y * tz - z * ty), fy - w * ty + z * tx, fz - w * tz - y * tx


@law
def matrix(w, x, y, z):
    """Rotation matrix of a unit quaternion, row by row: body frame to world frame."""
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return 1.0 - (yy + zz), xy - wz, xz + wy, xy + wz, 1.0 - (xx + zz), yz - wx, xz - wy, yz + wx, 1.0 - (xx + yy)


@law
def apply(a, b, c, d, e, f, g, h, i, x, y, z):
    """Product of a matrix, given row by row, and a vector."""
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


@law
def cross(ax, ay, az, bx, by, bz):
    """a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@ti.func
def _arc_slope(w, factor):
    """d/dw of acos(w)/sqrt(1 - w^2) = (w factor - 1)/(1 - w^2), without cancellation where w is near 1."""
    u = 1.0 - w
    near = polynomial(_SHORT_SLOPE, u)
    return select(u > _NEAR, (w * factor - 1.0) / larger(u * (2.0 - u), 1e-12), 0.0 - near)


@law_with_derivative(_arc_slope)
def _arc_factor(w):
    """acos(w)/sqrt(1 - w^2) for w in (-1, 1]; each lane's value does not depend on its neighbours."""
    u = 1.0 - w
    result = polynomial(_SHORT, u)
    if any_lane(u > _NEAR):
        v = 1.0 - absolute(w)
        far = polynomial(_LONG, v)
        sine = sqrt(larger(v * (2.0 - v), 1e-30))
        far = select(w < 0.0, 3.141592653589793 / sine - far, far)  # acos(w) = pi - acos(-w)
        result = select(u > _NEAR, far, result)
    return result


@ti.func
def _rotation_vector_slope(w, factor):
    """d/dw of :func:`rotation_vector_factor`."""
    u = 1.0 - w
    result = 0.0 - (0.5 + u * (0.375 + u * 0.234375))
    if any_lane(u * (2.0 - u) >= SMALL_SINE_SQUARED):
        result = select(u * (2.0 - u) >= SMALL_SINE_SQUARED, 2.0 * _arc_slope(w, 0.5 * factor), result)
    return result


@law_with_derivative(_rotation_vector_slope)
def rotation_vector_factor(w):
    """k such that the engine's rotation vector of (w, v) is k v.

    The exact 2 acos(w)/sqrt(1 - w^2), but 2 sqrt(2/(1 + w)) where 1 - w^2 < 2.4e-3: the small jump is part of the
    published engine. (Its zero at |w| = 1 is not: in single precision it would be a dead zone of 0.04 degrees.)
    """
    u = 1.0 - w  # rounding may leave w a little above 1; both series continue there
    result = 2.0 + u * (0.5 + u * (0.1875 + u * 0.078125))  # series of 2 sqrt(2/(1 + w)), exact to 1e-13 here
    if any_lane(u * (2.0 - u) >= SMALL_SINE_SQUARED):
        result = select(u * (2.0 - u) >= SMALL_SINE_SQUARED, 2.0 * _arc_factor(w), result)
    return result


@law
def to_rotation_vector(w, x, y, z):
    """Exact rotation vector [rad] of a unit quaternion, by the shorter way."""
    side = select(w < 0.0, 0.0 * w - 1.0, 0.0 * w + 1.0)
    factor = 2.0 * side * _arc_factor(w * side)
    return factor * x, factor * y, factor * z


@law
def from_rotation_vector(tx, ty, tz):
    """Unit quaternion of a rotation vector [rad]; series in the half angle, exact to 1e-16 below 0.25 rad."""
    hx = 0.5 * tx
    hy = 0.5 * ty
    hz = 0.5 * tz
    s = hx * hx + hy * hy + hz * hz
    w = 1.0 - s * (1 / 2 - s * (1 / 24 - s * (1 / 720 - s * (1 / 40320))))
    k = 1.0 - s * (1 / 6 - s * (1 / 120 - s * (1 / 5040 - s * (1 / 362880))))
    return w, k * hx, k * hy, k * hz


@law
def from_large_rotation_vector(tx, ty, tz):
    """Unit quaternion of a rotation vector of up to two turns: a sixteenth of it, squared four times."""
    w, x, y, z = from_rotation_vector(0.0625 * tx, 0.0625 * ty, 0.0625 * tz)
    for _ in ti.static(range(4)):
        w, x, y, z = multiply(w, x, y, z, w, x, y, z)
    return w, x, y, z


@law
def renormalise(w, x, y, z):
    """Pull a nearly unit quaternion back to length one (first order of 1/|q|)."""
    k = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
    return w * k, x * k, y * k, z * k
