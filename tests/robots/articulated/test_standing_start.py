"""The first step of robots that stand on level ground at the start: rounding does not decide which feet hold."""

import math

import numpy as np
import pytest
from articulated_files import CRAWLER

from robots.articulated import ArticulatedRobot, simulate
from robots.free import Free

LEG = """<link name="{0}_thigh"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
<inertia ixx="0.002" iyy="0.002" izz="0.0002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="{0}_shin"><inertial><origin xyz="0 0 -0.1"/><mass value="0.2"/>
<inertia ixx="0.0008" iyy="0.0008" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.03"/></geometry></collision></link>
<joint name="{0}_hip" type="revolute"><parent link="base"/><child link="{0}_thigh"/><origin xyz="{1} -0.05"/>
<axis xyz="0 1 0"/><limit lower="-0.9" upper="1.1" effort="20" velocity="8"/></joint>
<joint name="{0}_knee" type="revolute"><parent link="{0}_thigh"/><child link="{0}_shin"/><origin xyz="0 0 -0.2"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="0.3" effort="15" velocity="8"/></joint>"""
TWO_LEGS = f"""<robot name="two legs"><link name="base"><inertial><mass value="4"/>
<inertia ixx="0.03" iyy="0.05" izz="0.07" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.4 0.2 0.1"/></geometry></collision></link>
{LEG.format("l", "0.15 0.1")}{LEG.format("r", "-0.15 -0.1")}</robot>"""
STANDING = CRAWLER.replace('pos="0 0 0.1"', 'pos="0 0 0.09"')  # its feet are at z = 0
BARELY = 1e-6  # change of a size [1]


def distances(model: str, body: str) -> np.ndarray:
    """How far robots come that differ by a millionth of the size of a body [m]."""
    robot = ArticulatedRobot(model, duration=0.25, friction=math.inf, body_sizes={body: Free(0.5, 2.0)})
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    one = low + (high - low) * np.random.default_rng(0).uniform(0.2, 0.8, len(low))
    points = np.repeat(one[None], 64, 0)
    points[:, -1] += np.linspace(-BARELY / 2, BARELY / 2, len(points))
    return simulate(robot, points, precision="f64", threads=1).distance


@pytest.mark.kernels
@pytest.mark.parametrize(("model", "body"), [(TWO_LEGS, "?_shin"), (STANDING, "front")])
def test_robots_that_differ_by_a_millionth_come_out_alike(model: str, body: str) -> None:
    found = distances(model, body)
    assert np.ptp(found) < 10 * BARELY * max(1.0, abs(found).max())
