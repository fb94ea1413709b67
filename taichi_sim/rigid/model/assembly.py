"""Build trees from the parts of a robot's file: masses are summed, and massless parts join those that carry them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import check_fields
from taichi_sim.rigid.model.settings import Physics
from taichi_sim.rigid.model.shapes import Box, Capsule, Size, Solid, Sphere
from taichi_sim.rigid.model.tree import Body, Hinge, Joint, Tree, Weld
from taichi_sim.rigid.tables import Senses

USUAL = Physics(time_step=0.002, friction=1.0)  # MuJoCo's defaults, for what a file does not say
_STRAIGHT = 1e-3  # sines below it are rounding: 1.57 for a right angle
DEEPEST, DEEPEST_SHARE = 5e-3, 0.05  # m, and share of its height, that a robot of a file may start in the ground
SHALLOW = 1e-4  # m, a depth in the ground that is rounding
_ROUNDED = 1e-2  # part of a moment of inertia that the digits of a file may lack; published files have two or three
_COMPUTED = 1e-9  # part of a moment that is rounding of its computation
_MOST = 1e150  # kg m^2; eigenvalues of more do not converge
_NONE = 1e-12  # part of the largest moment that counts as none


@dataclass(frozen=True, eq=False)
class Model:
    """A robot that was read from a file.

    Attributes:
        tree: the robot; its first body is the base.
        senses: the file's touch sensors.
        world: time step, gravity and friction that the file gives, else MuJoCo's defaults.
        commands: names of the actuators or joints that receive the commands, in order.
        ignored: entries of the file that the engine does not support.
    """

    tree: Tree
    senses: Senses
    world: Physics
    commands: tuple[str, ...]
    ignored: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame: a position and axes, in the world, with the robot at rest.

    Attributes:
        position: position of its origin [m].
        rotation: matrix of its axes.
    """

    position: Floats
    rotation: Floats

    def then(self, position: Floats, rotation: Floats) -> "Frame":
        """Convert a frame that is given relative to this one to the world."""
        return Frame(self.position + self.rotation @ position, self.rotation @ rotation)


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
            return replace(self, inertia=self.inertia + other.inertia)  # which a file may bound from below
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        inertia = self.inertia + other.inertia
        for part in (self, other):
            arm = part.centre - centre
            inertia = inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return Lump(mass, centre, inertia)

    @property
    def is_thin(self) -> bool:
        """Whether nothing could move it on its own: it has no mass, or a moment of inertia of 0, as a point has."""
        if self.mass == 0:
            return True
        small, _, large = np.linalg.eigvalsh((self.inertia + self.inertia.T) / 2)
        return abs(float(small)) <= _NONE * float(large)

    @classmethod
    def of(cls, mass: float, place: Frame, inertia: Floats) -> "Lump":
        """Place a mass, whose inertia is given in the axes of that place."""
        return cls(mass, place.position, place.rotation @ inertia @ place.rotation.T)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along its third axis, which touches the ground as a capsule of the same overall length.

    Attributes:
        radius: [m].
        length: length of the cylinder [m].
    """

    radius: Size
    length: Size

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * self.length

    def inertia(self, mass: float) -> Floats:
        """Inertia of the cylinder with this mass about its own centre, (3, 3) [kg m^2]."""
        across = mass * (3 * self.radius**2 + self.length**2) / 12
        return np.diag([across, across, mass * self.radius**2 / 2])


@dataclass(frozen=True, eq=False)
class Part:
    """A body as a file describes it.

    Attributes:
        name: name of the part.
        joint: the joint that carries it; None for the base.
        lump: its mass.
        shapes: solids that may touch the ground, with centres in the world at rest.
        immersed: the same of solids that touch nothing but water.
        origin: of its frame in the world at rest [m].
    """

    name: str
    joint: Joint | None
    lump: Lump
    shapes: tuple[Solid, ...] = ()
    immersed: tuple[Solid, ...] = ()
    origin: Floats = field(default_factory=lambda: np.zeros(3))

    def with_fixed(self, other: "Part") -> "Part":
        """It and another that is fixed to it, as one."""
        shapes, immersed = self.shapes + other.shapes, self.immersed + other.immersed
        return replace(self, lump=self.lump + other.lump, shapes=shapes, immersed=immersed)

    def body(self, lump: Lump) -> Body:
        """The body of such a mass that it is."""
        shapes, immersed = (
            [replace(solid, centre=np.asarray(solid.centre) - lump.centre) for solid in solids]
            for solids in (self.shapes, self.immersed)
        )
        inertia, frame = (lump.inertia + lump.inertia.T) / 2, self.origin - lump.centre
        return Body(self.name, lump.centre, lump.mass, shapes, inertia, immersed, frame)


def solid_of(kind: str, name: str, size: Sequence[float]) -> Solid | Cylinder:
    """Make a solid in its own frame: a sphere (radius), a box (edges), a capsule or a cylinder (radius, length).

    Raises:
        ValueError: for sizes that are not allowed; names the solid.
    """
    try:
        if kind == "sphere":
            return Sphere(size[0])
        if kind == "box":
            return Box(size)
        return Capsule(size[0], size[1]) if kind == "capsule" else Cylinder(size[0], size[1])
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def possible_inertia(name: str, inertia: Floats, balanced: bool) -> Floats:
    """Check that some mass can have an inertia: none of its principal moments exceeds the sum of the others.

    Args:
        name: whose inertia it is, for messages.
        inertia: about the centre of mass, (3, 3) [kg m^2].
        balanced: whether a ball of the same mean moment takes the place of one that is impossible, as MuJoCo has it.

    Raises:
        ValueError: for an inertia that is impossible by more than its digits explain.
    """
    small, middle, large = np.linalg.eigvalsh(computable(name, inertia))
    if balanced and large - small - middle > _COMPUTED * large:
        return np.eye(3) * (small + middle + large) / 3
    if large - small - middle > _ROUNDED * large:
        raise ValueError(
            f"{name}: an inertia of moments {small:g}, {middle:g}, {large:g} is not allowed; give ones of which none "
            'exceeds the sum of the others, or a compiler with balanceinertia="true"'
        )
    return inertia


def computable(name: str, inertia: Floats) -> Floats:
    """Return an inertia whose moments can be computed.

    Raises:
        ValueError: for one that is too large.
    """
    if not np.abs(inertia).max() <= _MOST:
        raise ValueError(f"{name}: moments of inertia beyond {_MOST:g} kg m^2 are not allowed; give less mass")
    return inertia


def placed(solid: Solid | Cylinder, name: str, place: Frame) -> Solid:
    """Put a solid, along the third axis if it is round, at a place in the world, where it touches the ground.

    Raises:
        ValueError: for a box along other axes than those of the world, and a cylinder that is wider than long.
    """
    if isinstance(solid, Sphere):
        return replace(solid, centre=place.position)
    if isinstance(solid, Box):
        straight = np.abs(place.rotation).round()
        if np.abs(np.abs(place.rotation) - straight).max() > _STRAIGHT:
            raise ValueError(
                f"{name}: a box that is turned where its hinges rest is not allowed; give one along the axes of the "
                "world, rest angles with which it is so, or a capsule"
            )
        return Box(straight @ solid.size, place.position)
    length = solid.length if isinstance(solid, Capsule) else solid.length - 2 * solid.radius
    if length <= 0:
        raise ValueError(f"{name}: a cylinder that is wider than long is not allowed; give a sphere, box or capsule")
    return Capsule(solid.radius, length, place.rotation[:, 2], place.position)


def tree_of(parts: Sequence[Part], fixed: bool) -> Tree:
    """Build a tree from parts, which are given parents first.

    Parts without mass, or with a moment of inertia of 0, that are fixed to another become one with it.

    Raises:
        ValueError: for such a part that moves on its own, or parts that ``Tree`` does not allow.
    """
    found: dict[str, Part] = {}
    joined: dict[str, str] = {}
    for part in parts:
        joint = part.joint
        computable(f"inertia of {part.name}", part.lump.inertia)
        if joint is not None:
            joint = replace(joint, parent=joined.get(joint.parent, joint.parent))
        if isinstance(joint, Weld) and (part.lump.is_thin or found[joint.parent].lump.is_thin):
            found[joint.parent] = found[joint.parent].with_fixed(part)
            joined[part.name] = joint.parent
        else:
            found[part.name] = replace(part, joint=joint)
    bodies = []
    for part in found.values():
        lump = part.lump
        if lump.is_thin and part.joint is None and fixed:
            lump = replace(lump, inertia=np.eye(3))  # whatever does not move
        elif lump.mass == 0:
            raise ValueError(f"mass of {part.name}: 0 is not allowed; give an inertial or solids with a mass")
        elif lump.is_thin:
            raise ValueError(f"inertia of {part.name}: a moment of 0 is not allowed; give moments above 0")
        bodies.append(part.body(lump))
    return Tree(bodies, [part.joint for part in found.values() if part.joint is not None], fixed)


def depth_of(tree: Tree) -> float:
    """How deep a tree lies in the ground, z = 0, at rest [m]; 0 if nothing of it does that the ground can move.

    The ground moves neither what is fixed to the world nor what turns about vertical axes only, as a column does.
    """
    return float(max([0.0, *depths_of(tree)]))


def depths_of(tree: Tree) -> Floats:
    """How deep the points of a tree lie in the ground at rest [m], of those that the ground can move; above it < 0."""
    loose = [not tree.fixed]
    for parent, (_, joint) in zip(tree.parents[1:], tree.ordered[1:], strict=True):
        loose.append(loose[parent] or (isinstance(joint, Hinge) and not _is_vertical(joint)))
    heights = [(tree.ordered[n][0].position[2] + centre[2], radius) for n, centre, radius in tree.points() if loose[n]]
    return np.array([radius - height for height, radius in heights], float)


def _is_vertical(hinge: Hinge) -> bool:
    axis = np.array(hinge.axis, float)
    return float(np.hypot(*axis[:2])) <= _STRAIGHT * float(np.linalg.norm(axis))


def check_start(tree: Tree) -> None:
    """Refuse a tree that starts so deep in the ground, z = 0, that the ground would throw it out.

    What is less deep is pushed out at up to half a metre a second, in time steps of 2 ms.

    Raises:
        ValueError: says how deep it starts, and how much higher its base must start.
    """
    depth = depth_of(tree)
    if depth == 0.0:
        return
    centres, radii = tree.balls()
    height = float((centres[:, 2] + radii).max()) + depth
    allowed = min(DEEPEST, DEEPEST_SHARE * height)
    if depth > allowed:
        raise ValueError(
            f"model: its start {1e3 * depth:.3g} mm deep in the ground, z = 0, is not allowed; give a base that starts "
            f"at least {math.ceil(1e4 * (depth - 1e-9)) / 1e4:.4g} m higher, or angles at which it is not so deep"
        )


def raised(tree: Tree) -> Tree:
    """A tree, raised until nothing of it that the ground can move lies in it, z = 0."""
    up = np.array([0.0, 0.0, depth_of(tree)])
    bodies = [replace(body, position=np.add(body.position, up)) for body in tree.bodies]
    joints = [
        replace(each, anchor=np.add(each.anchor, up)) if isinstance(each, Hinge) else each for each in tree.joints
    ]
    return Tree(bodies, joints, tree.fixed)


OUTSIDE = "the angle at rest of hinges whose range excludes it: they rest in its middle"


def rest_within(span: tuple[float, float] | None, usual: float) -> tuple[float, bool]:
    """The angle at which a hinge rests [rad], and whether it is another than the usual one.

    Files of many legged robots have joints whose ranges exclude their zero, as knees that are always bent. They rest in
    the middle of their range.
    """
    if span is None or span[0] <= usual <= span[1] or not span[0] < span[1]:
        return usual, False
    return (span[0] + span[1]) / 2, True
