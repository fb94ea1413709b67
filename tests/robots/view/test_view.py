"""Pictures of the inflatable robot, and numbers read off its poses."""

import subprocess
import sys
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import motions
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from robots.inflatable import (
    INCHING,
    PUBLISHED,
    ROLLING,
    Frames,
    InflatableActuation,
    InflatableDesign,
    InflatableGeometry,
    InflatableResult,
    simulate,
)
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import gait_timeline
from robots.inflatable.view import shape
from robots.inflatable.view.motion import inflatable_motion
from robots.view import scene
from robots.view.drawing import draw_schedule
from robots.view.film import draw_strip
from robots.view.picture import inflatable_picture, motion_picture, save_motion_picture
from robots.view.scene import Camera
from robots.view.still import draw_pose, setting
from robots.world import Terrain

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
STILL = GaitSchedule(np.zeros((10, 1)), repeats=1)


def posed(places=((0.0, 0.0, 0.0),), geometry=TINY) -> InflatableResult:
    """The robot as it was built, moved to some places one after the other."""
    body, one = geometry.body, np.ones(1)
    positions = body.start_positions + np.array(places)[:, None, None]
    orientations = np.broadcast_to([1.0, 0, 0, 0], (*positions.shape[:3], 4))
    extents = np.full((*positions.shape[:3], 6), geometry.voxel_size / 2)
    frames = Frames(positions, orientations, 0.5 * np.arange(len(places)), extents, 2 * extents[..., ::2])
    return InflatableResult(
        one, one, one, np.array(["ok"]), one[:, None], np.array([99]), 1e-4, frames, body, np.zeros((1, 2))
    )


@pytest.mark.parametrize("geometry", [TINY, PUBLISHED])
def test_read_outs_of_the_robot_as_built(geometry):
    result = posed([(0, 0, 0), (0.3, 0, 0)], geometry)
    assert shape.width(result) == pytest.approx(geometry.columns * geometry.voxel_size)
    assert shape.height(result) == pytest.approx(2 * geometry.voxel_size)
    assert shape.ratio(result) == pytest.approx(geometry.columns / 2)


@pytest.mark.kernels
def test_the_surface_has_no_gaps():
    simulated = simulate(
        InflatableDesign(6e3, 0.0, STILL), geometry=TINY, actuation=QUICK, precision="f32", record_every=40
    )
    quads, _ = shape.surface(simulated)
    corners = [[tuple(corner) for corner in quad] for quad in quads.tolist()]
    edges = Counter(tuple(sorted(pair)) for quad in corners for pair in pairwise([*quad, quad[0]]))
    assert all(count % 2 == 0 for count in edges.values())


@pytest.mark.kernels
def test_pressure_makes_the_robot_round():
    slow = InflatableActuation(inflation_rate=0.05, pressure_ramp=10.0, hold_steps=1500, settle_steps=30)
    designs = [InflatableDesign(pressure, 0.0, STILL) for pressure in (0.0, 6e3, 12e3)]
    result = simulate(designs, geometry=TINY, actuation=slow, precision="f32", record_every=30)
    flat, middle, round_ = (shape.ratio(result, robot) for robot in range(3))
    assert flat > middle + 0.4 > round_ + 0.8
    assert shape.height(result, robot=2) > 1.5 * shape.height(result, robot=0)


@pytest.mark.kernels
def test_read_outs_need_frames():
    result = simulate(InflatableDesign(0.0, 0.0, STILL), geometry=TINY, actuation=QUICK, precision="f32")
    with pytest.raises(ValueError, match=r"^frames: nothing was recorded; simulate with record_every$"):
        shape.width(result)


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


def shown(places=((0.0, 0.0, 0.0),), gait=STILL):
    return inflatable_motion(posed(places), InflatableDesign(0.0, 0.0, gait), actuation=QUICK)


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


def test_a_chart_has_a_coloured_cell_for_every_bit():
    axes = Figure().add_subplot()
    draw_schedule(axes, INCHING.schedule)
    (cells,) = axes.collections
    off = np.isclose(cells.get_facecolor()[:, :3], scene.GROUND).all(axis=1)
    assert (~off).sum() == INCHING.schedule.played.sum() and off.size == INCHING.schedule.played.size
    assert axes.get_xlim() == (0, 16) and all(x % 1 == 0 for x in axes.get_xticks())
    assert [label.get_text() for label in axes.get_yticklabels()][0:9:8] == ["bladder 1", "foot 1"]


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
def test_the_picture_of_a_gait(tmp_path):
    for name, design, terrain in (("roll", ROLLING, Terrain()), ("inch", INCHING, Terrain(15.0))):
        path = tmp_path / f"{name}.png"
        result = save_motion_picture(design, terrain, path, geometry=TINY, actuation=QUICK, frames=4)
        assert result.status[0] == "ok" and len(result.frames.times) >= 4
        assert path.read_bytes().startswith(b"\x89PNG") and 20_000 < path.stat().st_size < 500_000
    figure = inflatable_picture(result, INCHING, Terrain(15.0), actuation=QUICK, frames=4)
    (title,) = figure.texts
    assert "BL/s up a slope of 15°; core at 0 kPa, heading 90°" in title.get_text()
    again = tmp_path / "again.png"
    save_motion_picture(INCHING, Terrain(15.0), again, geometry=TINY, actuation=QUICK, frames=4)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.kernels
def test_the_shortest_gait_has_a_picture(tmp_path):
    actuation = InflatableActuation(hold_steps=20, settle_steps=2)
    design = InflatableDesign(0.0, 0.0, STILL)
    save_motion_picture(design, Terrain(), tmp_path / "a.png", geometry=TINY, actuation=actuation)
    assert (tmp_path / "a.png").exists()


def test_the_picture_of_a_robot_that_diverged():
    frames = posed([(0.02 * i, 0, 0) for i in range(6)]).frames
    frames.positions[3:] = np.nan
    nothing = np.array([np.nan])
    status = np.array(["diverged"])
    numbers = nothing, nothing, nothing, status, nothing[:, None], np.array([50])
    result = InflatableResult(*numbers, 1e-4, frames, TINY.body, np.zeros((1, 2)))
    figure = inflatable_picture(result, ROLLING, Terrain())
    assert figure.texts[0].get_text().startswith("diverged on flat ground")
    assert len(figure.axes[0].texts) == 3 + 1  # the poses before, and the scale bar
    frames.positions[:] = np.nan
    assert inflatable_picture(result, ROLLING, Terrain()).texts[0].get_text().startswith("diverged")


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


def test_a_picture_needs_two_poses(tmp_path):
    with pytest.raises(ValueError, match=r"^frames: 1 is not allowed; give a whole number, at least 2$"):
        save_motion_picture(ROLLING, Terrain(), tmp_path / "a.png", geometry=TINY, frames=1)
    assert not any(tmp_path.iterdir())


def test_colours_of_the_paper_are_matplotlibs():
    assert tuple(scene.PAPER) == to_rgb("white")


@pytest.mark.long
def test_simulating_needs_no_matplotlib_and_pictures_neither_pyplot_nor_torch():
    program = (
        "import sys, robots.inflatable, robots.inflatable.view.shape\n"
        "print('matplotlib' in sys.modules)\n"
        "import robots.view.picture\n"
        "print('matplotlib.pyplot' in sys.modules, 'torch' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert out.split() == ["False", "False", "False"]
