"""Quadrupeds as a kind of robot: legged, wheeled or whegged, steered to a light by a network."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from robots.control.lights import LightKind
from robots.kind import choices
from robots.robot import Option, Robot
from taichi_sim.base.options import number, whole

DESIGNS = ("legged", "wheeled", "whegged")
_LENGTHS = {
    "body_width": "edge of the square main body",
    "body_height": "height of the main body",
    "limb_length": "length of each limb",
    "limb_radius": "radius of limbs",
    "wheel_radius": "radius of wheels",
}


class QuadrupedKind(LightKind):
    """The kind of quadrupeds, which are chosen by the names of their bodies."""

    name = "quadruped"
    title = "quadruped"
    designs = DESIGNS
    explored = choices(environment=[1, 2], limb_length=(0.15, 0.6), body_width=(0.15, 0.6), torque=(2, 30))
    options = (
        Option("variant", "the published experiment, or its text (default: as-run)", choices=("as-run", "text")),
        Option("looks", "at the sensors in a trial, one every 0.05 s (default: 1000)", whole(2), "N"),
        *(Option(name, f"{meaning}, in metres", number(1e-6), "M") for name, meaning in _LENGTHS.items()),
        Option("mass", "of each part, in kg (default: 1)", number(1e-6), "KG"),
        Option("torque", "largest of each motor, in N m (default: 10)", number(0), "N"),
        Option(
            "controller",
            "a .npy or .json file with 5 rows, the sensors, of 8 weights (default: free in searches, else random)",
            metavar="W",
        ),
        Option("seed", "of random weights (default: 0)", whole(0), "N", commands=("view", "simulate")),
    )

    def places(self) -> tuple[tuple[float, float], ...]:
        """Places of the light in the published environments [m]."""
        from robots.quadruped.body import ENVIRONMENTS

        return ENVIRONMENTS

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The quadruped of a name; legged by default."""
        from robots.control.neural import load_weights, random_weights
        from robots.quadruped.body import MOTORS, SENSORS
        from robots.quadruped.robot import QuadrupedRobot

        if source is not None and source not in DESIGNS:
            raise ValueError(f"robot: {source!r} is no quadruped; choose one of {', '.join(DESIGNS)}")
        given = dict(options)
        controller, seed = given.pop("controller", None), given.pop("seed", None)
        if controller is not None and seed is not None:
            raise ValueError("seed: it is of random weights; leave it out beside --controller")
        body = {name: given.pop(name) for name in (*_LENGTHS, "mass", "torque") if name in given}
        robot = QuadrupedRobot.of(given.pop("kind", source or "legged"), body, **given)
        if controller is not None:
            return robot.design(load_weights(Path(controller), SENSORS, MOTORS).ravel())
        if seed is not None:
            return robot.design(random_weights(1, SENSORS, MOTORS, np.random.default_rng(seed)).ravel())
        return robot
