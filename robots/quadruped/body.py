"""Bodies of quadrupeds that walk, roll, or both: legged, wheeled and whegged.

Source: dissertation, chapter 2 ("The robots"). All numbers are those of the published experiment; where its text
differs, ``TEXT`` holds the text's variant. A robot starts a little inside the ground, which pushes it out.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from taichi_sim.base.checks import number
from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Senses, Sphere, Tree, Weld

Kind = Literal["legged", "wheeled", "whegged"]

SENSORS, MOTORS = 5, 8
LEGS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # directions, in the order of touch sensors and motors
LIGHT_HEIGHT = 0.15  # m
ENVIRONMENTS = ((9.0, 0.0), (0.0, 9.0), (-9.0, 0.0), (0.0, -9.0))  # places of the light: 30 body lengths away
TWO_ENVIRONMENTS = (ENVIRONMENTS[0], ENVIRONMENTS[2])
STEPS = 1000


@dataclass(frozen=True)
class Variant:
    """Settings in which the published experiment, as it was run, differs from its text.

    Attributes:
        name: ``"as run"`` or ``"text"``.
        gain: gain of sensors on motor neurons.
        touch_values: readings of touch sensors off the ground, and on it.
        wheel_rate: fastest rate of wheels [rad/s].
        joint_limit: largest angle of legs' joints either way [rad]; commands span it.
        inertia_turned_twice: whether thighs have the moments of inertia of the published experiment's library, which
            turns them twice.
        quantum: light readings are rounded to multiples of it; 0: not.
    """

    name: str
    gain: float
    touch_values: tuple[float, float]
    wheel_rate: float
    joint_limit: float
    inertia_turned_twice: bool
    quantum: float


AS_RUN = Variant("as run", 1.0, (0.0, 1.0), 0.5 * 10 * math.pi / 4, math.pi / 4, True, 1e-6)
TEXT = Variant("text", 0.3, (-1.0, 1.0), math.pi / 2, math.pi / 2, False, 0.0)
VARIANTS = {"as-run": AS_RUN, "text": TEXT}


@dataclass(frozen=True)
class Quadruped:
    """Body of a quadruped on legs, wheels or whegs (legs that end in wheels).

    Attributes:
        kind: ``"legged"``: hips and knees move; ``"wheeled"``: legs are stiff and stand on wheels that drive and
            swivel; ``"whegged"``: hips move, and legs end in wheels.
        body_width: edge of the square main body [m].
        body_height: height of the main body [m].
        limb_length: length of each leg's two limbs, between their ends' centres [m].
        limb_radius: radius of the limbs [m].
        wheel_radius: radius of the wheels [m].
        mass: mass of each part [kg].
        torque: largest torque of each motor [N m].

    Raises:
        ValueError: for an unknown kind, or a number that is not allowed.
    """

    kind: Kind
    body_width: float = 0.3
    body_height: float = 0.1
    limb_length: float = 0.3
    limb_radius: float = 0.05
    wheel_radius: float = 0.1
    mass: float = 1.0
    torque: float = 10.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"kind: {self.kind!r} is unknown; choose {', '.join(get_args(Kind))}")
        for name in ("body_width", "body_height", "limb_length", "limb_radius", "wheel_radius", "mass"):
            number(name, getattr(self, name), 1e-6)
        number("torque", self.torque, 0)

    @property
    def height(self) -> float:
        """Height of the hips at rest [m]."""
        return self.limb_length + self.limb_radius

    def tree(self, variant: Variant = AS_RUN) -> Tree:
        """Build the robot as a tree of rigid bodies and joints."""
        main = Body("main", (0, 0, self.height), self.mass, [Box((self.body_width, self.body_width, self.body_height))])
        bodies, joints = [main], list[Hinge | Weld]()
        for leg in range(len(LEGS)):
            more, hung = self._leg(leg, variant)
            bodies += more
            joints += hung
        return Tree(bodies, joints)

    def _leg(self, leg: int, variant: Variant) -> tuple[list[Body], list[Hinge | Weld]]:
        """A leg's bodies and joints; a positive angle of its joints raises the foot."""
        along = np.array([*LEGS[leg], 0.0])
        across = -np.array([-along[1], along[0], 0.0])
        up = np.array([0.0, 0.0, 1.0])
        length, half = self.limb_length, self.body_width / 2
        hip, knee = half * along + self.height * up, (half + length) * along + self.height * up
        foot = knee - self.height * up
        thigh = Capsule(self.limb_radius, length, along)
        inertia = thigh.inertia(self.mass)
        if variant.inertia_turned_twice:
            inertia = Capsule(self.limb_radius, length, (0, 1, 0) if along[0] else (0, 0, 1)).inertia(self.mass)
        shin = Body(f"shin {leg}", knee - up * (self.height / 2), self.mass, [Capsule(self.limb_radius, length)])
        bodies = [Body(f"thigh {leg}", (hip + knee) / 2, self.mass, [thigh], inertia), shin]
        limit = variant.joint_limit
        bend = Motor.position(-limit, limit, 1.0, self.torque)
        names = ("main", f"thigh {leg}"), (f"thigh {leg}", f"shin {leg}")
        hips = Hinge(*names[0], hip, across, bend, leg, (-limit, limit))
        knees = Hinge(*names[1], knee, across, bend, leg + 4, (-limit, limit))
        stiff = [Weld(*names[0]), Weld(*names[1])]
        if self.kind == "legged":
            return bodies, [hips, knees]
        roll = Motor.velocity(variant.wheel_rate, self.torque)
        wheel = Body(f"wheel {leg}", foot, self.mass, [Sphere(self.wheel_radius)])
        if self.kind == "whegged":
            return [*bodies, wheel], [hips, stiff[1], Hinge(names[1][1], wheel.name, foot, (1, 0, 0), roll, leg + 4)]
        swivel = Body(f"swivel {leg}", foot, self.mass, [Sphere(self.wheel_radius)])
        swings = Hinge(names[1][1], swivel.name, foot, (0, 1, 0), roll, leg)
        return [*bodies, swivel, wheel], [
            *stiff,
            swings,
            Hinge(swivel.name, wheel.name, foot, (1, 0, 0), roll, leg + 4),
        ]

    def senses(self) -> Senses:
        """Sensors: four feet that feel the ground, and a light sensor at the main body's centre."""
        feet = "shin" if self.kind == "legged" else "wheel"
        return Senses([f"{feet} {leg}" for leg in range(len(LEGS))], [("main", (0, 0, 0))])


LEGGED = Quadruped("legged")
"""The published quadruped whose hips and knees move."""
WHEELED = Quadruped("wheeled")
"""The published quadruped whose stiff legs stand on wheels that drive and swivel."""
WHEGGED = Quadruped("whegged")
"""The published quadruped whose hips move and whose legs end in wheels."""
