"""MJCF that is written of any tree: read back here it is the same robot, and MuJoCo finds the same masses."""

import dataclasses

import numpy as np
import pytest
from random_urdf import random_urdf
from scipy.spatial.transform import Rotation

from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Passive, Physics, Servo, Sphere, Tree
from taichi_sim.rigid.model.files import read_model
from taichi_sim.rigid.model.mjcf_writing import SHORTER, drive_commands, law_of, mjcf_text, written_step

PHYSICS = Physics(0.004, -9.0, friction=0.7)
LEGGED = Tree(
    [
        Body("trunk", (0.0, 0.0, 0.3), 2.0, [Box((0.3, 0.2, 0.1))]),
        Body("thigh", (0.1, 0.0, 0.2), 0.3, [Capsule(0.03, 0.1, (1.0, 0.0, 2.0))]),
        Body("shank", (0.1, 0.05, 0.1), 0.2, [Sphere(0.04, (0.0, 0.01, 0.0))], np.diag([1e-3, 2e-3, 2.5e-3])),
    ],
    [
        Hinge("trunk", "thigh", (0.1, 0.0, 0.25), (0.0, 2.0, 1.0), Servo.position(-0.6, 0.9, 40.0, 1.0, 3.0), 1),
        Hinge(
            "thigh",
            "shank",
            (0.1, 0.02, 0.15),
            (1.0, 0.0, 0.0),
            Motor.velocity(2.0, 1.5),
            0,
            (-0.5, 0.8),
            0.3,
            Passive(2e-3, 0.05, 15.0, -0.2, 0.02),
        ),
    ],
)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def check_same(again, tree, physics):
    """Check that a tree that was read back has the matter, hinges and drives of another."""
    assert [body.name for body, _ in again.ordered] == [body.name for body, _ in tree.ordered]
    lift = np.subtract(again.bodies[0].position, tree.bodies[0].position)
    close(lift[:2], 0.0)
    for (body, _), (other, _) in zip(again.ordered, tree.ordered, strict=True):
        close(np.subtract(body.position, lift), other.position)
        close([body.mass, *np.ravel(body.inertia)], [other.mass, *np.ravel(other.inertia)])
        assert len(body.shapes) == len(other.shapes)
        for shape, like in zip(body.shapes, other.shapes, strict=True):
            assert type(shape) is type(like)
            close(sorted(c.tolist() for c, _ in shape.points()), sorted(c.tolist() for c, _ in like.points()))
            close(shape.volume, like.volume)
    for hinge, other in zip(again.hinges, tree.hinges, strict=True):
        assert (hinge.parent, hinge.child, hinge.stops is None) == (other.parent, other.child, other.stops is None)
        close(np.subtract(hinge.anchor, lift), other.anchor)
        close(hinge.axis, np.divide(other.axis, np.linalg.norm(other.axis)))
        close([hinge.rest, *(hinge.stops or ())], [other.rest, *(other.stops or ())])
        rests = {} if other.passive.stiffness else {"spring_rest": 0.0}  # of no spring
        close(dataclasses.astuple(dataclasses.replace(hinge.passive, **rests)), dataclasses.astuple(other.passive))
        assert (hinge.motor is None) == (other.motor is None)
        if other.motor is not None:
            by_angle, by_rate = law_of(tree, other, written_step(tree, physics))
            told = hinge.motor
            close([told.by_angle, told.by_rate], [by_angle, by_rate])
            close(told.torque, other.motor.torque)
            ends = np.array([-1.0, 1.0])
            close(np.sort(drive_commands(hinge, ends)[0]), np.sort(drive_commands(other, ends)[0]))


def test_a_tree_is_read_back_as_it_is():
    model = read_model(mjcf_text(LEGGED, PHYSICS, ["knee", "hip"], "hopper"))
    check_same(model.tree, LEGGED, PHYSICS)
    assert model.commands == ("knee", "hip") and set(model.ignored) == {"option integrator", "option cone"}
    assert not model.tree.fixed
    assert (model.world.time_step, model.world.gravity, model.world.friction) == (0.004 / SHORTER, -9.0, 0.7)
    centres, radii = model.tree.balls()
    close((centres[:, 2] - radii).min(), 0.0)  # it stands
    knee = model.tree.hinges[1].motor
    assert isinstance(knee, Servo) and knee.by_rate == LEGGED.inertia_about(LEGGED.hinges[1]) * SHORTER / 0.004
    servo = dataclasses.replace(LEGGED.hinges[1], motor=Servo(1.0))
    assert written_step(Tree(LEGGED.bodies, [LEGGED.hinges[0], servo]), PHYSICS) == 0.004


