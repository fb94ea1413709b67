"""Quadrupeds that walk, roll, or both: legged, wheeled and whegged.

Source: dissertation, chapter 2 ("The robots"). All numbers are those of the published experiment; where its text
differs, ``TEXT`` holds the text's variant. A robot starts a little inside the ground, which pushes it out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from robots.control.neural import check_weights
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number, whole_number
from taichi_sim.rigid import (
    Body,
    Box,
    Capsule,
    Hinge,
    Motor,
    Network,
    RigidEngine,
    RigidResult,
    Senses,
    Sphere,
    Tree,
    Weld,
    World,
)

Kind = Literal["legged", "wheeled", "whegged"]

SENSORS, MOTORS = 5, 8
LEGS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # directions, in the order of touch sensors and motors
LIGHT_HEIGHT = 0.15  # m
ENVIRONMENTS = ((9.0, 0.0), (0.0, 9.0), (-9.0, 0.0), (0.0, -9.0))  # places of the light: 30 body lengths away
TWO_ENVIRONMENTS = (ENVIRONMENTS[0], ENVIRONMENTS[2])
STEPS = 1000
TIME_STEP, GRAVITY, SLIP = 0.05, -1.0, 0.01  # s, m/s^2, m/(N s)


@dataclass(frozen=True)
class Variant:
    """What the published experiment and its text do differently.

    Attributes:
        name: ``"as run"`` or ``"text"``.
        gain: of sensors on motor neurons.
        touch_values: of touch sensors apart from the ground, and on it.
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
    """A quadruped's body.

    Attributes:
        kind: ``"legged"``: hips and knees move; ``"wheeled"``: legs are stiff and stand on wheels that drive and
            swivel; ``"whegged"``: hips move, and legs end in wheels.
        body_width: edge of the square main body [m].
        body_height: [m].
        limb_length: of each leg's two limbs, between their ends' centres [m].
        limb_radius: [m].
        wheel_radius: [m].
        mass: of each part [kg].
        torque: largest of each motor [N m].
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
        """Of the hips at rest [m]."""
        return self.limb_length + self.limb_radius

    def tree(self, variant: Variant = AS_RUN) -> Tree:
        """The robot as an articulated body."""
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
        """Four feet that feel the ground, and the light at the main body's centre."""
        feet = "shin" if self.kind == "legged" else "wheel"
        return Senses([f"{feet} {leg}" for leg in range(len(LEGS))], [("main", (0, 0, 0))])


LEGGED, WHEELED, WHEGGED = Quadruped("legged"), Quadruped("wheeled"), Quadruped("whegged")


@dataclass(frozen=True, eq=False)
class QuadrupedResult:
    """What N robots did in E environments.

    Attributes:
        light: last reading of the light sensor, (N, E) [1/m^2]; the fitness of an environment.
        distance: from the light at the end, seen from above, (N, E) [m].
        closest: smallest such distance at any time, (N, E) [m].
        position: of the main body at the end, (N, E, 3) [m].
        status: ``"ok"`` or ``"diverged"``, (N, E); numbers of the latter are NaN.
        rollouts: everything about the N E rollouts, environments changing fastest.
    """

    light: Floats
    distance: Floats
    closest: Floats
    position: Floats
    status: NDArray[np.str_]
    rollouts: RigidResult


def engine(robots: Quadruped | Sequence[Quadruped], variant: Variant = AS_RUN, **settings: Any) -> RigidEngine:
    """An engine for robots of one kind, in the world of the published experiment; settings as of ``RigidEngine``.

    Raises:
        ValueError: in one line, for no robot, or several kinds.
    """
    several = [robots] if isinstance(robots, Quadruped) else list(robots)
    if not several:
        raise ValueError("robots: an empty list is not allowed; give at least one")
    if len({each.kind for each in several}) > 1:
        raise ValueError("robots: several kinds are not allowed at once; give robots of one kind")
    world = World(TIME_STEP, GRAVITY, SLIP, integration="velocity")
    network = Network(1.0, variant.gain, variant.touch_values)
    return RigidEngine([each.tree(variant) for each in several], world, several[0].senses(), network, **settings)


