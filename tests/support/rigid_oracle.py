"""A second implementation of the rigid engine's step, slow and plain: explicit Jacobians, dense matrices, pivoting.

It shares descriptions (``Tree``, ``Physics``) with the engine and nothing else. A body's velocity is J u, u being that
of the base and the rates of hinges. The impulse of a motor, its stops or a normal falls in stairs as its rate grows: a
motor's at the rate that it wants, from all its strength one way to all of it the other way; a stop's at the rate that
leads no farther than to it, from any impulse to none; a normal's likewise, on sand from an upper bound. In each phase
of a step these rates and impulses are found together, and exactly.
"""

import numpy as np
from sand_surface import of_point
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Hinge

COMPLIANCE, ROUNDING = 2e-9, 1e-13  # s/kg, of normals, as in the engine in f64
REPETITIONS = 8  # of friction in its cone
EARTH = 9.81  # m/s^2, of the fall that the ground lifts a point from at most
MOST_PIVOTS = 3000


def complementarity(matrix, free, stairs):
    """Solve r = A x + free, x falling down its row's stairs as r grows; by pivoting: all wrong rows, or the last.

    Args:
        matrix: A, positive definite.
        free: what r is without x.
        stairs: of each row, by rising rate: (rate, impulse below it, impulse above it).

    Raises:
        RuntimeError: if no solution is found.
    """
    rows, most = np.arange(len(stairs)), max(map(len, stairs), default=0)
    rates, levels = np.full((len(stairs), most + 2), np.inf), np.zeros((len(stairs), most + 1))
    rates[:, 0] = -np.inf
    for row, each in enumerate(stairs):
        rates[row, 1 : len(each) + 1] = [rate for rate, *_ in each]
        levels[row, : len(each) + 1] = [each[0][1], *(above for *_, above in each)]
    # Where a row is: an even number for a tread, on which the impulse is given, an odd one for a rise, at a given rate.
    place, fewest, patience = np.array([len(each) for each in stairs], int), len(stairs) + 1, 5
    for _ in range(MOST_PIVOTS):
        step, rises = place // 2, place % 2 == 1
        x, lower, upper = levels[rows, step], rates[rows, step], rates[rows, step + 1]
        given = upper[rises] - free[rises] - matrix[np.ix_(rises, ~rises)] @ x[~rises]
        x[rises] = np.linalg.solve(matrix[np.ix_(rises, rises)], given)
        r = matrix @ x + free
        back = np.where(rises, x > levels[rows, step] + ROUNDING, r < lower - ROUNDING)
        ahead = np.where(rises, x < levels[rows, np.minimum(step + 1, most)] - ROUNDING, r > upper + ROUNDING)
        wrong = np.nonzero(back | ahead)[0]
        if len(wrong) == 0:
            return x
        patience, fewest = 5 if len(wrong) < fewest else patience - 1, min(fewest, len(wrong))
        changing = wrong if patience >= 0 else wrong[-1:]
        place[changing] += ahead[changing].astype(int) - back[changing]
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
        total = masses.sum() or 1.0  # of a base alone that is fixed and has no mass
        centre, going = (floats * x.sum(0) / total for x in (masses * places, linear))
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
        pushes, rows, stairs = self.hinges(commands)
        u = self.respond(matrix, momenta + pushes, rows, stairs, contacts, rotations, drift)
        self.carry(places, inertias, jacobians @ u)
        self.velocities[:, 3:] -= push_out * drift
        self.own = self.own + h * self.velocities[:, 3:]
        w, q = u[:3], self.orientation
        moved = q + h / 2 * np.array([-w @ q[1:], *(q[0] * w + np.cross(w, q[1:]))])
        self.orientation = moved / np.linalg.norm(moved)
        self.position, self.angles = self.position + h * u[3:6], self.angles + h * u[6:]

    def respond(self, matrix, right, rows, stairs, contacts, rotations, drift):
        """Velocities that momenta and pushes lead to, with rows of hinges, each with its stairs, and contacts."""
        h, push_out = self.world.time_step, self.world.error_reduction / self.world.time_step
        for depth, b, *_ in contacts if self.yield_per_depth is None else ():
            lifted = min(push_out * depth, np.sqrt(2 * EARTH * depth))  # no faster than after a fall through the depth
            stairs.append([(lifted + push_out * drift[b, 2], np.inf, 0.0)])
        for each in contacts if self.yield_per_depth is not None else ():
            limit = h * self.yield_per_depth * self.surface(each, rotations, [0, 0, -1])
            stairs.append([(push_out * drift[each[1], 2], limit, 0.0)])
        rows = np.array(rows + [motion[2] for *_, motion, _ in contacts]).reshape(-1, len(right))
        slides = [(motion[:2], push_out * drift[b, :2]) for _, b, motion, _ in contacts]
        ploughs = [lambda way, each=each: self.ploughing(each, rotations, way) for each in contacts]
        return self.solve(matrix, right, rows, stairs, slides, ploughs)

    def hinges(self, commands):
        """Impulses beside rows; rows of hinges, each with its stairs."""
        unit = np.eye(6 + len(self.angles))
        pushes, rows, stairs = np.zeros(len(unit)), [], []
        for n, (joint, angle) in enumerate(zip(self.tree.hinges, self.angles, strict=True), 6):
            motor, stops = joint.motor, joint.stops or (-np.inf, np.inf)
            wanted, strength = 0.0, 0.0
            if motor is not None:
                wanted = motor.by_command * commands[joint.command] + motor.by_angle * angle + motor.offset
                fastest = np.inf if motor.fastest is None else motor.fastest
                wanted, strength = np.clip(wanted, -fastest, fastest), self.world.time_step * motor.torque
            if self.world.integration == "velocity":
                pushes[n], own = self.studied(angle, wanted, strength, *stops)
            else:
                own = self.stopped(angle, wanted, strength, *stops)
            if own:
                rows.append(unit[n])
                stairs.append(own)
        return pushes, rows, stairs

    def stopped(self, angle, wanted, strength, lower, upper):
        """Stairs of a hinge: stops keep its rate within what leads no farther than to them."""
        back, at_once = self.world.error_reduction / self.world.time_step, 1 / self.world.time_step
        least = (lower - angle) * (back if angle <= lower else at_once)
        most = (upper - angle) * (back if angle >= upper else at_once)
        every = [(least, np.inf, strength), (np.clip(wanted, least, most), strength, -strength)]
        stairs = []
        for rate, below, above in [*every, (most, -strength, -np.inf)]:
            if stairs and rate == stairs[-1][0]:  # one stair as high as both
                stairs[-1] = rate, stairs[-1][1], above
            elif np.isfinite(rate) and below > above:
                stairs.append((rate, below, above))
        return stairs

    def studied(self, angle, wanted, strength, lower, upper):
        """Impulse beside the row and stairs of a hinge in the studies: stops act once they are passed."""
        back = self.world.error_reduction / self.world.time_step
        if not lower < angle < upper:
            push = strength if wanted > 0 or (wanted == 0 and angle >= upper) else -strength
            at_lower = [(back * (lower - angle), np.inf, 0.0)]
            return push, at_lower if angle <= lower else [(back * (upper - angle), 0.0, -np.inf)]
        return 0.0, [(wanted, strength, -strength)] if strength else []

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

    def solve(self, matrix, right, rows, stairs, slides, ploughs):
        """Velocities: first without friction, then with that of points that push; Coulomb's by repetition."""
        normals = np.arange(len(rows) - len(slides), len(rows))
        highest = np.array([stairs[n][0][1] for n in normals])
        soft = COMPLIANCE * (np.arange(len(rows)) >= len(rows) - len(slides))
        free = slice(6 * self.tree.fixed, None)
        strength, self.excess = np.zeros(len(slides)), 0.0
        for phase in range(1 if not slides else 2 if np.isinf(self.world.friction) else REPETITIONS):
            inertia = matrix + sum(s * motion.T @ motion for s, (motion, _) in zip(strength, slides, strict=True))
            drive = right + sum(s * motion.T @ slip for s, (motion, slip) in zip(strength, slides, strict=True))
            inverse = np.zeros_like(matrix)
            inverse[free, free] = np.linalg.inv(inertia[free, free])
            system = rows @ inverse @ rows.T + np.diag(soft)
            impulses = complementarity(system, rows @ inverse @ drive, stairs)
            u = inverse @ (drive + rows.T @ impulses)
            sliding = [motion @ u - slip for motion, slip in slides]
            speeds = np.array([np.linalg.norm([*each, 1e-6]) for each in sliding])
            self.saturated += int(((impulses[normals] == highest) & (highest > 0)).sum())
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
