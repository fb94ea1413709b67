"""Kinds of uneven ground and of covers (sand, water) by name: their parameters, heights, friction and spelling.

``robots.ground`` parses the names. A new kind or cover is one entry of ``GROUNDS`` or ``COVERS``, and a row of
``docs/terrains.md``. Kinds with a START are level below the robot's start.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.course import TIE, Course, hashed
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import MOST_FRICTION, STEEPEST_GROUND
from taichi_sim.base.short_text import shortest

if TYPE_CHECKING:
    from taichi_sim.lattice import Water

START = 0.3  # m ahead of a robot's origin, where stairs, ramps and gaps begin; the ground before is level
WATER_DENSITY = 1000.0  # kg/m^3
# Beyond these, the numbers of cells could exceed the range of integers.
SHORTEST, FARTHEST = 1e-4, 1e4  # m


@dataclass(frozen=True)
class Number:
    """A numeric parameter in the name of a ground or a cover.

    Attributes:
        name: name in capitals, as in messages and help.
        default: value if it is left out; None if it is required.
        low: lowest value.
        open: whether ``low`` itself is refused.
        high: highest value.
        whole: whether it must be a whole number below 2^32.
        start: whether it is the distance ahead of a robot's origin at which the ground begins to differ [m].
        lifts: whether the ground is raised or lowered by it somewhere, unless it is 0.
        nodes: how many distances between nodes of the ground's grid it must have at least.
    """

    name: str
    default: float | None = None
    low: float = 0.0
    open: bool = True
    whole: bool = False
    start: bool = False
    high: float = math.inf
    lifts: bool = False
    nodes: int = 0

    def check(self, value: float, text: str) -> None:
        """Check a value of the parameter; ``text`` is the name of the ground, for messages.

        Raises:
            ValueError: if it is not allowed.
        """
        told = f"terrain: {self.name} {shortest(value)} of {text!r} is not allowed; give"
        if value < self.low or (self.open and value == self.low):
            raise ValueError(f"{told} {'more than' if self.open else 'at least'} {self.low:g}")
        if value > self.high:
            raise ValueError(f"{told} at most {self.high:g}")
        if self.whole and not (value.is_integer() and value < 2**32):
            raise ValueError(f"{told} a whole number")


@dataclass(frozen=True)
class Numbered:
    """A part of a terrain's name with numeric parameters: a kind of ground or a cover.

    Attributes:
        name: name, which is written before the parameters.
        description: readable description.
        numbers: parameters in order; optional ones come last.
    """

    name: str
    description: str
    numbers: tuple[Number, ...]

    @property
    def way(self) -> str:
        """Its syntax, such as ``stairs:RISE,RUN[,START]``."""
        marks = ":" + "," * len(self.numbers)
        parts = [f"{mark}{number.name}" for mark, number in zip(marks, self.numbers, strict=False)]
        each = zip(parts, self.numbers, strict=True)
        return self.name + "".join(part if number.default is None else f"[{part}]" for part, number in each)

    def read(self, given: str, text: str) -> tuple[float, ...]:
        """Read the values of all parameters; those left out have their defaults.

        Args:
            given: numbers separated by commas.
            text: the whole name, for messages.

        Raises:
            ValueError: if a number is not allowed, or there are too many or too few.
        """
        found = read_numbers(given, text, len(self.numbers))
        for number in self.numbers[len(found) :]:
            if number.default is None:
                raise ValueError(f"terrain: {text!r} lacks {number.name}; give {self.way}")
            found += (number.default,)
        for number, value in zip(self.numbers, found, strict=True):
            number.check(value, text)
        return found


@dataclass(frozen=True)
class GroundKind(Numbered):
    """A kind of firm ground.

    Attributes:
        height: function of x, y [m] and the parameters that gives the height [m].
        friction: function of the same that gives the factor of friction; None if the factor is 1 everywhere.
    """

    height: Callable[..., Floats]
    friction: Callable[..., Floats] | None = None

    @property
    def start(self) -> int | None:
        """Index of the parameter that says where it begins; None if there is none."""
        return next((n for n, number in enumerate(self.numbers) if number.start), None)

    def is_level(self, *values: float) -> bool:
        """Whether the ground of some values of the parameters is the same height everywhere.

        True if all parameters that lift the ground are 0, or if the kind has no heights at all.
        """
        lifting = [value for number, value in zip(self.numbers, values, strict=True) if number.lifts]
        return self.height is _level or (bool(lifting) and not any(lifting))


@dataclass(frozen=True)
class Cover(Numbered):
    """A cover that may be on any ground, or alone on level ground, such as sand or water.

    Attributes:
        spoken: words for it after the name of the ground.
        laws: arguments of a ``taichi_sim.lattice.Relief`` by name, each a function of the parameters.
    """

    spoken: str
    laws: Mapping[str, Callable[..., Any]]

    @property
    def wet(self) -> bool:
        """Whether it is water, in which a robot has drag and buoyancy."""
        return "water" in self.laws


def read_numbers(given: str, text: str, most: int) -> tuple[float, ...]:
    """Read numbers separated by commas in the name of a ground.

    Raises:
        ValueError: if one is not a finite number, or there are more than ``most``.
    """
    try:
        numbers = tuple(float(part) for part in given.split(",")) if given else ()
    except ValueError:
        numbers = (math.nan,)
    if len(numbers) > most or not all(map(math.isfinite, numbers)):
        raise ValueError(f"terrain: {given!r} of {text!r} is not allowed; give at most {most} numbers, as in 0.01,0.05")
    return numbers


def _drawn(i: Floats, j: Floats, seed: float) -> Floats:
    """Pseudorandom number from 0 to 1 for every cell (i, j), which depends only on cell and seed."""
    cells = i.astype(np.int64).astype(np.uint64) * np.uint64(73856093)
    return hashed(cells ^ j.astype(np.int64).astype(np.uint64) * np.uint64(19349663), seed)


def _rough(x: Floats, y: Floats, height: float, size: float, seed: float) -> Floats:
    """Value noise: smooth interpolation between random heights at the corners of squares."""
    i, j = np.floor(x / size), np.floor(y / size)
    u, v = x / size - i, y / size - j
    u, v = (t * t * (3 - 2 * t) for t in (u, v))
    a, b, c, d = (_drawn(i + di, j + dj, seed) for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)))
    return height * ((a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v)


def _blocks(x: Floats, y: Floats, height: float, size: float, seed: float) -> Floats:
    return height * _drawn(np.floor(x / size + TIE), np.floor(y / size + TIE), seed)


def _stairs(x: Floats, y: Floats, rise: float, run: float, start: float) -> Floats:
    return rise * np.maximum(np.floor((x - start) / run + TIE) + 1, 0.0)


def _ramp(x: Floats, y: Floats, degrees: float, start: float) -> Floats:
    return math.tan(math.radians(degrees)) * np.maximum(x - start, 0.0)


def _gap(x: Floats, y: Floats, width: float, depth: float, start: float) -> Floats:
    return np.where((x >= start - TIE) & (x < start + width - TIE), -depth, 0.0)


def _wave(x: Floats, y: Floats, height: float, length: float) -> Floats:
    return 0.5 * height * (1 - np.cos(2 * math.pi * x / length))


def _patches(x: Floats, y: Floats, low: float, high: float, size: float, seed: float) -> Floats:
    return low + (high - low) * _drawn(np.floor(x / size + TIE), np.floor(y / size + TIE), seed)


def _level(x: Floats, y: Floats, *_: float) -> Floats:
    return np.zeros(x.shape)


def _course_height(x: Floats, y: Floats, *numbers: float) -> Floats:
    return Course(*numbers).height(x)


def _course_friction(x: Floats, y: Floats, *numbers: float) -> Floats:
    return Course(*numbers).friction(x)


def _water(level: float, density: float) -> "Water":
    from taichi_sim.lattice import Water

    return Water(level, density)


def _yield_per_depth(limit: float) -> float:
    return limit


LEVEL = GroundKind("level", "level ground", (), _level)


def _height(name: str, default: float | None = None) -> Number:
    return Number(name, default, open=False, high=FARTHEST, lifts=True)


def _length(name: str, default: float | None = None) -> Number:
    return Number(name, default, SHORTEST, open=False, high=FARTHEST, nodes=2 if name == "LENGTH" else 1)


def _factor(name: str, default: float | None = None) -> Number:
    return Number(name, default, open=False, high=MOST_FRICTION)


def _degrees(default: float | None = None) -> Number:
    return Number("DEGREES", default, -STEEPEST_GROUND, open=False, high=STEEPEST_GROUND, lifts=True)


HEIGHT, SIZE = _height("HEIGHT"), _length("SIZE", 0.05)
SEED = Number("SEED", 0.0, open=False, whole=True)
BEGINS = Number("START", START, -FARTHEST, open=False, start=True, high=FARTHEST)
GROUNDS = {
    kind.name: kind
    for kind in (
        GroundKind("rough", "smooth random hills", (HEIGHT, SIZE, SEED), _rough),
        GroundKind("blocks", "square blocks of random heights", (HEIGHT, SIZE, SEED), _blocks),
        GroundKind("stairs", "stairs", (_height("RISE"), _length("RUN"), BEGINS), _stairs),
        GroundKind("ramp", "level, then a slope", (_degrees(), BEGINS), _ramp),
        GroundKind("gap", "a trench across the way", (_length("WIDTH"), _height("DEPTH", 0.02), BEGINS), _gap),
        GroundKind("wave", "waves across the way", (HEIGHT, _length("LENGTH")), _wave),
        GroundKind(
            "patches",
            "level squares whose friction counts by a random factor",
            (_factor("LOW"), _factor("HIGH"), SIZE, SEED),
            _level,
            _patches,
        ),
        GroundKind(
            "course",
            "level stretches, and slopes, ridges and slippery ones in random order between them",
            (
                Number("SEED", open=False, whole=True),
                _length("LENGTH", 0.2),
                _degrees(8.0),
                _height("RIDGE", 0.004),
                _factor("FACTOR", 0.05),
            ),
            _course_height,
            _course_friction,
        ),
    )
}
EARLIER_NAMES = {"steps": "blocks"}  # still accepted wherever a ground is named, and kept as written
COVERS = {
    cover.name: cover
    for cover in (
        Cover(
            "sand", "granular ground", (Number("YIELD", high=1e12),), "of sand", {"yield_per_depth": _yield_per_depth}
        ),
        Cover(
            "water",
            "water on the ground",
            (Number("LEVEL", low=-FARTHEST, open=False, high=FARTHEST), Number("DENSITY", WATER_DENSITY, high=1e6)),
            "with water",
            {"water": _water},
        ),
    )
}


def ground_kind(name: str) -> GroundKind | None:
    """Kind of ground by its name, or a name that earlier versions used; None for other names."""
    return GROUNDS.get(EARLIER_NAMES.get(name, name))


def check_single(text: str) -> None:
    """Refuse the name of a terrain that names two grounds, or a slope after the ground.

    Raises:
        ValueError: that says what can be combined.
    """
    level = ("flat", "hill")  # ground of one height, which other ground may lie on
    named = [part for part in text.split("+") if _head(part) in level or ground_kind(_head(part))]
    are_level = [_head(part) in level for part in named]
    if len(named) < 2 or are_level == [True, False]:
        return
    if are_level == [False, True] and _head(named[1]) == "hill":
        raise ValueError(f"terrain: {text!r} is not allowed; give the slope first, as {named[1]}+{named[0]}")
    raise ValueError(
        f"terrain: {text!r} is not allowed, as two grounds cannot be combined; give one of {', '.join(named)}, or "
        "ground on a slope, as hill:5+rough:0.01"
    )


def _head(part: str) -> str:
    """What a part of a name begins with."""
    return part.partition(":")[0]


def ways() -> str:
    """Syntax of all kinds of ground and covers, as text."""
    on_it = " or ".join(f"+{cover.way}" for cover in COVERS.values())
    grounds = [kind.way for kind in GROUNDS.values()]
    return ", ".join([*grounds, "FILE.npy:SPACING", f"FILE.png:HEIGHT,SPACING; on any of them {on_it}"])


def described() -> str:
    """Syntax and description of all kinds of ground and covers, as text."""
    grounds = [f"{kind.way} ({kind.description})" for kind in GROUNDS.values()]
    covers = [f"{cover.way} ({cover.description})" for cover in COVERS.values()]
    files = ["FILE.npy:SPACING", "FILE.png:HEIGHT,SPACING (heights of a file)"]
    return f"{', '.join([*grounds, *files])}; after a plus on any of them, or alone, {', '.join(covers)}"
