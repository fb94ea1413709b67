"""Files of robots written anew with bodies of other sizes: read again they are the robots that were simulated."""

import contextlib
import re

import mujoco
import numpy as np
import pytest
from articulated_files import CRAWLER
from mujoco_reading import Pair
from random_mjcf import random_mjcf
from random_urdf import random_urdf

from taichi_sim.rigid.model.files import read_model
from taichi_sim.rigid.model.resizing import resized_text
from taichi_sim.rigid.model.scaling import scaled_tree

TETRAHEDRON = "0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"
PICTURED = f"""<?xml version="1.0" encoding="latin-1"?>
<!-- Licence: none. -->
<mujoco model="pictured"><compiler angle="radian" inertiagrouprange="0 1"/>
<default><geom density="500"/><site size="0.01"/>
<default class="leg"><geom type="capsule" size="0.02 0.1" pos="0 0 -0.1"/><joint axis="0 1 0" pos="0 0 0.03"/></default>
</default>
<asset><mesh name="shell" vertex="{TETRAHEDRON}" scale="2 2 2"/><mesh name="cap" vertex="{TETRAHEDRON}"/></asset>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="trunk" pos="0.3 0 0.5" euler="0 0 1"><freejoint/><geom type="box" size="0.2 0.1 0.05" euler="0 0 -1"/>
<geom type="mesh" mesh="shell" contype="0" conaffinity="0" group="2"/><camera name="eye" pos="0.3 0 0.1"/>
<!-- the left leg -->
<body name="left" pos="0 0.1 0" childclass="leg" quat="0.8 0.6 0 0"><joint name="left"/>
<inertial pos="0 0.01 -0.1" mass="0.4" diaginertia="0.002 0.002 0.001"/>
<geom/><site name="knee" pos="0 0 -0.2"/><geom type="mesh" mesh="cap" contype="0" conaffinity="0" group="2"/></body>
<body name="right" pos="0 -0.1 0" childclass="leg"><joint name="right" ref="0.2"/><geom/>
<body name="boot" pos="0 0 -0.2"><geom class="main" type="sphere" size="0.03"/>
<geom type="mesh" mesh="cap" contype="0" conaffinity="0" group="2" class="main"/></body></body>
</body></worldbody>
<actuator><position joint="left" kp="20" kv="2" ctrlrange="-1 1"/><velocity joint="right" kv="3" ctrlrange="-2 2"/>
</actuator></mujoco>"""
URDF = """<robot name="cart" xmlns:other="http://example.org/other">
<link name="base"><inertial><origin xyz="0.1 0 0"/><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>
<visual><geometry><mesh filename="package://cart/base.stl"/></geometry></visual>
<collision><origin xyz="0 0 -0.1"/><geometry><box size="0.4 0.2 0.1"/></geometry></collision></link>
<joint name="hip" type="revolute"><origin xyz="0.2 0 0"/><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="3"/></joint>
<link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0.001"/></inertial>
<visual><geometry><mesh filename="arm.stl" scale="0.001 0.001 0.001"/></geometry></visual>
<collision><origin xyz="0 0 -0.2"/><geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
<joint name="weld" type="fixed"><origin xyz="0 0 -0.4"/><parent link="arm"/><child link="tip"/></joint>
<link name="tip"/>
</robot>"""


def sizes_of(text, seed=0):
    tree = read_model(text).tree
    sizes = np.random.default_rng(seed).uniform(0.4, 2.2, len(tree.bodies))
    sizes[0] = 1.0 if tree.ordered[0][0].mass == 0 else sizes[0]
    return sizes


def readable(make, count, read):
    """Random files without bounds of masses that a reader takes, each with its seed."""
    for seed in range(count):
        text = re.sub(r'bound(mass|inertia)="[^"]*"', "", make(seed))
        with contextlib.suppress(ValueError):
            read(text)
            yield seed, text


@pytest.mark.parametrize("make", [random_mjcf, random_urdf])
def test_random_files_hold_robots_of_all_sizes(make):
    """The function compares with the resized tree itself, and refuses what differs."""
    resized = 0
    for seed, text in readable(make, 150, read_model):
        sizes = sizes_of(text, seed)
        assert (resized_text(text, sizes) == text) == (sizes == 1).all()
        resized += 1
    assert resized > 140


def test_random_files_hold_hinges_of_any_stiffness_and_drives_of_any_torque():
    """But for position drives with a constant bias of their class, which only a general one could have otherwise."""
    stiffened = 0
    for seed, text in readable(random_mjcf, 60, Pair):
        factors = np.random.default_rng(seed).uniform(0.3, 3.0, (2, len(read_model(text).tree.bodies)))
        try:
            Pair(resized_text(text, sizes_of(text, seed), *factors.tolist())).same()
            stiffened += 1
        except ValueError as refused:
            assert "would not be the same in such a file" in str(refused)
            assert "biasprm" in text and "<position" in text
    assert stiffened > 52


def test_mujoco_reads_the_same_bodies():
    compared = 0
    for seed, text in readable(random_mjcf, 40, Pair):
        Pair(resized_text(text, sizes_of(text, seed))).same()
        compared += 1
    assert compared > 35


