"""Designing what is free of a lattice robot for one terrain."""

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import ROBOT, Evaluation, check_kind
from optim.space import Space, Variable
from robots.lattice_robot.record import robot_of_record, robot_record, save_robot
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.simulation import LatticeRobotResult, differentiate, simulate
from robots.world import Terrain

OPTIONS = ("precision", "device")
STEP = 0.1  # of a mutation, part of a variable's range


@dataclass(frozen=True, eq=False)
class LatticeRobotProblem:
    """Objective: the speed along the heading [body lengths per second], see ``robots.lattice_robot``.

    The variables are what is free of the robot; a phase that may be all of a cycle is an angle.

    Attributes:
        robot: that is designed.
        terrain: where it moves.
        precision: ``"f32"`` or ``"f64"``.
        device: ``"cpu"``, ``"cuda"``, ``"vulkan"`` or ``"metal"``.
        threads: CPU threads, all available if None; changes no result, so it is not part of the description.
        progress: called now and then during an evaluation with the fraction done; not part of it either.
    """

    robot: LatticeRobot
    terrain: Terrain = field(default_factory=Terrain)
    precision: str = "f64"
    device: str = "cpu"
    threads: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        if not self.robot.free:
            raise ValueError("robot: nothing of it is free to change; make some value Free")
        self.robot.on(self.terrain)

    @property
    def objective_names(self) -> tuple[str, ...]:
        """The speed."""
        return ("speed",)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Body lengths per second."""
        return ("BL/s",)

    @cached_property
    def space(self) -> Space:
        """What is free."""
        phases = {n for d in self.robot.drives for n in d.free if n.startswith(f"{d.name}_phase")}
        return Space(
            tuple(
                Variable(
                    name,
                    free.low,
                    free.high,
                    step=STEP * (free.high - free.low),
                    kind="angle" if name in phases and free.high - free.low == 1 else "continuous",
                )
                for name, free in self.robot.free.items()
            )
        )

    def design(self, point: ArrayLike) -> LatticeRobot:
        """The robot of a point, shape (D,), without anything free."""
        return self.robot.filled(self.space.validate(point))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate all points, shape (N, D).

        Details: ``distance`` [m], shape (N,).
        """
        points = self.space.validate(np.atleast_2d(points))
        return self._judgement(simulate(self.robot, points, self.terrain, **self._where))

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """The same, with the gradient of the speed if wanted; nothing is binary, so there is nothing to sharpen."""
        if not gradients:
            return self.evaluate(points)
        points = self.space.validate(np.atleast_2d(points))
        return self._judgement(differentiate(self.robot, points, self.terrain, **self._where))

    @property
    def _where(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in (*OPTIONS, "threads", "progress")}

    def _judgement(self, result: LatticeRobotResult) -> Evaluation:
        status = np.where(result.reason == "", result.status, result.reason)
        slopes = result.gradient
        if slopes is not None:
            slopes = slopes / (self.robot.length * self.robot.cycle.duration)
        return Evaluation(result.speed, status, {"distance": result.distance}, slopes)

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the robot of a point as JSON, for ``robots.lattice_robot.load_robot``."""
        save_robot(self.design(point), path)

    def describe(self) -> dict[str, Any]:
        """All that results depend on; :meth:`from_description` builds the problem again, and runs no code for it."""
        terrain = {name: value for name, value in dataclasses.asdict(self.terrain).items() if value is not None}
        return {
            "kind": ROBOT,
            "robot": json.dumps(robot_record(self.robot), separators=(",", ":")),
            "terrain": terrain,
            **{name: getattr(self, name) for name in OPTIONS},
        }

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> "LatticeRobotProblem":
        """The problem that :meth:`describe` described.

        Raises:
            ValueError: in one line, that names what is missing, unknown or not allowed.
        """
        check_kind(description, ROBOT)
        settings = {name: value for name, value in description.items() if name != "kind"}
        try:
            settings["terrain"] = Terrain(**description["terrain"])
            settings["robot"] = robot_of_record(json.loads(description["robot"]))
            return cls(**settings)
        except (KeyError, TypeError) as error:
            raise ValueError(f"problem: its description is damaged ({error})") from None
