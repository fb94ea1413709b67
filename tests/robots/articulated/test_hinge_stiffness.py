"""Stiffness of servos and springs of a file's robot: given or free, with gradients, in files and commands."""

import json
import math
from dataclasses import astuple

import numpy as np
import pytest
from articulated_files import CRAWLER
from crawlers import HERE, assert_differences, some_points

from robots.articulated import ArticulatedRobot, simulate
from robots.articulated.loading import robot_of_record
from robots.free import Free
from taichi_sim.rigid import Servo
from taichi_sim.rigid.model.actuation import stiffened_tree
from taichi_sim.rigid.model.files import read_model

# A damped servo, one with a damping ratio, and a spring that nothing drives.
SPRUNG = (
    CRAWLER.replace('joint="shoulder" kp="30"', 'joint="shoulder" kp="30" kv="0.4"')
    .replace('joint="hip" kp="30"', 'joint="hip" kp="30" dampratio="0.7"')
    .replace(
        "</body>\n</body></worldbody>",
        '<body name="toe" pos="-0.1 0 -0.06"><joint name="ankle" axis="0 1 0" stiffness="2" damping="0.02" '
        'springref="10"/><geom type="sphere" size="0.03" mass="0.1"/></body></body></body></worldbody>',
    )
)
FREE = {"front": Free(0.5, 4.0), "rear": 0.6, "toe": Free(0.25, 2.0)}


def sprung(**settings):
    usual = {"duration": 0.3, "friction": math.inf, "hinge_stiffness": FREE}
    return ArticulatedRobot(SPRUNG, **{**usual, **settings})


def hinges(tree):
    return {hinge.child: hinge for hinge in tree.hinges}


def test_servos_keep_their_damping_ratio_and_springs_their_damper():
    tree = read_model(SPRUNG).tree
    names = [body.name for body, _ in tree.ordered]
    factors = [{"front": 4.0, "rear": 0.25, "toe": 3.0}.get(name, 1.0) for name in names]
    before, after = hinges(tree), hinges(stiffened_tree(tree, factors))
    for name, factor in (("front", 4.0), ("rear", 0.25)):
        servo, plain = after[name].motor, before[name].motor
        assert servo == Servo(
            factor * plain.by_command,
            factor * plain.by_angle,
            factor * plain.offset,
            math.sqrt(factor) * plain.by_rate,
            plain.torque,
            plain.damping_ratio,
        )
        assert after[name].passive == before[name].passive
    assert after["toe"].passive.stiffness == 6.0 and after["toe"].passive.damping == before["toe"].passive.damping
    assert stiffened_tree(tree, [1.0] * len(names)) is tree


def test_free_ones_are_parameters_after_sizes():
    robot = sprung(body_sizes={"front": Free(0.5, 2.0)})
    assert [each.name for each in robot.parameters[-3:]] == ["front_size", "front_stiffness", "toe_stiffness"]
    assert [each.low for each in robot.parameters[-3:]] == [0.5, 0.5, 0.25]
    assert robot.start[-3:].tolist() == [1.0, 1.0, 1.0]
    assert sprung(hinge_stiffness={"*": (0.5, 2)}).parameters[-1].name == "hinge_stiffness"
    told = dict(robot.facts())
    assert told["Hinges"] == "stiffness front 0.5 to 4, rear 0.6, toe 0.25 to 2"
    assert dict(robot.facts_of(robot.start))["Mass"] == "1.7 kg"


@pytest.mark.kernels
def test_a_free_one_does_what_the_same_number_in_the_file_does():
    robot = sprung()
    points = some_points(robot, 2)
    points[:, -2:] = [[4.0, 0.5], [0.5, 2.0]]
    found = simulate(robot, points, **HERE).distance
    for point, value in zip(points, found, strict=True):
        front, toe = point[-2:].tolist()
        text = (
            SPRUNG.replace('kp="30" kv="0.4"', f'kp="{30 * front!r}" kv="{0.4 * math.sqrt(front)!r}"')
            .replace('kp="30" dampratio', 'kp="18" dampratio')
            .replace('stiffness="2"', f'stiffness="{2 * toe!r}"')
        )
        plain = ArticulatedRobot(text, duration=0.3, friction=math.inf)
        assert simulate(plain, [point[:-2]], **HERE).distance[0] == pytest.approx(value, rel=1e-9)
    assert abs(found[0] - found[1]) > 1e-4


@pytest.mark.kernels
@pytest.mark.parametrize("sizes", [{}, {"rear": Free(0.5, 2.0)}], ids=["alone", "with sizes"])
def test_derivatives_are_central_differences(sizes):
    robot = sprung(body_sizes=sizes)
    assert_differences(robot, some_points(robot, 2, seed=4), 2 + len(sizes))


def test_records_have_them_only_if_given():
    robot = sprung()
    record = json.loads(json.dumps(robot.describe()))
    assert record["hinge_stiffness"] == {"front": [0.5, 4.0, 1.0], "rear": 0.6, "toe": [0.25, 2.0, 1.0]}
    assert robot_of_record(record).describe() == robot.describe()
    assert "hinge_stiffness" not in sprung(hinge_stiffness={}).describe()


