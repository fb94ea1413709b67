"""What lattice robots offer to commands, searches, views and reports."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from robots.lattice_robot.record import robot_record, save_robot
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.simulation import LatticeRobotResult, differentiate, simulate
from robots.robot import FRAMES, HERE, Facts, Measure, Outcome, Parameter, Progress, Replay, Robot, World
from robots.world import Terrain, terrain_of
from taichi_sim.base.compute import Compute

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

    def simulate(
        self,
        points: ArrayLike,
        world: World,
        *,
        compute: Compute = HERE,
        record_every: int | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """Let the robot move at N points."""
        points, terrain = self.points(points), terrain_of(world)
        return self._outcome(
            simulate(self.robot, points, terrain, **compute.options, record_every=record_every, progress=progress)
        )

    def differentiate(
        self, points: ArrayLike, world: World, *, compute: Compute = HERE, progress: Progress | None = None
    ) -> Outcome:
        """Let the robot move at N points, with the gradients of speed and distance."""
        points, terrain = self.points(points), terrain_of(world)
        return self._outcome(differentiate(self.robot, points, terrain, **compute.options, progress=progress))

    def _outcome(self, result: LatticeRobotResult) -> Outcome:
        gradients, frames = {}, {}
        if result.gradient is not None:
            seconds = self.robot.cycle.duration
            gradients = {"speed": result.gradient / (self.robot.length * seconds), "distance": result.gradient}
        if result.frames[0] is not None:
            frames = vars(result.frames[0])
        measures = {"speed": result.speed, "distance": result.distance}
        return Outcome(measures, result.status, result.reason, result.steps, gradients, frames, result)

    def replay(
        self,
        point: ArrayLike,
        world: World,
        *,
        frames: int = FRAMES,
        name: str = "",
        compute: Compute = HERE,
        progress: Progress | None = None,
    ) -> Replay:
        """Let one design move."""
        from robots.view.motion import record_every
        from robots.view.soft_motion import lattice_robot_motion

        fixed = self.design(point)
        cycle = fixed.robot.cycle
        every = record_every(cycle.end - cycle.begin, frames)
        outcome = fixed.simulate((), world, compute=compute, record_every=every, progress=progress)
        if outcome.reason[0]:
            raise ValueError(f"source: {name or self.name} is no robot: {outcome.reason[0]}")
        motion = lattice_robot_motion(outcome.result, fixed.robot, terrain_of(world), name=name or self.name)
        return Replay(outcome, motion)

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
