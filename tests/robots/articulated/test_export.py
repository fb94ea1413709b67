"""What leaves the lab of robots of files: these with bodies of a design, and what their drives are told."""

import json
from pathlib import Path

import numpy as np
import pytest
from articulated_files import CART, CRAWLER

from robots.articulated import ArticulatedRobot, DriveReflexes, simulate
from robots.articulated.export import command_table
from robots.articulated.loading import robot_of_record
from robots.free import Free

pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")
SIZES = {"front": Free(0.5, 2.0), "rear": 0.7}
GEARED = CRAWLER.replace(
    '<position name="b" joint="hip" kp="30" ctrlrange="-0.8 0.8" forcerange="-8 8"/>',
    '<velocity name="b" joint="hip" kv="3" gear="2" ctrlrange="-1 3"/>',
).replace('name="shoulder"', 'name="shoulder" ref="10"')


def a_point(robot):
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + 0.7 * (high - low)


@pytest.mark.kernels
def test_the_robot_of_the_file_moves_as_the_design_did(tmp_path):
    robot = ArticulatedRobot(CRAWLER, duration=0.5, body_sizes=SIZES)
    point = a_point(robot)
    assert robot.save_model(point, tmp_path / "sized.xml") == []
    again = ArticulatedRobot((tmp_path / "sized.xml").read_text(), duration=0.5)
    here = {"precision": "f64", "threads": 1}
    found, expected = simulate(again, [point[:-1]], **here), simulate(robot, [point], **here)
    assert abs(expected.distance[0]) > 1e-3 and found.distance == pytest.approx(expected.distance, rel=1e-6)


def test_a_urdf_file_does_not_tell_where_its_base_starts(tmp_path):
    robot = ArticulatedRobot(CART, body_sizes={"*": Free(0.5, 2.0)})
    point = a_point(robot)
    told, missing = robot.save_model(point, tmp_path / "cart.urdf")
    assert missing == "MuJoCo finds no free base, ground or drives in URDF; a file that ends in .mjcf has them"
    base = ArticulatedRobot((tmp_path / "cart.urdf").read_text()).tree.ordered[0][0]
    height = base.position[2] + base.frame[2]
    assert told == f"the origin of {base.name} starts {height:.4g} m above the ground, which URDF does not tell"
    with pytest.raises(ValueError, match=r"^model: .*cart.sdf is not allowed; give a file that ends in .urdf or"):
        robot.save_model(point, tmp_path / "cart.sdf")


def test_a_urdf_robot_leaves_as_mjcf_too(tmp_path):
    robot = ArticulatedRobot(CART, body_sizes={"*": Free(0.5, 2.0)})
    point = a_point(robot)
    told = robot.save_model(point, tmp_path / "cart.mjcf")
    assert told == ["drives hold rates here; those of the file are servos, which bend under a load"]
    again = ArticulatedRobot((tmp_path / "cart.mjcf").read_text())
    tree = robot.variants.tree_of(robot.split(robot.points(point))[1][0])
    assert again.drives == robot.drives and again.tree.masses.tolist() == pytest.approx(tree.masses.tolist())
    mujoco = pytest.importorskip("mujoco")
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "cart.mjcf"))
    assert (theirs.nu, theirs.nq) == (len(robot.drives), 7 + len(tree.hinges))


@pytest.mark.kernels
def test_servos_of_a_urdf_robot_leave_as_they_are(morpholab, tmp_path):
    (tmp_path / "cart.urdf").write_text(CART)
    search = "--duration 0.1 --method random --climbers 2 --generations 0 --terrain flat --quiet"
    code, _, error = morpholab(f"codesign --robot cart.urdf --servos axle=0,0.3 {search} --out run")
    assert code == 0, error
    code, out, error = morpholab("export run --model cart.mjcf")
    assert code == 0 and "drives hold rates" not in out + error
    (motor,) = (hinge.motor for hinge in ArticulatedRobot((tmp_path / "cart.mjcf").read_text()).tree.hinges)
    assert (motor.by_rate, motor.torque) == (0.3, 2.0)
    code, out, error = morpholab("export run --model told.urdf")
    assert code == 0 and "drives are servos with gains, which URDF does not tell" in out + error
    robot = ArticulatedRobot(CART, servos={"axle": (0.0, 0.3)})
    assert dict(robot.facts())["Servos"] == "axle 0 N m/rad, 0.3 N m s/rad"
    record = json.loads(json.dumps(ArticulatedRobot(CART, servos={"axle": (0.0, 0.3)}).describe()))
    assert record["servos"] == {"axle": [0.0, 0.3]} and robot_of_record(record).servos == {"axle": (0.0, 0.3)}
    for line, message in (
        ("--servos axle=0,0.3 --servos axle=1", "servos: 'axle' is given twice; give each name once"),
        ("--servos stiff", "servos: 'stiff' is not allowed; give NAME=STIFFNESS,DAMPING or NAME=STIFFNESS"),
        ("--servos 40", "cart.urdf: servos of axle: it turns without end; give a damping above 0"),
    ):
        code, _, error = morpholab(f"simulate --robot cart.urdf {line}")
        assert code == 2 and message in error, error


