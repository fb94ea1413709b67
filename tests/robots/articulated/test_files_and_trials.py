"""Articulated robots: what their files say of hinges and drives, and friction that is not known."""

import math

import numpy as np
import pytest
from articulated_files import CRAWLER

from robots.articulated import ArticulatedRobot, DriveReflexes, load_robot
from robots.articulated.kind import ArticulatedKind
from robots.articulated.rigid_motion import RigidMotion
from robots.articulated.robot import robot_of_record
from robots.uncertainty import Perturbation, Uncertainty
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.rigid.model.files import parse_model

HERE = Compute("cpu", "f64", 1)
MASS = '<inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def knee(limit: str, kind: str = "revolute", size: str = "0.1 0.1 0.1", turn: str = "0 0 0") -> str:
    box = f'<collision><origin rpy="{turn}"/><geometry><box size="{size}"/></geometry></collision>'
    return f"""<robot name="leg"><link name="base">{MASS}{box}</link><link name="shank">{MASS}</link>
      <joint name="knee" type="{kind}"><parent link="base"/><child link="shank"/><origin xyz="0 0 0.3"/>
      <axis xyz="0 1 0"/><limit {limit}/></joint></robot>"""


BENT = knee('lower="-1.6" upper="-0.2" effort="5" velocity="3"')


@pytest.mark.kernels
def test_frames_and_measures_count_angles_as_the_file_does():
    robot = ArticulatedRobot(BENT, duration=0.05)
    found = robot.simulate(robot.start[None], Terrain(), compute=HERE, record_every=1)
    assert found.frames["angles"][0, 0, 0] == pytest.approx(-0.9) == robot.model.tree.hinges[0].rest
    (run,) = found.result.runs
    motion = RigidMotion.of(robot, run.position, run.orientation, run.angles)
    assert np.array_equal(motion.angles, run.angles - 0.9) and run.frames.angles[0, 0, 0] == 0


def test_a_continuous_joint_without_velocity_turns_at_the_fastest_rate():
    for limit, rate in (('effort="5"', 10.0), ('effort="5" velocity="0"', 10.0), ('effort="5" velocity="3"', 3.0)):
        assert parse_model(knee(limit, "continuous")).tree.hinges[0].motor.by_command == rate
    assert parse_model(knee('effort="5"', "continuous"), fastest=4.0).tree.hinges[0].motor.by_command == 4.0


def test_right_angles_may_be_rounded():
    turned = parse_model(knee('effort="5"', "continuous", "0.1 0.2 0.3", "0 1.57 0")).tree.bodies[0].shapes[0]
    assert turned.size == pytest.approx((0.3, 0.2, 0.1))
    with pytest.raises(ValueError, match="a box that is turned where its hinges rest is not allowed; give one along"):
        parse_model(knee('effort="5"', "continuous", "0.1 0.2 0.3", "0 1.5 0"))


@pytest.mark.parametrize(
    ("limit", "angles", "message"),
    [
        (
            'lower="-1.6" upper="-0.2"',
            {"knee": 0.5},
            "^angles: 0.5 of joint knee is not allowed; give .* -1.6 to -0.2$",
        ),
        ('lower="0" upper="0"', {}, "^joint knee: limits 0 and 0 are not allowed; give a lower and a higher one"),
        ('lower="1" upper="-1"', {}, "^joint knee: limits 1 and -1 are not allowed"),
    ],
)
def test_angles_and_limits_are_named_as_in_the_file(limit, angles, message):
    with pytest.raises(ValueError, match=message):
        parse_model(knee(limit), angles=angles)


def test_friction_can_be_drawn_if_there_is_a_cone():
    robot = ArticulatedRobot(BENT, friction=0.5)
    Uncertainty.parse("friction=20%,slope=1").check(robot, Terrain())
    drawn = Perturbation(sliding=0.8, gripping=0.8)
    assert robot.perturbed(drawn).physics.friction == pytest.approx(0.4)
    assert ("Floor", "friction 0.5") in [(name, told) for name, told, *_ in robot.facts()]
    with pytest.raises(ValueError, match="no friction to draw"):
        Uncertainty.parse("friction=20%").check(ArticulatedRobot(BENT, friction=math.inf), Terrain())


@pytest.mark.parametrize("text", ["inf", "infinity", "Infinity"])
def test_no_limit_of_friction_is_spelled_as_python_spells_it(text):
    (option,) = (each for each in ArticulatedKind.options if each.name == "friction")
    assert option.read(text) == math.inf


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (
            {"command_rate": 20.0},
            "command_rate: 20.0 is not allowed with a network, which has no rhythm; leave it out",
        ),
        ({"slowest": 1.0}, "slowest: 1.0 is not allowed with a network, which has no rhythm; leave it at 0.5"),
        ({"quickest": 0.4}, "quickest: 0.4 is not allowed with a network, which has no rhythm; leave it at 2"),
    ],
)
def test_settings_of_rhythms_are_refused_beside_a_network(tmp_path, settings, told):
    """But for records, which may be of runs that had them and go on."""
    path, usual = tmp_path / "crawler.xml", {"slowest": 0.5, "quickest": 2.0, "command_rate": None}
    path.write_text(CRAWLER)
    robot = load_robot(path, controller="network", **usual)
    with pytest.raises(ValueError, match=rf"crawler\.xml: {told}$"):
        load_robot(path, controller="network", **settings)
    if settings != {"quickest": 0.4}:  # which was never allowed
        assert robot_of_record(robot.describe() | settings).describe() == robot.describe() | settings


def test_a_light_that_nothing_sees_is_refused(tmp_path):
    """Environments may have one with any rhythm, for their policies."""
    path, light = tmp_path / "crawler.xml", (2.0, 0.0, 0.1)
    path.write_text(CRAWLER)
    build = ArticulatedKind().build
    for settings in ({"controller": "network"}, {"reflexes": DriveReflexes(("light",))}):
        assert build(str(path), {"light": light, **settings}).light == light
    for settings in ({}, {"reflexes": DriveReflexes(("tilt",))}):
        with pytest.raises(ValueError, match=r"^light: 2,0,0\.1 is not allowed, as nothing sees it; give reflexes"):
            build(str(path), {"light": light, **settings})
    assert ArticulatedRobot(CRAWLER, light=light).light == light
