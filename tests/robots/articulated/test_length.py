"""The length of an articulated robot, by which speeds and readings are divided."""

import pytest

from robots.articulated import load_robot
from robots.articulated.simulation import anatomy_of

ROD = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="b" pos="0 0 0.3"><freejoint/>
<geom type="sphere" size="{radius}" mass="1"/><geom type="capsule" fromto="-0.5 0 0 0.5 0 0" size="0.01" mass="0.1"/>
<body name="leg"><joint name="hip" type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.28" size="0.02" mass="0.1"/></body></body></worldbody>
<actuator><velocity joint="hip" ctrlrange="-1 1" forcerange="-1 1"/></actuator></mujoco>"""


@pytest.mark.filterwarnings("ignore:model. ignored are gains of drives")
@pytest.mark.parametrize("radius", [0.02, 0.1, 0.29])
def test_it_is_the_longest_side_whatever_lies_in_the_middle(tmp_path, radius):
    (tmp_path / "rod.xml").write_text(ROD.format(radius=radius))
    assert anatomy_of(load_robot(tmp_path / "rod.xml", duration=1.0)).length == pytest.approx(1.02)
