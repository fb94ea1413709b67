"""A kind of robot that a user's package could add: a mass on a spring leg, with one joint that pushes it off."""

from dataclasses import dataclass

import numpy as np

from robots.robot import Measure, Outcome, Parameter, Replay, Robot, RobotKind
from robots.view.motion import CUBE, Motion, Node
from taichi_sim.base.options import options_of

GRAVITY, TIME_STEP = 9.81, 2e-3  # m/s^2, s


@dataclass(frozen=True)
class Hopper(Robot):
    """One joint stretches the leg by a stroke, at a rate, while the foot is on the ground."""

    mass: float = 1.0
    seconds: float = 1.0

    kind = "hopper"
    measures = (Measure("height", "m", "highest jump"), Measure("energy", "J", "work of the joint"))
    parameters = (Parameter("stiffness", 200.0, 2000.0, step=100.0), Parameter("stroke", 0.0, 0.1, step=0.01))
    horizons = (1, 2)

    def simulate(self, points, world, *, compute=None, record_every=None, progress=None):
        """Euler's method, symplectic; the joint stretches the leg at once."""
        stiffness, stroke = self.points(points).T
        height = velocity = np.zeros(len(stiffness))
        path = [height]
        for _ in range(round(self.seconds / TIME_STEP)):
            push = np.where(height < stroke, stiffness * (stroke - height), 0.0)
            velocity = velocity + (push / self.mass - GRAVITY) * TIME_STEP
            height = np.maximum(height + velocity * TIME_STEP, 0.0)
            velocity = np.where(height > 0, velocity, 0.0)
            path.append(height)
        measures = {"height": np.max(path, axis=0), "energy": 0.5 * stiffness * stroke**2}
        return Outcome(measures, result=np.array(path)[:: record_every or 1])

    def differentiate(self, points, world, **settings):
        """Central differences, which is all that this robot needs."""
        points = self.points(points)
        height = lambda moved: self.simulate(moved, world).measures["height"]  # noqa: E731
        slopes = [(height(points + h) - height(points - h)) / (2 * h.sum()) for h in np.diag([1e-3, 1e-7])]
        return Outcome(self.simulate(points, world).measures, gradients={"height": np.stack(slopes, axis=1)})

    def replay(self, point, world, *, frames=1000, name="", compute=None, progress=None):
        """A cube that jumps."""
        outcome = self.simulate(point, world, record_every=max(1, round(self.seconds / TIME_STEP / frames)))
        path = np.stack([0 * outcome.result, 0 * outcome.result, outcome.result], axis=-1)
        turns, sizes = np.tile([1.0, 0, 0, 0], (len(path), 1, 1)), np.full(path.shape, 0.1)
        nodes, times = (Node("mass", CUBE, (0.2, 0.4, 0.7)),), np.arange(len(path)) * self.seconds / len(path)
        return Replay(outcome, Motion(name, times, nodes, path, turns, sizes, path[:, 0]))

    def at_horizon(self, length):
        """The hopper for so many seconds."""
        return f"{length} s", Hopper(self.mass, float(length))


class HopperKind(RobotKind):
    """Makes hoppers of their options."""

    title = "one-joint hopper"
    options = options_of(Hopper, mass="of the body, in kg", seconds="of a trial")

    def build(self, source, options):
        """The hopper of some options."""
        return Hopper(**options)
