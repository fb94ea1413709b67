"""Largest torques of the drives of a file's robot: given or free, with gradients, in files and commands."""

import json
import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from articulated_files import CART, CRAWLER
from crawlers import HERE, assert_differences, some_points

from robots.articulated import ArticulatedRobot, simulate
from robots.articulated.loading import robot_of_record
from robots.free import Free
from taichi_sim.rigid import Motor, Servo
from taichi_sim.rigid.model.actuation import strengthened_tree
from taichi_sim.rigid.model.files import read_model

# A servo that is too weak for its commands, and a torque motor.
WEAK = CRAWLER.replace('joint="shoulder" kp="30"', 'joint="shoulder" kp="30" kv="0.4"').replace(
    'ctrlrange="-0.8 0.8" forcerange="-8 8"/>\n<position name="b" joint="hip" kp="30" ctrlrange="-0.8 0.8" '
    'forcerange="-8 8"/>',
    'ctrlrange="-0.8 0.8" forcerange="-1 1"/>\n<motor name="b" joint="hip" gear="1.5" ctrlrange="-0.6 0.8"/>',
)
FREE = {"front": Free(0.5, 4.0), "rear": Free(0.25, 2.0)}


def weak(**settings):
    usual = {"duration": 0.3, "friction": math.inf, "drive_torque": FREE}
    return ArticulatedRobot(WEAK, **{**usual, **settings})


def motors(tree):
    return {hinge.child: hinge.motor for hinge in tree.hinges}


def test_servos_keep_their_gains_and_torque_motors_have_all_torques_multiplied():
    tree = read_model(WEAK).tree
    names = [body.name for body, _ in tree.ordered]
    before, after = motors(tree), motors(strengthened_tree(tree, [{"front": 3.0}.get(name, 0.5) for name in names]))
    assert after["front"] == replace(before["front"], torque=3.0)
    servo = before["rear"]
    assert servo.offset != 0 and servo.torque is None
    assert after["rear"] == Servo(0.5 * servo.by_command, offset=0.5 * servo.offset)
    assert strengthened_tree(tree, [1.0] * len(names)) is tree


def test_ideal_drives_and_those_of_urdf_have_other_limits_at_the_same_rates():
    for text, settings in ((WEAK, {"speed": 10.0, "fastest": 5.0}), (CART, {})):
        tree = read_model(text, **settings).tree
        after = motors(strengthened_tree(tree, [2.0] * len(tree.bodies)))
        for child, motor in motors(tree).items():
            assert isinstance(motor, Motor) and after[child] == replace(motor, torque=2 * motor.torque)


def test_free_ones_are_parameters_after_sizes_and_stiffness():
    robot = weak(body_sizes={"front": Free(0.5, 2.0)}, hinge_stiffness={"front": Free(0.5, 2.0)})
    names = ["front_size", "front_stiffness", "front_torque", "rear_torque"]
    assert [each.name for each in robot.parameters[-4:]] == names
    assert dict(robot.facts())["Drives"] == "largest torques front 0.5 to 4, rear 0.25 to 2"
    tree = robot.variants.tree_of(np.array([1.0, 2.0, 3.0, 0.5]))
    assert motors(tree)["front"].torque == 3.0 and motors(tree)["front"].by_angle == -60.0


@pytest.mark.kernels
def test_a_free_one_does_what_the_same_number_in_the_file_does():
    robot = weak()
    points = some_points(robot, 2)
    points[:, -2:] = [[4.0, 0.5], [0.5, 2.0]]
    found = simulate(robot, points, **HERE).distance
    for point, value in zip(points, found, strict=True):
        front, rear = point[-2:].tolist()
        text = WEAK.replace('"-1 1"', f'"{-front!r} {front!r}"').replace('gear="1.5"', f'gear="{1.5 * rear!r}"')
        plain = ArticulatedRobot(text, duration=0.3, friction=math.inf)
        assert simulate(plain, [point[:-2]], **HERE).distance[0] == pytest.approx(value, rel=1e-9)
    assert abs(found[0] - found[1]) > 1e-4


@pytest.mark.kernels
@pytest.mark.parametrize("settings", [{}, {"speed": 10.0}], ids=["servo", "holding rates"])
def test_derivatives_are_central_differences(settings):
    robot = weak(**settings, hinge_stiffness={} if settings else {"front": Free(0.5, 2.0)})
    assert_differences(robot, some_points(robot, 2, seed=4), 2)


def test_records_have_them_only_if_given():
    record = json.loads(json.dumps(weak().describe()))
    assert record["drive_torque"] == {"front": [0.5, 4.0, 1.0], "rear": [0.25, 2.0, 1.0]}
    assert robot_of_record(record).describe() == weak().describe()
    assert "drive_torque" not in weak(drive_torque={}).describe()


