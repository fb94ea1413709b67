"""What articulated robots can feel, whenever a command is due."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.control.senses import Sense, SenseReader, way_gained
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.feedback import Felt


@dataclass(frozen=True)
class Anatomy:
    """What the senses of a robot may read: its touch sensors, hinges, light sensor and drives.

    Attributes:
        touch: bodies with touch sensors.
        hinges: number of hinges.
        light: whether it has a light sensor, whose reading follows those of touch.
        drives: number of drives, which answers are for.
        length: in which speeds are told [m].
    """

    touch: int
    hinges: int
    light: bool
    drives: int
    length: float


@dataclass(frozen=True, eq=False)
class Reading:
    """What senses of B robots read; its arrays may be traced.

    Attributes:
        anatomy: of the robot.
        spans: time since the reading before, and between that and the one before it [s].
        number: of the reading, from 0.
        time: since the first reading [s].
        points: of rhythms, whose first number is the frequency [Hz], (B, 1 + 3 M).
        position: of the base's centre, (B, 3) [m].
        orientation: of the base, (B, 4).
        angles: of the hinges, (B, H) [rad].
        readings: of the sensors, (B, S).
        before: position at the reading before; at the first one at the start.
        earlier: position at the reading before that.
    """

    anatomy: Anatomy
    spans: tuple[float, float]
    number: int
    time: float
    points: Any
    position: Any
    orientation: Any
    angles: Any
    readings: Any
    before: Any
    earlier: Any


def _touch(reading: Reading) -> Any:
    return reading.readings[:, : reading.anatomy.touch]


def _angles(reading: Reading) -> Any:
    return reading.angles


def _tilt(reading: Reading) -> Any:
    w, x, y, z = (reading.orientation[:, part] for part in range(4))
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x)], axis=1)


def _velocity(reading: Reading) -> Any:
    return (reading.position - reading.before)[:, :2] / (reading.anatomy.length * reading.spans[0])


def _acceleration(reading: Reading) -> Any:
    """Difference of the mean velocities of both ways, over the time from the middle of one to that of the other."""
    last, until = reading.spans
    gained = way_gained(reading.number, reading.position, reading.before, reading.earlier, until / last)
    return gained / (reading.anatomy.length * until * (0.5 * (last + until)))


def _light(reading: Reading) -> Any:
    touch = reading.anatomy.touch
    return reading.readings[:, touch : touch + 1]


def _clock(reading: Reading) -> Any:
    angle = 2 * np.pi * reading.points[:, 0] * reading.time
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def _two(anatomy: Anatomy) -> int:
    return 2


SENSES = {
    "touch": Sense(
        "whether each body with a touch sensor is on the ground, 1 or 0", lambda anatomy: anatomy.touch, _touch
    ),
    "angles": Sense("of all hinges, from where they rest [rad]", lambda anatomy: anatomy.hinges, _angles),
    "tilt": Sense("how far the base leans along x and along y", _two, _tilt),
    "velocity": Sense("of the base along x and y, since the last reading [lengths a second]", _two, _velocity),
    "light": Sense(
        "1 / d^2 of the distance to the light [1/m^2]; not the law of lattice robots",
        lambda anatomy: int(anatomy.light),
        _light,
    ),
    "clock": Sense("sine and cosine of the time in the rhythm's cycle", _two, _clock),
    "acceleration": Sense(
        "of the base along x, y and z, over the last two readings, 0 at the first two [lengths a second^2]",
        lambda anatomy: 3,
        _acceleration,
    ),
}


class DriveReader(SenseReader):
    """Reads what articulated robots feel; see ``SenseReader``.

    Attributes are those of ``SenseReader``, and:
        sooner: by how much the present reading is sooner than its time, as where a trial ends before that [s].
    """

    table, place = SENSES, "position"

    def __init__(self, names: Sequence[str], anatomy: Anatomy, span: float, points: Floats, first: Floats) -> None:
        """Set up.

        Args:
            names: of senses.
            anatomy: of the robot.
            span: time between readings [s].
            points: of the rhythms, (B, 1 + 3 M).
            first: where the bases' centres are at the start, (B, 3) [m].
        """
        self.anatomy, self.span, self.points, self.sooner = anatomy, span, points, 0.0
        super().__init__(names, first)

    def reading(self, number: int, arrays: dict[str, Any]) -> Reading:
        """What senses read at a reading."""
        spans, time = (self.span - self.sooner, self.span), number * self.span - self.sooner
        return Reading(self.anatomy, spans, number, time, **arrays)

    def read(self, number: int, felt: Felt) -> Floats:
        """What is felt at reading 0, 1, ..., (B, width)."""
        return self.read_arrays(number, {"points": self.points, **vars(felt)})

    def pull_back(self, number: int, by_felt: Floats | None) -> tuple[Felt, Floats]:
        """Derivatives by what was read, and by the points of rhythms; see ``SenseReader.pull_back_arrays``."""
        found = self.pull_back_arrays(number, by_felt)
        by_points = found.pop("points")
        return Felt(**found), by_points


def checked_place(field_name: str, value: object) -> tuple[float, float, float]:
    """The place of a light, x, y and z [m].

    Raises:
        ValueError: for anything else; names the field.
    """
    if not isinstance(value, list | tuple | np.ndarray) or len(value) != 3:
        raise ValueError(f"{field_name}: {value!r} is not allowed; give a place x, y, z [m]")
    x, y, z = (checks.number(field_name, each, unit="m") for each in value)
    return x, y, z
