"""Solids that bodies are made of: where they may touch flat ground, and how mass lies in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichi_sim.base.arrays import Floats

Vector = Sequence[float] | Floats
ORIGIN = (0.0, 0.0, 0.0)


def vector(field: str, value: Vector) -> Floats:
    """Check that a value is three finite numbers, and return them as an array.

    Raises:
        ValueError: for anything else.
    """
    try:
        found = np.array(value, float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(f"{field}: {value!r} is not allowed; give three finite numbers")
    return found


def is_number(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def is_whole(value: object) -> bool:
    """Whether a value is a whole number."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def positive(field: str, value: float, zero: bool = False) -> float:
    """Check that a value is a finite number above zero, or zero if ``zero`` allows it.

    Raises:
        ValueError: for anything else.
    """
    if not is_number(value) or value < 0 or (value == 0 and not zero):
        allowed = "a finite number, at least 0" if zero else "a positive finite number"
        raise ValueError(f"{field}: {value!r} is not allowed; give {allowed}")
    return float(value)


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


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Attributes:
        radius: [m].
        centre: from the body's centre of mass [m].
    """

    radius: float
    centre: Vector = ORIGIN

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        vector("centre", self.centre)

    def points(self) -> list[tuple[Floats, float]]:
        """Balls that stand for the solid in contact: centres from the body's centre of mass, and radii [m]."""
        return [(np.array(self.centre, float), self.radius)]

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

    radius: float
    length: float
    axis: Vector = (0.0, 0.0, 1.0)
    centre: Vector = ORIGIN

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        positive("length", self.length)
        unit("axis", self.axis)
        vector("centre", self.centre)

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

    size: Vector
    centre: Vector = ORIGIN

    def __post_init__(self) -> None:
        for edge in vector("size", self.size):
            positive("size", float(edge))
        vector("centre", self.centre)

    def points(self) -> list[tuple[Floats, float]]:
        """The eight corners as balls of radius 0: centres from the body's centre of mass, and radii [m]."""
        half = np.array(self.size, float) / 2
        signs = np.array([(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)])
        return [(np.array(self.centre) + half * each, 0.0) for each in signs]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        x, y, z = np.array(self.size, float) ** 2
        return np.diag([y + z, x + z, x + y]) * mass / 12


Solid = Sphere | Capsule | Box
