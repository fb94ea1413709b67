"""Descriptions of articulated robots: a base, and bodies joined to it by hinges or welds.

Everything is given as it lies at rest, in the frame of the world: all bodies' axes are then the world's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated

import numpy as np

from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import Finite, NotNegative, Positive, check_fields, number, positive
from taichi_sim.rigid.model.shapes import ORIGIN, Patch, Portion, Solid, Vector, unit, vector


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body of an articulated robot: mass, inertia and the solids that it is made of.

    Attributes:
        name: name of the body, unique in its tree.
        position: position of its centre of mass at rest [m].
        mass: mass [kg]; 0 of a base that is fixed to the world and has none, which needs an inertia all the same.
        shapes: solids it is made of; all of them collide with the ground.
        inertia: about the centre of mass, (3, 3) [kg m^2]; of its only solid, centred, if not given.
        immersed: further solids, on which water acts like on the others, but which touch nothing.
        frame: origin of its own frame, from its centre of mass at rest [m]; bodies without a hinge are scaled about it.

    Raises:
        ValueError: for a value that is not allowed, or no inertia unless there is one solid, centred.
    """

    name: str
    position: Vector
    mass: float
    shapes: Sequence[Solid] = ()
    inertia: Floats | None = None
    immersed: Sequence[Solid] = ()
    frame: Vector = ORIGIN

    def __post_init__(self) -> None:
        vector(f"position of {self.name}", self.position)
        vector(f"frame of {self.name}", self.frame)
        if self.mass != 0 or self.inertia is None:
            positive(f"mass of {self.name}", self.mass)
        for name, solids in (("shapes", self.shapes), ("immersed", self.immersed)):
            if not isinstance(solids, Sequence) or not all(isinstance(solid, Solid) for solid in solids):
                raise ValueError(f"{name} of {self.name}: {solids!r} is not allowed; give a list of solids")
        if self.inertia is None:
            if len(self.shapes) != 1 or np.any(self.shapes[0].centre):
                raise ValueError(f"inertia of {self.name}: None is not allowed; give it for all but one centred solid")
            object.__setattr__(self, "inertia", self.shapes[0].inertia(self.mass))
        inertia = np.array(self.inertia, float)
        if inertia.shape != (3, 3) or not np.allclose(inertia, inertia.T) or not np.linalg.eigvalsh(inertia)[0] > 0:
            raise ValueError(f"inertia of {self.name}: not allowed; give a symmetric positive definite 3 x 3 matrix")
        object.__setattr__(self, "inertia", inertia)


@dataclass(frozen=True)
class Motor:
    """A drive that holds a hinge's rate at by_command m + by_angle angle + offset, as far as its torque allows.

    A rate beyond ``fastest`` is held at ``fastest``.

    Attributes:
        torque: largest torque in either direction [N m].
        by_command: rate for each unit of the command m [rad/s].
        by_angle: rate for each radian of the angle, negative for position control [1/s].
        offset: constant part of the rate [rad/s].
        fastest: largest rate that it holds in either direction [rad/s]; None has no limit.

    Raises:
        ValueError: for a value that is not allowed.
    """

    torque: NotNegative
    by_command: Finite
    by_angle: Finite = 0.0
    offset: Finite = 0.0
    fastest: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def position(
        cls, lowest: float, highest: float, speed: float, torque: float, fastest: float | None = None
    ) -> "Motor":
        """Make a position drive: commands from -1 to 1 mean angles from ``lowest`` to ``highest`` [rad].

        The rate is ``speed`` [1/s] times the angle that is missing, at most ``fastest`` [rad/s].

        Raises:
            ValueError: for angles that are no numbers, or a speed that is not positive.
        """
        lowest, highest, speed = number("lowest", lowest), number("highest", highest), positive("speed", speed)
        return cls(torque, speed * (highest - lowest) / 2, -speed, speed * (highest + lowest) / 2, fastest)

    @classmethod
    def velocity(cls, fastest: float, torque: float) -> "Motor":
        """Make a velocity drive: commands from -1 to 1 mean rates from -``fastest`` to ``fastest`` [rad/s]."""
        return cls(torque, fastest)