GENERAL = SPRUNG.replace(
    '<position name="a" joint="shoulder" kp="30" kv="0.4"',
    '<general name="a" joint="shoulder" gear="2" biastype="affine" gainprm="8" biasprm="0.5 -7 -0.3"',
)
OF_CLASS = SPRUNG.replace(' kp="30" kv="0.4"', "").replace(
    "<worldbody>",
    '<default><position kp="25" kv="0.3"/><joint stiffness="0.7"/></default><worldbody>',
)


@pytest.mark.parametrize("text", [SPRUNG, GENERAL, OF_CLASS], ids=["position", "general", "defaults"])
def test_the_file_that_leaves_has_the_gains_of_the_design(text, tmp_path):
    text = text.replace('dampratio="0.7"', 'kv="0.2"') if text is OF_CLASS else text
    robot = ArticulatedRobot(text, body_sizes={"front": 1.5}, hinge_stiffness=FREE)
    point = [*robot.start[:-2], 2.5, 0.4]
    assert robot.save_model(point, tmp_path / "own.xml") == []
    again = hinges(ArticulatedRobot((tmp_path / "own.xml").read_text()).tree)
    for name, hinge in hinges(robot.variants.tree_of(np.array([2.5, 0.4]))).items():
        assert astuple(again[name].motor or hinge.passive) == pytest.approx(astuple(hinge.motor or hinge.passive))
        assert astuple(again[name].passive) == pytest.approx(astuple(hinge.passive))


# Drives that hold no angle here: an ideal one, and one whose bias its type leaves out.
LOOSE = {
    "ideal": (SPRUNG.replace('kv="0.4"', "").replace('dampratio="0.7"', ""), {"speed": 10.0}),
    "without bias": (GENERAL.replace(' biastype="affine"', ""), {}),
}


@pytest.mark.parametrize("name", LOOSE)
def test_only_the_spring_is_written_where_a_drive_holds_no_angle(name, tmp_path):
    text, settings = LOOSE[name]
    sprung = text.replace('joint name="shoulder"', 'joint name="shoulder" stiffness="3"')
    robot = ArticulatedRobot(sprung, hinge_stiffness={"front": 4.0}, **settings)
    robot.save_model(robot.start, tmp_path / "own.xml")
    written = (tmp_path / "own.xml").read_text()
    assert 'stiffness="12"' in written and "120" not in written
    again = hinges(ArticulatedRobot(written, **settings).tree)["front"]
    assert again.motor == hinges(robot.tree)["front"].motor == hinges(robot.model.tree)["front"].motor


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"trunk": 2.0},
            "hinge_stiffness: 'trunk' is no hinge with a servo or a spring; give one of front, ",
        ),
        (
            {"*": 2.0, "toe": 1.0},
            "hinge_stiffness: '*' and 'toe' are both toe; give each hinge with a servo",
        ),
        ({"toe": 0.001}, "hinge_stiffness of toe: 0.001 is not allowed; give a number from 0.01 to 100"),
        ([2.0], "hinge_stiffness: [2.0] is not allowed; give stiffness by names of bodies"),
    ],
)
def test_what_has_no_stiffness_is_refused(given, message):
    with pytest.raises(ValueError) as told:
        sprung(hinge_stiffness=given)
    assert str(told.value).startswith(message)


def test_a_robot_of_torque_motors_has_none():
    text = CRAWLER.replace("<position", "<motor").replace(' kp="30"', "")
    with pytest.raises(ValueError, match=r"^hinge_stiffness: '\*' is no hinge with .*; the robot has none$"):
        ArticulatedRobot(text, hinge_stiffness={"*": 2.0})


@pytest.mark.kernels
def test_stiffness_is_searched_and_exported(morpholab, tmp_path):
    (tmp_path / "sprung.xml").write_text(SPRUNG)
    search = "--hinge-stiffness 'f*=0.5:4' --hinge-stiffness toe --friction inf --duration 0.2"
    line = f"codesign --robot sprung.xml {search} --method gradient --climbers 2 --generations 2 --terrain flat --quiet"
    code, _, error = morpholab(f"{line} --out run")
    assert code == 0, error
    values = json.loads((tmp_path / "run/best.json").read_text())["values"]
    assert list(values)[-2:] == ["f_stiffness", "toe_stiffness"]
    code, _, error = morpholab("export run --model best.xml")
    assert code == 0, error
    best = hinges(read_model((tmp_path / "best.xml").read_text()).tree)
    assert best["front"].motor.by_angle == pytest.approx(-30 * values["f_stiffness"])
    assert best["toe"].passive.stiffness == pytest.approx(2 * values["toe_stiffness"])
    code, _, error = morpholab("simulate --robot sprung.xml --hinge-stiffness toe=0:1")
    assert code == 2 and "argument --hinge-stiffness: 0.0 is not allowed; give a number from 0.01 to 100" in error
