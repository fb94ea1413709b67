"""Uneven ground: heights and friction on a grid of nodes, between which it is made of flat triangles."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.checks import STEEPEST_GROUND, Finite, NotNegative, Positive, check_fields, number, positive
from taichi_sim.ground.cells import (
    CARRIED,
    CELL,
    CELLS_X,
    CELLS_Y,
    HEAD,
    LEVEL,
    ORIGIN_X,
    ORIGIN_Y,
    PER_CELL,
    SHARED,
    STEEPNESS,
    TOP,
    WEIGHT,
    WIDTH,
    YIELD,
)
from taichi_sim.ground.laws import FIRM, ground

MOST_NODES = 4_000_000
NOWHERE = -1e6  # m: level of water where there is none


@dataclass(frozen=True)
class Water:
    """Water at rest on the ground, everywhere up to one level: what lies lower is a pond, or a sea with its shore.

    Attributes:
        level: height of the water's surface over the level floor [m].
        density: density of the water [kg/m^3].
        gravity: gravity that acts on the water around lattice robots [m/s^2]; for rigid ones their world's counts.
        added_mass: added-mass coefficient: the mass of water that a body accelerates with it, over that which it
            displaces; 0.5 is that of a sphere (Lamb, Hydrodynamics, 1932, art. 92).

    Raises:
        ValueError: for a value that is not allowed.
    """

    level: Finite
    density: Positive = 1000.0
    gravity: NotNegative = 9.80665
    added_mass: NotNegative = 0.5

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False)
class Relief:
    """Ground whose height and friction differ from place to place; beyond its grid it goes on as at the edge.

    Attributes:
        heights: heights of the nodes over the level floor [m], shape (X, Y), at least 2 each way, read-only.
        spacing: distance between neighbouring nodes [m].
        origin: place (x, y) of node (0, 0) [m].
        friction: factors by which the friction coefficients of the robot count at the nodes, shape (X, Y), read-only;
            None is 1 everywhere.
        water: water on the ground; None is dry.
        yield_per_depth: of granular ground, the stress per depth at which it gives way [N/m^3] (see
            ``laws.giving_way``); None is firm ground.

    Raises:
        ValueError: for heights or factors that are not finite, of the wrong shape, or negative factors; ground steeper
            than 80 degrees; a stress per depth that is not positive.
    """

    heights: np.ndarray
    spacing: float
    origin: tuple[float, float] = (0.0, 0.0)
    friction: np.ndarray | None = None
    water: Water | None = None
    yield_per_depth: float | None = None

    def __post_init__(self) -> None:
        heights = _nodes("heights", self.heights)
        if min(heights.shape) < 2 or heights.size > MOST_NODES:
            raise ValueError(f"heights: shape {heights.shape} is not allowed; give 2 by 2 to {MOST_NODES} nodes")
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "spacing", number("spacing", self.spacing, 1e-9, 1e9, "m"))
        x, y = self.origin
        object.__setattr__(self, "origin", (number("origin", x, -1e9, 1e9, "m"), number("origin", y, -1e9, 1e9, "m")))
        if self.friction is not None:
            friction = _nodes("friction", self.friction)
            if friction.shape != heights.shape:
                raise ValueError(f"friction: shape {friction.shape} is not allowed; give {heights.shape} as heights")
            if friction.min() < 0:
                raise ValueError(f"friction: {friction.min():g} is not allowed; give factors of at least 0")
            object.__setattr__(self, "friction", friction)
        if self.yield_per_depth is not None:
            object.__setattr__(self, "yield_per_depth", positive("yield_per_depth", self.yield_per_depth, 1e12))
        if self.steepness > 1 / np.cos(np.radians(STEEPEST_GROUND)):
            degrees = float(np.degrees(np.arccos(1 / self.steepness)))
            raise ValueError(
                f"heights: a slope of {degrees:.1f} degrees is not allowed; give at most {STEEPEST_GROUND:g}"
            )

    @cached_property
    def is_floor(self) -> bool:
        """Whether the ground is the level floor: firm and dry, of the robots' own friction, without any height."""
        smooth = self.friction is None or bool((self.friction == 1).all())
        return smooth and self.water is None and self.yield_per_depth is None and not self.heights.any()

    @property
    def steepness(self) -> float:
        """Largest ratio of surface area to area seen from above: 1 / cos of the steepest slope."""
        x, y = (np.abs(np.diff(self.heights, axis=axis)).max() / self.spacing for axis in (0, 1))
        return float(np.sqrt(1 + x**2 + y**2))

    def height(self, x: Any, y: Any) -> np.ndarray:
        """Return the height over the floor at places (x, y) [m], as the simulation has it."""
        return self._below(np.asarray(x, float), np.asarray(y, float))[0]

    def factor(self, x: Any, y: Any) -> np.ndarray:
        """Return the factor of friction at places (x, y) [m], as the simulation has it."""
        factor: np.ndarray = self._below(np.asarray(x, float), np.asarray(y, float))[4]
        return factor

    def below(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the height over the floor [m] and third component of the unit normal at places (x, y) [m]."""
        height, normals = self.planes(x, y)
        return height, normals[..., 2]

    def planes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the height over the floor [m] and the unit normal, shape (..., 3), at places (x, y) [m]."""
        height, *normal, _ = self._below(x, y)
        return height, np.stack(normal, axis=-1)

    def _below(self, x: np.ndarray, y: np.ndarray) -> tuple[Any, Any, Any, Any, Any]:
        """Height, normal (3) and factor of friction at places."""
        found: tuple[Any, Any, Any, Any, Any] = ground(x, y, *self.cells_under(x, y), 1 / self.spacing)
        return found

    def cells_under(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """First corner (2) and table (10) of the cells under places (x, y) [m], shape (12, ...)."""
        found = []
        for place, start, nodes in zip(np.broadcast_arrays(x, y), self.origin, self.heights.shape, strict=True):
            found.append((np.clip(np.floor((place - start) / self.spacing), 0, nodes - 2).astype(int), start))
        (i, _), (j, _) = found
        corners = (start + cell * self.spacing for cell, start in found)
        return np.stack([*corners, *np.moveaxis(self.cells[i, j], -1, 0)])

    def rise(self, centres: Any, edge: float) -> float:
        """Return how far voxels at these centres, shape (..., 3), with this edge, must rise to stand on the ground [m].

        Not at all on the level floor, on which robots begin as they are, with their noise.
        """
        if self.is_floor:
            return 0.0
        x, y, z = np.moveaxis(np.asarray(centres, float), -1, 0)
        height, nz = self.below(x, y)
        return float((height + 0.5 * edge * (1 / nz - 1) - z).max())

    def rise_of_balls(self, centres: Any, radii: Any) -> float:
        """Return how far balls at these centres, shape (N, 3), must rise to stand on it [m]; negative above it."""
        x, y, z = np.asarray(centres, float).T
        height, nz = self.below(x, y)
        return float((height + np.asarray(radii, float) / nz - z).max())

    @property
    def head(self) -> np.ndarray:
        """What kernels read before the cells, see ``cells``."""
        found = np.zeros(HEAD)
        found[ORIGIN_X], found[ORIGIN_Y] = self.origin
        found[LEVEL], found[YIELD] = NOWHERE, FIRM if self.yield_per_depth is None else self.yield_per_depth
        found[CELLS_X], found[CELLS_Y] = self.cells.shape[:2]
        if self.water is not None:
            found[LEVEL], density = self.water.level, self.water.density
            found[WEIGHT], found[CARRIED] = density * self.water.gravity, density * self.water.added_mass
        return found

    @cached_property
    def cells(self) -> np.ndarray:
        """What kernels read of every cell, shape (X - 1, Y - 1, 10): see ``laws.ground``."""
        friction = np.ones(self.heights.shape) if self.friction is None else self.friction
        return np.stack([*_sides(self.heights), *_sides(friction)], axis=-1)


def planes_below(reliefs: Sequence[Relief], x: Any, y: Any) -> tuple[Any, tuple[Any, Any, Any]]:
    """Height [m] and components of the unit normal of each robot's ground below places, shape (B, ...) each.

    Args:
        reliefs: of the B robots, with the same spacing.
        x, y: places [m], shape (B, ...), that may be traced.
    """
    at, every = (value_of(x), value_of(y)), {id(one): one for one in reliefs}
    cells = np.empty((2 + CELL, *at[0].shape))
    for one in every.values():
        rows = np.array([each is one for each in reliefs])
        cells[:, rows] = one.cells_under(at[0][rows], at[1][rows])
    height, nx, ny, nz, _ = ground(x, y, *cells, 1 / reliefs[0].spacing)
    return height, (nx, ny, nz)


def _nodes(name: str, values: Any) -> np.ndarray:
    """A read-only table of finite numbers."""
    table = np.array(values, float)
    if table.ndim != 2 or not np.isfinite(table).all():
        raise ValueError(f"{name}: give a table of finite numbers, shape (X, Y)")
    table.setflags(write=False)
    return table


def _sides(nodes: np.ndarray) -> list[np.ndarray]:
    """For every cell the value at its first corner, and its growth along the lower, right, upper and left side."""
    a, b, c, d = nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]
    return [a, b - a, d - b, d - c, c - a]


@dataclass(frozen=True, eq=False)
class GroundTables:
    """The grids of a batch as kernels read them.

    Attributes:
        relief: numbers that all grids share, then each grid that is different, of its own size, flat.
        grid: where each robot's begins, shape (B,).
        water: whether there is any.
        granular: whether any ground yields.
    """

    relief: np.ndarray
    grid: np.ndarray
    water: bool = False
    granular: bool = False

    def numbers(self, dtype: type) -> np.ndarray:
        """The flat numbers in a precision, converted once: control in the loop begins hundreds of runs on a ground."""
        return self._single if dtype is np.float32 else self.relief.astype(dtype, copy=False)

    @cached_property
    def _single(self) -> np.ndarray:
        return self.relief.astype(np.float32)


def ground_tables(field: str, reliefs: Sequence[Relief]) -> GroundTables:
    """The tables of each robot's ground; robots with the same object share one.

    Raises:
        ValueError: if the grids differ in their spacing, or some have water and others none.
    """
    first, different = reliefs[0], {id(one): one for one in reliefs}
    if any(one.spacing != first.spacing for one in different.values()):
        raise ValueError(f"{field}: the spacing of nodes must be the same for all robots of a batch")
    if len(wet := {one.water is None for one in different.values()}) > 1:
        raise ValueError(f"{field}: water for some robots of a batch and none for others is not allowed; split it")
    shared = np.zeros(SHARED)
    shared[WIDTH], shared[PER_CELL] = first.spacing, 1 / first.spacing
    shared[TOP] = max(one.heights.max() for one in different.values())
    shared[STEEPNESS] = max(one.steepness for one in different.values())
    parts, slots, slot = [shared], {}, SHARED
    for key, one in different.items():
        slots[key] = slot
        parts += [one.head, one.cells.ravel()]
        slot += HEAD + one.cells.size
    return GroundTables(
        np.concatenate(parts),
        np.array([slots[id(one)] for one in reliefs], np.int32),
        water=False in wet,
        granular=any(one.yield_per_depth for one in different.values()),
    )
