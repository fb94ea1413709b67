"""A kind of robot that a user's package could add: a mass on a spring leg, with one joint that pushes it off."""

from dataclasses import dataclass

import numpy as np

from robots.robot import Measure, Outcome, Parameter, Robot, RobotKind
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
    differentiable = True

    @property
    def steps(self):
        return round(self.seconds / TIME_STEP)

    def run(self, points, trial):
        """Euler's method, symplectic; the joint stretches the leg at once. Gradients are central differences."""
        stiffness, stroke = points.T
        path, velocity = [np.zeros(len(points))], np.zeros(len(points))
        for _ in range(self.steps):
            push = np.where(path[-1] < stroke, stiffness * (stroke - path[-1]), 0.0)
            velocity = velocity + (push / self.mass - GRAVITY) * TIME_STEP
            path.append(np.maximum(path[-1] + velocity * TIME_STEP, 0.0))
            velocity = np.where(path[-1] > 0, velocity, 0.0)
        slopes = []
        for h in np.diag([1e-3, 1e-7]) if trial.gradients else ():
            up, down = (self.simulate(moved, trial.world).measures["height"] for moved in (points + h, points - h))
            slopes.append((up - down) / (2 * h.sum()))
        measures = {"height": np.max(path, axis=0), "energy": 0.5 * stiffness * stroke**2}
        gradients = {"height": np.stack(slopes, axis=1)} if slopes else {}
        return Outcome(measures, gradients=gradients, result=np.array(path)[:: trial.record_every or 1])

    def motion(self, outcome, world, name):
        """A cube that jumps."""
        path = np.stack([0 * outcome.result, 0 * outcome.result, outcome.result], axis=-1)
        turns, sizes = np.tile([1.0, 0, 0, 0], (len(path), 1, 1)), np.full(path.shape, 0.1)
        nodes, times = (Node("mass", CUBE, (0.2, 0.4, 0.7)),), np.arange(len(path)) * self.seconds / len(path)
        return Motion(name, times, nodes, path, turns, sizes, path[:, 0])

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
