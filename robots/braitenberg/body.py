"""Bodies of Braitenberg vehicles: where the light sensors sit; the published grid of bodies, and its symmetries.

Source: dissertation, chapters 3 and 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from taichi_sim.base.checks import number

FORMAT = "morpholab-vehicle-1"  # of files of vehicles
CONTROLLERS = ("contralateral", "full")
HALF_SIDE = 0.5  # m: sensors sit in a square of 1 m about the centre
SITES_PER_AXIS = 9  # of the published grid
SITES = SITES_PER_AXIS**2
DESIGNS = SITES**2  # bodies of two sensors on that grid
_PITCH = 2 * HALF_SIDE / (SITES_PER_AXIS - 1)

Site = tuple[float, float]


@dataclass(frozen=True)
class VehicleBody:
    """Body of a Braitenberg vehicle: the places of its light sensors.

    Attributes:
        sensors: places of its light sensors in its own frame [m], x ahead and y to the left, each from -0.5 to 0.5.

    Raises:
        ValueError: for sites outside the body, or none.
    """

    sensors: tuple[Site, ...]

    def __post_init__(self) -> None:
        places = self.sensors.tolist() if isinstance(self.sensors, np.ndarray) else self.sensors
        if not isinstance(places, Sequence) or isinstance(places, str) or not len(places):
            raise ValueError(f"sensors: {places!r} is not allowed; give at least one place (x, y)")
        object.__setattr__(self, "sensors", tuple(_site(place) for place in places))

    @classmethod
    def published(cls, design: int) -> Self:
        """Return body number 1 to 6561 of the published grid, which has 9 x 9 places for each of two sensors.

        Raises:
            ValueError: for any other number.
        """
        whole = isinstance(design, int | np.integer) and not isinstance(design, bool)
        if not whole or not 1 <= design <= DESIGNS:
            raise ValueError(f"design: {design!r} is not allowed; give a whole number from 1 to {DESIGNS}")
        return cls(tuple(_grid_site(site) for site in divmod(int(design) - 1, SITES)))

    @property
    def design(self) -> int | None:
        """Number of the body in the published grid; None if it is not on the grid."""
        if len(self.sensors) != 2:
            return None
        first, second = (_grid_number(site) for site in self.sensors)
        return None if first is None or second is None else SITES * first + second + 1

    @property
    def mirrored(self) -> "VehicleBody":
        """Mirror image of the body: places of sensors, and sensors, exchanged between left and right."""
        return VehicleBody(tuple((x, 0.0 - y) for x, y in reversed(self.sensors)))

    @property
    def reversed(self) -> "VehicleBody":
        """Body turned by half a turn, with sensors exchanged: driven backwards it is the same vehicle."""
        return VehicleBody(tuple((0.0 - x, 0.0 - y) for x, y in reversed(self.sensors)))


def _site(place: object) -> Site:
    if not isinstance(place, Sequence) or isinstance(place, str) or len(place) != 2:
        raise ValueError(f"sensors: {place!r} is not allowed; give places (x, y)")
    x, y = (number("sensors", value, -HALF_SIDE, HALF_SIDE, "m, inside the body") for value in place)
    return x, y


def _grid_site(site: int) -> Site:
    ix, iy = divmod(site, SITES_PER_AXIS)
    return ix * _PITCH - HALF_SIDE, iy * _PITCH - HALF_SIDE


def _grid_number(site: Site) -> int | None:
    ix, iy = ((value + HALF_SIDE) / _PITCH for value in site)
    return int(SITES_PER_AXIS * ix + iy) if ix.is_integer() and iy.is_integer() else None


BASELINE = VehicleBody.published(6553)  # eyes at the front, left and right; the canonical body
