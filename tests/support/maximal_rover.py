"""The two-wheel vehicle in maximal coordinates, as the solver of the published experiment has it (ODE, dWorldStep).

Every body has a position and a rotation of its own; hinges are rows of a linear system and pull back what drifts off
them. One vehicle, slowly: a reference that shows what the reduced coordinates leave out, the drift of hinges' axes.
Source: Smith, Open Dynamics Engine user guide, "Joint error and the error reduction parameter" and "How joints work".
"""

import math

import numpy as np

from robots.rover import GRAVITY, LIGHT_HEIGHT, SLIP, TIME_STEP, Rover
from taichi_sim.autodiff import rotations
from taichi_sim.rigid import Hinge
from taichi_sim.rigid.pose import rotation_matrix

CORRECTION = 0.2 / TIME_STEP  # 1/s, part of an error undone in a second
SOFTNESS = 1e-10 / TIME_STEP


def product(a, b):
    return np.array(rotations.multiply(*a, *b))


def across(axis):
    """Two unit vectors that complete an axis."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


class MaximalRover:
    """A vehicle with weights (w1, w2) and a light at (x, y)."""

    def __init__(self, rover: Rover, weights, light, drifting: bool = True) -> None:
        """Begin at rest; without ``drifting`` all rotations follow the box."""
        tree = rover.tree()
        self.weights, self.light, self.drifting = weights, np.array([*light, LIGHT_HEIGHT]), drifting
        self.bodies, self.joints = tree.bodies, tree.joints
        self.names = [body.name for body in self.bodies]
        self.rest = np.array([body.position for body in self.bodies], float)
        self.masses = np.array([body.mass for body in self.bodies])
        self.places, self.turns = self.rest.copy(), np.tile([1.0, 0, 0, 0], (len(self.bodies), 1))
        self.velocity = np.zeros((len(self.bodies), 6))  # linear, then angular
        self.closest, self.pushed = math.inf, {}  # motors at their limit and which way they push

    def row(self, **parts):
        """A row of the system: what the velocity of bodies (by number, ``b0``, ``b1``, ...) adds."""
        found = np.zeros((len(self.bodies), 6))
        for name, (linear, angular) in parts.items():
            found[int(name[1:])] = [*linear, *angular]
        return found.ravel()

    def look(self):
        """Readings of both sensors."""
        self.closest = min(self.closest, math.hypot(*(self.places[0] - self.light)[:2]))
        return [1 / np.sum((self.light - self.places[self.names.index(s)]) ** 2) for s in ("sensor 1", "sensor 2")]

    def step(self):
        """One time step."""
        seen = self.look()
        commands = [math.tanh(w * s) for w, s in zip(self.weights[::-1], seen[::-1], strict=True)]  # left, right
        matrices = [rotation_matrix(q) for q in self.turns]
        inertias = [r @ body.inertia @ r.T for r, body in zip(matrices, self.bodies, strict=True)]
        size = 6 * len(self.bodies)
        inverse, force = np.zeros((size, size)), np.zeros((len(self.bodies), 6))
        for b, (mass, inertia) in enumerate(zip(self.masses, inertias, strict=True)):
            inverse[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = np.eye(3) / mass
            inverse[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = np.linalg.inv(inertia)
            w = self.velocity[b, 3:]
            force[b] = [0, 0, mass * GRAVITY, *-np.cross(w, inertia @ w)]
        rows, motors = self._rows(matrices, commands)
        jacobian, wanted, softness = (np.array(x) for x in zip(*rows, strict=True))
        matrix = jacobian @ inverse @ jacobian.T + np.diag(softness)
        start = self.velocity.ravel() / TIME_STEP + inverse @ force.ravel()
        impulses = self._solve(matrix, wanted / TIME_STEP - jacobian @ start, motors)
        self.velocity += TIME_STEP * (inverse @ (force.ravel() + jacobian.T @ impulses)).reshape(-1, 6)
        self.places += TIME_STEP * self.velocity[:, :3]
        for b, w in enumerate(self.velocity[:, 3:]):
            turned = self.turns[b] + TIME_STEP / 2 * product([0, *w], self.turns[b])
            self.turns[b] = turned / np.linalg.norm(turned)
        if not self.drifting:
            self.turns[:] = self.turns[0]

    def _rows(self, matrices, commands):
        """Rows with the velocity each wants and its softness; torques of motors by the number of their row."""
        rows, motors, nothing = [], {}, np.zeros(3)
        for joint in self.joints:
            hinged = isinstance(joint, Hinge)
            a, b = self.names.index(joint.child), self.names.index(joint.parent)
            anchor = np.array(joint.anchor if hinged else (0, 0, 0), float)  # the published sensors hang at the origin
            arms = [matrices[n] @ (anchor - self.rest[n]) for n in (a, b)]
            gap = self.places[b] + arms[1] - self.places[a] - arms[0]
            for u, error in zip(np.eye(3), gap, strict=True):
                parts = {f"b{a}": (u, np.cross(arms[0], u)), f"b{b}": (-u, -np.cross(arms[1], u))}
                rows.append((self.row(**parts), CORRECTION * error, SOFTNESS))
            at_rest = np.array(joint.axis if hinged else (0, 0, 1), float)
            axis, other = matrices[a] @ at_rest, matrices[b] @ at_rest
            for u in across(axis):
                twist = self.row(**{f"b{a}": (nothing, u), f"b{b}": (nothing, -u)})
                rows.append((twist, CORRECTION * np.cross(axis, other) @ u, SOFTNESS))
            about = self.row(**{f"b{a}": (nothing, axis), f"b{b}": (nothing, -axis)})
            if not hinged:
                relative = product(self.turns[a] * [1, -1, -1, -1], self.turns[b])
                rows.append((about, CORRECTION * 2 * math.atan2(relative[1:] @ at_rest, relative[0]), SOFTNESS))
            elif joint.motor is not None:
                motors[len(rows)] = joint.motor.torque
                rows.append((about, joint.motor.by_command * commands[joint.command], SOFTNESS))
        for n, (body, place) in enumerate(zip(self.bodies, self.places, strict=True)):
            if n and body.shapes and place[2] <= body.shapes[0].radius:  # balls; the box stays above the ground
                radius = body.shapes[0].radius
                for u, wanted, softness in (
                    (2, CORRECTION * (radius - place[2]), SOFTNESS),
                    (0, 0, SLIP / TIME_STEP),
                    (1, 0, SLIP / TIME_STEP),
                ):
                    along = np.eye(3)[u]
                    rows.append((self.row(**{f"b{n}": (along, np.cross([0, 0, -radius], along))}), wanted, softness))
        return rows, motors

    def _solve(self, matrix, right, motors):
        """Forces of all rows; a motor that cannot hold its rate pushes with all its torque."""
        for _ in range(20):
            forces, free = np.zeros(len(right)), np.ones(len(right), bool)
            for r, way in self.pushed.items():
                free[r], forces[r] = False, way * motors[r]
            known = matrix[np.ix_(free, ~free)] @ forces[~free]
            forces[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free] - known)
            late = matrix @ forces - right
            before = dict(self.pushed)
            for r, torque in motors.items():
                if r in before and late[r] * before[r] > 1e-12:
                    del self.pushed[r]
                elif r not in before and abs(forces[r]) > torque:
                    self.pushed[r] = math.copysign(1, forces[r])
            if self.pushed == before:
                return forces
        raise AssertionError("motors do not settle")
