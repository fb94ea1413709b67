"""What the motion of a soft robot is worth: speed, height, turning, work, mass.

Measures are functions of arrays that may be traced (``taichi_sim.autodiff.arrays``), so each is written once and has
derivatives by everything that it depends on.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robots.control.cyclic import FRAMES_FROM, LAST_CYCLE
from robots.lattice_robot.props import Placed
from robots.lattice_robot.squeeze import squeezed_forces
from robots.robot import Measure
from robots.world import Terrain
from taichi_sim.autodiff.arrays import revalued, value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody, LatticeResult

MEASURES = (
    Measure("speed", "BL/s", "speed along its heading"),
    Measure("distance", "m", "distance along its heading"),
    Measure("jump", "m", "rise of the centre of mass in the last cycle"),
    Measure("turning", "degrees/s", "turning to the left"),
    Measure("energy", "J", "work of the muscles in the last cycle"),
    Measure("mass", "kg", "mass"),
    Measure("payload", "kg", "mass of what nothing drives"),
)
TARGETED = Measure("remaining", "m", "distance that remains to the target")
OF_PROPS = (  # of the first of them, where there are any
    Measure("prop_distance", "m", "distance of the prop along the heading"),
    Measure("prop_height", "m", "height of the prop's middle at the end, above the ground where the robot began"),
)

UP = np.array([0.0, 0.0, 1.0])


def checked_target(given: Any) -> tuple[float, float]:
    """A point (x, y) [m].

    Raises:
        ValueError: for anything else.
    """
    try:
        x, y = (float(each) for each in given)
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"target: {given!r} is not allowed; give (x, y) in metres")
    return x, y


@dataclass(frozen=True, eq=False)
class Record:
    """What a run recorded for its measures: after the first cycle, after the last, then through the last cycle.

    Attributes:
        positions: voxel centres [m], shape (B, 67, V, 3).
        strains: of every link, shape (B, 67, L).
        sizes: rest size of every voxel along its own axes [m], shape (B, 67, V, 3).
    """

    positions: Any
    strains: Any
    sizes: Any

    @classmethod
    def of(cls, run: LatticeResult) -> "Record":
        """The part of a run that counts, in memory as in a batch of one, for sums of the same bits."""
        parts = (run.positions, run.strains, run.sizes)
        return cls(*(np.ascontiguousarray(each[:, :FRAMES_FROM]) for each in parts))

    def own(self, placed: Placed) -> "Record":
        """The record of the robot without props."""
        own = placed.own
        strains = self.strains[:, :, placed.own_links]
        strains = revalued(strains, np.ascontiguousarray(value_of(strains)))  # summed as in a batch of one
        return Record(self.positions[:, :, :own], strains, self.sizes[:, :, :own])

    @property
    def arrays(self) -> tuple[Any, Any, Any]:
        """Positions, strains, sizes."""
        return self.positions, self.strains, self.sizes


@dataclass(frozen=True, eq=False)
class Constants:
    """What measures know of the robots beside their motion.

    Attributes:
        density: of each voxel [kg/m^3], shape (B, V).
        modulus: Young's modulus of each voxel [Pa], shape (B, V).
        driven: how much of each voxel is driven, 0 to 1, shape (B, V).
        body: the first robot's, whose links and voxels are those of all.
        direction: of travel, shape (3,).
        length: in which speeds are told [m].
        duration: of the cycles that count [s].
        frequency: cycles per second [Hz].
        moments: times at which the last cycle was recorded, from where it begins [s], shape (65,).
        target: point (x, y) that the centre of mass should come near, from where it starts [m], or that of each robot,
            shape (B, 2); None for none.
        placed: the robot among props; None without.
        is_light: whether the target is a light, which lies from where the middle of the voxels starts.
        poissons_ratio: of each voxel, shape (B, V); 0 for none.
        pulled: along which axes of the world weight pulls all voxels, shape (B, 3).
        raised: by how much the ground raises each voxel where it starts [m], shape (B, V); 0 on level ground.
        laws: of measures of a user's own, by name.
    """

    density: Any
    modulus: Any
    driven: Any
    body: LatticeBody
    direction: Floats
    length: float
    duration: float
    frequency: float
    moments: Floats
    target: tuple[float, float] | Floats | None
    placed: Placed | None = None
    raised: Any = 0.0
    is_light: bool = False
    poissons_ratio: Any = 0.0
    pulled: Any = False
    laws: Mapping[str, "Law"] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measures that can be told."""
        found = measures_of(self.target is not None)
        return *(m.name for m in ((*found, *OF_PROPS) if self.placed else found)), *self.laws

    @property
    def own(self) -> "Constants":
        """The constants of the robot without props."""
        assert self.placed is not None
        own = self.placed.own
        named = "density", "modulus", "driven", "raised", "poissons_ratio"
        parts = {name: getattr(self, name) for name in named}
        cut = {name: each[:, :own] for name, each in parts.items() if np.ndim(each)}
        return replace(self, **cut, body=self.placed.robot, placed=None)

    @property
    def materials(self) -> tuple[Any, Any, Any, Any]:
        """Density, modulus, Poisson's ratio, and how much is driven."""
        return self.density, self.modulus, self.poissons_ratio, self.driven

    def shares(self) -> list[Any]:
        """Each voxel's part of the mass, shape (V,), robot by robot."""
        return [row / row.sum() for row in self.density]

    def centres(self, positions: Any) -> Any:
        """Coordinates of centres of mass, shape (B, ...), of those of voxels, shape (B, ..., V)."""
        return np.stack([row @ share for row, share in zip(positions, self.shares(), strict=True)])


