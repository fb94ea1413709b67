"""The motion of articulated robots from which users' own measures are computed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.own_measures import OwnMeasure, sealed
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import RigidResult, Tree, poses

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot

POSE = "position", "orientation", "angles"  # of bases and of hinges at the end of a run
ENDED = *POSE, "work"  # what is known of a run


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Final poses of B articulated robots of N bodies and H hinges, from which users' own measures are computed.

    Bodies and hinges are in the order of their names. Arrays of the end may be traced for derivatives: a law computes
    with operators and with the functions of NumPy that ``taichi_sim.autodiff.arrays`` knows, and takes plain arrays
    just as well.

    Attributes:
        places: bodies' centres at the end [m], shape (B, N, 3).
        turns: orientations of the bodies at the end, unit quaternions (w, x, y, z), shape (B, N, 4).
        angles: angles of the hinges at the end, as the robot's file counts them [rad], shape (B, H).
        start_places: bodies' centres as the model has them, with the robot's sizes [m], shape (N, 3).
        start_turns: bodies' orientations as the model has them, shape (N, 4).
        masses: masses of the bodies [kg], shape (N,); 0 of a base that stands for the world.
        bodies: names of the bodies.
        hinges: names of the bodies that the hinges carry.
        duration: duration of the trial [s].
        heading: unit vector of the direction of travel, shape (3,).
        energy: work of all drives [J], shape (B,); NaN where only poses are known.
    """

    places: Any
    turns: Any
    angles: Any
    start_places: Floats
    start_turns: Floats
    masses: Floats
    bodies: tuple[str, ...]
    hinges: tuple[str, ...]
    duration: float
    heading: Floats
    energy: Any

    @classmethod
    def of(
        cls,
        robot: "ArticulatedRobot",
        position: Any,
        orientation: Any,
        angles: Any,
        tree: Tree | None = None,
        work: Any = None,
    ) -> "RigidMotion":
        """Make a motion from the bases' places (B, 3) [m] and orientations (B, 4), and hinge angles (B, H) [rad].

        ``tree`` is that of the robots, by default the robot's own, and ``work`` that of all drives (B,) [J].
        """
        tree = robot.tree if tree is None else tree
        names = tuple(body.name for body, _ in tree.ordered), tuple(hinge.child for hinge in tree.hinges)
        places, turns = poses(tree, position, orientation, angles)
        start, still = np.array(tree.ordered[0][0].position, float), np.array([1.0, 0.0, 0.0, 0.0])
        begin = poses(tree, start, still, np.zeros(len(tree.hinges)))
        time = robot.steps * robot.physics.time_step
        told = sealed(angles) + np.array([hinge.rest for hinge in tree.hinges])
        energy = np.full(len(position), np.nan) if work is None else work
        return cls(places, turns, told, *begin, tree.masses, *names, time, robot.direction, sealed(energy))

    @property
    def began(self) -> Floats:
        """Where the bodies are at the start, as ``SoftMotion`` calls it: ``start_places``."""
        return self.start_places

    @property
    def ended(self) -> Any:
        """Where the bodies are at the end, as ``SoftMotion`` calls it: ``places``."""
        return self.places

    def centres(self, places: Any) -> Any:
        """Compute centres of mass [m], shape (..., 3), from the bodies' places, shape (..., N, 3)."""
        return (places * (self.masses / self.masses.sum())[:, None]).sum(axis=-2)


def own_measure_values(
    robot: "ArticulatedRobot", own: OwnMeasure, run: RigidResult, tree: Tree | None = None
) -> Floats:
    """A measure of a user's own of what robots came to, shape (B,); NaN of those that diverged."""
    motion = RigidMotion.of(robot, run.position, run.orientation, run.angles, tree, run.work)
    found = own.values(motion, len(run.status))
    return np.where(run.status == "ok", found, np.nan)


def slopes_of(
    robot: "ArticulatedRobot", own: OwnMeasure, run: RigidResult, tree: Tree | None = None
) -> dict[str, Floats]:
    """Derivatives of a measure of a user's own by what is known of a run, as a tape takes."""

    def measured(position: Any, orientation: Any, angles: Any, work: Any) -> Any:
        return own.values(RigidMotion.of(robot, position, orientation, angles, tree, work), len(run.status))

    _, pull = trace(measured, *(np.nan_to_num(getattr(run, name)) for name in ENDED))
    return dict(zip(ENDED, pull((run.status == "ok").astype(float)), strict=True))
