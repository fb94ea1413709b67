"""Pressures of the cores of the inflatable robot: as designs give them, and as programs see them."""

from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.body import REGION_COUNT, SKIN_REGIONS, InflatableGeometry, skin_regions
from robots.inflatable.schedule import MAXIMUM_PRESSURE
from taichi_sim.autodiff.dual import Real, value_of
from taichi_sim.base.arrays import Ints
from taichi_sim.base.checks import number

Pressure = float | tuple[float, ...]  # of all cores alike, or of each [Pa]
Scalar = float | Real


def checked_pressure(given: object) -> Pressure:
    """A pressure of all cores as a float, several as a tuple.

    Raises:
        ValueError: in one line, for anything else, and beyond 0 to 15,000 Pa.
    """
    if not isinstance(given, list | tuple) and not (isinstance(given, np.ndarray) and given.ndim):
        return number("pressure", given, 0.0, MAXIMUM_PRESSURE, "Pa")
    if not len(given):
        raise ValueError("pressure: none is given; give one for all cores, or one each")
    each = tuple(number("pressure", one, 0.0, MAXIMUM_PRESSURE, "Pa") for one in given)
    return each[0] if len(each) == 1 else each


def each_pressure(pressure: Pressure, geometry: InflatableGeometry) -> tuple[float, ...]:
    """The pressure of every core [Pa].

    Raises:
        ValueError: in one line, for as many as there are no cores.
    """
    if not isinstance(pressure, tuple):
        return (pressure,) * geometry.cores
    if len(pressure) != geometry.cores:
        allowed = "give one, for the one core" if geometry.cores == 1 else f"give one, or {geometry.cores}, one a core"
        raise ValueError(f"pressure: {len(pressure)} values are not allowed; {allowed}")
    return pressure


def highest_pressure(pressure: Pressure) -> float:
    """Of all cores [Pa]: how long the ramp lasts."""
    return max(pressure) if isinstance(pressure, tuple) else pressure


def common_pressure(pressure: Pressure) -> float | None:
    """That all cores have [Pa]; None where they differ."""
    if not isinstance(pressure, tuple):
        return pressure
    return pressure[0] if len(set(pressure)) == 1 else None


def kilopascals(pressure: Pressure) -> str:
    """In words, such as ``"12 kPa"`` or ``"12 and 0 kPa"``."""
    *before, last = (f"{one / 1000:.3g}" for one in (pressure if isinstance(pressure, tuple) else (pressure,)))
    return f"{', '.join(before)} and {last} kPa" if before else f"{last} kPa"


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


@dataclass(frozen=True, eq=False)
class InflatedCores:
    """The cores of a robot while its program is written. Pressures may carry derivatives.

    Attributes:
        each: pressure of every core [Pa].
        mean: what bladders feel [Pa]: they lie over all cores, and lengthen by the mean of the pressures, each
            weighted by the rows that the core has under bladders.
    """

    each: tuple[Scalar, ...]
    mean: Scalar

    @classmethod
    def of(cls, pressure: Scalar | tuple[Scalar, ...], geometry: InflatableGeometry) -> Self:
        """The cores of a geometry at one pressure for all, or one each [Pa].

        Raises:
            ValueError: in one line, for as many as there are no cores.
        """
        if not isinstance(pressure, tuple):
            return cls((pressure,) * geometry.cores, pressure)
        each_pressure(tuple(float(value_of(one)) for one in pressure), geometry)
        return cls(pressure, sum(share * one for share, one in zip(bladder_shares(geometry), pressure, strict=True)))

    @property
    def everywhere(self) -> Ints:
        """All regions."""
        return np.concatenate([np.arange(REGION_COUNT), self.skin(SKIN_REGIONS)[len(SKIN_REGIONS) :]])

    def skin(self, kinds: ArrayLike) -> Ints:
        """Regions of these kinds in all cores, core by core."""
        return np.concatenate([skin_regions(np.atleast_1d(kinds), core) for core in range(len(self.each))])


def bladder_shares(geometry: InflatableGeometry) -> list[float]:
    """The part of the rows under bladders that each core has."""
    under = geometry.bladder_rows
    return [sum(row in under for row in rows) / len(under) for rows in geometry.core_rows]
