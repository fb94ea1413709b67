"""Solids that bodies are made of: where they touch flat ground, how mass lies in them, what water finds of them."""

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
SLICES, BLOCKS = 6, 3  # of a capsule and along an edge of a box, in water
LARGEST = 1e6  # m; the fifth powers of sizes in inertias stay far within single precision
_CORNERS = np.array([(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)])
_size = partial(positive, high=LARGEST)
Size = Annotated[float, _size]


@dataclass(frozen=True, eq=False)
class Faces:
    """Areas by which a fluid resists a portion of a solid, as symmetric matrices in the axes at rest, (3, 3) [m^2].

    They are what drag on faces, as of lattice robots, comes to where a solid moves along one of its own axes: pressure
    on a face by the square of the cosine between its normal and the motion, friction by that of the sine.

    Attributes:
        pressure: that meet the fluid.
        friction: that it flows along.
    """

    pressure: Floats
    friction: Floats


@dataclass(frozen=True, eq=False)
class Portion:
    """A part of a solid as water sees it.

    Attributes:
        centre: from the body's centre of mass [m].
        spread: three times the covariance of its places about its centre, (3, 3) [m^2]; along a direction n its heights
            lie evenly within sqrt(n.spread n) of the centre's, so that of a block at rest is exact.
        volume: [m^3].
        faces: its part of the solid's surface.
        is_ball: whether it is a ball instead, exactly; ``spread`` has its squared radius then.
    """

    centre: Floats
    spread: Floats
    volume: float
    faces: Faces
    is_ball: bool = False


@dataclass(frozen=True, eq=False)
class Patch:
    """The part of a solid's surface that belongs to one of its points, as sand finds it.

    Attributes:
        ball: share of the ball about the point, and what is added to it for each unit of the cosine between ``axis``
            and straight down.
        length: of the cylinder half of which belongs to the point [m].
        axis: along that cylinder, outwards; a unit vector, or zero.
        edges: of the box whose corner the point is, as they go from it along the three axes at rest; signed [m].
    """

    ball: tuple[float, float] = (0.0, 0.0)
    length: float = 0.0
    axis: Vector = ORIGIN
    edges: Vector = ORIGIN


def _about(axis: Floats, along: float, across: float) -> Floats:
    """The symmetric matrix with one value along a unit vector, and another across it."""
    return across * np.eye(3) + (along - across) * np.outer(axis, axis)


@dataclass(frozen=True)
class Sphere:
    """A solid ball.

    Attributes:
        radius: radius of the ball [m].
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

    def patches(self) -> list[Patch]:
        """Return the whole surface of the ball as one patch."""
        return [Patch((1.0, 0.0))]

    def portions(self) -> list[Portion]:
        """Return the ball itself as its only portion."""
        section = math.pi * self.radius**2
        faces = Faces(section / 2 * np.eye(3), 8 / 3 * section * np.eye(3))
        return [Portion(np.array(self.centre), self.radius**2 * np.eye(3), self.volume, faces, is_ball=True)]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        return np.eye(3) * 0.4 * mass * self.radius**2


@dataclass(frozen=True)
class Capsule:
    """A solid capsule: a cylinder with half balls at its ends.

    Attributes:
        radius: radius of cylinder and ends [m].
        length: length of the cylinder [m].
        axis: direction of the cylinder, in the axes of the world at rest.
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

    def patches(self) -> list[Patch]:
        """Split the surface between both ends: the half ball of each, and half of the cylinder."""
        axis = unit("axis", self.axis)
        return [Patch((0.5, 0.5), self.length, side * axis) for side in (-1.0, 1.0)]

    def portions(self) -> list[Portion]:
        """Split the solid into its half balls and equal slices of the cylinder, as many for any size."""
        r, axis, cap = self.radius, unit("axis", self.axis), 3 / 8 * self.radius  # of a half ball, to its centre
        thick = self.length / SLICES
        middles = thick * (np.arange(SLICES) + 0.5) - self.length / 2
        section, side = math.pi * r**2, math.pi * r * thick
        round_about = Faces(_about(axis, 0.0, 4 / 3 * r * thick), _about(axis, 2 * side, side))
        piece = _about(axis, thick**2 / 4, 3 / 4 * r**2), section * thick, round_about
        faces = Faces(section / 4 * np.eye(3), 4 / 3 * section * np.eye(3))
        half = _about(axis, 57 / 320 * r**2, 3 / 5 * r**2), 2 / 3 * section * r, faces
        ends = [(side * (self.length / 2 + cap), half) for side in (-1.0, 1.0)]
        slices = [(at, piece) for at in middles]
        return [Portion(np.array(self.centre) + at * axis, *each) for at, each in slices + ends]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        r, l = self.radius, self.length
        cylinder = mass * l / (l + 4 / 3 * r)
        ends = mass - cylinder
        along = (0.5 * cylinder + 0.4 * ends) * r**2
        across = cylinder * (r**2 / 4 + l**2 / 12) + ends * (0.4 * r**2 + 0.375 * r * l + l**2 / 4)
        axis = unit("axis", self.axis)
        return _about(axis, along, across)


@dataclass(frozen=True)
class Box:
    """A solid cuboid, whose edges lie along the axes of the world when its robot is at rest.

    Attributes:
        size: lengths of the edges along x, y and z [m].
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
        return [(np.array(self.centre) + half * each, 0.0) for each in _CORNERS]

    def patches(self) -> list[Patch]:
        """Split the surface among the corners: a quarter of each of the three faces that meet at a corner."""
        return [Patch(edges=-np.array(self.size) * each) for each in _CORNERS]

    def portions(self) -> list[Portion]:
        """Split the solid into equal blocks, three along each edge; as many for any size, which may change."""
        size = np.array(self.size)
        edges = size / BLOCKS
        spread, volume = np.diag((edges / 2) ** 2), float(np.prod(edges))
        x, y, z = size
        pressure, friction = np.diag([y * z, z * x, x * y]), 2 * np.diag([x * (y + z), y * (z + x), z * (x + y)])
        faces = Faces(pressure / BLOCKS**3, friction / BLOCKS**3)
        places = (
            np.array(self.centre) + edges * (np.add(n, 0.5)) - size / 2 for n in np.ndindex(BLOCKS, BLOCKS, BLOCKS)
        )
        return [Portion(place, spread, volume, faces) for place in places]

    def inertia(self, mass: float) -> Floats:
        """Inertia of the solid with this mass about its own centre, (3, 3) [kg m^2]."""
        x, y, z = np.array(self.size) ** 2
        return np.diag([y + z, x + z, x + y]) * mass / 12


Solid = Sphere | Capsule | Box
