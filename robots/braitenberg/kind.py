"""Braitenberg vehicles as a kind of robot: sensors and weights, judged by how close they come to the light."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robots.braitenberg.body import CONTROLLERS, FORMAT
from robots.environments import Environment
from robots.kind import choices
from robots.robot import Option, Robot, RobotKind, World
from taichi_sim.base.options import whole

DESIGN = Option(
    "design",
    "sensors: a body of the published grid, 1 to 6561 (default: 6553; free in searches)",
    whole(1),
    "N",
)


class VehicleKind(RobotKind):
    """The kind of Braitenberg vehicles, whose light sensors drive two motors."""

    name = "vehicle"
    title = "Braitenberg vehicle"
    world_option = "environment"
    world_hint = "place of the light, or of the robot, from 1 to 4 (default: 1, of searches all)"
    explored = choices(environment=[1, 2, 3, 4])
    options = (
        DESIGN,
        Option(
            "controller",
            "two weights such as 1,-0.5, or what searches find weights of: contralateral or full (default: "
            "contralateral, of weights 1,1)",
            metavar="W",
        ),
        Option("sensors", "how many, where their places are free (default: 2)", whole(1), "N"),
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """Sensors and weights to be searched; or the vehicle of a file, of which nothing is free."""
        from robots.braitenberg.body import VehicleBody
        from robots.braitenberg.robot import VehicleRobot, load_vehicle, one_vehicle
        from robots.control.neural import pair_of

        if source is not None:
            for name in options:
                raise ValueError(f"{name}: the vehicle in {source} has its own; leave it out")
            return load_vehicle(Path(source))
        body = VehicleBody.published(options["design"]) if "design" in options else None
        controller = options.get("controller", CONTROLLERS[0])
        if controller in CONTROLLERS:
            return VehicleRobot(body, controller, options.get("sensors", 2))
        return one_vehicle(body or VehicleBody.published(6553), pair_of(controller))

    def world(self, text: Any) -> World:
        """The environment of a number."""
        return Environment.parse(text)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Designs that searches save."""
        return form == FORMAT

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The vehicle that was described."""
        from robots.braitenberg.robot import vehicle_of_description

        return vehicle_of_description(description)
