"""What a run is given: checked, and written into the robots' memory."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.tree import Tree
from taichi_sim.rigid.pose import momenta, poses, velocities
from taichi_sim.rigid.state import State

_FAR_AWAY = np.array([[1e9, 0.0, 0.0]])  # a light that is nowhere
_NEAREST = 1e-6  # m


@dataclass(frozen=True, eq=False)
class Given:
    """Arrays of a run, with a first axis of the batch, or of one where all robots share them.

    Attributes:
        batch: number of robots.
        state: where they start.
        weights: (B, S, M); without entries where commands are given.
        commands: (B, K, M); without entries where weights are given.
        lights: (B, 3) [m].
    """

    batch: int
    state: State
    weights: Floats
    commands: Floats
    lights: Floats

    def rows(self, robots: Ints) -> "Given":
        """What some of the robots are given."""
        state = State(*(_rows(getattr(self.state, each.name), robots) for each in fields(State)))
        arrays = (_rows(x, robots) for x in (self.weights, self.commands, self.lights))
        return Given(len(robots), state, *arrays)


def _rows(array: Floats, robots: Ints) -> Floats:
    return array[robots] if len(array) > 1 else np.repeat(array, len(robots), 0)


def check(
    trees: Sequence[Tree],
    sensors: int,
    weights: Floats | None,
    commands: Floats | None,
    lights: Floats | None,
    start: State,
) -> Given:
    """What a run is given, as arrays.

    Raises:
        ValueError: for other shapes, numbers that are not finite, or both weights and commands.
    """
    motors, hinges = trees[0].motors, len(trees[0].hinges)
    if weights is not None and commands is not None:
        raise ValueError("commands: not allowed beside weights; give one of them")
    if weights is None and commands is None:
        commands = np.zeros((1, 1, motors))
    arrays: dict[str, tuple[Floats, tuple[int | None, ...]]] = {
        "weights": (np.zeros((1, 0, 0)), (0, 0)) if weights is None else (weights, (sensors, motors)),
        "commands": (np.zeros((1, 0, motors)), (0, motors)) if commands is None else (commands, (None, motors)),
        "lights": (_FAR_AWAY if lights is None else lights, (3,)),
        "position": (start.position, (3,)),
        "orientation": (start.orientation, (4,)),
        "angles": (start.angles, (hinges,)),
        "velocity": (start.velocity, (6,)),
        "rates": (start.rates, (hinges,)),
    }
    found = {name: _check(name, value, shape) for name, (value, shape) in arrays.items()}
    if commands is not None and found["commands"].shape[1] == 0:
        raise ValueError("commands: none over time are not allowed; give at least one")
    batch = max(len(trees), *map(len, found.values()))
    for name, value in (*found.items(), ("trees", np.empty(len(trees)))):
        if len(value) not in (1, batch):
            raise ValueError(f"{name}: {len(value)} rows are not allowed; give one, or {batch} as others have")
    if not np.allclose(np.linalg.norm(found["orientation"], axis=1), 1, atol=1e-6):
        raise ValueError("orientation: not allowed; give unit quaternions (w, x, y, z)")
    state = State(*(found[each.name] for each in fields(State)))
    if np.linalg.norm(found["lights"] - state.position, axis=1).min() < _NEAREST:
        raise ValueError("lights: a light on the robot is not allowed; give a place away from its start")
    return Given(batch, state, found["weights"], found["commands"], found["lights"])


def _check(name: str, value: Floats, shape: tuple[int | None, ...]) -> Floats:
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: not allowed; give numbers") from None
    fits = found.ndim == len(shape) + 1 and all(n in (None, m) for n, m in zip(shape, found.shape[1:], strict=True))
    if not fits or len(found) == 0:
        wanted = ", ".join(["B", *("K" if n is None else str(n) for n in shape)])
        raise ValueError(f"{name}: shape {found.shape} is not allowed; give ({wanted})")
    if not np.isfinite(found).all():
        raise ValueError(f"{name}: numbers that are not finite are not allowed")
    return found


def fill(
    found: np.ndarray,
    plan: NDArray[np.int32],
    given: Given,
    trees: Sequence[Tree],
    numbers: dict[int, Floats],
    by_momentum: bool,
) -> None:
    """Write what robots start with into their memory.

    Args:
        found: memory, (slots, B), zero.
        plan: its sections.
        given: what the run is given, of these robots.
        trees: of these robots: one, or one each.
        numbers: values (B, ...) or (1, ...) of sections that trees and senses fill.
        by_momentum: whether bodies carry momenta from step to step.
    """

    def put(first: int, values: Floats) -> None:
        flat = values.reshape(len(values), -1)
        found[first : first + flat.shape[1]] = flat.T

    state = given.state
    put(slots.POSITION, state.position)
    put(slots.ORIENTATION, state.orientation)
    put(slots.LIGHT, given.lights)
    found[slots.CLOSEST], found[slots.DIVERGED] = 1e30, -1
    for section, values in (*numbers.items(), (slots.WEIGHT, given.weights), (slots.COMMAND, given.commands)):
        put(plan[section], values)
    carried, places, moving = _carried(trees, state, by_momentum)
    for n in range(len(trees[0].bodies)):
        body = plan[slots.BODY] + n * slots.BODY_WIDTH
        put(body + slots.CARRIED, carried[:, n])
        put(body + slots.OWN, places[:, n])
        put(body + slots.MOVING, moving[:, n])
    for h, n in enumerate(trees[0].hinged):
        found[plan[slots.BODY] + n * slots.BODY_WIDTH + slots.ANGLE] = state.angles[:, h]


def _carried(trees: Sequence[Tree], state: State, by_momentum: bool) -> tuple[Floats, Floats, Floats]:
    """What bodies carry, (B, bodies, 6), their places, (B, bodies, 3), and velocities, (B, bodies, 6)."""
    if len(trees) == 1:
        return _of_tree(trees[0], state, by_momentum)
    each = [
        _of_tree(tree, State(*(getattr(state, f.name)[n : n + 1] for f in fields(State))), by_momentum)
        for n, tree in enumerate(trees)
    ]
    carried, places, moving = (np.concatenate(parts) for parts in zip(*each, strict=True))
    return carried, places, moving


def _of_tree(tree: Tree, state: State, by_momentum: bool) -> tuple[Floats, Floats, Floats]:
    places, turns = poses(tree, state.position, state.orientation, state.angles)
    moving = velocities(tree, places, turns, state.velocity, state.rates)
    if not by_momentum:
        return moving, places, moving
    carried = momenta(tree, places, turns, moving)
    if not tree.fixed:  # as ``stages.motion.shift_moments`` has them
        masses = np.array([body.mass for body, _ in tree.ordered])[:, None]
        arms = places - places[..., :1, :]
        centre, velocity = ((masses * x).sum(-2, keepdims=True) / masses.sum() for x in (arms, moving[..., 3:]))
        carried[..., :3] -= np.cross(centre, carried[..., 3:]) + np.cross(arms - centre, masses * velocity)
    return carried, places, moving
