"""Trees as the kernel wants them: integers that all robots of a batch share, and numbers of each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.shapes import Vector, vector
from taichi_sim.rigid.model.tree import Hinge, Tree
from taichi_sim.rigid.slots import Counts

Ints = NDArray[np.int32]


@dataclass(frozen=True)
class Senses:
    """What a robot senses, in the order of its controller's inputs.

    Attributes:
        touch: names of bodies that feel whether they touch the ground.
        light: light sensors, as names of bodies and places from their centres at rest [m].
    """

    touch: Sequence[str] = ()
    light: Sequence[tuple[str, Vector]] = ()

    @property
    def count(self) -> int:
        """Number of sensors."""
        return len(self.touch) + len(self.light)


@dataclass(frozen=True, eq=False)
class Tables:
    """A tree's integers.

    Attributes:
        counts: sizes.
        bodies: (bodies, columns): parent, whether hinged, motor or -1, hinges up to the base, touch sensor or -1.
        points: the body of each point.
        paths: (bodies, depth): the hinged bodies between the base and each body, the first next to the base.
        eyes: the body of each light sensor.
    """

    counts: Counts
    bodies: Ints
    points: Ints
    paths: Ints
    eyes: Ints

    def same_structure(self, other: "Tables") -> bool:
        """Whether one kernel run serves both."""
        return self.counts == other.counts and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ("bodies", "points", "paths", "eyes")
        )


def tables_of(tree: Tree, senses: Senses, commands: int) -> Tables:
    """The integers of a tree.

    Raises:
        ValueError: for senses of bodies that do not exist or cannot touch.
    """
    points = tree.points()
    touchable = {n for n, _, _ in points}
    for name in senses.touch:
        if tree.place_of(name) not in touchable:
            raise ValueError(f"touch: {name!r} has no shape that could touch; give a body with one")
    if len(set(senses.touch)) < len(senses.touch):
        raise ValueError(f"touch: {list(senses.touch)!r} is not allowed; give each body once")
    feeling = {tree.place_of(name): s for s, name in enumerate(senses.touch)}
    paths: list[list[int]] = []
    rows = np.full((len(tree.bodies), slots.BODY_COLUMNS), -1, np.int32)
    for n, (_, joint) in enumerate(tree.ordered):
        hinged = isinstance(joint, Hinge)
        paths.append([] if n == 0 else paths[tree.parents[n]] + [n] * hinged)
        motor = joint.command if isinstance(joint, Hinge) and joint.motor is not None else -1
        rows[n] = tree.parents[n], hinged, motor, len(paths[n]), feeling.get(n, -1)
    depth = max(map(len, paths))
    table = np.zeros((len(paths), max(1, depth)), np.int32)
    for n, path in enumerate(paths):
        table[n, : len(path)] = path
    counts = Counts(
        len(tree.bodies),
        len(tree.hinges),
        len(points),
        len(senses.touch),
        len(senses.light),
        tree.motors,
        max(1, depth),
        commands,
    )
    return Tables(
        counts,
        rows.ravel(),
        np.array([n for n, _, _ in points] or [0], np.int32),
        table.ravel(),
        np.array([tree.place_of(name) for name, _ in senses.light] or [0], np.int32),
    )


def parameters_of(tree: Tree) -> Floats:
    """Parameters of all bodies, (bodies, PARAMETER_WIDTH)."""
    found = np.zeros((len(tree.bodies), slots.PARAMETER_WIDTH))
    for n, (body, joint) in enumerate(tree.ordered):
        each, position = found[n], np.array(body.position, float)
        each[slots.MASS] = body.mass
        inertia = np.asarray(body.inertia)
        each[slots.REST_INERTIA : slots.REST_INERTIA + 6] = inertia[np.tril_indices(3)]
        each[[slots.LOWER, slots.UPPER]] = -slots.NO_STOP, slots.NO_STOP
        if joint is None:
            continue
        of_parent = np.array(tree.ordered[tree.parents[n]][0].position, float)
        anchor = np.array(joint.anchor, float) if isinstance(joint, Hinge) else position
        each[slots.CENTRE : slots.CENTRE + 3] = position - anchor
        each[slots.ANCHOR : slots.ANCHOR + 3] = anchor - of_parent
        if isinstance(joint, Hinge):
            each[slots.AXIS : slots.AXIS + 3] = np.array(joint.axis) / np.linalg.norm(joint.axis)
            if joint.motor is not None:
                motor = joint.motor
                each[slots.TORQUE : slots.OFFSET + 1] = motor.torque, motor.by_command, motor.by_angle, motor.offset
            if joint.stops is not None:
                each[[slots.LOWER, slots.UPPER]] = joint.stops
    return found


def points_of(tree: Tree) -> Floats:
    """Centres and radii of all points, (points, 4)."""
    return np.array([(*centre, radius) for _, centre, radius in tree.points()]).reshape(-1, 4)


def eyes_of(senses: Senses) -> Floats:
    """Places of light sensors on their bodies, (sensors, 3)."""
    return np.array([vector("light", place) for _, place in senses.light]).reshape(-1, 3)