Law = Callable[[Record, Constants], Any]  # gives a measure, shape (B,)


def measures_of(targeted: bool, muscled: bool = True) -> tuple[Measure, ...]:
    """The measures of a robot, with or without a target; the work of muscles only where it has any."""
    found = MEASURES if muscled else tuple(each for each in MEASURES if each.name != "energy")
    return (*found, TARGETED) if targeted else found


def measures_among(worlds: Sequence[Terrain], targeted: bool, muscled: bool = True) -> tuple[Measure, ...]:
    """The measures of a robot that can be told in all of some worlds.

    Args:
        worlds: where it is tried.
        targeted: whether it has something to come near in each of them.
        muscled: whether it has muscles.
    """
    found = measures_of(targeted, muscled)
    return (*found, *OF_PROPS) if all(world.props for world in worlds) else found


def measure(name: str, record: Record, constants: Constants) -> Any:
    """A measure by its name, shape (B,); unless it is of props, of the robot alone."""
    if constants.placed is not None and name not in (each.name for each in OF_PROPS):
        record, constants = record.own(constants.placed), constants.own
    return (constants.laws[name] if name in constants.laws else _LAWS[name])(record, constants)


def _distance(record: Record, constants: Constants) -> Any:
    way = constants.centres(record.positions[:, :2] @ constants.direction)
    return way[:, 1] - way[:, 0]


def _speed(record: Record, constants: Constants) -> Any:
    return _distance(record, constants) / constants.length / constants.duration


def _jump(record: Record, constants: Constants) -> Any:
    """Highest centre of mass at a moment of the last cycle, above where it started."""
    heights = constants.centres(record.positions[:, LAST_CYCLE, :, 2])
    start = np.broadcast_to(constants.body.start_positions[:, 2], constants.density.shape) + constants.raised
    highest = value_of(heights).argmax(axis=1)
    return heights[np.arange(len(highest)), highest] - constants.centres(start)


def _turning(record: Record, constants: Constants) -> Any:
    """Angle by which the last cycle turns the voxels about their centre of mass, in the plane, at best."""
    begin, end = (record.positions[:, moment] for moment in (LAST_CYCLE.start, LAST_CYCLE.stop - 1))
    (x0, y0), (x1, y1) = ([_about(each[..., axis], constants) for axis in (0, 1)] for each in (begin, end))
    along, across = x0 * x1 + y0 * y1, x0 * y1 - y0 * x1
    angle = np.arctan2(constants.centres(across), constants.centres(along))
    return angle * (constants.frequency * 180 / np.pi)


