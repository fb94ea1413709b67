"""Controllers of rigid robots: weights from each sensor to each motor neuron, tried in several environments."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np

from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.files import UNREADABLE, array_of, content_of, read_text, why_unread
from taichi_sim.base.parsing import parse_json

if TYPE_CHECKING:
    from taichi_sim.rigid import RigidEngine, RigidResult
    from taichi_sim.rigid.gradient import RigidTape

TIME_STEP, GRAVITY, SLIP = 0.05, -1.0, 0.01  # s, m/s^2, m/(N s), of the published experiments

Lights = Sequence[Sequence[float]]
Body = TypeVar("Body")


def check_weights(weights: object, sensors: int, motors: int) -> Floats:
    """Weights as an array (N, sensors, motors); a single controller's become the first of one.

    Raises:
        ValueError: for other shapes, what is no number, and numbers that are not finite.
    """
    try:
        found = checks.real_array(weights)
    except (TypeError, ValueError, OverflowError):
        allowed = f"give numbers of shape (N, {sensors}, {motors})"
        raise ValueError(f"weights: {checks.shown(weights)} is not allowed; {allowed}") from None
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


def as_list(bodies: Body | Sequence[Body]) -> list[Body]:
    """One body, or several, as a list."""
    return list(bodies) if isinstance(bodies, Sequence) else [bodies]


@dataclass(frozen=True, eq=False)
class ControllerTrials(Generic[Body]):
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
    def of(cls, field: str, bodies: Body | Sequence[Body], weights: Floats, lights: Lights, height: float) -> Self:
        """The trials of controllers in one body, or in one each.

        Args:
            field: what messages call the bodies.
            bodies: one, or a list of one or N.
            weights: (N, S, M).
            lights: places of the light, (E, 2) [m].
            height: of the lights [m].

        Raises:
            ValueError: for lights that are no places, or another number of bodies.
        """
        places, count = check_lights(lights), len(weights)
        several = as_list(bodies)
        if len(several) not in (1, count):
            allowed = "give one, or one for each of"
            raise ValueError(f"{field}: {len(several)} are not allowed; {allowed} {count} controllers")
        each = len(places)
        sources = np.column_stack([np.tile(places, (count, 1)), np.full(count * each, height)])
        if len(several) > 1:
            several = [body for body in several for _ in range(each)]
        return cls(several, np.repeat(weights, each, 0), sources, (count, each))

    def run(
        self, engine: "RigidEngine", looks: int, record_every: int | None, gradients: bool
    ) -> "tuple[RigidResult, RigidTape | None]":
        """Run the trials, with so many looks at the sensors, each before a time step, the last one after all.

        Returns:
            What they came to, and the tape that gives its derivatives if gradients are wanted.
        """
        steps = whole_number("steps", looks, 1) - 1
        if gradients:
            tape = engine.record(steps, weights=self.weights, lights=self.lights)
            return tape.result, tape
        found = engine.run(steps, weights=self.weights, lights=self.lights, record_every=record_every)
        return found, None

    def distances(self, found: "RigidResult") -> Floats:
        """Distances from the lights at the end, seen from above, by controllers and environments [m]."""
        return self.by_environment(np.hypot(*(found.position - self.lights)[:, :2].T))

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
        found = array_of(content_of(path)) if path.suffix == ".npy" else parse_json(read_text(path))
        weights = checks.real_array(found)
    except OSError as error:
        raise ValueError(f"controller: {path} cannot be read ({why_unread(error)})") from None
    except (*UNREADABLE, OverflowError):
        raise ValueError(f"controller: {path} holds no table of numbers; give {sensors, motors}") from None
    if not np.isfinite(weights).all():
        raise ValueError(f"controller: {path} holds numbers that are not finite")
    if weights.shape != (sensors, motors):
        raise ValueError(f"controller: {path} has shape {weights.shape}, which is not allowed; give {sensors, motors}")
    return weights
