"""The rover as a kind of robot: a two-wheel vehicle, steered to a light by two weights."""

from collections.abc import Mapping
from typing import Any

from robots.control.lights import LightKind
from robots.robot import Option, Robot
from taichi_sim.base.options import number, numbers, whole


class RoverKind(LightKind):
    """The two-wheel vehicle of chapter 3; ``rover-best`` has the sensors that the published sweep found."""

    name = "rover"
    title = "two-wheel vehicle"
    designs = ("rover-best",)
    options = (
        Option("sensors", "places of the two light sensors on the body, in metres", numbers(4), "X1,Y1,X2,Y2"),
        Option("looks", "at the light in a trial, one every 0.05 s (default: 2500)", whole(2), "N"),
        Option("body_mass", "of the box, in kg", number(1e-6), "KG"),
        Option("wheel_mass", "of each wheel, in kg", number(1e-6), "KG"),
        Option("castor_mass", "of the ball in front, in kg", number(1e-6), "KG"),
        Option("wheel_radius", "of wheels and castor, in metres", number(1e-6), "M"),
        Option("torque", "largest of each motor, in N m", number(0), "N"),
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The rover of options; with the canonical sensors by default."""
        from robots.rover.body import BEST, Rover
        from robots.rover.offered import OfferedRover

        given = dict(options)
        looks = {"looks": given.pop("looks")} if "looks" in given else {}
        if source is not None:
            if source not in self.designs:
                raise ValueError(f"robot: {source!r} is no rover; choose one of {', '.join(self.designs)}")
            given.setdefault("sensors", BEST)
        places = given.get("sensors")
        if isinstance(places, tuple | list) and len(places) == 4:
            given["sensors"] = (tuple(places[:2]), tuple(places[2:]))
        return OfferedRover(Rover(**given), **looks)
