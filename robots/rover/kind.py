"""The rover as a kind of robot: a two-wheel vehicle, steered to a light by two weights."""

from collections.abc import Mapping
from typing import Any

from robots.control.lights import LightKind
from robots.kind import choices
from robots.robot import Option, Robot
from taichi_sim.base.checks import built
from taichi_sim.base.options import number, numbers, whole


class RoverKind(LightKind):
    """The two-wheel vehicle of chapter 3; ``rover-best`` has the sensors that the published sweep found."""

    name = "rover"
    title = "two-wheel vehicle"
    designs = ("rover-best",)
    explored = choices(environment=[1, 2, 3, 4], wheel_radius=(0.15, 0.5), torque=(1, 20))
    options = (
        Option("sensors", "places of the two light sensors on the body, in metres", numbers(4), "X1,Y1,X2,Y2"),
        Option("looks", "at the light in a trial, one every 0.05 s (default: 2500)", whole(2), "N"),
        Option("body_mass", "of the box, in kg", number(1e-6), "KG"),
        Option("wheel_mass", "of each wheel, in kg", number(1e-6), "KG"),
        Option("castor_mass", "of the ball in front, in kg", number(1e-6), "KG"),
        Option("wheel_radius", "of wheels and castor, in metres", number(1e-6), "M"),
        Option("torque", "largest of each motor, in N m", number(0), "N"),
        Option("design", "sensors: a body of the published grid, 1 to 6561 (default: 6553)", whole(1), "N"),
        Option("controller", "two weights such as 1,-0.5 (default: free in searches, else 1,1)", metavar="W"),
    )

    def places(self) -> tuple[tuple[float, float], ...]:
        """Places of the light in the published environments [m]."""
        from robots.rover.body import LIGHTS

        return LIGHTS

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The rover of options; with the canonical sensors by default."""
        from robots.control.neural import pair_of
        from robots.rover.body import BEST, Rover
        from robots.rover.robot import RoverRobot

        given = dict(options)
        controller, design = given.pop("controller", None), given.pop("design", None)
        if design is not None:
            if source is not None or "sensors" in given:
                raise ValueError(f"design: {design} is not allowed beside other sensors; leave them out")
            given["sensors"] = Rover.published(design).sensors
        looks = {"looks": given.pop("looks")} if "looks" in given else {}
        if source is not None:
            if source not in self.designs:
                raise ValueError(f"robot: {source!r} is no rover; choose one of {', '.join(self.designs)}")
            given.setdefault("sensors", BEST)
        places = given.get("sensors")
        if isinstance(places, tuple | list) and len(places) == 4:
            given["sensors"] = (tuple(places[:2]), tuple(places[2:]))
        robot = RoverRobot(built(Rover, given), **looks)
        return robot if controller is None else robot.design(pair_of(controller))
