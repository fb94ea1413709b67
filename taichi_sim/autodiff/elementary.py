"""Elementary functions that native vectors lack, as laws: sine, cosine and hyperbolic tangent."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.polynomial import Chebyshev, Polynomial

from taichi_sim.autodiff.lanes import absolute
from taichi_sim.autodiff.tracing import Traced, law, primitive, select
from taichi_sim.runtime import inside_kernel, rearranges_sums, single_precision, ti

_EIGHTH = math.pi / 4  # of a turn
_ROUNDER = {True: 1.5 * 2.0**23, False: 1.5 * 2.0**52}  # adding and taking it away rounds to a whole number
# A quarter of a turn in two parts; the first has so few bits that small multiples of it are exact.
_QUARTER = {True: (1.5703125, math.pi / 2 - 1.5703125), False: (1.5707963267341256, 6.077100506506192e-11)}
_FASTEST = {True: 1e4, False: 1e9}  # rad a step; beyond, an angle has no meaning left


def economised(first: int, degrees: tuple[int, int], largest: float) -> dict[bool, list[float]]:
    """Series of (-1)^k / (2k + first)! z^k, lowest first, in f32 (True) and f64, of the degrees given.

    Chebyshev's polynomials make short ones as good up to z = ``largest``^2 as Taylor's longer ones.
    """
    domain = (0.0, largest**2)
    taylor = Polynomial([(-1) ** k / math.factorial(2 * k + first) for k in range(12)])
    coefficients = taylor.convert(kind=Chebyshev, domain=domain, window=[-1, 1]).coef
    return {
        single: [float(c) for c in Chebyshev(coefficients[: degree + 1], domain=domain).convert(kind=Polynomial).coef]
        for single, degree in zip((True, False), degrees, strict=True)
    }


# (a - sin(a)) / a^3 and (cos(a) - 1 + a^2 / 2) / a^4; errors of sine and cosine of 1e-16 (f32: 2e-8) at most.
_SINE, _COSINE = economised(3, (2, 5), _EIGHTH), economised(4, (2, 5), _EIGHTH)


@primitive
def _single() -> bool:
    """Whether reals are of single precision; NumPy's are not."""
    return inside_kernel() and single_precision()


@primitive
def _nearest(x: Any) -> Any:
    """The nearest whole number; a constant to derivatives."""
    if isinstance(x, Traced):
        return Traced(x.tape, _nearest(x.value))
    if inside_kernel() and rearranges_sums():
        return ti.floor(x + 0.5)  # what native vectors lack; the sum below would come to x
    return (x + _ROUNDER[_single()]) - _ROUNDER[_single()]


@primitive
def polynomial(coefficients: Mapping[bool, Sequence[float]], z: Any) -> Any:
    """A polynomial in z by Horner's rule; coefficients, lowest first, in f32 (True) and f64."""
    *others, result = coefficients[_single()]
    for c in reversed(others):
        result = result * z + c
    return result


@primitive
def _less_quarters(angle: Any, quarters: Any) -> Any:
    """What is left of an angle without so many quarters of a turn."""
    coarse, fine = _QUARTER[_single()]
    return (angle - quarters * coarse) - quarters * fine


@primitive
def _has_meaning(angle: Any) -> Any:
    return absolute(angle) < _FASTEST[_single()]


@primitive
def sine_cosine_by(angle: Any, sine: Mapping[bool, Sequence[float]], cosine: Mapping[bool, Sequence[float]]) -> Any:
    """Sine and cosine by these series, within their range."""
    z = angle * angle
    return angle - angle * z * polynomial(sine, z), 1.0 - (0.5 * z - z * z * polynomial(cosine, z))


@law
def _wrapped(quarters):
    """Quarters of a turn as turns, from -1/2 to 1/2."""
    return 0.25 * quarters - _nearest(0.25 * quarters)


@law
def sine_cosine(angle):
    """Sine and cosine of any angle [rad]; beyond ``_FASTEST``, where angles have no meaning left, of 0."""
    bounded = select(_has_meaning(angle), angle, 0.0)
    quarters = _nearest(bounded * (2.0 / math.pi))
    s, c = sine_cosine_by(_less_quarters(bounded, quarters), _SINE, _COSINE)
    half = 0.5 * quarters - _nearest(0.5 * quarters)  # 0 of even quarters, else a half
    sine, cosine = select(half * half > 0.125, c, s), select(half * half > 0.125, s, c)
    here, ahead = _wrapped(quarters), _wrapped(quarters + 1.0)
    sine = select((here < -0.125) | (here > 0.375), 0.0 - sine, sine)
    cosine = select((ahead < -0.125) | (ahead > 0.375), 0.0 - cosine, cosine)
    return sine, cosine


_STEEPEST = 20.0  # beyond, the hyperbolic tangent is 1 to rounding


@law
def _of_double(t):
    """tanh(2 y) from t = tanh(y)."""
    return 2.0 * t / (1.0 + t * t)


@law
def hyperbolic_tangent(x):
    """tanh(x): Lambert's continued fraction for x / 2^5, cut off where it is exact to rounding, doubled five times."""
    y = select(x > _STEEPEST, _STEEPEST, select(x < 0.0 - _STEEPEST, 0.0 - _STEEPEST, x)) * 0.03125
    z = y * y
    t = y * (135135.0 + z * (17325.0 + z * (378.0 + z))) / (135135.0 + z * (62370.0 + z * (3150.0 + z * 28.0)))
    return _of_double(_of_double(_of_double(_of_double(_of_double(t)))))
