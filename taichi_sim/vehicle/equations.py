"""The Braitenberg vehicle: light sensors drive two motors through a linear controller.

Source: dissertation, chapters 3 and 4 (equations of the vehicle). In the frame of the world, the light at the origin,

    s_j = 1 / |x + R(a) l_j|^2,   m = W s,   x' = (m_1 + m_2) / 2 (cos a, sin a),   a' = m_1 - m_2,

with sensor sites l_j in the frame of the body, and explicit Euler steps of length h. Here the body sees the light:
p = R(-a) x. A sensor is then at p + l_j, without any angle, and an Euler step of the world is exactly

    p <- R(-h a') (p + h (m_1 + m_2) / 2 e_1),

which takes sine and cosine of one step's turn only.
"""

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

from taichi_sim.autodiff.elementary import economised, sine_cosine, sine_cosine_by
from taichi_sim.autodiff.lanes import absolute, any_lane
from taichi_sim.autodiff.tracing import Traced, law, primitive, select, sqrt
from taichi_sim.runtime import emit, inside_kernel

_SMALL = 1 / 8  # rad a step: nearly all turns are smaller, and shorter series hold for them
_SMALL_SINE, _SMALL_COSINE = economised(3, (1, 3), _SMALL), economised(4, (0, 2), _SMALL)


@law
def turn_of_step(angle):
    """Sine and cosine of the turn of a step, which is rarely large."""
    large = absolute(angle) > _SMALL
    sine, cosine = sine_cosine_by(angle, _SMALL_SINE, _SMALL_COSINE)
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
def advance(
    px: Any, py: Any, sites: Sequence[Any], weights: Sequence[Any], wiring: Sequence[Sequence[int]], time_step: Any
) -> Any:
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
