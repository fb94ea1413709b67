"""Solids that bodies are made of: where they may touch flat ground, and how mass lies in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import check_fields, positive, real_array

Vector = Sequence[float] | Floats
ORIGIN = (0.0, 0.0, 0.0)


def vector(field: str, value: Vector) -> Floats:
    """Check that a value is three finite numbers, and return them as an array.

    Raises:
        ValueError: for anything else.
    """
    try:
        found = np.array(real_array(value))
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(f"{field}: {value!r} is not allowed; give three finite numbers")
    return found


def triple(field: str, value: Vector) -> tuple[float, ...]:
    """Check that a value is three finite numbers, and return them as floats, with the errors of :func:`vector`."""
    return tuple(vector(field, value).tolist())


def unit(field: str, value: Vector) -> Floats:
    """Check a direction, and return it as a unit vector.

    Raises:
        ValueError: for the zero vector, or anything that is no vector.
    """
    found = vector(field, value)
    length = float(np.linalg.norm(found))
    if length < 1e-12:
        raise ValueError(f"{field}: {value!r} is not allowed; give a direction")
    return found / length


def _direction(field: str, value: Vector) -> tuple[float, ...]:
    unit(field, value)
    return triple(field, value)


Place = Annotated[Vector, triple]
LARGEST = 1e6  # m; the fifth powers of sizes in inertias stay far within single precision
_size = partial(positive, high=LARGEST)
Size = Annotated[float, _size]


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Attributes:
        radius: [m].
        centre: from the body's centre of mass [m].
    """

    radius: Size
    centre: Place = ORIGIN

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return 4 / 3 * math.pi * self.radius**3

    def points(self) -> list[tuple[Floats, float]]:
        """Balls that stand for the solid in contact: centres from the body's centre of mass, and radii [m]."""
        return [(np.array(self.centre), self.radius)]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        return np.eye(3) * 0.4 * mass * self.radius**2


@dataclass(frozen=True)
class Capsule:
    """A capsule: a cylinder with half balls at its ends.

    Attributes:
        radius: [m].
        length: length of the cylinder [m].
        axis: along it, in the axes of the world at rest.
        centre: from the body's centre of mass [m].
    """

    radius: Size
    length: Size
    axis: Annotated[Vector, _direction] = (0.0, 0.0, 1.0)
    centre: Place = ORIGIN

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * self.length + 4 / 3 * math.pi * self.radius**3

    def points(self) -> list[tuple[Floats, float]]:
        """Balls at the two ends: centres from the body's centre of mass, and radii [m]."""
        arm = unit("axis", self.axis) * self.length / 2
        return [(np.array(self.centre) + side * arm, self.radius) for side in (-1.0, 1.0)]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        r, l = self.radius, self.length
        cylinder = mass * l / (l + 4 / 3 * r)
        ends = mass - cylinder
        along = (0.5 * cylinder + 0.4 * ends) * r**2
        across = cylinder * (r**2 / 4 + l**2 / 12) + ends * (0.4 * r**2 + 0.375 * r * l + l**2 / 4)
        axis = unit("axis", self.axis)
        return across * np.eye(3) + (along - across) * np.outer(axis, axis)


@dataclass(frozen=True)
class Box:
    """A cuboid along the axes of the world at rest.

    Attributes:
        size: its edges [m].
        centre: from the body's centre of mass [m].
    """

    size: Place
    centre: Place = ORIGIN

    def __post_init__(self) -> None:
        check_fields(self)
        for edge in self.size:
            _size("size", edge)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(np.prod(self.size))

    def points(self) -> list[tuple[Floats, float]]:
        """The eight corners as balls of radius 0: centres from the body's centre of mass, and radii [m]."""
        half = np.array(self.size) / 2
        signs = np.array([(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)])
        return [(np.array(self.centre) + half * each, 0.0) for each in signs]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        x, y, z = np.array(self.size) ** 2
        return np.diag([y + z, x + z, x + y]) * mass / 12


Solid = Sphere | Capsule | Box
