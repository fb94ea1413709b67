"""What lattice robots can feel, sixteen times in every cycle."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robots.control.cyclic import SEGMENTS
from robots.control.senses import Sense, SenseReader, way_gained
from robots.lattice_robot.props import Placed
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.ground.relief import planes_below
from taichi_sim.lattice import Felt, LatticeBody, Relief
from taichi_sim.lattice.laws.enclosure import chamber_surfaces, chambers_under_pressure, enclosed_volume

STILL = 1e-6  # m: a slip far below this has no direction
STRAIN, TOUCH, SPEED = 0.05, 0.1, 1.0  # for a feeling of 1: strain; edges above the ground, for 1/e; lengths per cycle
RISE = 0.05  # for a feeling of 1: part by which the pressure of a chamber rises from one reading to the next
LEAST_VOLUME = 0.1  # of a chamber, part of its volume as built: what a hose and a gauge hold is not squeezed
PER_READING = 1 / SEGMENTS  # cycles


@dataclass(frozen=True)
class Parts:
    """How many parts a body has that are felt apart, with a number each.

    Attributes:
        regions: that are driven.
        chambers: that have pressurised voxels.
    """

    regions: int
    chambers: int = 0

    @classmethod
    def of(cls, body: LatticeBody, regions: Sequence[int]) -> "Parts":
        """The parts of a body that is driven in some regions."""
        return cls(len(regions), len(chambers_under_pressure(body)))


def check_felt(names: Iterable[str], body: LatticeBody, regions: Sequence[int]) -> None:
    """Refuse a body without driven regions, in which nothing can answer, and one that lacks what senses feel.

    Raises:
        ValueError: that says what to give.
    """
    if not regions:
        raise ValueError("reflexes: no drive changes a scale; give a Drive of a region's scale")
    if "pressure" in names:
        closed_chambers(body)


def closed_chambers(body: LatticeBody) -> list[tuple[Ints, float]]:
    """The closed surface of each chamber of a body, in ascending order, with its volume as built [m^3].

    Raises:
        ValueError: for a body without chambers, or with one that is open or empty.
    """
    refused = "senses: pressure is not allowed for a body"
    try:
        surfaces = chamber_surfaces(body)
    except ValueError as error:
        raise ValueError(
            f"{refused} whose chamber is open: {error}; give a skin that is closed but for cut links"
        ) from None
    if not surfaces:
        raise ValueError(f"{refused} without a chamber; give pressure_normals, out of a skin that is closed")
    volumes = [float(enclosed_volume(squares, body.start_positions)) for squares in surfaces]
    for label, volume in zip(chambers_under_pressure(body).tolist(), volumes, strict=True):
        if abs(volume) < 1e-6 * body.voxel_size**3:
            raise ValueError(f"{refused} whose chamber {label} encloses no volume; give one that does")
    return list(zip(surfaces, volumes, strict=True))


@dataclass(frozen=True, eq=False)
class Anatomy:
    """What senses know of the body.

    Attributes:
        body: the robot's own.
        members: which voxels are in each driven region, as shares that add up to 1, shape (R, V).
        links: which links are within each, likewise, shape (R, L).
        edge: of a voxel [m].
        length: in which speeds are told [m].
        floor: whether there is level ground, or the uneven ground below each of B robots.
        origin: mean of the voxel centres before noise, shape (3,).
        lights: where each robot's light is, from where its centre starts [m], shape (B, 2), or (1, 2) for all; None
            without.
        placed: the robot among props, which it does not feel but by touching them; None without.
    """

    body: LatticeBody
    members: Floats
    links: Floats
    edge: float
    length: float
    floor: bool | Sequence[Relief]
    origin: Floats
    lights: Floats | None = None
    placed: Placed | None = None

    @classmethod
    def of(
        cls,
        body: LatticeBody,
        regions: Sequence[int],
        length: float,
        floor: bool | Sequence[Relief],
        lights: Floats | None = None,
        placed: Placed | None = None,
    ) -> "Anatomy":
        """The anatomy of a body that is driven in some regions."""
        every, ends = np.asarray(body.regions), body.topology.links
        members = np.array([every == region for region in regions], float)
        within = np.array([(every[ends] == region).all(axis=1) for region in regions], float).reshape(-1, len(ends))
        return cls(
            body,
            members / members.sum(axis=1, keepdims=True),
            within / np.maximum(within.sum(axis=1, keepdims=True), 1.0),
            body.voxel_size,
            length,
            floor,
            body.start_positions.mean(axis=0),
            lights,
            placed,
        )

    @cached_property
    def chambers(self) -> list[tuple[Ints, float]]:
        """The closed surface of each chamber, ascending, with its volume as built; of bodies that feel pressure."""
        return closed_chambers(self.body)

    def volumes(self, positions: Any) -> Any:
        """Volume of every chamber over that as built, at least ``LEAST_VOLUME``, shape (B, C)."""
        parts = [enclosed_volume(squares, positions)[:, None] / built for squares, built in self.chambers]
        found = np.concatenate(parts, axis=1)
        return np.where(value_of(found) > LEAST_VOLUME, found, LEAST_VOLUME)

    def clearance(self, positions: Any) -> Any:
        """Height of voxel centres above where they would touch the ground, if any [edges], shape (B, V)."""
        x, y, z = positions[:, :, 0], positions[:, :, 1], positions[:, :, 2]
        if isinstance(self.floor, bool):
            return z / self.edge
        height, (_, _, nz) = planes_below(self.floor, x, y)
        return (z - height) * nz / self.edge - 0.5 * (1.0 - nz)

    def along(self, ways: Any, positions: Any) -> list[Any]:
        """Components along the ground below voxel centres of ways of theirs [m], shape (B, V) each."""
        x, y, z = (ways[:, :, axis] for axis in range(3))
        if isinstance(self.floor, bool):
            return [x, y]
        _, (nx, ny, nz) = planes_below(self.floor, positions[:, :, 0], positions[:, :, 1])
        off = x * nx + y * ny + z * nz
        return [x - nx * off, y - ny * off, z - nz * off]

    def nearness(self, positions: Any) -> Any:
        """1 where a voxel is on the ground, 1/e at ``TOUCH`` edges above it, 0 without ground, shape (B, V)."""
        if self.floor is False:
            return 0.0 * positions[:, :, 2]
        above = self.clearance(positions)
        return np.exp(-np.where(value_of(above) > 0, above, 0.0 * above) / TOUCH)


@dataclass(frozen=True, eq=False)
class Reading:
    """What senses of B robots read; its arrays may be traced.

    Attributes:
        anatomy: of the body.
        number: of the reading, from 0.
        positions: voxel centres [m], shape (B, V, 3).
        orientations: quaternions, shape (B, V, 4).
        strains: of every link, shape (B, L).
        before: voxel centres at the reading before; at the first one where robots were put.
        earlier: voxel centres at the reading before that.
    """

    anatomy: Anatomy
    number: int
    positions: Any
    orientations: Any
    strains: Any
    before: Any
    earlier: Any

    @property
    def touching(self) -> Any:
        """How near the ground each voxel is, times its share in every driven region, shape (B, R, V)."""
        return self.anatomy.nearness(self.positions)[:, None, :] * self.anatomy.members


def _strain(reading: Reading) -> Any:
    return (reading.strains[:, None, :] * reading.anatomy.links).sum(axis=2) / STRAIN


def _touch(reading: Reading) -> Any:
    return reading.touching.sum(axis=2)


def _tilt(reading: Reading) -> Any:
    w, x, y, z = (reading.orientations[:, :, part].mean(axis=1) for part in range(4))
    return np.concatenate([(2 * (x * z + w * y))[:, None], (2 * (y * z - w * x))[:, None]], axis=1)


def _slip(reading: Reading) -> Any:
    touching, moved = reading.touching, reading.positions - reading.before
    gone = [(way[:, None, :] * touching).sum(axis=2) for way in reading.anatomy.along(moved, reading.positions)]
    away = np.sqrt(sum(way * way for way in gone) + STILL * STILL) - STILL
    return away / (reading.anatomy.length * PER_READING * SPEED)


def _velocity(reading: Reading) -> Any:
    moved = (reading.positions - reading.before).mean(axis=1)[:, :2]
    return moved / (reading.anatomy.length * PER_READING * SPEED)


def _acceleration(reading: Reading) -> Any:
    gained = way_gained(reading.number, reading.positions, reading.before, reading.earlier).mean(axis=1)
    return gained / (reading.anatomy.length * PER_READING * PER_READING)


def _light(reading: Reading) -> Any:
    """Brightness at the middle of every driven region: 1 at the light, 1/2 a length away from it."""
    anatomy, total = reading.anatomy, 0.0
    assert anatomy.lights is not None
    for axis in (0, 1):
        middle = (reading.positions[:, None, :, axis] * anatomy.members).sum(axis=2)
        total = total + ((middle - (anatomy.origin[axis] + anatomy.lights[:, axis, None])) / anatomy.length) ** 2
    return 1.0 / (1.0 + total)


def _clock(reading: Reading) -> Any:
    angle = 2 * np.pi * (((reading.number + 1) % SEGMENTS) / SEGMENTS)
    return np.broadcast_to([np.sin(angle), np.cos(angle)], (len(reading.positions), 2))


def _pressure(reading: Reading) -> Any:
    """By Boyle's law, as no gas comes or goes from one reading to the next; before the first one it may."""
    anatomy = reading.anatomy
    if reading.number == 0:
        return np.zeros((len(reading.positions), len(anatomy.chambers)))
    return (anatomy.volumes(reading.before) / anatomy.volumes(reading.positions) - 1.0) / RISE


