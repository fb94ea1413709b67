"""Kinds of uneven ground by name, and what may be on any: their numbers, heights and friction, how they are written.

``robots.ground`` reads the names. Kinds that begin somewhere leave the ground below a robot level.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robots.course import Course, hashed
from taichi_sim.base.arrays import Floats

START = 0.3  # m ahead of a robot's origin: where stairs, ramps and gaps begin; up to there the ground is level
WATER_DENSITY = 1000.0  # kg/m^3


@dataclass(frozen=True)
class Named:
    """A kind of ground that is made from a few numbers.

    Attributes:
        description: what it is, for help.
        numbers: names of its numbers, with the value of those that may be left out, else None.
        make: height [m] at places (x, y) [m], from these numbers.
        friction: factor of friction there, from these numbers; None is 1 everywhere.
    """

    description: str
    numbers: tuple[tuple[str, float | None], ...]
    make: Callable[..., Floats]
    friction: Callable[..., Floats] | None = None


def _drawn(i: Floats, j: Floats, seed: float) -> Floats:
    """A number from 0 to 1 for every cell (i, j), always the same."""
    cells = i.astype(np.int64).astype(np.uint64) * np.uint64(73856093)
    return hashed(cells ^ j.astype(np.int64).astype(np.uint64) * np.uint64(19349663), seed)


def _rough(x: Floats, y: Floats, height: float, size: float, seed: float) -> Floats:
    """Value noise: smooth between random heights of the corners of squares."""
    i, j = np.floor(x / size), np.floor(y / size)
    u, v = x / size - i, y / size - j
    u, v = (t * t * (3 - 2 * t) for t in (u, v))
    a, b, c, d = (_drawn(i + di, j + dj, seed) for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)))
    return height * ((a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v)


def _blocks(x: Floats, y: Floats, height: float, size: float, seed: float) -> Floats:
    return height * _drawn(np.floor(x / size), np.floor(y / size), seed)


def _stairs(x: Floats, y: Floats, rise: float, run: float, start: float) -> Floats:
    return rise * np.maximum(np.floor((x - start) / run) + 1, 0.0)


def _ramp(x: Floats, y: Floats, degrees: float, start: float) -> Floats:
    return math.tan(math.radians(degrees)) * np.maximum(x - start, 0.0)


def _gap(x: Floats, y: Floats, width: float, depth: float, start: float) -> Floats:
    return np.where((x >= start) & (x < start + width), -depth, 0.0)


def _wave(x: Floats, y: Floats, height: float, length: float) -> Floats:
    return 0.5 * height * (1 - np.cos(2 * math.pi * x / length))


def _patches(x: Floats, y: Floats, low: float, high: float, size: float, seed: float) -> Floats:
    return low + (high - low) * _drawn(np.floor(x / size), np.floor(y / size), seed)


def _level(x: Floats, y: Floats, *_: float) -> Floats:
    return np.zeros(x.shape)


def _course_height(x: Floats, y: Floats, *numbers: float) -> Floats:
    return Course(*numbers).height(x)


def _course_friction(x: Floats, y: Floats, *numbers: float) -> Floats:
    return Course(*numbers).friction(x)


LEVEL = Named("level ground", (), _level)
SEED, BEGINS = ("SEED", 0.0), ("START", START)
GROUNDS = {
    "rough": Named("smooth random hills", (("HEIGHT", None), ("SIZE", 0.05), SEED), _rough),
    "steps": Named("square blocks of random heights", (("HEIGHT", None), ("SIZE", 0.05), SEED), _blocks),
    "stairs": Named("stairs", (("RISE", None), ("RUN", None), BEGINS), _stairs),
    "ramp": Named("level, then a slope", (("DEGREES", None), BEGINS), _ramp),
    "gap": Named("a trench across the way", (("WIDTH", None), ("DEPTH", 0.02), BEGINS), _gap),
    "wave": Named("waves across the way", (("HEIGHT", None), ("LENGTH", None)), _wave),
    "patches": Named(
        "level squares whose friction counts by a random factor",
        (("LOW", None), ("HIGH", None), ("SIZE", 0.05), SEED),
        _level,
        _patches,
    ),
    "course": Named(
        "level stretches, and slopes, ridges and slippery ones in random order between them",
        (("SEED", None), ("LENGTH", 0.2), ("DEGREES", 8.0), ("RIDGE", 0.004), ("FACTOR", 0.05)),
        _course_height,
        _course_friction,
    ),
}
# What may be on any ground, level ground without a name, too.
SAND, WATER = "sand", "water"
COVERS = {
    SAND: Named("granular", (("YIELD", None),), _level),
    WATER: Named("water", (("LEVEL", None), ("DENSITY", WATER_DENSITY)), _level),
}
SIGNED = ("DEGREES", "START", "LEVEL")  # numbers that may be negative
POSITIVE = ("SIZE", "RUN", "LENGTH", "WIDTH", "YIELD", "DENSITY")


def way(kind: str) -> str:
    """How a kind of ground is written, such as ``stairs:RISE,RUN[,START]``."""
    first, *others = (GROUNDS | COVERS)[kind].numbers
    return f"{kind}:{first[0]}" + "".join(f",{name}" if value is None else f"[,{name}]" for name, value in others)


def ways() -> str:
    """How all kinds of ground are written."""
    on_it = " or ".join(f"+{way(kind)}" for kind in COVERS)
    return ", ".join([*map(way, GROUNDS), "FILE.npy:SPACING", f"FILE.png:HEIGHT,SPACING; on any of them {on_it}"])
