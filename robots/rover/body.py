"""The rover: a vehicle on two driven wheels and a castor, steered by two light sensors, on the ground.

Source: dissertation, chapter 3, "The empirical model"; the defaults are the published base parameters, found by a
search of its authors. The vehicle drives along its own y; x is to its right. Lights are points of light here: that the
published ones are balls, which stop the vehicle, does not matter, as it succeeds before it touches them.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

from robots.braitenberg import VehicleBody
from taichi_sim.base.checks import number
from taichi_sim.rigid import Body, Box, Hinge, Motor, Senses, Sphere, Tree, Weld

Site = tuple[float, float]
Sites = tuple[Site, Site]

CANONICAL: Sites = ((-0.5, 0.5), (0.5, 0.5))  # at the front, left and right
BEST: Sites = ((-0.125, -0.5), (0.375, 0.5))  # the best that the published sweep found, by both metrics

WIDTH = 1.0  # m, of the square body
WHEEL_SETBACK = 0.025  # m, of the wheels behind the body's centre
LIGHTS = ((4.0, 4.0), (-4.0, 4.0), (-4.0, -4.0), (4.0, -4.0))  # m, places of the light in the environments
LIGHT_RADIUS, LIGHT_HEIGHT = 0.2, 0.201  # m
STEPS = 2500
ROUNDING = 2.0**-10  # m, added to the distance of success in the published experiment (spacing of half precision at 1)


@dataclass(frozen=True)
class Rover:
    """Body of a vehicle with two driven wheels, a castor and two light sensors.

    Attributes:
        sensors: places of the light sensors on the body, x to the right and y ahead of its centre [m]. The first
            drives the right wheel, the second the left one.
        body_mass: mass of the box [kg].
        wheel_mass: mass of each wheel [kg].
        castor_mass: mass of the ball in front that rolls along [kg].
        wheel_radius: radius of wheels and castor [m]; the box is half as thick.
        speed: of motors: each holds half of speed times the rate it is commanded, if its torque suffices [1].
        command_range: rate that a neuron of one commands [rad/s].
        torque: largest torque of each motor [N m].
        sensor_radius: radius of the sensors, which are balls [m].
        sensor_mass: mass of each sensor [kg].
        sensor_height: height of the sensors' centres above the tops of the wheels [m].

    Raises:
        ValueError: for numbers that are not allowed, or sites beside the body.
    """

    sensors: Sites = CANONICAL
    body_mass: float = 999.973
    wheel_mass: float = 117.519
    castor_mass: float = 0.00666004
    wheel_radius: float = 0.260017
    speed: float = 2.59115 * math.pi
    command_range: float = 2.59255 * math.pi
    torque: float = 1.95026 * math.pi
    sensor_radius: float = 0.05
    sensor_mass: float = 1.0
    sensor_height: float = 0.05

    def __post_init__(self) -> None:
        try:
            sound = len(self.sensors) == 2 and all(len(site) == 2 for site in self.sensors)
        except TypeError:
            sound = False
        if not sound:
            raise ValueError(f"sensors: {self.sensors!r} is not allowed; give two places (x, y)")
        half = WIDTH / 2
        sites = tuple(tuple(number("sensors", x, -half, half, "m, on the body") for x in s) for s in self.sensors)
        object.__setattr__(self, "sensors", sites)
        for name in ("body_mass", "wheel_mass", "castor_mass", "wheel_radius", "sensor_radius", "sensor_mass"):
            number(name, getattr(self, name), 1e-6)
        for name in ("speed", "command_range", "torque", "sensor_height"):
            number(name, getattr(self, name), 0)

    @classmethod
    def published(cls, design: int) -> Self:
        """Make the base body with the sensors of ``VehicleBody.published``, turned from driving along x to along y."""
        (x1, y1), (x2, y2) = VehicleBody.published(design).sensors
        return cls(((0.0 - y1, x1), (0.0 - y2, x2)))

    @property
    def vehicle(self) -> VehicleBody:
        """Body of the theoretical model, a Braitenberg vehicle, with the same sensors."""
        return VehicleBody(tuple((y, 0.0 - x) for x, y in self.sensors))

    @property
    def mirrored(self) -> Self:
        """Mirror image of the body: places of sensors, and sensors, exchanged between left and right."""
        (x1, y1), (x2, y2) = self.sensors
        return replace(self, sensors=((0.0 - x2, y2), (0.0 - x1, y1)))

    @property
    def success_distance(self) -> float:
        """Largest distance between centres, seen from above, at which a light counts as reached [m]."""
        return WIDTH / 2 + self.wheel_radius + LIGHT_RADIUS + ROUNDING

    @property
    def rate(self) -> float:
        """Rate of a wheel at full command, if its motor's torque suffices [rad/s]."""
        return 0.5 * self.speed * self.command_range

    def tree(self) -> Tree:
        """Build the vehicle as a tree of rigid bodies: the box carries wheels, castor and sensors."""
        radius, half = self.wheel_radius, WIDTH / 2
        ball, drive = Sphere(radius), Motor.velocity(self.rate, self.torque)
        bodies = [Body("body", (0, 0, radius), self.body_mass, [Box((WIDTH, WIDTH, radius / 2))])]
        joints = list[Hinge | Weld]()
        for command, (name, x) in enumerate({"left wheel": -half, "right wheel": half}.items()):
            place = (x, -WHEEL_SETBACK, radius)
            bodies.append(Body(name, place, self.wheel_mass, [ball]))
            joints.append(Hinge("body", name, place, (-1, 0, 0), drive, command))  # a positive rate drives ahead
        place = (0, half, radius)
        bodies.append(Body("castor", place, self.castor_mass, [ball]))
        joints.append(Hinge("body", "castor", place, (1, 0, 0)))
        inertia = Sphere(self.sensor_radius).inertia(self.sensor_mass)
        for name, site in zip(_SENSORS, self.sensors, strict=True):  # without shapes: they touch nothing
            above = (*site, 2 * radius + self.sensor_height)
            bodies.append(Body(name, above, self.sensor_mass, inertia=inertia))
            joints.append(Weld("body", name))
        return Tree(bodies, joints)


_SENSORS = ("sensor 1", "sensor 2")
SENSES = Senses(light=[(name, (0, 0, 0)) for name in _SENSORS])