def _about(coordinates: Any, constants: Constants) -> Any:
    """Coordinates of voxels, shape (B, V), from the centre of mass."""
    return coordinates - np.reshape(constants.centres(coordinates), (-1, 1))


def _energy(record: Record, constants: Constants) -> Any:
    """Positive work that changes of rest lengths do against the elastic forces of the links.

    A link of rest length l pulls with E_l h^2 times its strain, and with what Poisson's effect adds to that; between
    two moments of the cycle the work is that of the mean of both forces. Nothing that a muscle gets back counts.
    """
    body = constants.body
    links, axes = body.topology.links, body.topology.link_axes
    strains = record.strains[:, LAST_CYCLE]
    if np.any(value_of(constants.poissons_ratio)):
        forces = squeezed_forces(body, strains, constants.modulus, constants.poissons_ratio, constants.pulled)
    else:
        minus, plus = (constants.modulus[:, end] for end in links.T)
        stiffness = 2 * minus * plus / (minus + plus) * body.voxel_size**2
        forces = strains * stiffness[:, None]
    sizes = record.sizes[:, LAST_CYCLE]
    lengths = 0.5 * (sizes[:, :, links[:, 0], axes] + sizes[:, :, links[:, 1], axes])
    work = -0.5 * (forces[:, 1:] + forces[:, :-1]) * (lengths[:, 1:] - lengths[:, :-1])
    return np.maximum(work, 0.0).sum(axis=(1, 2))


def _mass(record: Record, constants: Constants) -> Any:
    return constants.density.sum(axis=1) * constants.body.voxel_size**3


def _payload(record: Record, constants: Constants) -> Any:
    return (constants.density * (1.0 - constants.driven)).sum(axis=1) * constants.body.voxel_size**3


def _remaining(record: Record, constants: Constants) -> Any:
    goals, away = np.broadcast_to(np.asarray(constants.target, float), (len(constants.density), 2)), []
    origin = replace(constants, density=_evenly(value_of(constants.density))) if constants.is_light else constants
    for axis, goal in enumerate(goals.T):
        end = constants.centres(record.positions[:, 1, :, axis])
        start = np.broadcast_to(constants.body.start_positions[:, axis], constants.density.shape)
        away.append(end - origin.centres(start) - goal)
    return np.sqrt(away[0] * away[0] + away[1] * away[1])


def _evenly(density: Floats) -> Floats:
    """Densities whose centre of mass is the middle of the voxels; those given where they are even, for their bits."""
    return np.where(density.min(axis=1, keepdims=True) == density.max(axis=1, keepdims=True), density, 1.0)


def _prop_middles(record: Record, constants: Constants, along: Floats) -> Any:
    """How far the first prop's middle is along a direction after the first cycle and after the last, shape (B, 2)."""
    assert constants.placed is not None
    rows = np.flatnonzero(constants.placed.of(1))
    shares = np.full(len(rows), 1 / len(rows))
    return np.stack(
        [(each[:, rows] @ along) @ shares for each in record.positions[:, :2]]
    )  # summed as in a batch of one


def _prop_distance(record: Record, constants: Constants) -> Any:
    way = _prop_middles(record, constants, constants.direction)
    return way[:, 1] - way[:, 0]


def _prop_height(record: Record, constants: Constants) -> Any:
    ground = constants.raised[:, 0] if np.ndim(constants.raised) else 0.0
    return _prop_middles(record, constants, UP)[:, 1] - ground + 0.5 * constants.body.voxel_size


_LAWS: dict[str, Law] = {
    "speed": _speed,
    "distance": _distance,
    "jump": _jump,
    "turning": _turning,
    "energy": _energy,
    "mass": _mass,
    "payload": _payload,
    "remaining": _remaining,
    "prop_distance": _prop_distance,
    "prop_height": _prop_height,
}
