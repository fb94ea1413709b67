"""Controllers of rigid robots: weights from each sensor to each motor neuron, tried in several environments."""

import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

import numpy as np

from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.base.files import read_text, why_unread

Lights = Sequence[Sequence[float]]
Body = TypeVar("Body")


def check_weights(weights: object, sensors: int, motors: int) -> Floats:
    """Weights as an array (N, sensors, motors); a single controller's become the first of one.

    Raises:
        ValueError: for other shapes, or numbers that are not finite.
    """
    try:
        found = np.asarray(weights, float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.ndim == 2:
        found = found[None]
    if found.ndim != 3 or found.shape[1:] != (sensors, motors) or len(found) == 0:
        raise ValueError(
            f"weights: shape {found.shape} is not allowed; give (N, {sensors}, {motors}): "
            "one row a sensor, one column a motor"
        )
    if not np.isfinite(found).all():
        raise ValueError("weights: numbers that are not finite are not allowed")
    return found


def random_weights(count: int, sensors: int, motors: int, generator: np.random.Generator) -> Floats:
    """Weights drawn evenly between -1 and 1, (count, sensors, motors)."""
    return generator.uniform(-1, 1, (count, sensors, motors))


def check_lights(lights: Lights) -> Floats:
    """Places of the light in E environments as an array (E, 2) [m].

    Raises:
        ValueError: for another shape, or numbers that are not finite.
    """
    found = np.array([[number("lights", x) for x in place] for place in lights], float)
    if found.ndim != 2 or found.shape[1] != 2 or len(found) == 0:
        raise ValueError(f"lights: shape {found.shape} is not allowed; give (E, 2)")
    return found


@dataclass(frozen=True, eq=False)
class Trials(Generic[Body]):
    """N controllers, each in E environments, which change fastest.

    Attributes:
        bodies: one for all trials, or one for each.
        weights: of each trial, (N E, S, M).
        lights: of each trial, (N E, 3) [m].
        shape: (N, E).
    """

    bodies: list[Body]
    weights: Floats
    lights: Floats
    shape: tuple[int, int]

    @classmethod
    def of(cls, field: str, bodies: Sequence[Body], weights: Floats, lights: Lights, height: float) -> Self:
        """The trials of controllers in one body, or in one each.

        Args:
            field: what messages call the bodies.
            bodies: one, or N.
            weights: (N, S, M).
            lights: places of the light, (E, 2) [m].
            height: of the lights [m].

        Raises:
            ValueError: for lights that are no places, or another number of bodies.
        """
        places, count = check_lights(lights), len(weights)
        if len(bodies) not in (1, count):
            allowed = "give one, or one for each of"
            raise ValueError(f"{field}: {len(bodies)} are not allowed; {allowed} {count} controllers")
        each = len(places)
        sources = np.column_stack([np.tile(places, (count, 1)), np.full(count * each, height)])
        several = list(bodies) if len(bodies) == 1 else [body for body in bodies for _ in range(each)]
        return cls(several, np.repeat(weights, each, 0), sources, (count, each))

    def by_environment(self, values: Any) -> Any:
        """Values of the trials, (N E, ...), by controllers and environments, (N, E, ...)."""
        return np.reshape(values, (*self.shape, *np.shape(values)[1:]))


def pair_of(text: str) -> tuple[float, float]:
    """Two weights, as ``1,-0.5``.

    Raises:
        ValueError: for anything else.
    """
    try:
        first, second = (checks.number("controller", float(part)) for part in text.split(","))
    except ValueError:
        raise ValueError(f"controller: {text!r} is not allowed; give two numbers, such as 1,-0.5") from None
    return first, second


def load_weights(path: Path, sensors: int, motors: int) -> Floats:
    """Weights of a ``.npy`` or JSON file, (sensors, motors).

    Raises:
        ValueError: if the file cannot be read, or holds no such table of finite numbers.
    """
    try:
        found = np.load(path, allow_pickle=False) if path.suffix == ".npy" else np.array(json.loads(read_text(path)))
        weights = np.asarray(found, float)
    except OSError as error:
        raise ValueError(f"controller: {path} cannot be read ({why_unread(error)})") from None
    except (ValueError, TypeError, OverflowError, EOFError, RecursionError, zipfile.BadZipFile):
        raise ValueError(f"controller: {path} holds no table of numbers") from None
    if not np.isfinite(weights).all():
        raise ValueError(f"controller: {path} holds numbers that are not finite")
    if weights.shape != (sensors, motors):
        raise ValueError(f"controller: {path} has shape {weights.shape}, which is not allowed; give {sensors, motors}")
    return weights
