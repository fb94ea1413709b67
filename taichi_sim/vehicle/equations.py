"""The Braitenberg vehicle: light sensors drive two motors through a linear controller.

Source: dissertation, chapters 3 and 4 (equations of the vehicle). In the frame of the world, the light at the origin,

    s_j = 1 / |x + R(a) l_j|^2,   m = W s,   x' = (m_1 + m_2) / 2 (cos a, sin a),   a' = m_1 - m_2,

with sensor sites l_j in the frame of the body, and explicit Euler steps of length h. Here the body sees the light:
p = R(-a) x. A sensor is then at p + l_j, without any angle, and an Euler step of the world is exactly

    p <- R(-h a') (p + h (m_1 + m_2) / 2 e_1),

which takes sine and cosine of one step's turn only.
"""

import math
from collections.abc import Mapping, Sequence
from functools import reduce
from operator import add
from typing import Any

from numpy.polynomial import Chebyshev, Polynomial

from taichi_sim.lanes import absolute, any_lane
from taichi_sim.runtime import emit, inside_kernel, single_precision
from taichi_sim.tracing import Traced, law, primitive, select, sqrt

_EIGHTH = math.pi / 4  # of a turn
_SMALL = 1 / 8  # rad a step: nearly all turns are smaller, and shorter series hold for them
_ROUNDER = {True: 1.5 * 2.0**23, False: 1.5 * 2.0**52}  # adding and taking it away rounds to a whole number
# A quarter of a turn in two parts; the first has so few bits that small multiples of it are exact.
_QUARTER = {True: (1.5703125, math.pi / 2 - 1.5703125), False: (1.5707963267341256, 6.077100506506192e-11)}
_FASTEST = {True: 1e4, False: 1e9}  # rad a step; beyond, an angle has no meaning left


def _economised(first: int, degrees: tuple[int, int], largest: float) -> dict[bool, list[float]]:
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
_SINE, _COSINE = _economised(3, (2, 5), _EIGHTH), _economised(4, (2, 5), _EIGHTH)
_SMALL_SINE, _SMALL_COSINE = _economised(3, (1, 3), _SMALL), _economised(4, (0, 2), _SMALL)


@primitive
def _single() -> bool:
    """Whether reals are of single precision; NumPy's are not."""
    return inside_kernel() and single_precision()


@primitive
def _nearest(x: Any) -> Any:
    """The nearest whole number; a constant to derivatives."""
    if isinstance(x, Traced):
        return Traced(x.tape, _nearest(x.value))
    return (x + _ROUNDER[_single()]) - _ROUNDER[_single()]


@primitive
def _series(coefficients: Mapping[bool, Sequence[float]], z: Any) -> Any:
    """Horner's rule, unrolled."""
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
def _sine_cosine(angle: Any, sine: Mapping[bool, Sequence[float]], cosine: Mapping[bool, Sequence[float]]) -> Any:
    z = angle * angle
    return angle - angle * z * _series(sine, z), 1.0 - (0.5 * z - z * z * _series(cosine, z))


@law
def _wrapped(quarters):
    """Quarters of a turn as turns, from -1/2 to 1/2."""
    return 0.25 * quarters - _nearest(0.25 * quarters)


@law
def sine_cosine(angle):
    """Sine and cosine of any angle [rad]; beyond ``_FASTEST``, where angles have no meaning left, of 0."""
    bounded = select(_has_meaning(angle), angle, 0.0)
    quarters = _nearest(bounded * (2.0 / math.pi))
    s, c = _sine_cosine(_less_quarters(bounded, quarters), _SINE, _COSINE)
    half = 0.5 * quarters - _nearest(0.5 * quarters)  # 0 of even quarters, else a half
    sine, cosine = select(half * half > 0.125, c, s), select(half * half > 0.125, s, c)
    here, ahead = _wrapped(quarters), _wrapped(quarters + 1.0)
    sine = select((here < -0.125) | (here > 0.375), 0.0 - sine, sine)
    cosine = select((ahead < -0.125) | (ahead > 0.375), 0.0 - cosine, cosine)
    return sine, cosine


@law
def turn_of_step(angle):
    """Sine and cosine of the turn of a step, which is rarely large."""
    large = absolute(angle) > _SMALL
    sine, cosine = _sine_cosine(angle, _SMALL_SINE, _SMALL_COSINE)
    if any_lane(large):
        far_sine, far_cosine = sine_cosine(angle)
        sine = select(large, far_sine, sine)
        cosine = select(large, far_cosine, cosine)
    return sine, cosine


@law
def pair_of_readings(px, py, ax, ay, bx, by):
    """Readings 1/d^2 of two sensors at a and b, for one division."""
    first = (px + ax) * (px + ax) + (py + ay) * (py + ay)
    second = (px + bx) * (px + bx) + (py + by) * (py + by)
    inverse = 1.0 / (first * second)
    return second * inverse, first * inverse


@law
def reading(px, py, ax, ay):
    """Reading 1/d^2 of one sensor."""
    return 1.0 / ((px + ax) * (px + ax) + (py + ay) * (py + ay))


@primitive
def readings(px: Any, py: Any, sites: Sequence[Any]) -> list[Any]:
    """Readings of all sensors, whose coordinates follow one another in ``sites``."""
    found: list[Any] = []
    for j in range(0, len(sites) - 3, 4):
        found.extend(pair_of_readings(px, py, *sites[j : j + 4]))
    if len(sites) % 4:
        found.append(reading(px, py, *sites[-2:]))
    return [emit(x) if inside_kernel() and not isinstance(x, Traced) else x for x in found]


@law
def move(px, py, first, second, time_step):
    """The light's place as seen after a step with the two motors at these speeds, and the turn of the step."""
    turn = (first - second) * time_step
    sine, cosine = turn_of_step(turn)
    ahead = px + (first + second) * (0.5 * time_step)
    return cosine * ahead + sine * py, cosine * py - sine * ahead, turn


@primitive
def advance(px: Any, py: Any, sites: Sequence[Any], weights: Sequence[Any], wiring: Sequence[Sequence[int]],
            time_step: Any) -> Any:  # fmt: skip
    """One Euler step: (px, py, turn). ``weights`` follow ``wiring``, which names each motor's sensors."""
    seen = readings(px, py, sites)
    left = iter(weights)
    motors = [reduce(add, [next(left) * seen[j] for j in sensors]) if sensors else 0.0 * px for sensors in wiring]
    return move(px, py, *motors, time_step)


@law
def hopeless(px, py, reach, target, bound_left):
    """Whether the centre cannot come closer than ``target`` [m] any more, whatever happens.

    Each sensor is at least rho = |x| - reach from the light, if ``reach`` is the largest |l|; so the speed is at most
    w / rho^2 with w = sum of |W| / 2, and rho^3 falls by at most 3 w h a step: for a step,
    (rho - h w / rho^2)^3 >= rho^3 - 3 h w by Bernoulli's inequality, so this holds for Euler's method, too.

    Args:
        reach: largest distance of a sensor from the centre [m].
        bound_left: 3 w h times the steps left [m^3].
    """
    rho = sqrt(px * px + py * py) - reach
    least = select(target > reach, target - reach, 0.0)
    return (rho > 0.0) & (rho * rho * rho > (bound_left + least * least * least) * (1.0 + 1e-6))
