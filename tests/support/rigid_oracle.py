"""A second implementation of the rigid engine's step, slow and plain: explicit Jacobians, dense matrices, pivoting.

It shares descriptions (``Tree``, ``World``) with the engine and nothing else. A body's velocity is J u, u being that
of the base and the rates of hinges; what motors, stops and normals ask of u is a linear complementarity problem. On
sand normals have an upper bound, too.
"""

import numpy as np
from sand_surface import of_point
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Hinge

COMPLIANCE, ROUNDING = 2e-9, 1e-12  # s/kg, of normals, as in the engine in f64
REPETITIONS = 8  # of friction in its cone
ROUNDS = 20


def complementarity(matrix, right, low, high):
    """Solve r = A x - b with x at its lower bound where r > 0, at its upper where r < 0, else r = 0; by pivoting."""
    side, fewest, patience = np.zeros(len(right), int), len(right) + 1, 5  # -1: at the lower bound, 1: at the upper
    for _ in range(1000):
        x, free = np.choose(side + 1, [low, np.zeros_like(low), high]), side == 0
        x[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free] - matrix[np.ix_(free, ~free)] @ x[~free])
        excess = matrix @ x - right
        after = np.where((side < 0) & (excess < -ROUNDING) | (side > 0) & (excess > ROUNDING), 0, side)
        after[free & (x < low - ROUNDING)], after[free & (x > high + ROUNDING)] = -1, 1
        wrong = np.nonzero(after != side)[0]
        if len(wrong) == 0:
            return x
        patience, fewest = 5 if len(wrong) < fewest else patience - 1, min(fewest, len(wrong))
        changing = wrong if patience >= 0 else wrong[-1:]
        side[changing] = after[changing]
    raise RuntimeError("no solution of a complementarity problem was found")


