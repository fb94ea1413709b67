"""Articulated robots: what their files say of hinges and drives, and friction that is not known."""

import math

import numpy as np
import pytest

from robots.articulated import ArticulatedRobot
from robots.articulated.kind import ArticulatedKind
from robots.articulated.rigid_motion import RigidMotion
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
