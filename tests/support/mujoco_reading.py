"""MuJoCo's own reading of an MJCF text beside the lab's: every number that both have."""

from dataclasses import astuple, dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np

from taichi_sim.rigid import slots
from taichi_sim.rigid.model.files import read_model
from taichi_sim.rigid.tables import parameters_of

mujoco.set_mju_user_warning(lambda _: None)  # which it would write into a file beside, and do no more
ABOVE = 1e4  # m, to which the plane is raised, so that everything that may touch it does
EXACT = 1e-9  # share by which numbers may differ
TURNED = (
    5e-6  # share by which inertias may: as far are principal axes off that MuJoCo finds of six numbers, or two solids
)


def refusal(text):
    """What MuJoCo says against a text; None if it takes it."""
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        return str(error).splitlines()[0]
    return None


def close(found, expected, what, scale=None, most=EXACT):
    """Fail unless numbers agree to a share of their size."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    scale = max(np.abs(expected).max(initial=0.0), 1e-12) if scale is None else scale
    assert found.shape == expected.shape, what
    apart = np.abs(found - expected).max(initial=0.0)
    assert apart <= most * scale, f"{what}: off by {apart / scale:.1e}, {found} instead of {expected}"


@dataclass
class Pair:
    """One text as both read it; ``rests`` are the angles at which hinges rest in the lab's reading, by their child."""

    text: str

    def __post_init__(self):
        self.root = ElementTree.fromstring(self.text)
        self.model = read_model(self.text, fixed=self.root.tag == "robot")  # MuJoCo has the bases of URDF fixed
        self.tree = self.model.tree
        self.theirs = mujoco.MjModel.from_xml_string(self.text)
        self.data = mujoco.MjData(self.theirs)
        first = 0 if self.tree.bodies[0].name == "world" else 1  # a body without a name has its number
        self.names = [self.theirs.body(n).name or f"body {n - first}" for n in range(self.theirs.nbody)]
        self.joint_of = {
            self.names[int(self.theirs.jnt_bodyid[number])]: number
            for number in range(self.theirs.njnt)
            if self.theirs.jnt_type[number] == mujoco.mjtJoint.mjJNT_HINGE
        }
        self.rests = {hinge.child: self.rest(hinge) for hinge in self.tree.hinges}
        for child, rest in self.rests.items():
            self.data.qpos[self.theirs.jnt_qposadr[self.joint_of[child]]] = rest
        mujoco.mj_kinematics(self.theirs, self.data)
        mujoco.mj_comPos(self.theirs, self.data)

    def rest(self, hinge):
        """The angle at which a hinge should rest: that of the file, or the middle of a range that excludes it."""
        number = self.joint_of[hinge.child]
        usual, (low, high) = self.theirs.qpos0[self.theirs.jnt_qposadr[number]], self.theirs.jnt_range[number]
        outside = self.theirs.jnt_limited[number] and not low <= usual <= high
        return (low + high) / 2 if outside else usual

    def same(self):
        """Fail unless both have the same masses, places, hinges, drives, contacts and settings."""
        self.same_bodies()
        self.same_hinges()
        self.same_notes()
        self.same_drives()
        self.same_contacts()
        self.same_settings()

    def owner(self, number):
        """Name of the body of the tree that has the mass of one of MuJoCo's, which may be massless."""
        names = {body.name for body in self.tree.bodies}
        while number and self.names[number] not in names:
            number = int(self.theirs.body_parentid[number])
        return self.names[number]

    def same_bodies(self):
        assert self.tree.fixed == (not (self.theirs.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any())
        for place, (body, joint) in enumerate(self.tree.ordered):
            numbers = [n for n in range(1, self.theirs.nbody) if self.owner(n) == body.name]
            mass = self.theirs.body_mass[numbers].sum()
            if place == 0 and self.tree.fixed and np.allclose(body.inertia, np.eye(3)):
                continue  # whatever does not move
            close(body.mass, mass, f"mass of {body.name}")
            centre = self.theirs.body_mass[numbers] @ self.data.xipos[numbers] / mass
            close(body.position, centre, f"centre of {body.name}", 1.0)
            inertia = np.zeros((3, 3))
            for n in numbers:
                axes, arm = self.data.ximat[n].reshape(3, 3), self.data.xipos[n] - centre
                inertia += axes @ np.diag(self.theirs.body_inertia[n]) @ axes.T
                inertia += self.theirs.body_mass[n] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
            close(body.inertia, inertia, f"inertia of {body.name}", most=TURNED)
            if len(numbers) == 1:
                moments = np.sort(self.theirs.body_inertia[numbers[0]])
                close(np.linalg.eigvalsh(body.inertia), moments, f"moments of {body.name}", most=1e-7)
            if joint is not None:
                carrier = int(self.theirs.body_parentid[self.names.index(body.name)])
                assert joint.parent in (self.owner(carrier), self.tree.bodies[0].name), body.name

    def same_hinges(self):
        assert {hinge.child for hinge in self.tree.hinges} == set(self.joint_of)
        stops_off = self.theirs.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT
        for hinge in self.tree.hinges:
            number = self.joint_of[hinge.child]
            axis = np.divide(hinge.axis, np.linalg.norm(hinge.axis))
            close(axis, self.data.xaxis[number], f"axis of {hinge.child}", 1.0)
            close(hinge.anchor, self.data.xanchor[number], f"anchor of {hinge.child}", 1.0)
            limited = self.theirs.jnt_limited[number] and not stops_off
            assert (hinge.stops is not None) == bool(limited), hinge.child
            if limited:
                close(np.add(hinge.stops, self.rests[hinge.child]), self.theirs.jnt_range[number], "stops", 1.0)

    def same_notes(self):
        for values, name in ((self.theirs.jnt_margin, "margin of joints"),):
            hinged = values if len(values) == self.theirs.njnt else values[self.theirs.jnt_dofadr]
            assert (name in self.model.ignored) == bool(hinged.any()), name

    def same_drives(self):
        """Fail unless all torques of hinges are those of MuJoCo's numbers: of drives, springs, dampers and rotors."""
        elements = list(self.root.iterfind("actuator/*"))
        assert len(elements) == self.theirs.nu == len(self.model.commands)
        assert sum(hinge.motor is not None for hinge in self.tree.hinges) == len(elements)
        for hinge in self.tree.hinges:
            number = self.joint_of[hinge.child]
            dof, rest = self.theirs.jnt_dofadr[number], self.rests[hinge.child]
            spring = self.theirs.qpos_spring[self.theirs.jnt_qposadr[number]] - rest
            stiffness, friction = self.theirs.jnt_stiffness[number], self.theirs.dof_frictionloss[dof]
            wanted = self.theirs.dof_armature[dof], self.theirs.dof_damping[dof], stiffness, spring, friction
            close(astuple(hinge.passive), wanted, f"passive forces of {hinge.child}", 1.0)
            if hinge.motor is not None:
                joint = self.theirs.actuator_trnid[hinge.command, 0]
                assert joint == number, hinge.child
                expected, torque = self.expected_servo(hinge.command, number, rest)
                drag = parameters_of(self.tree)[self.tree.place_of(hinge.child), slots.BY_RATE]
                found = hinge.motor.by_command, hinge.motor.by_angle, hinge.motor.offset, drag
                for name, value, each in zip(
                    ("by_command", "by_angle", "offset", "drag"), found, expected, strict=True
                ):
                    scale = max(1e-12, abs(each), abs(expected[1]))
                    if name != "drag":
                        close(value, each, f"{name} of {hinge.child}", scale)
                    elif self.at_zero():  # where MuJoCo takes the inertia for ratios of damping
                        close(value, each, f"{name} of {hinge.child}", scale, TURNED)
                assert (hinge.motor.torque is None) == (torque is None), hinge.child
                close(hinge.motor.torque or 0.0, torque or 0.0, f"torque of {hinge.child}")

    def at_zero(self):
        """Whether all hinges rest at the angles of the file."""
        usual = [self.theirs.qpos0[self.theirs.jnt_qposadr[self.joint_of[child]]] for child in self.rests]
        return np.allclose(usual, list(self.rests.values()), atol=1e-9)

    def expected_servo(self, command, joint, rest):
        """Torque of a drive by command, angle, nothing and rate, and its limit, of MuJoCo's numbers."""
        gear = self.theirs.actuator_gear[command, 0]
        low, high = self.theirs.actuator_ctrlrange[command]
        if not self.theirs.actuator_ctrlrange[command].any():
            low, high = sorted(gear * self.theirs.jnt_range[joint])
        gain, bias = self.theirs.actuator_gainprm[command, 0], self.theirs.actuator_biasprm[command]
        by_length, by_velocity = bias[1:3] * (self.theirs.actuator_biastype[command] == mujoco.mjtBias.mjBIAS_AFFINE)
        limits = [np.inf]
        if self.theirs.actuator_forcelimited[command]:
            limits.append(abs(gear) * self.theirs.actuator_forcerange[command, 1])
        if self.theirs.jnt_actfrclimited[joint]:
            limits.append(self.theirs.jnt_actfrcrange[joint, 1])
        constant = bias[0] * (self.theirs.actuator_biastype[command] == mujoco.mjtBias.mjBIAS_AFFINE)
        offset = gear * (gain * (low + high) / 2 + constant) + gear**2 * by_length * rest
        law = gear * gain * (high - low) / 2, gear**2 * by_length, offset, -(gear**2) * by_velocity
        return law, min(limits) if min(limits) < np.inf else None

    def same_contacts(self):
        """Everything that may touch the plane, which is raised above it, and the largest friction that it finds."""
        planes = np.nonzero(self.theirs.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)[0]
        if len(planes) == 0:
            return
        self.theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # whose boxes know nothing of what follows
        self.data.geom_xpos[planes[0], 2] = ABOVE
        mujoco.mj_collision(self.theirs, self.data)
        touching, frictions = set(), set()
        for contact in self.data.contact[: self.data.ncon]:
            if planes[0] in contact.geom:
                touching.add(int(contact.geom.sum() - planes[0]))
                frictions.add(float(contact.friction[0]) if contact.dim > 1 else 0.0)
        close(self.model.world.friction, max(frictions, default=1.0), "friction", 1.0)
        expected = [ball for geom in sorted(touching) for ball in self.balls(geom)]
        found = [
            (*np.add(self.tree.ordered[place][0].position, centre), radius)
            for place, centre, radius in self.tree.points()
            if self.moves(self.tree.ordered[place][0].name)
        ]
        ordered = [np.array(sorted(np.round(each, 7).tolist() for each in balls)) for balls in (found, expected)]
        assert len(found) == len(expected), f"{len(found)} points of contact instead of {len(expected)}"
        close(*ordered, "points of contact", 1e3)  # 1 um, as both were rounded

    def moves(self, name):
        return self.theirs.body_weldid[self.names.index(name)] != 0

    def balls(self, geom):
        """Balls that stand for one of MuJoCo's solids: centres and radii."""
        kind, size = mujoco.mjtGeom(self.theirs.geom_type[geom]), self.theirs.geom_size[geom]
        place, axes = self.data.geom_xpos[geom], self.data.geom_xmat[geom].reshape(3, 3)
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            return [(*place, size[0])]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            signs = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
            return [(*(place + axes @ (size * sign)), 0.0) for sign in signs]
        half = size[1] - size[0] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else size[1]  # as a capsule of its length
        return [(*(place + side * half * axes[:, 2]), size[0]) for side in (-1, 1)]

    def same_settings(self):
        close(self.model.world.time_step, self.theirs.opt.timestep, "time step")
        weightless = self.theirs.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        close(self.model.world.gravity, 0.0 if weightless else self.theirs.opt.gravity[2], "gravity", 1.0)
        sites = [
            self.theirs.site_bodyid[self.theirs.site(each.get("site")).id]
            for each in self.root.iterfind("sensor/touch")
        ]
        assert list(self.model.senses.touch) == [self.names[int(body)] for body in sites]
