"""Motions of the inflatable robot."""

from dataclasses import replace

import numpy as np
import pytest
from motions import DESIGN, QUICK, TINY

from robots.inflatable import simulate
from robots.inflatable.view.motion import inflatable_motion
from robots.view.motion import GroundPlane
from robots.world import Terrain
from taichi_sim.lattice.faces import corners, mean_of_face_corners, rotate


@pytest.fixture(scope="module")
def inflatable():
    return simulate(DESIGN, geometry=TINY, actuation=QUICK, precision="f32", record_every=10, threads=1)


@pytest.mark.kernels
def test_boxes_of_voxels_have_their_corners(inflatable):
    motion = inflatable_motion(inflatable, DESIGN, actuation=QUICK)
    frame = 7
    f = inflatable.frames
    pose = (a[frame, 0].astype(float) for a in (f.positions, f.orientations, f.extents))
    expected = corners(*pose)
    signs = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    shown = motion.translation[frame][:, None] + rotate(
        motion.rotation[frame][:, None], signs * motion.scale[frame][:, None]
    )
    assert np.abs(shown - expected).max() < 1e-6
    assert len(motion.nodes) == inflatable.body.voxel_count and motion.times == pytest.approx(f.times)


@pytest.mark.kernels
def test_the_timeline_of_a_gait_is_its_matrix(inflatable):
    motion = inflatable_motion(inflatable, DESIGN, Terrain(10.0), actuation=QUICK)
    switches = [channel for channel in motion.channels if channel.switch]
    assert [channel.name for channel in switches] == [f"bladder {i}" for i in range(1, 9)] + ["foot 1", "foot 2"]
    assert np.array_equal([channel.values[:-1] for channel in switches], DESIGN.schedule.played)
    assert switches[0].times[-1] == pytest.approx(inflatable.steps[0] * inflatable.time_step)
    others = {channel.name: channel for channel in motion.channels if not channel.switch}
    assert others["core pressure"].values == pytest.approx(np.full(2, 6.0))
    f = inflatable.frames
    middle = mean_of_face_corners(inflatable.body, *(a[[0, -1], 0] for a in (f.positions, f.orientations, f.extents)))
    gone = np.diff(middle[:, :2], axis=0)[0] @ [np.cos(np.pi / 6), np.sin(np.pi / 6)]
    assert others["distance"].values[-1] == pytest.approx(gone, abs=1e-7)
    assert motion.ground == GroundPlane(-0.01, 10.0, 30.0)
    lit = {node.channel for node in motion.nodes}
    assert lit == {None, *range(10)} and {node.foot for node in motion.nodes} == {None, 8, 9}
    assert [channel.name for channel in motion.channels if channel.read_out] == ["core pressure", "distance", "speed"]
    assert [channel.group for channel in switches] == ["bladder"] * 8 + ["foot"] * 2


@pytest.mark.kernels
def test_frames_that_are_missing_or_of_others_are_refused_in_one_line(inflatable):
    nothing = replace(inflatable, frames=None)
    with pytest.raises(ValueError, match=r"^frames: nothing was recorded; simulate with record_every$"):
        inflatable_motion(nothing, DESIGN)
    other = replace(inflatable, body=replace(TINY, rows=12).body)
    with pytest.raises(ValueError, match=r"^frames: they have \d+ voxels, the body \d+; give its own$"):
        inflatable_motion(other, DESIGN)
    with pytest.raises(ValueError, match=r"^robot: 1 is not allowed; the batch has 1$"):
        inflatable_motion(inflatable, DESIGN, robot=1)
    lost = replace(inflatable.frames, positions=np.full_like(inflatable.frames.positions, np.nan))
    with pytest.raises(ValueError, match=r"^frames: the robot has none; it diverged at once"):
        inflatable_motion(replace(inflatable, frames=lost), DESIGN)


@pytest.mark.kernels
def test_a_robot_that_diverges_is_shown_until_then(inflatable):
    frames = inflatable.frames
    positions = frames.positions.copy()
    positions[5:] = np.nan
    motion = inflatable_motion(replace(inflatable, frames=replace(frames, positions=positions)), DESIGN)
    assert len(motion.times) == 5
