"""Pressures of the cores of the inflatable robot: one number for all cores, or a tuple with one for each."""

from itertools import product
from typing import TypeVar

import numpy as np

from robots.inflatable.body import InflatableGeometry
from robots.inflatable.schedule import MAXIMUM_PRESSURE
from taichi_sim.base.checks import number

Pressure = float | tuple[float, ...]  # of all cores alike, or of each [Pa]
Number = TypeVar("Number")


def checked_pressure(given: object) -> Pressure:
    """A pressure of all cores as a float, several as a tuple.

    Raises:
        ValueError: for anything else, and beyond 0 to 15,000 Pa.
    """
    if not isinstance(given, list | tuple) and not (isinstance(given, np.ndarray) and given.ndim):
        return number("pressure", given, 0.0, MAXIMUM_PRESSURE, "Pa")
    if not len(given):
        raise ValueError("pressure: none is given; give one for all cores, or one each")
    each = tuple(number("pressure", one, 0.0, MAXIMUM_PRESSURE, "Pa") for one in given)
    return each[0] if len(each) == 1 else each


def each_pressure(pressure: Number | tuple[Number, ...], geometry: InflatableGeometry) -> tuple[Number, ...]:
    """The pressure of every core [Pa].

    Raises:
        ValueError: if several pressures are not as many as the cores.
    """
    if not isinstance(pressure, tuple):
        return (pressure,) * geometry.cores
    if len(pressure) != geometry.cores:
        allowed = "give one, for the one core" if geometry.cores == 1 else f"give one, or {geometry.cores}, one a core"
        raise ValueError(f"pressure: {len(pressure)} values are not allowed; {allowed}")
    return pressure


def highest_pressure(pressure: Pressure) -> float:
    """The highest pressure of any core [Pa], which says how long the ramp lasts."""
    return max(np.atleast_1d(pressure).tolist())


def common_pressure(pressure: Pressure) -> float | None:
    """The pressure that all cores have [Pa]; None where they differ."""
    first, *others = set(np.atleast_1d(pressure).tolist())
    return None if others else first


def kilopascals(pressure: Pressure) -> str:
    """Pressures in words, such as ``"12 kPa"`` or ``"12 and 0 kPa"``."""
    *before, last = (f"{one / 1000:.3g}" for one in np.atleast_1d(pressure).tolist())
    return f"{', '.join(before)} and {last} kPa" if before else f"{last} kPa"


def core_shapes(geometry: InflatableGeometry, pressure: float) -> list[tuple[float, ...]]:
    """Pressures of the cores in all 2^N shapes of a geometry with N cores [Pa].

    Shape s has core k inflated where bit k of s is 1, the first core's being the lowest bit: so the first shape is
    flat, the second has the first core alone, and the last has all.

    Args:
        geometry: of the body.
        pressure: of cores that are inflated [Pa].

    Raises:
        ValueError: for a pressure that is not allowed, or none.
    """
    inflated = checked_pressure(pressure)
    if isinstance(inflated, tuple) or inflated == 0:
        raise ValueError(f"pressure: {pressure!r} is not allowed; give one above 0 Pa")
    return [shape[::-1] for shape in product((0.0, inflated), repeat=geometry.cores)]


def bladder_shares(geometry: InflatableGeometry) -> list[float]:
    """The part of the rows under bladders that each core has."""
    under = geometry.bladder_rows
    return [sum(row in under for row in rows) / len(under) for rows in geometry.core_rows]