def _one_each(parts: Parts) -> int:
    return parts.regions


def _two(parts: Parts) -> int:
    return 2


SENSES = {
    "strain": Sense("mean strain of the links within every driven region, over 0.05", _one_each, _strain),
    "touch": Sense("how much of every driven region is on the ground, 0 to 1", _one_each, _touch),
    "tilt": Sense("how far the body leans along x and along y", _two, _tilt),
    "slip": Sense("how fast every driven region slides on the ground it touches [lengths a cycle]", _one_each, _slip),
    "velocity": Sense("of the body's middle along x and y, since the last reading [lengths a cycle]", _two, _velocity),
    "light": Sense(
        "1 / (1 + d^2) at every driven region, d the distance to a light in body lengths; not the law of rigid robots",
        _one_each,
        _light,
    ),
    "clock": Sense("sine and cosine of the time in the cycle", _two, _clock),
    "acceleration": Sense(
        "of the body's middle along x, y and z, over the last two readings, 0 at the first two [lengths a cycle^2]",
        lambda parts: 3,
        _acceleration,
    ),
    "pressure": Sense(
        "by what part the absolute pressure in every chamber rises as it is squeezed, since the last reading, 0 at the "
        "first, over 0.05",
        lambda parts: parts.chambers,
        _pressure,
    ),
}


class LatticeReader(SenseReader):
    """Reads what lattice robots feel, of the robots alone where they are among props; see ``SenseReader``."""

    table, place = SENSES, "positions"

    def __init__(self, names: Sequence[str], anatomy: Anatomy, first: Floats, keeps: bool = True) -> None:
        """Set up; ``first`` is where the robots' voxel centres were put, shape (B, V, 3) [m]."""
        self.anatomy = anatomy
        super().__init__(names, first, keeps)

    def reading(self, number: int, arrays: dict[str, Any]) -> Reading:
        """What senses read at a reading."""
        return Reading(self.anatomy, number, **arrays)

    def read(self, number: int, felt: Felt) -> Floats:
        """What is felt at reading 0, 1, ..., shape (B, width)."""
        placed = self.anatomy.placed
        return self.read_arrays(number, vars(felt if placed is None else placed.own_part(felt)))

    def pull_back(self, number: int, by_felt: Floats | None) -> Felt:
        """Derivatives by the voxels and links of all bodies, see ``SenseReader.pull_back_arrays``."""
        found, placed = Felt(**self.pull_back_arrays(number, by_felt)), self.anatomy.placed
        return found if placed is None else placed.widened(found)