def test_a_fixed_tree_stays_where_it_is():
    base = Body("base", (0.0, 0.0, 1.0), 0.0, inertia=np.eye(3))
    arm = Body("arm", (0.2, 0.0, 1.0), 0.5, [Capsule(0.02, 0.2, (1.0, 0.0, 0.0))])
    hinge = Hinge("base", "arm", (0.1, 0.0, 1.0), (0.0, 1.0, 0.0), Servo(2.0), 0, passive=Passive(damping=0.1))
    tree = Tree([base, arm], [hinge], fixed=True)
    again = read_model(mjcf_text(tree, PHYSICS)).tree
    assert again.fixed
    close(again.bodies[1].position, arm.position)
    assert drive_commands(again.hinges[0], np.array([0.5]))[1] == "N m"


def disc(name, rng, place=(0.0, 0.0, 0.5)):
    """A thin plate that lies anyhow: one of its moments is the sum of the others."""
    turned = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    flat = np.diag([a := rng.uniform(1e-3, 1e-2), b := rng.uniform(1e-3, 1e-2), a + b])
    return Body(name, place, 0.4, [Sphere(0.01)], turned @ flat @ turned.T)


@pytest.mark.parametrize("seed", range(20))
def test_flat_bodies_and_one_called_world_are_taken_by_mujoco(seed):
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(seed)
    bodies = [disc("base", rng), disc("world", rng, (0.1, 0.0, 0.5)), disc("world_", rng, (0.2, 0.0, 0.5))]
    hinges = [
        Hinge("base", "world", (0.05, 0.0, 0.5), (0.0, 1.0, 0.0), Servo(1.0), 0),
        Hinge("world", "world_", (0.15, 0.0, 0.5), (0.0, 1.0, 0.0), Servo(1.0), 0),
    ]
    text = mjcf_text(Tree(bodies, hinges), PHYSICS)
    theirs = mujoco.MjModel.from_xml_string(text)
    assert [theirs.body(n).name for n in range(4)] == ["world", "base", "world__", "world_"]
    assert [theirs.actuator(n).name for n in range(2)] == ["drive 0 of world__", "drive 0 of world_"]
    for number, body in enumerate(bodies, 1):
        turn = Rotation.from_quat(np.roll(theirs.body_iquat[number], -1)).as_matrix()
        found = turn @ np.diag(theirs.body_inertia[number]) @ turn.T
        np.testing.assert_allclose(found, body.inertia, rtol=1e-9, atol=1e-14)
    again = read_model(text).tree
    np.testing.assert_allclose([b.inertia for b, _ in again.ordered], [b.inertia for b in bodies], atol=1e-13)


def test_a_moment_that_mujoco_does_not_take_is_refused():
    speck = Body("speck", (0.0, 0.0, 1.0), 1e-12, [Sphere(0.01)], 1e-15 * np.eye(3))
    with pytest.raises(ValueError, match=r"^inertia of speck: a moment of 1e-15 kg m\^2 is not allowed in MJCF"):
        mjcf_text(Tree([speck]), PHYSICS)


@pytest.mark.filterwarnings("ignore:model. ignored")
@pytest.mark.parametrize("seed", range(12))
def test_robots_of_urdf_files_are_the_same_in_mujoco(seed):
    mujoco = pytest.importorskip("mujoco")
    tree = read_model(random_urdf(seed)).tree
    text = mjcf_text(tree, PHYSICS)
    check_same(read_model(text).tree, tree, PHYSICS)
    theirs = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(theirs)
    mujoco.mj_forward(theirs, state)
    assert theirs.nu == tree.motors and theirs.nq == len(tree.hinges) + (0 if tree.fixed else 7)
    for body, _ in tree.ordered:
        number = mujoco.mj_name2id(theirs, mujoco.mjtObj.mjOBJ_BODY, body.name)
        close(theirs.body_mass[number], body.mass)
        close(
            state.xipos[number] - state.xipos[1],
            np.subtract(body.position, tree.ordered[0][0].position),
        )


def test_a_damping_ratio_is_that_of_what_hangs_on_the_hinge():
    """A rod of 0.3 kg and 0.4 m about its end, with a rotor: critically damped by 2 sqrt(k I)."""
    rod = np.diag([1e-6, 0.3 * 0.4**2 / 12, 0.3 * 0.4**2 / 12])
    arm = Body("arm", (0.2, 0.0, 1.0), 0.3, [Sphere(0.01)], rod)
    base = Body("base", (0.0, 0.0, 1.0), 0.0, inertia=np.eye(3))
    servo = dataclasses.replace(Servo.position(-1.0, 1.0, 40.0, 0.1), damping_ratio=1.0)
    hinge = Hinge("base", "arm", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), servo, 0, passive=Passive(rotor_inertia=2e-3))
    again = read_model(mjcf_text(Tree([base, arm], [hinge], fixed=True), PHYSICS)).tree.hinges[0].motor
    assert again.by_angle == -40.0
    assert again.by_rate == pytest.approx(0.1 + 2 * np.sqrt(40.0 * (0.3 * 0.4**2 / 3 + 2e-3)))
