"""The design problem of version 1.0 for a lattice robot: the fastest robot on one terrain."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from optim.problem import ROBOT, check_kind
from optim.problems.robot import RobotDesignProblem
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.robot import LatticeRobot
from robots.robot import KINDS, World
from robots.world import Terrain
from taichi_sim.base.parsing import parse_json

OPTIONS = ("precision", "device")


@dataclass(frozen=True, eq=False)
class LatticeRobotProblem(RobotDesignProblem):
    """Design a lattice robot by its speed along the heading [body lengths per second] on one terrain.

    The variables are what is free of the robot; a phase that may be all of a cycle is an angle.

    Attributes:
        robot: that is designed.
        terrain: where it moves.
    """

    robot: LatticeRobot
    terrain: Terrain = field(default_factory=Terrain)

    def __post_init__(self) -> None:
        _ = self.space, self.robot.on(self.terrain)

    @property
    def offered(self) -> LatticeRobot:
        """The lattice robot, with its free parameters."""
        return self.robot

    @property
    def tried_in(self) -> tuple[World, ...]:
        """The terrain on which the robot is simulated, as the only world."""
        return (self.terrain,)

    def design(self, point: ArrayLike) -> LatticeRobot:
        """Return the robot of a point, shape (D,), with nothing free."""
        return self.robot.filled(self.space.validate(point))

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; :meth:`from_description` runs no code to rebuild the problem."""
        return {
            "kind": ROBOT,
            "robot": json.dumps(self.robot.describe(), separators=(",", ":")),
            "terrain": KINDS["lattice"].world_record(self.terrain),
            **{name: getattr(self, name) for name in OPTIONS},
        }

    @classmethod
    def settings_of(cls, description: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a description from :meth:`describe` to the fields of the problem."""
        check_kind(description, ROBOT)
        settings = {name: value for name, value in description.items() if name != "kind"}
        robot = robot_of_record(parse_json(description["robot"]))
        return {**settings, "terrain": Terrain(**description["terrain"]), "robot": robot}
