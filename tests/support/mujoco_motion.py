"""How a robot of an MJCF text moves in MuJoCo and in the lab: energies, inertias and accelerations at the same pose."""

import re
from dataclasses import replace

import mujoco
import numpy as np
from mujoco_reading import Pair
from rigid_oracle import Oracle
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Motor, Physics, RigidEngine, State, Tree

STEP = 1e-3  # s, of accelerations, which do not depend on it
_OWN_FORCES = re.compile(r' (armature|frictionloss|damping|stiffness|gravcomp)="[^"]*"')
OFF = ("CONTACT", "LIMIT", "ACTUATION")


def plain(text):
    """An MJCF text without what the lab ignores of it and names: forces of joints, and what lifts bodies."""
    return _OWN_FORCES.sub("", text)


class Pose:
    """A random pose and velocity of a robot, in the lab's coordinates and in MuJoCo's."""

    def __init__(self, pair: Pair, rng):
        self.pair, self.tree, self.theirs, self.data = pair, pair.tree, pair.theirs, pair.data
        hinges, position, turn = len(self.tree.hinges), np.array(self.tree.bodies[0].position), Rotation.identity()
        angles = rng.uniform(-1.5, 1.5, hinges)
        for hinge, angle in zip(self.tree.hinges, angles, strict=True):
            number = pair.joint_of[hinge.child]
            self.data.qpos[self.theirs.jnt_qposadr[number]] = pair.rests[hinge.child] + angle
        if not self.tree.fixed:
            own = Rotation.from_quat(self.theirs.qpos0[3:7], scalar_first=True)
            turn, arm = Rotation.from_quat(rng.normal(size=4)), self.theirs.qpos0[:3] - position
            position = position + rng.uniform(-1, 1, 3)
            self.data.qpos[:3] = position + turn.apply(arm)
            self.data.qpos[3:7] = (turn * own).as_quat(scalar_first=True)
        velocity, rates = (0.0 if self.tree.fixed else 1.0) * rng.normal(size=(1, 6)), rng.normal(size=(1, hinges))
        self.state = State(position[None], turn.as_quat(scalar_first=True)[None], angles[None], velocity, rates)
        self.moving = slice(6 * self.tree.fixed, None)  # of the lab's coordinates
        self.data.qvel[:] = self.to_theirs() @ np.append(velocity, rates)[self.moving]
        self.theirs.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        for name in OFF:
            self.theirs.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")
        mujoco.mj_forward(self.theirs, self.data)
        self.oracle = Oracle(self.tree, pair.model.world, self.state)

    def to_theirs(self):
        """Matrix that takes the lab's velocities (turning, centre of the base, hinges) to MuJoCo's."""
        places = [int(self.theirs.jnt_dofadr[self.pair.joint_of[hinge.child]]) for hinge in self.tree.hinges]
        free = 0 if self.tree.fixed else 6
        matrix = np.zeros((self.theirs.nv, free + len(places)))
        matrix[places, free + np.arange(len(places))] = 1.0
        if free:
            arm = self.data.qpos[:3] - self.state.position[0]
            matrix[:3, :3], matrix[:3, 3:6] = np.cross(np.eye(3), arm).T, np.eye(3)
            matrix[3:6, :3] = Rotation.from_quat(self.data.qpos[3:7], scalar_first=True).as_matrix().T
        return matrix

    def inertias(self):
        """Both mass matrices, in the lab's coordinates."""
        rotations, _, jacobians = self.oracle.kinematics()
        mine = np.einsum("bij,bik,bkl->jl", jacobians[:, :3], self.oracle.inertias(rotations), jacobians[:, :3])
        mine += np.einsum("bij,b,bil->jl", jacobians[:, 3:], self.oracle.masses, jacobians[:, 3:])
        full = np.zeros((self.theirs.nv, self.theirs.nv))
        mujoco.mj_fullM(self.theirs, full, self.data.qM)
        change = self.to_theirs()
        return mine[self.moving, self.moving], change.T @ full @ change

    def energies(self):
        """Both potential and kinetic energies [J]; potentials are those of all bodies that may move."""
        rotations, places, jacobians = self.oracle.kinematics()
        moving = jacobians @ np.append(self.state.velocity[0], self.state.rates[0])
        spin = np.einsum("bi,bij,bj->", moving[:, :3], self.oracle.inertias(rotations), moving[:, :3])
        kinetic = 0.5 * (spin + self.oracle.masses @ (moving[:, 3:] ** 2).sum(1))
        names = [body.name for body, _ in self.tree.ordered]
        loose = np.array([self.pair.moves(name) for name in names])
        potential = -self.pair.model.world.gravity * (self.oracle.masses * loose) @ places[:, 2]
        held = self.theirs.body_mass * (self.theirs.body_weldid == 0)
        gravity = self.pair.model.world.gravity
        return (potential, kinetic), (self.data.energy[0] + gravity * held @ self.data.xipos[:, 2], self.data.energy[1])

    def accelerations(self, tests):
        """Both accelerations of all bodies (turning, centre) from rest under gravity and a torque of 1 N m.

        Args:
            tests: numbers of the hinges on which the torque acts, one after the other.
        """
        still = replace(self.state, velocity=0 * self.state.velocity, rates=0 * self.state.rates)
        trees, world = [self._pushed(number) for number in tests], self.pair.model.world
        engine = RigidEngine(trees, Physics(STEP, world.gravity), precision="f64", threads=1)
        start = State(*(np.repeat(getattr(still, name), len(trees), 0) for name in State.__dataclass_fields__))
        done = engine.run(1, commands=np.ones((len(trees), 1, 1)), start=start)
        self.data.qvel[:] = 0.0
        theirs = []
        for number in tests:
            self.data.qfrc_applied[:] = 0.0
            hinge = self.pair.joint_of[self.tree.hinges[number].child]
            self.data.qfrc_applied[self.theirs.jnt_dofadr[hinge]] = 1.0
            mujoco.mj_forward(self.theirs, self.data)
            theirs.append(self._of_bodies(self.data.qacc))
        return done.velocities / STEP, np.array(theirs)

    def _pushed(self, number):
        """The tree, with nothing but a drive that never gets as fast as it wants to."""
        hinges = [hinge.child for hinge in self.tree.hinges]
        joints = [
            replace(joint, stops=None, command=0, motor=Motor(float(joint.child == hinges[number]), 1e9))
            if joint.child in hinges
            else joint
            for joint in self.tree.joints
        ]
        return Tree([replace(body, shapes=()) for body in self.tree.bodies], joints, self.tree.fixed)

    def _of_bodies(self, rates):
        """Turning and motion of the centre of each body of the tree for rates of MuJoCo's coordinates."""
        found = []
        for place, (body, _) in enumerate(self.tree.ordered):
            turning, moving = np.zeros((3, self.theirs.nv)), np.zeros((3, self.theirs.nv))
            centre, number = self.oracle.kinematics()[1][place], self.pair.names.index(body.name)
            mujoco.mj_jac(self.theirs, self.data, moving, turning, centre, number)
            found.append(np.concatenate([turning @ rates, moving @ rates]))
        return np.array(found)