def test_how_a_robot_starts_and_what_was_given_beside_its_file_is_told(tmp_path):
    ranged = CRAWLER.replace('name="shoulder"', 'name="shoulder" ref="10"').replace('name="hip"', 'name="hip" ref="5"')
    robot = ArticulatedRobot(ranged, angles={"hip": 0.3}, friction=np.inf, time_step=1e-3, body_sizes=SIZES)
    assert robot.save_model(a_point(robot), tmp_path / "crawler.xml") == [
        "hinges start at hip=0.3 rad, which the file does not tell",
        "the coefficient of friction is inf, which the file does not tell",
        "time steps are 0.001 s, which the file does not tell",
    ]
    cart = ArticulatedRobot(CART, fixed=True)
    told = cart.save_model(a_point(cart), tmp_path / "cart.urdf")
    assert told[0] == "the base is fixed to the world, which the file does not tell" and len(told) == 3
    hinged = ArticulatedRobot(ranged.replace('axis="0.2 1 0" range="-60 60"', 'axis="0.2 1 0" range="20 60"'))
    (told,) = hinged.save_model(a_point(hinged), tmp_path / "hinged.xml")
    assert told == "hinges start at hip=0.698132 rad, which the file does not tell"


def test_drives_are_told_angles_and_rates_as_their_file_counts_them(tmp_path):
    robot = ArticulatedRobot(GEARED, duration=0.3, command_rate=20.0)
    point = [1.5, 0.6, 0.1, 0.4, 0.5, 0.2, -0.3]  # frequency, then amplitude, phase and offset of a and b
    names, rows = command_table(robot, point)
    assert names == ["time [s]", "a [rad]", "b [rad/s]"]
    times = np.arange(6) * 0.05
    waves = [p * np.sin(2 * np.pi * (1.5 * times + q)) + (1 - p) * r for p, q, r in ((0.6, 0.1, 0.4), (0.5, 0.2, -0.3))]
    np.testing.assert_allclose(rows[:, 0], times, atol=1e-12)
    np.testing.assert_allclose(rows[:, 1], 0.8 * waves[0], atol=1e-12)  # the target that MuJoCo is told, too
    np.testing.assert_allclose(rows[:, 2], (1.0 + 2.0 * waves[1]) / 2, atol=1e-12)
    robot.save_commands(point, tmp_path / "told.csv")
    assert (tmp_path / "told.csv").read_text().startswith("time [s],a [rad],b [rad/s]\n0,")
    np.testing.assert_allclose(np.loadtxt(tmp_path / "told.csv", delimiter=",", skiprows=1), rows, atol=1e-9)


def test_drives_by_torque_are_told_torques_and_ideal_ones_rates():
    motors = CRAWLER.replace('<position name="b" joint="hip" kp="30"', '<motor name="b" joint="hip" gear="-5"')
    point = [1.5, 0.6, 0.1, 0.4, 0.5, 0.2, -0.3]
    (names, torques), (ideal, rates) = (
        command_table(ArticulatedRobot(motors, duration=0.3, fastest=fastest), point) for fastest in (None, 7.0)
    )
    assert names[1:] == ["a [rad]", "b [N m]"] and ideal[1:] == ["a [rad]", "b [rad/s]"]
    np.testing.assert_allclose(torques[:, 2] / (-5 * 0.8), rates[:, 2] / -7.0, atol=1e-12)
    assert abs(torques[:, 2]).max() > 1


def test_robots_that_decide_as_they_move_have_no_table(tmp_path):
    feeling = ArticulatedRobot(CRAWLER, reflexes=DriveReflexes(("touch",)))
    with pytest.raises(ValueError, match=r"^commands: a robot with reflexes decides them as it moves; give"):
        feeling.save_commands(feeling.start, tmp_path / "told.csv")
    thinking = ArticulatedRobot(CRAWLER, controller="network")
    with pytest.raises(ValueError, match=r"^commands: a robot with a network decides them as it moves"):
        thinking.save_commands(thinking.start, tmp_path / "told.csv")


@pytest.mark.kernels
def test_a_run_is_exported_with_its_body_and_commands(morpholab, tmp_path):
    Path("crawler.xml").write_text(CRAWLER)
    search = "codesign --robot crawler.xml --duration 0.3 --body-sizes front=0.5:2 --threads 1 --quiet --out run"
    assert morpholab(f"{search} --method hill-climb --climbers 2 --generations 1")[0] == 0
    code, out, error = morpholab("export run --model sized.xml --commands told.csv --json")
    assert code == 0, error
    assert json.loads(out) | {"source": ""} == {
        "source": "",
        "model": {"path": "sized.xml", "untold": []},
        "commands": "told.csv",
    }
    size = json.loads(Path("run/best.json").read_text())["values"]["front_size"]
    front = ArticulatedRobot(Path("sized.xml").read_text()).tree.ordered[1][0]
    assert front.mass == pytest.approx(0.3 * size**3)
    code, _, error = morpholab("export run --model sized.xml")
    assert code == 2 and "model: sized.xml exists; name a new file" in error
    code, _, error = morpholab("export inching --model inching.xml")
    assert code == 2 and "model: inflatable robot has no such file; leave it out" in error
    code, _, error = morpholab("export inching --commands told-2.csv")
    assert code == 2 and "commands: inflatable robot has no such table; leave it out" in error
    assert not Path("inching.xml").exists()
