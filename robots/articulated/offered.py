"""What articulated robots offer to commands, searches, views and reports."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from robots.articulated.robot import ArticulatedRobot
from robots.articulated.simulation import differentiate, simulate
from robots.outcome import recorded
from robots.robot import Facts, Measure, Outcome, Parameter, Place, Robot, Trial, World
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.view.motion import Motion

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
    differentiable = True
    horizons = (1, 2, 4)

    @property
    def name(self) -> str:
        """The robot's own."""
        return self.robot.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """What is free of the controller."""
        return self.robot.parameters

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Let the robot move at N points, with the gradients of speed and distance if wanted."""
        compute, tell = trial.compute.options, trial.progress
        if trial.gradients:
            found = differentiate(self.robot, points, progress=tell, **compute)
        else:
            found = simulate(self.robot, points, record_every=trial.record_every, progress=tell, **compute)
        seconds = self.robot.steps * self.robot.world.time_step
        slopes = {}
        if found.gradient is not None:
            slopes = {"speed": found.gradient / seconds, "distance": found.gradient}
        measures, frames = {"speed": found.distance / seconds, "distance": found.distance}, found.runs[0].frames
        return Outcome(
            measures, found.status, steps=found.steps, gradients=slopes, frames=recorded(frames), result=found
        )

    @property
    def steps(self) -> int:
        """Time steps of a trial."""
        return self.robot.steps

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the robot, with its sensors and commands."""
        from robots.view.rigid_motion import driven_motion

        (run,), robot = outcome.result.runs, self.robot
        sensors = [*(f"{body} on ground" for body in robot.senses.touch), *(["light"] if robot.light else [])]
        lights = [] if robot.light is None else [robot.light]
        return driven_motion(robot.model.tree, run.frames, sensors, robot.drives, name=name, lights=lights)

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
