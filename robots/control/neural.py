"""Controllers of rigid robots: weights from each sensor to each motor neuron, tried in several environments."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number

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
