"""Recordings for Rerun, read back by its own reader."""

import sys

import motions
import numpy as np
import pytest
from made_motion import made

from robots.ground import Ground
from robots.view.glb import surface
from robots.view.mesh import boxes, joined_corners
from robots.view.motion import GroundPlane
from robots.view.rerun_file import SHADES, felt, save_rerun, skin_parts
from taichi_sim.lattice.faces import rotate


def entities(path):
    """Everything in a recording: component by entity and name, as its times [s] and its rows; None if it is static."""
    chunks = pytest.importorskip("rerun.chunk", reason="needs the extra rerun")
    found = {}
    for chunk in chunks.RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        columns = dict(zip(batch.schema.names, batch.columns, strict=True))
        times = None if chunk.is_static else np.asarray(columns["time"].cast("int64")) / 1e9
        for name, column in columns.items():
            if ":" in name:
                rows = column.to_pylist()
                at = [None] * len(rows) if times is None else times
                given = [(time, row) for time, row in zip(at, rows, strict=True) if row is not None]
                found.setdefault((chunk.entity_path, name), []).extend(given)
    return {key: sorted(rows, key=lambda row: row[0] or 0.0) for key, rows in found.items()}


def series(found, key, times):
    """Rows of a component over time, after a check of their times."""
    assert np.abs(np.array([time for time, _ in found[key]]) - times).max() < 1e-8
    return [np.array(row) for _, row in found[key]]


def static(found, key):
    ((time, row),) = found[key]
    assert time is None
    return np.array(row)


def colour(packed):
    return np.array([packed >> 24, packed >> 16 & 255, packed >> 8 & 255]) / 255


def check_series(found, motion):
    """All channels are there, with their values, units and steps."""
    names = {}
    for (entity, component), rows in found.items():
        if component == "SeriesLines:names":
            names[rows[0][1][0]] = entity
    channels = [*motion.channels, *felt(motion)]
    assert len(names) == len(channels)
    for channel in channels:
        entity = names[f"{channel.name} [{channel.unit}]" if channel.unit else channel.name]
        values = series(found, (entity, "Scalars:scalars"), channel.times)
        assert np.array_equal(np.ravel(values), channel.values)
        (mode,) = static(found, (entity, "SeriesLines:interpolation_mode"))
        assert mode == (2 if channel.switch else 1)


def outwards(motion, points):
    """Unit normals of the points of a surface: along the sum of the areas of the faces around them."""
    areas = np.zeros_like(points)
    for _, corners, *_ in skin_parts(motion):
        a, b, c, d = points[corners].swapaxes(0, 1)
        for corner in corners.T:
            np.add.at(areas, corner, np.cross(b - a, c - a) + np.cross(c - a, d - a))
    return areas / (np.linalg.norm(areas, axis=1, keepdims=True) + 1e-30)


@pytest.mark.kernels
@pytest.mark.parametrize("robot", [motions.inflatable, motions.soft_walker])
def test_lattices_are_meshes_whose_vertices_move(robot, tmp_path, monkeypatch):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    monkeypatch.setattr("robots.view.rerun_file.AT_ONCE", 10_000)  # several blocks
    motion = robot().every(6)
    assert save_rerun(motion, tmp_path / "a.rrd") == (tmp_path / "a.rrd").stat().st_size
    found = entities(tmp_path / "a.rrd")
    shown = 0
    for entity, corners, full, channel in skin_parts(motion):
        triangles = static(found, (entity, "Mesh3D:triangle_indices"))
        places = series(found, (entity, "Mesh3D:vertex_positions"), motion.times)
        normals = series(found, (entity, "Mesh3D:vertex_normals"), motion.times)
        for frame in range(len(motion.times)):
            points = joined_corners(boxes(motion, frame), motion.skin.knots)
            a, b, c, d = points[corners].swapaxes(0, 1)
            expected = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            assert np.array_equal(places[frame][triangles], expected.astype(np.float32))
            assert np.abs(normals[frame] - outwards(motion, points)[np.unique(corners)]).max() < 1 / SHADES
        factors = found[entity, "Mesh3D:albedo_factor"]
        if channel is None:
            assert np.abs(colour(factors[0][1][0]) - full).max() < 1 / 255
        else:
            levels = motion.channels[channel].levels(motion.times)
            at = np.searchsorted([time for time, _ in factors], motion.times + 1e-6) - 1
            apart = np.array([np.abs(colour(factors[k][1][0]) - full).max() for k in at])
            assert (apart[levels == 1] < 1 / 255).all() and (apart[levels < 0.5] > 0.1).all()
        shown += len(triangles)
    assert shown == 2 * len(motion.skin.faces)
    check_series(found, motion)


