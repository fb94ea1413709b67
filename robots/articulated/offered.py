"""What articulated robots offer to commands, searches, views and reports."""

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import ArrayLike

from robots.articulated.robot import ArticulatedRobot
from robots.articulated.simulation import ArticulatedResult, differentiate, simulate
from robots.robot import FRAMES, HERE, Facts, Measure, Outcome, Parameter, Place, Progress, Replay, Robot, World
from taichi_sim.base.compute import Compute

GROUND = Place("ground")


@dataclass(frozen=True, eq=False)
class OfferedArticulated(Robot):
    """An articulated robot whose controller is free.

    Attributes:
        robot: the robot.
    """

    robot: ArticulatedRobot

    kind = "articulated"
    measures = (
        Measure("speed", "m/s", "speed along its heading"),
        Measure("distance", "m", "distance along its heading"),
    )
    worlds = (GROUND,)
    horizons = (1, 2, 4)

    @property
    def name(self) -> str:
        """The robot's own."""
        return self.robot.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """What is free of the controller."""
        return self.robot.parameters

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
        found = simulate(self.robot, points, record_every=record_every, progress=progress, **compute.options)
        return self._outcome(found)

    def differentiate(
        self, points: ArrayLike, world: World, *, compute: Compute = HERE, progress: Progress | None = None
    ) -> Outcome:
        """Let the robot move at N points, with the gradients of speed and distance."""
        return self._outcome(differentiate(self.robot, points, progress=progress, **compute.options))

    def _outcome(self, found: ArticulatedResult) -> Outcome:
        seconds = self.robot.steps * self.robot.world.time_step
        slopes = {}
        if found.gradient is not None:
            slopes = {"speed": found.gradient / seconds, "distance": found.gradient}
        frames = found.runs[0].frames
        measures = {"speed": found.distance / seconds, "distance": found.distance}
        recorded = {} if frames is None else vars(frames)
        return Outcome(measures, found.status, (), found.steps, slopes, recorded, found)  # type: ignore[arg-type]

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
        from robots.view.rigid_motion import driven_motion

        every = record_every(self.robot.steps, frames)
        outcome = self.simulate(point, world, compute=compute, record_every=every, progress=progress)
        (run,) = outcome.result.runs
        sensors = [*(f"{body} on ground" for body in self.robot.senses.touch), *(["light"] if self.robot.light else [])]
        lights = [] if self.robot.light is None else [self.robot.light]
        model = self.robot.model
        motion = driven_motion(model.tree, run.frames, sensors, model.commands, name=name or self.name, lights=lights)
        return Replay(outcome, motion)

    def describe(self) -> dict[str, Any]:
        """All of the robot, the text of its model included."""
        return self.robot.describe()

    def facts(self) -> Facts:
        """Body, drives and trial."""
        tree, robot = self.robot.model.tree, self.robot
        mass = sum(body.mass for body in tree.bodies)
        return [
            ("Robot", f"{robot.name}: {len(tree.bodies)} bodies on {len(tree.hinges)} hinges, {mass:.3g} kg"),
            ("Driven", f"{', '.join(robot.drives)}, by a {robot.controller}"),
            ("Trial", f"{robot.duration:g} s; distance along {robot.heading:g}°"),
        ]

    def at_horizon(self, length: int) -> tuple[str, "OfferedArticulated"]:
        """The robot for so many seconds."""
        seconds = "1 second" if length == 1 else f"{length} seconds"
        return seconds, OfferedArticulated(replace(self.robot, duration=float(length)))
