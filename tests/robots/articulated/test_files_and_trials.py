"""Articulated robots: what their files say of hinges and drives, and friction that is not known."""

import math

import numpy as np
import pytest
from articulated_files import CRAWLER

from morpholab import OwnMeasure
from robots.articulated import ArticulatedRobot, DriveReflexes, differentiate, load_robot, simulate
from robots.articulated.kind import ArticulatedKind
from robots.articulated.loading import robot_of_record
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


ARM = """<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="1 1 1"/><body name="arm" pos="0 0 1">
  <joint name="h" axis="0 1 0" range="-90 90"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.1"/></body></worldbody>
  <actuator><position joint="h" kp="50" kv="5"/></actuator></mujoco>"""
STAND = """<robot name="stand"><link name="world"/>
  <link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="0.1"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-5"/></inertial></link>
  <joint name="h" type="revolute"><parent link="world"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
  <limit lower="-1.5708" upper="1.5708" effort="100" velocity="10"/></joint></robot>"""


@pytest.mark.kernels
@pytest.mark.parametrize("text", [ARM, STAND])
def test_the_world_that_an_arm_is_hinged_to_has_no_share_in_its_centre(text):
    """It counted 1 kg: an arm of 0.1 kg that turned by a right angle came 18 mm, not 0.2 m."""
    way = OwnMeasure("way", "m", law=lambda motion: motion.centres(motion.places)[:, 0])
    robot = ArticulatedRobot(text, duration=2.0, friction=math.inf, own_measures=(way,))
    assert (
        robot.model.tree.masses.tolist() == [0.0, 0.1]
        and "1 bodies on 1 hinges, 0.1 kg" in dict(robot.facts())["Robot"]
    )
    found = simulate(robot, [[1.0, 0.0, 0.0, -1.0]], precision="f64", threads=1)
    assert found.distance == pytest.approx([0.2], abs=1e-4) == found.own["way"]
    point = np.array([[1.0, 0.0, 0.0, 0.3]])
    slope = differentiate(robot, point, precision="f64", threads=1).gradient[0, 3]
    ends = [
        simulate(robot, point + np.array([0, 0, 0, sign * 1e-4]), precision="f64", threads=1).distance[0]
        for sign in (1, -1)
    ]
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-5) and abs(slope) > 0.2


def test_what_is_fixed_to_the_world_has_the_mass_that_its_file_says():
    base = MASS.replace('mass value="1"', 'mass value="3"')
    bolts = '<joint name="bolts" type="fixed"><parent link="world"/><child link="plate"/></joint>'
    bolted = STAND.replace("</robot>", f'<link name="plate">{base}</link>{bolts}</robot>')
    assert parse_model(bolted).tree.masses.tolist() == [3.0, 0.1]
    heavy = STAND.replace('<link name="world"/>', f'<link name="world">{base}</link>')
    assert parse_model(heavy, fixed=True).tree.masses.tolist() == [3.0, 0.1]


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
