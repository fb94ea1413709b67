"""Props: bodies beside the robot in its world, such as a ball to push, a payload to carry, a wall in the way.

They are soft, of the robot's own voxels, and touch it, the ground and each other by the contact that is there.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_sim.base import checks
from taichi_sim.base.arrays import Bools, Ints
from taichi_sim.base.options import value_of

DENSITY = 1000.0  # kg/m^3
KINDS = {"box": "a box to push or to carry", "ball": "a ball", "wall": "a box that the world holds"}
SIZES = {"box": ("LX", "LY", "LZ"), "ball": ("DIAMETER",), "wall": ("LX", "LY", "LZ")}
MOST_VOXELS = 100_000


@dataclass(frozen=True)
class Prop:
    """A body beside the robot.

    Attributes:
        kind: ``"box"``, ``"ball"`` or ``"wall"``, which stays where it is.
        size: edges of a box or wall along the robot's heading, to its left and up, or the diameter of a ball [m];
            rounded to whole voxels, whose axes are those of the world: edges go the way that is nearest.
        x: of its middle, ahead of where the robot's middle starts [m].
        y: of its middle, to the left of that [m].
        z: of its lower side above the ground on which the robot stands [m]; None stands on the ground below it.
        density: [kg/m^3].
        rubbing: factor of its friction where the terrain gives none, of a draw; names do not tell it.
    """

    kind: str
    size: tuple[float, ...]
    x: float
    y: float
    z: float | None = None
    density: float = DENSITY
    rubbing: float = 1.0

    def __post_init__(self) -> None:
        checks.choice("prop", self.kind, KINDS)
        if not isinstance(self.size, list | tuple) or len(self.size) != len(SIZES[self.kind]):
            raise ValueError(f"size: {self.size!r} is not allowed; give {', '.join(SIZES[self.kind])} in metres")
        object.__setattr__(self, "size", tuple(checks.positive("size", each, 1e3) for each in self.size))
        for name in ("x", "y"):
            object.__setattr__(self, name, checks.number(name, getattr(self, name), -1e3, 1e3, "m"))
        if self.z is not None:
            object.__setattr__(self, "z", checks.number("z", self.z, 0.0, 1e3, "m"))
        object.__setattr__(self, "density", checks.positive("density", self.density, 1e6))

    @property
    def held(self) -> bool:
        """Whether the world holds it."""
        return self.kind == "wall"

    def is_voxel(self, edge: float) -> bool:
        """Whether it has a single voxel of an edge [m]."""
        return all(round(each / edge) <= 1 for each in self.size)

    @property
    def name(self) -> str:
        """Its text as :meth:`parse` reads it, such as ``"ball:0.04,0.12,0.0"``."""
        numbers = [*self.size, self.x, self.y]
        if self.z is not None or self.density != DENSITY:
            numbers += [math.nan if self.z is None else self.z]
        if self.density != DENSITY:
            numbers += [self.density]
        return f"{self.kind}:{','.join('ground' if math.isnan(each) else repr(each) for each in numbers)}"

    @classmethod
    def parse(cls, text: str) -> "Prop":
        """The prop of a name.

        Raises:
            ValueError: for anything else.
        """
        kind, _, given = text.partition(":")
        words = SIZES[checks.choice("prop", kind, KINDS)]
        values: list[Any] = [value_of(each) for each in given.split(",")]
        count = len(words)
        if not count + 2 <= len(values) <= count + 4:
            raise ValueError(f"prop: {text!r} is not allowed; give {kind}:{','.join(words)},X,Y[,Z|ground[,DENSITY]]")
        x, y, *more = values[count:]
        z = None if not more or more[0] == "ground" else more[0]
        return cls(kind, tuple(values[:count]), x, y, z, *more[1:])

    def cells(self, edge: float) -> Ints:
        """Places of its voxels of an edge [m], from 0 on, shape (N, 3).

        Raises:
            ValueError: if they are too many.
        """
        counts = [max(1, round(each / edge)) for each in self.size]
        if self.kind == "ball":
            counts *= 3
        if math.prod(counts) > MOST_VOXELS:
            raise ValueError(f"size: {self.size} is not allowed with voxels of {edge:g} m; it has over {MOST_VOXELS}")
        places: Ints = np.indices(counts).reshape(3, -1).T
        if self.kind == "ball":
            places = places[_in_ball(places)]
        return places


def _in_ball(places: Ints) -> Bools:
    """Which places of a cube are those of a ball as wide: whole shells, whose number is nearest to its volume."""
    squares = ((2 * places - places.max()) ** 2).sum(axis=1)
    shells, counts = np.unique(squares, return_counts=True)
    volume = np.pi / 6 * len(places)
    last = shells[np.abs(np.cumsum(counts) - volume).argmin()]
    within: Bools = squares <= last
    return within


LIGHT = "light"  # begins its place in the name of a world


def split_name(text: str) -> tuple[str, list[str]]:
    """The name of a world, without what is in it, and the names of the light and the props in it."""
    found: list[str] = []
    while True:
        rest, plus, last = text.rpartition("+")
        if not plus or last.partition(":")[0] not in (LIGHT, *KINDS):
            return text, found[::-1]
        text, found = rest, [*found, last]