GENERAL = WEAK.replace(
    '<position name="a" joint="shoulder" kp="30" kv="0.4"',
    '<general name="a" joint="shoulder" gear="2" biastype="affine" gainprm="8" biasprm="0.5 -7 -0.3"',
).replace('<motor name="b" joint="hip" gear="1.5"', '<general name="b" joint="hip" gear="1.5" gainprm="3"')
OF_CLASS = WEAK.replace(' forcerange="-1 1"', "").replace(
    "<worldbody>",
    '<default><position forcerange="-1 1"/><joint actuatorfrcrange="-0.9 0.9"/></default><worldbody>',
)
UNLIMITED = WEAK.replace(' forcerange="-1 1"', "")
FILES = {
    "position and motor": (WEAK, {}),
    "general": (GENERAL, {}),
    "defaults": (OF_CLASS, {}),
    "holding rates": (WEAK, {"speed": 10.0, "fastest": 5.0}),
    "holding rates without a limit": (UNLIMITED, {"speed": 10.0}),
}


@pytest.mark.parametrize("name", FILES)
def test_the_file_that_leaves_has_the_torques_of_the_design(name, tmp_path):
    text, settings = FILES[name]
    robot = ArticulatedRobot(text, body_sizes={"front": 1.5}, drive_torque=FREE, **settings)
    factors = np.array([0.7, 0.4] if text is UNLIMITED else [2.5, 0.4])
    assert robot.save_model([*robot.start[:-2], *factors], tmp_path / "own.xml") == []
    again = motors(ArticulatedRobot((tmp_path / "own.xml").read_text(), **settings).tree)
    for child, motor in motors(robot.variants.tree_of(factors)).items():
        assert astuple(again[child]) == pytest.approx(astuple(motor))
        assert motor != motors(robot.tree)[child]


def test_a_limit_that_a_file_cannot_tell_is_refused(tmp_path):
    """That of an ideal drive is the torque of its whole range."""
    robot = ArticulatedRobot(UNLIMITED, drive_torque={"front": 2.0}, speed=10.0)
    with pytest.raises(ValueError, match="the joint of front would not be the same in such a file"):
        robot.save_model(robot.start, tmp_path / "own.xml")


@pytest.mark.parametrize("suffix", [".urdf", ".mjcf"])
def test_effort_of_urdf_leaves(suffix, tmp_path):
    robot = ArticulatedRobot(CART, drive_torque={"wheel": 2.5}, servos={"axle": (0.0, 1.0)})
    robot.save_model(robot.start, tmp_path / f"own{suffix}")
    again = read_model((tmp_path / f"own{suffix}").read_text(), **({} if suffix == ".mjcf" else robot.reading)).tree
    assert motors(again)["wheel"].torque == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "given", "message"),
    [
        (WEAK, {"trunk": 2.0}, "drive_torque: 'trunk' is no hinge with a drive that has a largest torque; give one of"),
        (UNLIMITED, {"front": 2.0}, "drive_torque: 'front' is no hinge with a drive that has a largest torque; give"),
        (WEAK, {"front": 0.001}, "drive_torque of front: 0.001 is not allowed; give a number from 0.01 to 100"),
        (WEAK, [2.0], "drive_torque: [2.0] is not allowed; give torque by names of bodies"),
    ],
)
def test_what_has_no_largest_torque_is_refused(text, given, message):
    with pytest.raises(ValueError) as told:
        ArticulatedRobot(text, drive_torque=given)
    assert str(told.value).startswith(message)


@pytest.mark.kernels
def test_torques_are_searched_and_exported(morpholab, tmp_path):
    (tmp_path / "weak.xml").write_text(WEAK)
    search = "--drive-torque 'f*=0.5:4' --drive-torque rear --friction inf --duration 0.2"
    objectives = "--objective speed --objective minimise:0.01*energy"
    line = f"codesign --robot weak.xml {search} {objectives} --method gradient --climbers 2 --generations 2 --quiet"
    code, _, error = morpholab(f"{line} --terrain flat --out run")
    assert code == 0, error
    values = json.loads((tmp_path / "run/best.json").read_text())["values"]
    assert list(values)[-2:] == ["f_torque", "rear_torque"]
    code, _, error = morpholab("export run --model best.xml")
    assert code == 0, error
    best = motors(read_model((tmp_path / "best.xml").read_text()).tree)
    assert best["front"].torque == pytest.approx(values["f_torque"])
    assert best["rear"].by_command == pytest.approx(1.5 * 0.7 * values["rear_torque"])
    code, _, error = morpholab("simulate --robot weak.xml --drive-torque rear=0:1")
    assert code == 2 and "argument --drive-torque: 0.0 is not allowed; give a number from 0.01 to 100" in error