@pytest.mark.kernels
@pytest.mark.parametrize("robot", [motions.legged, motions.two_wheels, motions.vehicle])
def test_parts_are_meshes_with_poses(robot, tmp_path):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    motion = robot()
    save_rerun(motion, tmp_path / "a.rrd")
    found = entities(tmp_path / "a.rrd")
    check_parts(found, motion)
    check_series(found, motion)
    for n, place in enumerate(motion.lights, start=1):
        ball = static(found, (f"/world/scene/light_{n}", "Mesh3D:vertex_positions")) - place
        assert np.abs(np.linalg.norm(ball, axis=1) - motion.light_radius).max() < 1e-5


def check_parts(found, motion):
    """All vertices of all parts are where the motion has them."""
    for n, node in enumerate(motion.nodes):
        entity = "/world/scene/" + node.name.replace(" ", "\\ ")
        places = series(found, (entity, "Transform3D:translation"), motion.times)
        turns = series(found, (entity, "Transform3D:quaternion"), motion.times)
        vertices = static(found, (entity, "Mesh3D:vertex_positions"))
        sizes = [np.ones(3)] * len(places)
        if (entity, "Transform3D:scale") in found:
            sizes = series(found, (entity, "Transform3D:scale"), motion.times)
        for frame in range(len(motion.times)):
            turn = np.broadcast_to(np.roll(turns[frame].ravel(), 1), (len(vertices), 4))
            shown = places[frame].ravel() + rotate(turn, sizes[frame].ravel() * vertices)
            form = np.asarray(surface(node.solid).vertices) * motion.scale[frame, n]
            turn = np.broadcast_to(motion.rotation[frame, n], (len(form), 4))
            expected = motion.translation[frame, n] + rotate(turn, form)
            assert np.abs(shown - expected).max() < 1e-6 * (1 + np.abs(expected).max())


def test_parts_that_grow_and_a_slope(tmp_path):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    motion = made(ground=GroundPlane(slope=20.0, heading=30.0))
    save_rerun(motion, tmp_path / "a.rrd")
    found = entities(tmp_path / "a.rrd")
    check_parts(found, motion)
    turn = np.roll(static(found, ("/world/scene", "Transform3D:quaternion")).ravel(), 1)
    assert np.abs(turn - motion.ground.upright).max() < 1e-6


def test_ground_is_where_the_simulation_has_it(tmp_path):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    relief = Ground("stairs:0.05,0.3,0.1").relief(30.0, 0.05)
    places = {}
    for name, ground in {
        "a": GroundPlane(-0.025, relief=relief),
        "b": GroundPlane(-0.025),
        "c": GroundPlane(solid=False),
    }.items():
        save_rerun(made(ground=ground), tmp_path / f"{name}.rrd")
        found = entities(tmp_path / f"{name}.rrd")
        places[name] = ("/world/scene/ground", "Mesh3D:vertex_positions") in found
        if places[name]:
            x, y, z = static(found, ("/world/scene/ground", "Mesh3D:vertex_positions")).T
            height = relief.height(x, y) if name == "a" else 0.0
            assert np.abs(z + 0.025 - height).max() < 1e-6
            assert x.min() < 0 < 3 < x.max()
    assert places == {"a": True, "b": True, "c": False}


def test_a_motion_is_one_recording_with_a_layout(tmp_path):
    chunks = pytest.importorskip("rerun.chunk", reason="needs the extra rerun")
    for name, motion in {"a": made(), "b": made(), "c": made(frames=5)}.items():
        save_rerun(motion, tmp_path / f"{name}.rrd")
    stores = [chunks.RrdReader(tmp_path / f"{name}.rrd") for name in "abc"]
    first, again, other = (reader.recordings()[0].recording_id for reader in stores)
    assert first == again != other and all(len(reader.blueprints()) == 1 for reader in stores)
    assert entities(tmp_path / "a.rrd") == entities(tmp_path / "b.rrd")


def test_files_that_exist_are_refused(tmp_path):
    (tmp_path / "a.rrd").write_text("mine")
    with pytest.raises(ValueError, match=r"^path: .*a.rrd exists; name a new file$"):
        save_rerun(made(), tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_text() == "mine" and len(list(tmp_path.iterdir())) == 1


def test_recordings_need_their_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ValueError, match=r"^rerun: rerun-sdk is missing; install the extra rerun "):
        save_rerun(made(), tmp_path / "a.rrd")
    assert not list(tmp_path.iterdir())
