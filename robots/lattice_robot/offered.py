"""What lattice robots offer to commands, searches, views and reports."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from robots.lattice_robot.record import robot_record, save_robot
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.simulation import differentiate, simulate
from robots.outcome import recorded
from robots.robot import Facts, Measure, Outcome, Parameter, Robot, Trial, World
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.view.motion import Motion

STEP = 0.1  # of a mutation, part of a parameter's range


@dataclass(frozen=True, eq=False)
class OwnRobot(Robot):
    """A lattice robot and all that is free of it.

    Attributes:
        robot: the robot.
    """

    robot: LatticeRobot

    kind = "lattice"
    measures = (
        Measure("speed", "BL/s", "speed along its heading"),
        Measure("distance", "m", "distance along its heading"),
    )
    worlds = (Terrain(),)
    differentiable = True
    horizons = (1, 2, 4)

    @property
    def name(self) -> str:
        """The robot's own."""
        return self.robot.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """What is free; a phase that may be all of a cycle is an angle."""
        phases = {n for d in self.robot.drives for n in d.free if n.startswith(f"{d.name}_phase")}
        return tuple(
            Parameter(
                name,
                free.low,
                free.high,
                "angle" if name in phases and free.high - free.low == 1 else "continuous",
                STEP * (free.high - free.low),
                start=free.middle,
            )
            for name, free in self.robot.free.items()
        )

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Let the robot move at N points, with the gradients of speed and distance if wanted."""
        terrain, compute, tell = terrain_of(trial.world), trial.compute.options, trial.progress
        if trial.gradients:
            found = differentiate(self.robot, points, terrain, **compute, progress=tell)
        else:
            found = simulate(self.robot, points, terrain, **compute, record_every=trial.record_every, progress=tell)
        gradients = {}
        if found.gradient is not None:
            seconds = self.robot.cycle.duration
            gradients = {"speed": found.gradient / (self.robot.length * seconds), "distance": found.gradient}
        measures, frames = {"speed": found.speed, "distance": found.distance}, recorded(found.frames[0])
        return Outcome(measures, found.status, found.reason, found.steps, gradients, frames, found)

    @property
    def steps(self) -> int:
        """Time steps of the cycles."""
        return self.robot.cycle.end - self.robot.cycle.begin

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the robot."""
        from robots.view.soft_motion import lattice_robot_motion

        return lattice_robot_motion(outcome.result, self.robot, terrain_of(world), name=name)

    def design(self, point: ArrayLike) -> "OwnRobot":
        """The robot of one point."""
        return OwnRobot(self.robot.filled(self.points(point)[0]))

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the robot of one point, for ``load_robot``."""
        save_robot(self.design(point).robot, path)

    def describe(self) -> dict[str, Any]:
        """All of the robot, with what is free of it."""
        return robot_record(self.robot)

    def facts(self) -> Facts:
        """Body, drives and cycle."""
        robot, body = self.robot, self.robot.body
        voxels = f"{body.voxel_count} voxels of {1000 * body.voxel_size:g} mm"
        cycles = "1 cycle" if robot.cycles == 1 else f"{robot.cycles} cycles"
        return [
            ("Robot", f"{robot.name}: {voxels}"),
            ("Driven", ", ".join(f"{drive.name} ({drive.quantity})" for drive in robot.drives)),
            ("Cycle", f"{robot.frequency:g} Hz; the speed is that of {cycles}"),
        ]

    def at_horizon(self, length: int) -> tuple[str, "OwnRobot"]:
        """The robot for so many cycles."""
        return "1 cycle" if length == 1 else f"{length} cycles", OwnRobot(replace(self.robot, cycles=length))
