"""Build trees from the parts of a robot's file: masses are summed, and massless parts join those that carry them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.settings import World
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid, Sphere
from taichi_sim.rigid.model.tree import Body, Hinge, Joint, Motor, Tree, Weld
from taichi_sim.rigid.tables import Senses

_STRAIGHT = 1e-6  # sines below it are rounding


@dataclass(frozen=True, eq=False)
class Model:
    """A robot that was read from a file.

    Attributes:
        tree: the robot; its first body is the base.
        senses: the file's touch sensors.
        world: time step, gravity and friction that the file gives, and defaults.
        commands: names of the actuators or joints that receive the commands, in order.
        ignored: entries of the file that the engine does not support.
    """

    tree: Tree
    senses: Senses
    world: World
    commands: tuple[str, ...]
    ignored: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Place:
    """A frame: a position and axes, in the world, with the robot at rest.

    Attributes:
        position: position of its origin [m].
        rotation: matrix of its axes.
    """

    position: Floats
    rotation: Floats

    def then(self, position: Floats, rotation: Floats) -> "Place":
        """Convert a frame that is given relative to this one to the world."""
        return Place(self.position + self.rotation @ position, self.rotation @ rotation)


@dataclass(frozen=True, eq=False)
class Lump:
    """A mass [kg], its centre [m] and its inertia about the centre [kg m^2], in the axes of the world at rest."""

    mass: float = 0.0
    centre: Floats = field(default_factory=lambda: np.zeros(3))
    inertia: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    def __add__(self, other: "Lump") -> "Lump":
        """Combine two masses into one (parallel axis theorem)."""
        mass = self.mass + other.mass
        if mass == 0:
            return self
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        inertia = self.inertia + other.inertia
        for part in (self, other):
            arm = part.centre - centre
            inertia = inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return Lump(mass, centre, inertia)

    @classmethod
    def of(cls, mass: float, place: Place, inertia: Floats) -> "Lump":
        """Place a mass, whose inertia is given in the axes of that place."""
        return cls(mass, place.position, place.rotation @ inertia @ place.rotation.T)


@dataclass(frozen=True)
class HingeOf:
    """The hinge that carries a part, at rest in the world; the fields are those of ``Hinge``."""

    anchor: Floats
    axis: Floats
    motor: Motor | None = None
    command: int = 0
    stops: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """A body as a file describes it.

    Attributes:
        name: name of the part.
        parent: name of the part that carries it; None for the base.
        hinge: the hinge that joins it to its parent; None if it is fixed to the parent.
        lump: its mass.
        shapes: solids with centres in the world at rest.
    """

    name: str
    parent: str | None
    hinge: HingeOf | None
    lump: Lump
    shapes: tuple[Solid, ...]


def sphere(place: Place, radius: float) -> Sphere:
    """A ball at a place in the world."""
    return Sphere(radius, place.position)


def capsule(place: Place, radius: float, length: float) -> Capsule:
    """A capsule along the third axis of a place in the world."""
    return Capsule(radius, length, place.rotation[:, 2], place.position)


def box(name: str, place: Place, size: Floats) -> Box:
    """A cuboid along the axes of a place in the world.

    Raises:
        ValueError: if these are not the axes of the world.
    """
    straight = np.abs(place.rotation).round(6)
    if np.abs(np.abs(place.rotation) - straight.round()).max() > _STRAIGHT:
        raise ValueError(f"{name}: a box that is turned at rest is not allowed; give one along the axes of the world")
    return Box(straight.round() @ size, place.position)


def solid_inertia(kind: str, mass: float, size: Sequence[float]) -> Floats:
    """Inertia of a solid about its own axes [kg m^2].

    Sizes are those of a sphere (radius), a box (edges), or a capsule or cylinder (radius, length).
    """
    if kind == "sphere":
        return Sphere(size[0]).inertia(mass)
    if kind == "box":
        return Box(np.array(size)).inertia(mass)
    if kind == "capsule":
        return Capsule(size[0], size[1]).inertia(mass)
    across = mass * (3 * size[0] ** 2 + size[1] ** 2) / 12
    return np.diag([across, across, mass * size[0] ** 2 / 2])


def solid_volume(kind: str, size: Sequence[float]) -> float:
    """Volume of a solid [m^3], with the sizes of :func:`solid_inertia`."""
    ball = 4 / 3 * np.pi * size[0] ** 3
    if kind == "box":
        return float(np.prod(size))
    if kind == "sphere":
        return float(ball)
    return float(np.pi * size[0] ** 2 * size[1] + (ball if kind == "capsule" else 0))


def placed(kind: str, name: str, place: Place, size: Sequence[float]) -> Solid:
    """Make the solid that touches the ground; a cylinder becomes a capsule of the same overall length.

    Raises:
        ValueError: for solids that the engine does not support.
    """
    if kind == "sphere":
        return sphere(place, size[0])
    if kind == "box":
        return box(name, place, np.array(size))
    length = size[1] if kind == "capsule" else size[1] - 2 * size[0]
    if length <= 0:
        raise ValueError(f"{name}: a cylinder that is wider than long is not allowed; give a sphere, box or capsule")
    return capsule(place, size[0], length)


def tree_of(parts: Sequence[Part], fixed: bool) -> Tree:
    """Build a tree from parts, which are given parents first.

    Parts without mass that are fixed to another become one with it.

    Raises:
        ValueError: for a part without mass that moves on its own, or parts that ``Tree`` does not allow.
    """
    found: dict[str, Part] = {}
    joined: dict[str, str] = {}
    for part in parts:
        parent = None if part.parent is None else joined.get(part.parent, part.parent)
        if parent is not None and part.hinge is None and 0 in (part.lump.mass, found[parent].lump.mass):
            carrier = found[parent]
            found[parent] = replace(carrier, lump=carrier.lump + part.lump, shapes=carrier.shapes + part.shapes)
            joined[part.name] = parent
        else:
            found[part.name] = replace(part, parent=parent)
    bodies, joints = list[Body](), list[Joint]()
    for part in found.values():
        lump = part.lump
        if lump.mass == 0 and part.parent is None and fixed:
            lump = Lump(1.0, lump.centre, np.eye(3))  # whatever does not move
        if lump.mass == 0:
            raise ValueError(f"mass of {part.name}: 0 is not allowed; give an inertial or solids with a mass")
        shapes = [replace(shape, centre=np.asarray(shape.centre) - lump.centre) for shape in part.shapes]
        bodies.append(Body(part.name, lump.centre, lump.mass, shapes, (lump.inertia + lump.inertia.T) / 2))
        if part.parent is not None:
            hinge = part.hinge
            joints.append(
                Weld(part.parent, part.name)
                if hinge is None
                else Hinge(part.parent, part.name, hinge.anchor, hinge.axis, hinge.motor, hinge.command, hinge.stops)
            )
    return Tree(bodies, joints, fixed)