def test_meshes_defaults_and_comments_stay_and_grow_with_their_bodies():
    tree = read_model(PICTURED).tree
    assert [body.name for body, _ in tree.ordered] == ["trunk", "left", "right", "boot"]
    text = resized_text(f"{PICTURED}\n<!-- The end, </mujoco>. -->\n", [1.0, 0.5, 2.0, 2.0])
    assert "The end" not in text  # what looks like the end of the root is left out
    text = resized_text(f"{PICTURED}\n<!-- The end. -->\n", [1.0, 0.5, 2.0, 2.0])
    assert text.endswith("</mujoco>\n<!-- The end. -->\n")
    assert text.startswith("<!-- Licence: none. -->\n<mujoco model=") and "<!-- the left leg -->" in text
    assert 'euler="0 0 -1"' in text and '<velocity joint="right" kv="3" ctrlrange="-2 2" />' in text
    before, after = mujoco.MjModel.from_xml_string(PICTURED), mujoco.MjModel.from_xml_string(text)
    factors = np.array([0.0, 1.0, 0.5, 2.0, 2.0])
    np.testing.assert_allclose(after.body_mass, factors**3 * before.body_mass, rtol=1e-12)
    np.testing.assert_allclose(after.body_inertia, factors[:, None] ** 5 * before.body_inertia, rtol=1e-12)
    assert after.nmesh == 4  # a cap of either size
    for geom in range(before.ngeom):
        body = before.geom_bodyid[geom]
        np.testing.assert_allclose(after.geom_rbound[geom], max(factors[body], 0) * before.geom_rbound[geom], rtol=1e-6)
    data = [mujoco.MjData(model) for model in (before, after)]
    for model, each in zip((before, after), data, strict=True):
        mujoco.mj_forward(model, each)
    left = [each.xanchor[1] for each in data]  # the left hinge, which stays where the trunk has it
    np.testing.assert_allclose(left[1] - data[1].xpos[1], left[0] - data[0].xpos[1], atol=1e-12)
    knee = [each.site_xpos[0] - each.xanchor[1] for each in data]
    np.testing.assert_allclose(knee[1], 0.5 * knee[0], atol=1e-12)


def test_places_and_sizes_that_parts_do_not_tell_themselves_grow_too():
    classes = '<camera pos="0.3 0 0.2"/><default class="leg"><light pos="0 0.1 0"/>'
    text = PICTURED.replace('<site size="0.01"/>', "").replace('<default class="leg">', classes)
    parts = '<site name="tip" type="box" size="0.03"/><camera name="back"/><light name="lamp"/><geom/>'
    text = text.replace("<geom/>", parts, 1)
    before, after = (mujoco.MjModel.from_xml_string(each) for each in (text, resized_text(text, [1.0, 0.5, 2.0, 2.0])))
    np.testing.assert_allclose(before.site("knee").size, 0.005)
    for name in ("knee", "tip"):
        np.testing.assert_allclose(after.site(name).size, 0.5 * before.site(name).size, rtol=1e-12)
    np.testing.assert_allclose(after.camera("back").pos, [0.15, 0.0, 0.1], rtol=1e-12)
    np.testing.assert_allclose(after.camera("eye").pos, [0.3, 0.0, 0.1], rtol=1e-12)
    np.testing.assert_allclose(after.light("lamp").pos, [0.0, 0.05, 0.0], rtol=1e-12)


def test_links_keep_their_joints_and_their_pictures_grow():
    text = resized_text(URDF, [1.5, 0.5])
    for told in ('scale="1.5 1.5 1.5"', 'scale="0.0005 0.0005 0.0005"', '<origin xyz="0 0 -0.2" />', 'value="0.125"'):
        assert told in text
    assert '<limit lower="-1" upper="1" effort="5" velocity="3" />' in text and text.count('xyz="0.3') == 1


def test_bounds_of_masses_do_not_grow_so_that_masses_are_told():
    bounded = CRAWLER.replace("<mujoco>", '<mujoco><compiler boundmass="0.5" boundinertia="0.01"/>')
    text = resized_text(bounded, [1.0, 0.5, 1.2])
    assert "bound" not in text and text.count("<inertial") == 3
    wanted = scaled_tree(read_model(bounded).tree, [1.0, 0.5, 1.2])
    np.testing.assert_allclose(read_model(text).tree.masses, wanted.masses, rtol=1e-12)
    np.testing.assert_allclose(wanted.masses, [1.0, 0.5 * 0.5**3, 0.5 * 1.2**3], rtol=1e-12)
    ghost = bounded.replace(
        '<site name="toe"/>', '<site name="toe"/><geom type="sphere" size="0.1" contype="0" conaffinity="0"/>'
    )
    with pytest.raises(ValueError, match="model: front would be another body in such a file, as with bounds"):
        resized_text(ghost, [1.0, 0.5, 1.2])


def test_a_robot_of_its_own_sizes_is_its_file():
    assert resized_text(CRAWLER, [1.0, 1.0, 1.0]) == CRAWLER