@dataclass(frozen=True)
class Servo:
    """A drive whose torque is by_command m + by_angle angle + offset - by_rate rate, as far as its largest torque goes.

    That of a position servo is proportional to the angle that lacks, less a damping; a torque motor has ``by_command``
    only.

    Attributes:
        by_command: torque for each unit of the command m [N m].
        by_angle: torque for each radian of the angle, at most 0 [N m/rad].
        offset: constant part of the torque [N m].
        by_rate: torque against each unit of the hinge's rate [N m s/rad].
        torque: largest torque in either direction [N m]; None has no limit.
        damping_ratio: further torque against the rate, as a share of the critical one of what hangs on the hinge at
            rest, with its rotor; 1 comes to its angle without passing it.

    Raises:
        ValueError: for a value that is not allowed.
    """

    by_command: Finite
    by_angle: Annotated[float, partial(number, high=0.0)] = 0.0
    offset: Finite = 0.0
    by_rate: NotNegative = 0.0
    torque: NotNegative | None = None
    damping_ratio: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def position(
        cls, lowest: float, highest: float, stiffness: float, damping: float = 0.0, torque: float | None = None
    ) -> "Servo":
        """Make a position servo: commands from -1 to 1 mean angles from ``lowest`` to ``highest`` [rad].

        Its torque is ``stiffness`` [N m/rad] times the angle that lacks, less ``damping`` [N m s/rad] times the rate,
        at most ``torque`` [N m].

        Raises:
            ValueError: for angles that are no numbers, or a stiffness that is not positive.
        """
        lowest, highest = number("lowest", lowest), number("highest", highest)
        stiffness = positive("stiffness", stiffness)
        return cls(stiffness * (highest - lowest) / 2, -stiffness, stiffness * (highest + lowest) / 2, damping, torque)


@dataclass(frozen=True)
class Passive:
    """What acts on a hinge besides its motor: the inertia of a rotor, a damper, a spring and friction.

    Attributes:
        rotor_inertia: of what turns with the hinge inside its drive, times the gear ratio squared [kg m^2]; MuJoCo's
            armature. It resists changes of the hinge's rate only.
        damping: torque against the rate of the hinge [N m s/rad].
        stiffness: torque of a spring for each radian [N m/rad].
        spring_rest: angle at which the spring is at rest [rad].
        friction: torque against the rate, whatever that is, which holds the hinge as far as it goes [N m].

    Raises:
        ValueError: for a value that is not allowed.
    """

    rotor_inertia: NotNegative = 0.0
    damping: NotNegative = 0.0
    stiffness: NotNegative = 0.0
    spring_rest: Finite = 0.0
    friction: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Hinge:
    """A joint that turns its child body about an axis: rate = axis . (its angular velocity - the parent's).

    Attributes:
        parent: name of the body nearer to the base.
        child: name of the body it carries.
        anchor: a point on the axis at rest [m].
        axis: direction of the axis at rest, of any length but 0.
        motor: its drive, which holds a rate or has a law of torque; None turns freely.
        command: number of the command that the drive receives.
        stops: smallest and largest angle [rad]; None has no limits.
        rest: the angle at rest as its file counts it [rad]; here it is 0 there, as are stops and commands.
        passive: the rotor of its drive, a damper, a spring and friction.

    Raises:
        ValueError: for a value that is not allowed.
    """

    parent: str
    child: str
    anchor: Vector
    axis: Vector
    motor: Motor | Servo | None = None
    command: int = 0
    stops: tuple[float, float] | None = None
    rest: float = 0.0
    passive: Passive = Passive()

    def __post_init__(self) -> None:
        vector(f"anchor of {self.child}", self.anchor)
        unit(f"axis of {self.child}", self.axis)
        if self.stops is not None and not _around_zero(self.stops):
            raise ValueError(
                f"stops of {self.child}: {self.stops!r} is not allowed; give two angles around the start, 0"
            )
        if self.motor is not None:
            checks.integer(f"command of {self.child}", self.command, 0)


def _around_zero(stops: tuple[float, float]) -> bool:
    try:
        lower, upper = checks.numbers("stops", stops, 2)
    except ValueError:
        return False
    return bool(lower <= 0 <= upper and lower < upper)


@dataclass(frozen=True)
class Weld:
    """A joint that fixes its child body to the parent.

    Attributes:
        parent: name of the body nearer to the base.
        child: name of the body it carries.
    """

    parent: str
    child: str


Joint = Hinge | Weld