class Oracle:
    """One robot, step by step; ``position``, ``orientation`` and ``angles`` are where it is."""

    def __init__(self, tree, world, start, yield_per_depth=None):
        self.tree, self.world, self.yield_per_depth, self.saturated = tree, world, yield_per_depth, 0
        self.position, self.orientation, self.angles = start.position[0], start.orientation[0], start.angles[0]
        self.masses = np.array([body.mass for body, _ in tree.ordered])
        rotations, places, jacobians = self.kinematics()
        self.own = places  # of bodies that may drift off their hinges
        self.carry(places, self.inertias(rotations), jacobians @ np.append(start.velocity[0], start.rates[0]))

    def kinematics(self):
        """Rotations, centres and Jacobians (angular, then linear) of all bodies."""
        rotations = [Rotation.from_quat(self.orientation, scalar_first=True).as_matrix()]
        places, hinge = [self.position], 6
        jacobians = np.zeros((len(self.tree.bodies), 6, 6 + len(self.angles)))
        jacobians[0, :, :6] = np.eye(6)
        for b, parent in list(enumerate(self.tree.parents))[1:]:
            (body, joint), jacobian, turned = self.tree.ordered[b], jacobians[b], rotations[parent]
            arm = turned @ np.subtract(body.position, self.tree.ordered[parent][0].position)
            if isinstance(joint, Hinge):
                axis = turned @ joint.axis / np.linalg.norm(joint.axis)
                lever = turned @ np.subtract(body.position, joint.anchor)
                turn = Rotation.from_rotvec(axis * self.angles[hinge - 6]).as_matrix()
                arm, turned = arm - lever + turn @ lever, turn @ turned
                jacobian[:, hinge], hinge = [*axis, *np.cross(axis, turn @ lever)], hinge + 1
            rotations.append(turned)
            places.append(places[parent] + arm)
            jacobian[:3] += jacobians[parent, :3]
            jacobian[3:] += jacobians[parent, 3:] + np.cross(jacobians[parent, :3].T, arm).T
        return np.array(rotations), np.array(places), jacobians

    def inertias(self, rotations):
        return rotations @ [body.inertia for body, _ in self.tree.ordered] @ rotations.transpose(0, 2, 1)

    def carry(self, places, inertias, velocities):
        """What goes into the next step: velocities, or momenta and their moments relative to the centre of mass."""
        linear, spin = self.masses[:, None] * velocities[:, 3:], np.einsum("bij,bj->bi", inertias, velocities[:, :3])
        self.velocities, self.momenta = velocities, (spin + self.moments(places, linear), linear)

    def moments(self, places, linear):
        """Of momenta; where the base floats, about the centre of mass of those relative to it."""
        floats, masses = not self.tree.fixed, self.masses[:, None]
        centre, going = (floats * x.sum(0) / masses.sum() for x in (masses * places, linear))
        return np.cross(places - centre, linear - masses * going)

    def step(self, commands):
        """One time step with these commands to the motors."""
        h, by_velocity = self.world.time_step, self.world.integration == "velocity"
        push_out = self.world.error_reduction / h
        rotations, places, jacobians = self.kinematics()
        inertias, drift = self.inertias(rotations), by_velocity * (self.own - places)
        drift[0] = 0
        if by_velocity:
            turning = self.velocities[:, :3]
            spin = np.einsum("bij,bj->bi", inertias, turning)
            spin = spin - h * np.cross(turning, spin)
            linear = self.masses[:, None] * (self.velocities[:, 3:] + push_out * drift)
        else:
            spin, linear = self.momenta[0] - self.moments(places, self.momenta[1]), self.momenta[1]
        linear = linear + h * self.world.gravity * np.outer(self.masses, [0, 0, 1])
        matrix = np.einsum("bij,bik,bkl->jl", jacobians[:, :3], inertias, jacobians[:, :3])
        matrix += np.einsum("bij,b,bil->jl", jacobians[:, 3:], self.masses, jacobians[:, 3:])
        momenta = np.einsum("bij,bi->j", jacobians, np.hstack([spin, linear]))
        contacts = self.contacts(rotations, places + drift, jacobians)
        held = {}  # stops that hold, by hinge: 1 the lower, -1 the upper one
        for _ in range(ROUNDS):
            pushes, rows, demands, ranges = self.hinges(commands, held)
            u = self.respond(matrix, momenta + pushes, rows, demands, contacts, rotations, drift)
            fits = {n: self.fitting(u[n], held.get(n, 0), *each) for n, each in ranges.items()}
            fits = {n: side for n, side in fits.items() if side}
            if fits == held:
                break
            held = fits
        self.carry(places, inertias, jacobians @ u)
        self.velocities[:, 3:] -= push_out * drift
        self.own = self.own + h * self.velocities[:, 3:]
        w, q = u[:3], self.orientation
        moved = q + h / 2 * np.array([-w @ q[1:], *(q[0] * w + np.cross(w, q[1:]))])
        self.orientation = moved / np.linalg.norm(moved)
        self.position, self.angles = self.position + h * u[3:6], self.angles + h * u[6:]

    def respond(self, matrix, right, rows, demands, contacts, rotations, drift):
        """Velocities that momenta and pushes lead to, with rows of hinges, each with its demand, and contacts."""
        h, push_out = self.world.time_step, self.world.error_reduction / self.world.time_step
        if self.yield_per_depth is None:
            demands += [(push_out * (depth + drift[b, 2]), 0.0, np.inf) for depth, b, *_ in contacts]
        else:
            limits = [h * self.yield_per_depth * self.surface(each, rotations, [0, 0, -1]) for each in contacts]
            demands += [
                (push_out * drift[each[1], 2], 0.0, limit) for each, limit in zip(contacts, limits, strict=True)
            ]
        rows = np.array(rows + [motion[2] for *_, motion, _ in contacts]).reshape(-1, len(right))
        slides = [(motion[:2], push_out * drift[b, :2]) for _, b, motion, _ in contacts]
        ploughs = [lambda way, each=each: self.ploughing(each, rotations, way) for each in contacts]
        return self.solve(matrix, right, rows, np.array(demands).reshape(-1, 3).T, slides, ploughs)

    def fitting(self, rate, side, wanted, least, most):
        """Which stop of a hinge should hold at a rate: 1 the lower, -1 the upper, 0 none; ``side`` is what held."""
        if side:
            return side if side * (rate - np.clip(wanted, least, most)) < 1e-12 else 0
        return int(rate < least - 1e-12) - int(rate > most + 1e-12)

    def hinges(self, commands, held):
        """Impulses of motors at stops; rows of motors and stops, each with its rate, lowest and highest impulse.

        Beside them the rate that each hinge's motor wants, and the least and largest that its stops allow.
        """
        h, unit = self.world.time_step, np.eye(6 + len(self.angles))
        pushes, rows, demands, ranges = np.zeros(len(unit)), [], [], {}
        for n, (joint, angle) in enumerate(zip(self.tree.hinges, self.angles, strict=True), 6):
            motor, (lower, upper) = joint.motor, joint.stops or (-np.inf, np.inf)
            wanted, strength = 0.0, 0.0
            if motor is not None:
                wanted = motor.by_command * commands[joint.command] + motor.by_angle * angle + motor.offset
                strength = h * motor.torque
            back = self.world.error_reduction / h
            if self.world.integration != "velocity":
                least = (lower - angle) * (back if angle <= lower else 1 / h)
                most = (upper - angle) * (back if angle >= upper else 1 / h)
                ranges[n], side = (wanted, least, most), held.get(n, 0)
                pushes[n] = side * strength
                if side:
                    demands.append((least, 0.0, np.inf) if side > 0 else (most, -np.inf, 0.0))
                elif strength:
                    demands.append((np.clip(wanted, least, most), -strength, strength))
                if side or strength:
                    rows.append(unit[n])
            elif angle <= lower or angle >= upper:
                pushes[n] = strength if wanted > 0 or (wanted == 0 and angle >= upper) else -strength
                rate = back * ((lower if angle <= lower else upper) - angle)
                demands.append((rate, 0.0, np.inf) if angle <= lower else (rate, -np.inf, 0.0))
                rows.append(unit[n])
            elif strength:
                demands.append((wanted, -strength, strength))
                rows.append(unit[n])
        return pushes, rows, demands, ranges

    def contacts(self, rotations, places, jacobians):
        """Depth, body, Jacobian and number of each point on the ground."""
        levers = [(b, rotations[b] @ centre - [0, 0, radius]) for b, centre, radius in self.tree.points()]
        return [
            (-(places[b] + lever)[2], b, jacobians[b, 3:] + np.cross(jacobians[b, :3].T, lever).T, i)
            for i, (b, lever) in enumerate(levers)
            if (places[b] + lever)[2] <= 0
        ]

    def surface(self, contact, rotations, way):
        """Integral over the surface of a point of depth by cos^2 from a way."""
        depth, b, _, i = contact
        owners = [(s, n) for body, _ in self.tree.ordered for s in body.shapes for n in range(len(s.points()))]
        return of_point(*owners[i], rotations[b], depth, np.array(way))

    def ploughing(self, contact, rotations, sliding):
        """What ploughing adds to the largest impulse of friction of a point that slides so."""
        if self.yield_per_depth is None:
            return 0.0
        way = [*(sliding / np.linalg.norm([*sliding, 1e-10])), 0.0]
        return 0.37 * self.world.time_step * self.yield_per_depth * self.surface(contact, rotations, way)

    def solve(self, matrix, right, rows, demands, slides, ploughs):
        """Velocities: first without friction, then with that of points that push; Coulomb's by repetition."""
        (rates, low, high), normals = demands, np.arange(len(rows) - len(slides), len(rows))
        soft = COMPLIANCE * (np.arange(len(rows)) >= len(rows) - len(slides))
        free = slice(6 * self.tree.fixed, None)
        strength, self.excess = np.zeros(len(slides)), 0.0
        for phase in range(1 if not slides else 2 if np.isinf(self.world.friction) else REPETITIONS):
            inertia = matrix + sum(s * motion.T @ motion for s, (motion, _) in zip(strength, slides, strict=True))
            drive = right + sum(s * motion.T @ slip for s, (motion, slip) in zip(strength, slides, strict=True))
            inverse = np.zeros_like(matrix)
            inverse[free, free] = np.linalg.inv(inertia[free, free])
            system = rows @ inverse @ rows.T + np.diag(soft)
            impulses = complementarity(system, rates - rows @ inverse @ drive, low, high)
            u = inverse @ (drive + rows.T @ impulses)
            sliding = [motion @ u - slip for motion, slip in slides]
            speeds = np.array([np.linalg.norm([*each, 1e-6]) for each in sliding])
            self.saturated += int(((impulses == high) & (high > 0) & (low == 0))[normals].sum())
            most = self.world.time_step / self.world.slip
            if np.isinf(self.world.friction):
                strength = np.where(impulses[normals] > 0, most, 0.0)
                continue
            largest = self.world.friction * np.maximum(impulses[normals], 0)
            largest += [plough(each) for plough, each in zip(ploughs, sliding, strict=True)]
            lawful = np.minimum(largest / speeds, most)  # no more than the cone allows at the speed that is left
            self.excess = float(np.abs(strength - lawful).max(initial=0.0) / most)
            if phase == 0:
                strength, free_speeds = lawful, speeds
                continue
            slide = (strength > 0) & (strength < most)
            together = largest[slide].sum() / max((strength * speeds)[slide].sum(), 1e-20)
            share = np.where(strength < most, together, largest / np.maximum(strength * speeds, 1e-20))
            left = np.where(strength > 0, free_speeds - share * np.maximum(free_speeds - speeds, 0), speeds)
            strength = np.minimum(largest / np.maximum(left, 1e-20), most)
        return u
