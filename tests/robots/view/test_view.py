"""Poses and strips on paper, and pictures of all robots."""

from dataclasses import replace

import motions
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from motions import QUICK, TINY, posed, shown

from robots.inflatable import InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import gait_timeline
from robots.inflatable.view import shape
from robots.view import scene
from robots.view.film import draw_strip
from robots.view.picture import motion_picture
from robots.view.scene import Camera
from robots.view.still import draw_pose, setting


@given(st.floats(0, 90), st.floats(-45, 45))
def test_what_is_along_the_way_keeps_its_length_and_slope_on_paper(heading, slope):
    camera = Camera(heading, slope)
    way = np.diff(camera.on_ground([0.0, 1.0], [0.2, 0.2], -0.01), axis=0)[0]
    assert way == pytest.approx([np.cos(np.deg2rad(slope)), np.sin(np.deg2rad(slope))], abs=1e-12)
    assert camera.project(np.array(camera.frame[2])) == pytest.approx([0, 1], abs=1e-12)


@given(st.floats(0, 90), st.floats(-45, 45))
def test_what_lies_towards_the_viewer_is_in_the_same_place_on_paper(heading, slope):
    camera = Camera(heading, slope)
    place = np.array([0.1, -0.2, 0.3])
    assert camera.project(place + 0.7 * camera.toward) == pytest.approx(camera.project(place))


def test_nearer_faces_are_painted_later_and_hidden_ones_never():
    motion, (quads, _) = shown(), shape.surface(posed())
    robot = setting(motion, [0]).polygons(0)
    assert 0 < len(robot.corners) < len(quads)
    assert len(robot.colours) == len(robot.corners) and robot.colours.min() >= 0 and robot.colours.max() <= 1
    assert robot.shadow[..., 1].max() < robot.corners[..., 1].max()


def test_sliding_feet_are_paler():
    both = GaitSchedule(np.concatenate([np.zeros((8, 2)), [[1, 0], [1, 0]]]), repeats=1)
    length = gait_timeline(InflatableDesign(0.0, 0.0, both), QUICK).steps * 1e-4
    motion = shown([(0.0, 0.0, 0.0)] * 2, both)
    motion = replace(motion, times=np.array([0.1, 0.9]) * length)
    gripping, sliding = (setting(motion, [frame]).polygons(frame).colours for frame in (0, 1))
    assert (sliding >= gripping).all() and sliding.sum() > gripping.sum()


def test_a_pose_on_any_axes():
    axes = Figure().add_subplot()
    draw_pose(axes, shown(), frame=0)
    assert any(isinstance(drawn, PolyCollection) for drawn in axes.collections)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert right - left > TINY.columns * TINY.voxel_size and top > 0 > bottom


@pytest.mark.long
@pytest.mark.parametrize(("step", "lines"), [(0.02, 3), (1.0, 1)])
def test_poses_that_are_clear_of_each_other_share_one_ground(step, lines):
    axes = Figure().add_subplot()
    places = [(step * i, 0, 0) for i in range(6)]
    draw_strip(axes, shown(places), list(range(6)))
    *times, bar = axes.texts
    assert [text.get_text() for text in times] == [f"{0.5 * i:.1f} s" for i in range(6)]
    assert bar.get_text().endswith(" cm" if step < 1 else " m")
    assert len({round(text.xy[1], 6) for text in times}) == lines


@pytest.mark.kernels
@pytest.mark.parametrize("make", [motions.soft_walker, motions.legged, motions.vehicle])
def test_every_robot_has_a_picture_with_its_channels(make):
    motion = make()
    figure = motion_picture(motion, frames=3)
    labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    switches = [channel for channel in motion.channels if channel.switch]
    drawn = switches or [channel for channel in motion.channels if np.ptp(channel.values) > 0]
    assert figure.texts[0].get_text() == motion.name and len(labels) == len(drawn)
    assert labels[0].startswith(drawn[0].name)


def test_colours_of_the_paper_are_matplotlibs():
    assert tuple(scene.PAPER) == to_rgb("white")
