"""Motions, and GLB files of them."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from made_motion import made
from motions import DESIGN, QUICK, TINY

from robots.inflatable import simulate
from robots.inflatable.view.motion import inflatable_motion
from robots.view.glb import save_glb
from robots.view.motion import CUBE, Channel, GroundPlane, Node, product
from robots.world import Terrain
from taichi_sim.lattice.faces import rotate


def test_uphill_is_up():
    for heading in (0.0, 40.0, 90.0):
        angle = np.deg2rad(heading)
        uphill = rotate(GroundPlane(0.0, 20.0, heading).upright, np.array([np.cos(angle), np.sin(angle), 0.0]))
        assert uphill == pytest.approx(
            [*np.cos(np.deg2rad(20)) * np.array([np.cos(angle), np.sin(angle)]), np.sin(np.deg2rad(20))]
        )


def test_motions_that_do_not_fit_are_refused_in_one_line():
    for change, words in {
        "nodes": "nodes: there are none; give at least one",
        "times": r"times: shape \(0,\) is not allowed; give \(F,\)",
    }.items():
        with pytest.raises(ValueError, match=f"^{words}$"):
            made(**{change: ()})
    with pytest.raises(ValueError, match=r"^scale: nan is not allowed; give finite numbers$"):
        made(scale=np.full((4, 3, 3), np.nan))
    with pytest.raises(ValueError, match=r"^path: shape \(3, 3\) is not allowed; give \(4, 3\)$"):
        made(path=np.zeros((3, 3)))
    with pytest.raises(ValueError, match=r"^channel: 1 of a node is not allowed; there are 0$"):
        made(nodes=[Node("n", CUBE, (0, 0, 0), 1)] * 3)
    with pytest.raises(ValueError, match=r"^a: 0.0 has no logarithm; give positive values$"):
        Channel("a", "", [0.0, 1.0], [0.0, 1.0], logarithmic=True)


def test_signs_of_rotations_do_not_jump():
    straight = made(frames=50)
    signs = np.where(np.arange(50)[:, None, None] % 3 == 1, -1.0, 1.0)
    jumping = replace(straight, rotation=straight.rotation * signs)
    assert (np.einsum("fnk,fnk->fn", jumping.rotation[1:], jumping.rotation[:-1]) > 0).all()
    assert jumping.rotation == pytest.approx(straight.rotation)


def test_fewer_frames_begin_and_end_alike():
    motion = made(frames=10)
    assert motion.every(4).times == pytest.approx(motion.times[[0, 4, 8, 9]])
    assert motion.every(3).translation == pytest.approx(motion.translation[[0, 3, 6, 9]])
    with pytest.raises(ValueError, match=r"^every: 0 is not allowed; give a whole number, at least 1$"):
        motion.every(0)


# GLB


def read_glb(path):
    """The document, and a function that reads an accessor."""
    data = path.read_bytes()
    assert data[:4] == b"glTF" and struct.unpack("<II", data[4:12]) == (2, len(data))
    length = struct.unpack("<I", data[12:16])[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def values(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, np.float32).reshape(accessor["count"], -1)

    return document, values


def test_tracks_of_a_glb_are_the_frames(tmp_path):
    motion = made(frames=9, lights=[[1.0, 2.0, 3.0]])
    path = tmp_path / "made.glb"
    assert save_glb(motion, path) == path.stat().st_size
    document, values = read_glb(path)
    (animation,) = document["animations"]
    names = [node["name"] for node in document["nodes"]]
    assert names == ["made", "part 0", "part 1", "part 2", "light 1"]
    tracks = {}
    for channel in animation["channels"]:
        sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
        assert values(sampler["input"])[:, 0] == pytest.approx(motion.times)
        tracks[target["node"], target["path"]] = values(sampler["output"])
    for n in range(3):
        assert tracks[n + 1, "translation"] == pytest.approx(motion.translation[:, n], abs=1e-6)
        assert tracks[n + 1, "rotation"][:, [3, 0, 1, 2]] == pytest.approx(motion.rotation[:, n], abs=1e-6)
        assert tracks[n + 1, "scale"] == pytest.approx(motion.scale[:, n], abs=1e-6)
    assert len(tracks) == 9  # none for the light
    geometry = [mesh["primitives"][0]["attributes"]["POSITION"] for mesh in document["meshes"]]
    assert len(geometry) == 4 and len(set(geometry)) == 2  # cubes share their numbers, and so do balls


@pytest.mark.kernels
def test_trimesh_loads_a_glb_with_all_nodes_in_place(tmp_path):
    result = simulate(DESIGN, geometry=TINY, actuation=QUICK, precision="f32", record_every=10, threads=1)
    motion = inflatable_motion(result, DESIGN, Terrain(15.0), actuation=QUICK)
    file = tmp_path / "robot.glb"
    save_glb(motion, file, rate=200.0)
    scene = trimesh.load(file)
    shown = [name for name in scene.graph.nodes_geometry if name.startswith("voxel")]
    assert len(shown) == len(motion.nodes)
    upright = product(np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0]), motion.ground.upright)
    for n in (0, 17, len(motion.nodes) - 1):
        place, _ = scene.graph.get(motion.nodes[n].name)
        assert place[:3, 3] == pytest.approx(rotate(upright, motion.translation[0, n]), abs=1e-6)
    document, values = read_glb(file)
    apart = np.diff(values(document["animations"][0]["samplers"][0]["input"])[:, 0])
    assert apart[:-1] == pytest.approx(np.full(len(apart) - 1, 0.005), rel=0.3)


def test_a_glb_that_exists_is_kept(tmp_path):
    path = tmp_path / "made.glb"
    path.write_text("mine")
    with pytest.raises(ValueError, match=r"^path: .*made.glb exists; name a new file$"):
        save_glb(made(), path)
    assert path.read_text() == "mine"
