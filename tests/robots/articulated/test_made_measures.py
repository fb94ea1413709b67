"""Measures of how a file's robot is made: its mass, and the limits of its drives."""

import json

import numpy as np
import pytest
from articulated_files import CART, CRAWLER
from crawlers import HERE, crawler, some_points

from robots.articulated import ArticulatedRobot
from robots.free import Free
from robots.own_measures import OwnMeasure
from taichi_sim.base.compute import Compute
from taichi_sim.rigid import Motor, Servo
from taichi_sim.rigid.model.actuation import largest_torque

ALONE = Compute.given(HERE)
FREE = {"body_sizes": {"*r*": Free(0.5, 2.0)}, "drive_torque": {"front": Free(0.5, 2.0)}, "duration": 0.05}


@pytest.mark.parametrize(
    ("drive", "largest"),
    [
        (Motor(3.0, 5.0), 3.0),
        (Servo(8.0, -10.0, torque=2.0), 2.0),
        (Servo(8.0, -10.0), np.inf),
        (Servo(8.0, by_rate=1.0), np.inf),
        (Servo(-8.0, offset=2.0), 10.0),
        (Servo(-8.0, offset=2.0, torque=9.0), 9.0),
    ],
)
def test_the_largest_torque_of_a_drive_is_its_limit_or_that_of_its_commands(drive, largest):
    assert largest_torque(drive) == largest


def test_torque_limits_are_a_measure_where_every_drive_has_a_limit():
    assert [measure.name for measure in crawler().measures] == ["speed", "distance", "energy", "mass", "torque_limits"]
    text = CRAWLER.replace('ctrlrange="-0.8 0.8" forcerange="-8 8"/>\n', 'ctrlrange="-0.8 0.8"/>\n')
    assert "torque_limits" not in [measure.name for measure in ArticulatedRobot(text).measures]


@pytest.mark.kernels
def test_they_are_those_of_the_tree_whatever_it_does():
    robot = crawler(**FREE)
    points = some_points(robot, 3)
    found = robot.differentiate(points, robot.worlds[0], measures=["mass", "torque_limits"], compute=ALONE)
    sizes, torques = points[:, -2:].T
    assert found.measures["mass"] == pytest.approx(1.6 * sizes**3)
    assert found.measures["torque_limits"] == pytest.approx(8 * torques + 8)
    assert found.gradients["mass"][:, -2] == pytest.approx(4.8 * sizes**2, rel=1e-8)
    assert found.gradients["torque_limits"][:, -1] == pytest.approx(8.0, rel=1e-8)
    assert not found.gradients["mass"][:, :-2].any() and not found.gradients["torque_limits"][:, :-1].any()
    plain = ArticulatedRobot(CART, duration=0.05)
    told = plain.simulate(some_points(plain, 2), plain.worlds[0], compute=ALONE).measures
    assert told["mass"].tolist() == [2, 2] and told["torque_limits"].tolist() == [2, 2]


@pytest.mark.kernels
def test_a_measure_of_ones_own_may_have_their_names():
    own = OwnMeasure("mass", law=lambda motion: 3.0 + 0.0 * motion.places[:, 0, 0])
    robot = crawler(**FREE, own_measures=(own,))
    found = robot.differentiate(some_points(robot, 1), robot.worlds[0], measures=["mass"], compute=ALONE)
    assert found.measures["mass"].tolist() == [3.0] and not found.gradients["mass"].any()


@pytest.mark.kernels
def test_searches_weigh_and_bound_them(morpholab, tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    free = "--drive-torque front --body-sizes trunk --duration 0.1 --friction inf --terrain flat"
    goals = "--objective speed --objective minimise:0.5*torque_limits --objective 'mass <= 1'"
    search = f"--method gradient --climbers 2 --generations 12 --quiet {goals}"
    code, _, error = morpholab(f"codesign --robot crawler.xml {free} {search} --out run")
    assert code == 0, error
    values = json.loads((tmp_path / "run/best.json").read_text())["values"]
    assert values["front_torque"] < 0.9 and values["trunk_size"] < 0.95
    code, out, _ = morpholab("simulate --robot run --json")
    made = json.loads(out)
    assert made["torque_limits"] == pytest.approx(8 * values["front_torque"] + 8)
    assert made["mass"] == pytest.approx(values["trunk_size"] ** 3 + 0.6)
