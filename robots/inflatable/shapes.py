"""The shapes of a body with several cores, each of them empty or inflated."""

from itertools import product

from robots.inflatable.body import InflatableGeometry
from robots.inflatable.cores import checked_pressure


def core_shapes(geometry: InflatableGeometry, pressure: float) -> list[tuple[float, ...]]:
    """Pressures of the cores in all 2^N shapes of a geometry with N cores [Pa].

    Shape s has core k inflated where bit k of s is 1, the first core's being the lowest bit: so the first shape is
    flat, the second has the first core alone, and the last has all.

    Args:
        geometry: of the body.
        pressure: of cores that are inflated [Pa].

    Raises:
        ValueError: in one line, for a pressure that is not allowed, or none.
    """
    inflated = checked_pressure(pressure)
    if isinstance(inflated, tuple) or inflated == 0:
        raise ValueError(f"pressure: {pressure!r} is not allowed; give one above 0 Pa")
    return [shape[::-1] for shape in product((0.0, inflated), repeat=geometry.cores)]