@dataclass(frozen=True, eq=False)
class Tree:
    """An articulated robot as a tree of bodies and joints; the first body is the base.

    Attributes:
        bodies: all bodies.
        joints: one for every body but the base.
        fixed: whether the base is fixed to the world.

    Raises:
        ValueError: if the joints make no tree.
    """

    bodies: Sequence[Body]
    joints: Sequence[Joint] = ()
    fixed: bool = False

    def __post_init__(self) -> None:
        names = [body.name for body in self.bodies]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"bodies: {names!r} is not allowed; give at least one body, each with a name of its own")
        carried = {names[0]}
        for joint in self.joints:
            for end in (joint.parent, joint.child):
                if end not in names:
                    raise ValueError(f"joints: there is no body {end!r}; there are {', '.join(names)}")
            if joint.child in carried:
                raise ValueError(f"joints: {joint.child!r} is carried twice or is the base; give a tree without loops")
            carried.add(joint.child)
        for body in self.bodies[1 if self.fixed else 0 :]:
            positive(f"mass of {body.name}", body.mass)
        lost = [name for n, name in enumerate(names) if n not in self.order]
        if lost:
            raise ValueError(f"joints: {lost[0]!r} does not hang on the base {names[0]!r}; give a tree without loops")

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Numbers of the bodies in the order of ``ordered``: the base, then what hangs on it, and so on."""
        parent_of = {joint.child: joint.parent for joint in self.joints}
        order, last = [0], {self.bodies[0].name}
        while last:
            found = [n for n, body in enumerate(self.bodies) if parent_of.get(body.name) in last]
            order += found
            last = {self.bodies[n].name for n in found}
        return tuple(order)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """Place in ``ordered`` of the body that carries each body; -1 for the base."""
        return tuple(-1 if joint is None else self.place_of(joint.parent) for _, joint in self.ordered)

    @cached_property
    def ordered(self) -> list[tuple[Body, Joint | None]]:
        """All bodies with the joints that carry them, parents first; the base has no joint."""
        joint_of = {joint.child: joint for joint in self.joints}
        return [(self.bodies[i], joint_of.get(self.bodies[i].name)) for i in self.order]

    @property
    def masses(self) -> Floats:
        """Masses of the bodies in the order of ``ordered`` [kg]."""
        return np.array([body.mass for body, _ in self.ordered], float)

    @cached_property
    def hinges(self) -> list[Hinge]:
        """All hinges in the order of their bodies, which is the order of angles in results."""
        return [joint for _, joint in self.ordered if isinstance(joint, Hinge)]

    @cached_property
    def hinged(self) -> list[int]:
        """Places in ``ordered`` of the bodies that hinges carry."""
        return [n for n, (_, joint) in enumerate(self.ordered) if isinstance(joint, Hinge)]

    @property
    def motors(self) -> int:
        """Number of commands."""
        return max((h.command + 1 for h in self.hinges if h.motor is not None), default=0)

    def place_of(self, name: str) -> int:
        """Place in ``ordered`` of the body with a name.

        Raises:
            ValueError: for a body that does not exist.
        """
        names = [body.name for body, _ in self.ordered]
        if name not in names:
            raise ValueError(f"bodies: there is no body {name!r}; there are {', '.join(names)}")
        return names.index(name)

    def inertia_about(self, hinge: Hinge) -> float:
        """Inertia at rest about a hinge of all that hangs on it, with its rotor [kg m^2]."""
        axis, carried = np.array(hinge.axis, float) / np.linalg.norm(hinge.axis), {hinge.child}
        found = hinge.passive.rotor_inertia
        for body, joint in self.ordered:
            if body.name == hinge.child or (joint is not None and joint.parent in carried):
                carried.add(body.name)
                arm = np.cross(axis, np.subtract(body.position, hinge.anchor))
                found += float(axis @ np.asarray(body.inertia) @ axis + body.mass * arm @ arm)
        return found

    def points(self) -> list[tuple[int, Floats, float]]:
        """Balls that stand for the bodies in contact: place of the body, centre from its centre of mass, radius [m]."""
        return [
            (n, centre, radius)
            for n, (body, _) in enumerate(self.ordered)
            for shape in body.shapes
            for centre, radius in shape.points()
        ]

    def patches(self) -> list[Patch]:
        """Return the part of the surface that belongs to each of the ``points``, for forces of sand."""
        return [patch for body, _ in self.ordered for shape in body.shapes for patch in shape.patches()]

    def portions(self) -> list[tuple[int, Portion]]:
        """Portions that stand for the bodies in water, each with the place of its body."""
        return [
            (n, part)
            for n, (body, _) in enumerate(self.ordered)
            for shape in (*body.shapes, *body.immersed)
            for part in shape.portions()
        ]

    def balls(self) -> tuple[Floats, Floats]:
        """Return centres (N, 3) and radii (N,) at rest of balls that may touch ground, or of bodies' centres [m]."""
        found = [(np.add(self.ordered[n][0].position, centre), radius) for n, centre, radius in self.points()]
        found = found or [(np.array(body.position, float), 0.0) for body in self.bodies]
        return np.array([centre for centre, _ in found]), np.array([radius for _, radius in found])

    @property
    def reach(self) -> float:
        """Distance of the base from what is farthest of the robot that may touch the ground, at rest [m]."""
        centres, radii = self.balls()
        base = self.ordered[0][0].position
        return float((np.linalg.norm(centres - np.array(base, float), axis=1) + radii).max())
