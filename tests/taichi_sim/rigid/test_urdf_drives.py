"""Drives of URDF robots: ideal ones unless they have gains, by which they are servos."""

import mujoco
import numpy as np
import pytest
from mujoco_motion import coordinates_under
from random_urdf import random_urdf

from taichi_sim.rigid import Motor, Physics, RigidEngine, Servo
from taichi_sim.rigid.model.files import read_model
from taichi_sim.rigid.model.mjcf_writing import mjcf_text

LEG = """<robot name="leg">
  <link name="base"><inertial><mass value="3"/><inertia ixx="0.1" iyy="0.2" izz="0.25"/></inertial></link>
  <link name="thigh"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.01"/>
    </inertial></link>
  <link name="shank"><inertial><origin xyz="0 0 -0.2"/><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/>
    </inertial></link>
  <link name="wheel"><inertial><mass value="0.2"/><inertia ixx="0.002" iyy="0.003" izz="0.002"/></inertial></link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="thigh"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="0.5" effort="7" velocity="2"/></joint>
  <joint name="knee" type="revolute"><origin xyz="0 0 -0.3"/><parent link="thigh"/><child link="shank"/>
    <axis xyz="0 1 0"/><limit lower="0.2" upper="1.4" effort="5" velocity="2"/></joint>
  <joint name="axle" type="continuous"><origin xyz="0 0 -0.4"/><parent link="shank"/><child link="wheel"/>
    <axis xyz="0 1 0"/><limit effort="2" velocity="6"/></joint></robot>"""


def motors(text=LEG, **settings):
    model = read_model(text, **settings)
    return dict(zip(model.commands, (hinge.motor for hinge in model.tree.hinges), strict=True))


def test_named_drives_are_servos_with_their_gains():
    ideal, found = motors(), motors(servos={"hip": (40.0, 1.5)})
    assert found["hip"] == Servo.position(-1.0, 0.5, 40.0, 1.5, 7.0)
    assert found["knee"] == ideal["knee"] and isinstance(ideal["knee"], Motor)
    assert motors(servos={"hip": (40.0, 0.0)})["hip"].damping_ratio == 0


def test_stiffness_alone_is_critically_damped():
    found = motors(servos={"knee": 30})["knee"]  # which starts in the middle of its range
    assert (found.by_angle, found.by_rate, found.damping_ratio) == (-30.0, 0.0, 1.0)
    assert found.by_command / 30 == pytest.approx(0.6) and found.offset / 30 == pytest.approx(0.0)


def test_a_joint_without_limits_has_a_servo_by_rate():
    found = motors(servos={"*": (40.0, 0.5)})
    assert found["axle"] == Servo(3.0, by_rate=0.5, torque=2.0)
    assert {type(each) for each in found.values()} == {Servo}
    plain = LEG.replace(' velocity="6"', "")
    assert motors(plain, servos={"axle": (0.0, 0.5)}, fastest=4.0)["axle"].by_command == 2.0


@pytest.mark.parametrize(
    ("servos", "message"),
    [
        ({"ankle": (40, 1)}, "servos: 'ankle' is no drive; give one of hip, knee, axle, or a pattern of them"),
        ({"*": (40, 1), "hip": (40, 1)}, "servos: '*' and 'hip' are both hip; give each drive once"),
        ({"axle": (40,)}, "servos of axle: it turns without end; give a damping above 0, as 0,1, by which"),
        ({"hip": (0, 1)}, "servos of hip: a stiffness of 0 is not allowed between limits; give one above 0"),
        ({"hip": (-1, 1)}, "servos of hip: stiffness: -1 is not allowed"),
        ({"hip": (1, float("nan"))}, "servos of hip: damping: nan"),
        ({"hip": (1, 2, 3)}, "servos of hip: .* is not allowed; give a stiffness and a damping, or a stiffness alone"),
        ({"hip": "soft"}, "servos of hip: stiffness: 'soft' is not allowed"),
        ([40, 1], "servos: .* is not allowed; give gains by names of joints"),
    ],
)
def test_what_is_no_gain_of_a_drive_is_refused(servos, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace("*'", r"\*'")):
        read_model(LEG, servos=servos)


def test_actuators_of_mjcf_have_gains_of_their_own():
    text = mjcf_text(read_model(LEG).tree, Physics(0.002))
    with pytest.raises(ValueError, match=r"^servos: not allowed of MJCF; give its actuators gains in the file"):
        read_model(text, servos={"*": (40.0, 1.0)})


@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
@pytest.mark.parametrize("text", [LEG, *map(random_urdf, range(4))], ids=["leg", *map("random {}".format, range(4))])
def test_servos_move_as_those_of_the_file_that_is_written_for_mujoco(text):
    """Of a free robot in the air: as near to short steps there as MuJoCo itself is with steps as here."""
    step, many = 1e-3, 10
    tree = read_model(text, servos={"*": (8.0, 0.4)}).tree
    if not tree.motors:
        pytest.skip("none of its joints turns")
    theirs = mujoco.MjModel.from_xml_string(mjcf_text(tree, Physics(step)))
    bodies = [theirs.body(hinge.child).id for hinge in tree.hinges]
    angles = theirs.jnt_qposadr[theirs.body_jntadr[bodies]]
    told = np.random.default_rng(2).uniform(-1, 1, (many, tree.motors))
    hold = round(0.05 / step)
    engine = RigidEngine([tree], Physics(step), precision="f64", threads=1)
    run = engine.run(many * hold, commands=told[None], hold=hold, record_every=hold)
    exact, alike = (coordinates_under(theirs, told, each, 0.05)[:, angles] for each in (step / 50, step))
    found = run.frames.angles[1:, 0] + [hinge.rest for hinge in tree.hinges]
    assert np.ptp(exact, axis=0).max() > 0.1
    assert np.abs(found - exact).max() < 1.5 * np.abs(alike - exact).max() + 2e-3