def simulate(
    robots: Quadruped | Sequence[Quadruped],
    weights: object,
    lights: Sequence[Sequence[float]] = TWO_ENVIRONMENTS,
    *,
    variant: Variant = AS_RUN,
    steps: int = STEPS,
    record_every: int | None = None,
    **settings: Any,
) -> QuadrupedResult:
    """Run controllers in robots, each in all environments.

    Args:
        robots: one robot for all controllers, or one for each, of one kind.
        weights: (N, 5, 8): four touch sensors and the light; eight motors.
        lights: places of the light in the environments, (E, 2) [m].
        variant: the published experiment, or its text.
        steps: looks at the sensors; the last one counts, so that steps - 1 time steps are run.
        record_every: record every so many time steps.
        **settings: precision, device, threads, width of ``RigidEngine``.

    Raises:
        ValueError: in one line, for what is not allowed.
    """
    trials = _Trials.check(robots, weights, lights)
    found = engine(trials.robots, variant, **settings).run(
        whole_number("steps", steps, 1) - 1, weights=trials.weights, lights=trials.lights, record_every=record_every
    )
    return trials.result(found, variant)


def differentiate(
    robots: Quadruped | Sequence[Quadruped],
    weights: object,
    lights: Sequence[Sequence[float]] = TWO_ENVIRONMENTS,
    *,
    variant: Variant = AS_RUN,
    steps: int = STEPS,
    **settings: Any,
) -> tuple[QuadrupedResult, Floats]:
    """As :func:`simulate`, with derivatives of the last light readings by the weights, (N, E, 5, 8) [1/m^2].

    Contacts, stops and limits act as they did (see ``taichi_sim.rigid.gradient``); readings are not rounded before. It
    takes about five times as long as :func:`simulate`, and 2 MB for a rollout of 1,000 steps in f64. Derivatives of
    robots that diverged are NaN.
    """
    trials = _Trials.check(robots, weights, lights)
    robots_at_work = engine(trials.robots, variant, **settings)
    tape = robots_at_work.record(whole_number("steps", steps, 1) - 1, weights=trials.weights, lights=trials.lights)
    of_light = np.zeros((len(trials.weights), SENSORS))
    of_light[:, -1] = 1
    slopes = tape.pull_back(readings=of_light).weights
    return trials.result(tape.result, variant), slopes.reshape(*trials.shape, SENSORS, MOTORS)


@dataclass(frozen=True, eq=False)
class _Trials:
    """All controllers in all environments, the latter changing fastest."""

    robots: list[Quadruped]
    weights: Floats
    lights: Floats
    shape: tuple[int, int]

    @classmethod
    def check(
        cls, robots: Quadruped | Sequence[Quadruped], weights: object, lights: Sequence[Sequence[float]]
    ) -> "_Trials":
        """Raises ValueError in one line for what is not allowed."""
        several = [robots] if isinstance(robots, Quadruped) else list(robots)
        given = check_weights(weights, SENSORS, MOTORS)
        places = np.array([[number("light", x) for x in place] for place in lights], float)
        if places.ndim != 2 or places.shape[1] != 2 or len(places) == 0:
            raise ValueError(f"lights: shape {places.shape} is not allowed; give (E, 2)")
        if len(several) not in (1, len(given)):
            allowed = f"give one, or one for each of {len(given)} controllers"
            raise ValueError(f"robots: {len(several)} are not allowed; {allowed}")
        count, environments = len(given), len(places)
        sources = np.column_stack([np.tile(places, (count, 1)), np.full(count * environments, LIGHT_HEIGHT)])
        trees = several if len(several) == 1 else [each for each in several for _ in range(environments)]
        return cls(trees, np.repeat(given, environments, 0), sources, (count, environments))

    def result(self, found: RigidResult, variant: Variant) -> QuadrupedResult:
        """What a run came to, by controllers and environments."""
        light = found.readings[:, -1]
        if variant.quantum:
            light = np.round(light / variant.quantum) * variant.quantum
        away = np.hypot(*(found.position - self.lights)[:, :2].T)
        light, away, closest = (x.reshape(self.shape) for x in (light, away, found.closest))
        status = found.status.reshape(self.shape)
        return QuadrupedResult(light, away, closest, found.position.reshape(*self.shape, 3), status, found)