def pendulum(text, step, steps):
    """Where hinges, or the free base, come to from rest in the lab and in MuJoCo, by steps of the same kind."""
    pair = Pair(text)
    mine = RigidEngine(pair.tree, Physics(step, pair.model.world.gravity), precision="f64", threads=1).run(steps)
    pair.theirs.opt.timestep = step
    pair.theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(pair.theirs)
    for _ in range(steps):
        mujoco.mj_step(pair.theirs, data)
    return (mine.angles[0] if pair.tree.fixed else mine.position[0]), data.qpos[: None if pair.tree.fixed else 3]


def coordinates_under(theirs, commands, step, each):
    """Coordinates in MuJoCo after each of some commands from -1 to 1, shape (C, nq), by steps of a length [s].

    Args:
        theirs: the model, without contacts from here on.
        commands: shares of the drives' ranges, shape (C, nu).
        step: of time [s].
        each: how long a command lasts [s].
    """
    theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    theirs.opt.timestep, data, found = step, mujoco.MjData(theirs), []
    low, high = theirs.actuator_ctrlrange.T
    for command in commands:
        data.ctrl[:] = (low + high) / 2 + command * (high - low) / 2
        for _ in range(round(each / step)):
            mujoco.mj_step(theirs, data)
        found.append(data.qpos.copy())
    return np.array(found)
