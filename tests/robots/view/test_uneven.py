"""Uneven ground in pictures and files: it is where the simulation has it."""

import base64
import json
import re
import struct
import zlib

import numpy as np
import pytest
from made_motion import made

from robots.ground import Ground
from robots.lattice_robot import walker
from robots.lattice_robot.motion import lattice_robot_motion
from robots.view.film import strip_picture
from robots.view.glb import save_glb
from robots.view.lattice_states import LatticeStates
from robots.view.motion import GroundPlane, Motion
from robots.view.paraview import save_paraview
from robots.view.player import page
from robots.view.scene import Camera, shadow
from robots.view.still import setting, still_picture
from robots.view.uneven import MOST_NODES, cut, hidden, node_tints, nodes, pieces, relief_around, triangles
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, Material, Relief

EDGE, LEVEL = 0.05, -0.025
NAMES = ("rough:0.05,0.2", "stairs:0.05,0.3,0.1", "gap:0.3,0.1,0.2", "ramp:20,0.1", "wave:0.05,0.4")


def relief(name: str, heading: float = 0.0) -> Relief:
    return Ground(name).relief(heading, EDGE)


def on(name: str, **more) -> Motion:
    """A motion over a ground."""
    return made(ground=GroundPlane(LEVEL, relief=relief(name), **more))


def read_glb(path):
    """The document of a GLB file, and a function that reads an accessor."""
    content = path.read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    document, binary = json.loads(content[20 : 20 + length]), content[28 + length :]

    def values(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5123: "<u2"}[accessor["componentType"]]
        flat = np.frombuffer(binary, kind, view["byteLength"] // np.dtype(kind).itemsize, view["byteOffset"])
        return flat.reshape(accessor["count"], -1)

    return document, values


def ground_points(path):
    """Points of a VTK file."""
    kind, packed = re.search(r'type="(\w+)" Name="points".*?>([^<]+)<', path.read_text()).groups()
    assert kind == "Float32"
    return np.frombuffer(zlib.decompress(base64.b64decode(packed[24:])), "<f4").reshape(-1, 3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("heading", [0.0, 30.0])
def test_pieces_of_pictures_are_on_the_ground(name, heading):
    ground = relief(name, heading)
    found = pieces(ground, LEVEL, Camera(heading), np.array([[-0.2, 1.1], [-0.3, 0.4]]))
    for points in (found.quads, found.profile, found.end, found.lines):
        assert np.abs(points[..., 2] - LEVEL - ground.height(points[..., 0], points[..., 1])).max(initial=0.0) < 1e-9
    assert found.base < found.quads[..., 2].min()
    depth = found.quads.mean(axis=1) @ Camera(heading).toward
    assert (np.diff(depth) >= 0).all() and ((found.colours > 0.5) & (found.colours <= 1)).all()


@pytest.mark.parametrize("name", NAMES)
def test_files_have_the_ground_around_the_motion(name, tmp_path):
    motion, truth = on(name), relief(name)
    save_glb(motion, tmp_path / "a.glb")
    save_paraview(motion, tmp_path / "folder")
    document, values = read_glb(tmp_path / "a.glb")
    node = document["nodes"][-1]
    assert node["name"] == "ground" and document["nodes"][0]["children"][-1] == len(document["nodes"]) - 1
    (primitive,) = document["meshes"][node["mesh"]]["primitives"]
    points, corners = values(primitive["attributes"]["POSITION"]), values(primitive["indices"]).reshape(-1, 3)
    assert np.abs(points[:, 2] - LEVEL - truth.height(points[:, 0], points[:, 1])).max() < 1e-6
    a, b, c = points[corners].swapaxes(0, 1)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    # Between the nodes, too: in the middle of triangles.
    middle = points[corners].mean(axis=1, dtype=float)
    assert np.abs(middle[:, 2] - LEVEL - truth.height(middle[:, 0], middle[:, 1])).max() < 1e-6
    places = motion.translation.reshape(-1, 3)
    assert (points.min(axis=0) < places.min(axis=0)).all() and (points.max(axis=0) > places.max(axis=0))[:2].all()
    assert np.allclose(ground_points(tmp_path / "folder" / "ground.vtp"), points, atol=1e-6)
    index = (tmp_path / "folder" / "motion.pvd").read_text()
    assert index.count('part="1" file="ground.vtp"') == len(motion.times)


def test_a_plane_has_no_mesh(tmp_path):
    save_glb(made(), tmp_path / "a.glb")
    save_paraview(made(), tmp_path / "folder")
    assert "ground" not in [node["name"] for node in read_glb(tmp_path / "a.glb")[0]["nodes"]]
    assert not (tmp_path / "folder" / "ground.vtp").exists() and relief_around(made()) is None


def test_large_ground_keeps_some_of_its_nodes_and_goes_on_beyond_its_grid():
    whole = relief("rough:0.05,0.2")
    part = cut(whole, np.array([-3.0, -1.0]), np.array([9.0, 1.0]))
    assert part.heights.size <= MOST_NODES < part.heights.size * 4
    x, y, z = nodes(part, 0.0).T
    assert np.abs(z - whole.height(x, y)).max() < 1e-9
    assert x.min() <= -3 and x.max() >= 9 and len(triangles(part)) == 2 * (np.array(part.heights.shape) - 1).prod()


def test_friction_is_seen_by_shade(tmp_path):
    motion, ground = on("patches:0.5,2,0.2"), relief("patches:0.5,2,0.2")
    assert ground.friction is not None
    shade = node_tints(ground, ground).max(axis=1)
    assert shade.max() == 1 and ground.friction.ravel()[shade.argmin()] == ground.friction.max()
    save_glb(motion, tmp_path / "a.glb")
    document, values = read_glb(tmp_path / "a.glb")
    colours = values(document["meshes"][-1]["primitives"][0]["attributes"]["COLOR_0"])
    assert np.ptp(colours) > 0.2 and colours.max() <= 1
    drawn = pieces(ground, LEVEL, Camera(), np.array([[0.0, 1.0], [0.0, 1.0]]))
    assert np.ptp(drawn.colours) > 0.2


def test_what_is_below_water_is_blue(tmp_path):
    name = "ramp:-10,0.1+water:-0.02"
    motion, ground = on(name), relief(name)
    assert ground.water is not None
    tinted = node_tints(ground, ground)
    wet = ground.heights.ravel() < ground.water.level
    assert wet.any() and not wet.all()
    assert (tinted[wet, 2] > tinted[wet, 0]).all() and (tinted[~wet] == 1).all()
    save_glb(motion, tmp_path / "a.glb")
    document, values = read_glb(tmp_path / "a.glb")
    colours = values(document["meshes"][-1]["primitives"][0]["attributes"]["COLOR_0"])
    assert np.ptp(colours[:, 0]) > 0.2 and np.ptp(colours[:, 2]) == 0
    drawn = pieces(ground, LEVEL, Camera(), np.array([[0.0, 1.0], [0.0, 1.0]]))
    assert np.ptp(drawn.colours[:, 0]) > 0.2


def test_shadows_lie_on_the_ground():
    ground, points = relief("wave:0.05,0.4"), np.random.default_rng(0).uniform(0.2, 0.4, (20, 3))
    for slope in (0.0, 10.0):
        camera = Camera(0.0, slope)
        down, found = camera.frame[2], shadow(points, camera, LEVEL, ground)
        # Some point straight below is on the ground and in that place on paper.
        fall = np.linspace(0, 0.6, 6001)[:, None, None]
        below = points - fall * down
        x, y, z = np.moveaxis(below, -1, 0)
        where = np.abs(z - LEVEL - ground.height(x, y)).argmin(axis=0)
        assert np.abs(camera.project(below[where, np.arange(20)]) - found).max() < 2e-3


def test_what_is_behind_a_hill_is_hidden():
    hill = Relief(np.where(np.arange(41)[None] == 10, 0.1, 0.0) * np.ones((41, 1)), 0.02, (-0.4, -0.4))
    points = np.array([[0.0, -0.16, 0.03], [0.0, -0.16, 0.2], [0.0, -0.3, 0.03]])
    assert hidden(points, hill, 0.0, Camera()).tolist() == [True, False, False]


@pytest.mark.parametrize("name", NAMES)
def test_contact_is_with_the_ground_below(name):
    body, ground = LatticeBody(np.zeros((1, 3), int), (Material(1e5, 1000.0),), np.zeros(1, int), EDGE), relief(name)
    places = np.random.default_rng(1).uniform(-0.3, 1.0, (50, 1, 3)) * [1.0, 1.0, 0.0]
    places[..., 2] = [[ground.rise(place, EDGE)] for place in places]
    assert touching(body, places - [0, 0, 1e-6], ground).all()
    assert not touching(body, places - [0, 0, -1e-6], ground).any()


def touching(body, places, ground):
    shape = places.shape[:2]
    turns = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*shape, 4))
    return LatticeStates(
        body, places, turns, np.full((*shape, 6), EDGE / 2), np.full((*shape, 3), EDGE), relief=ground
    ).on_floor()


def test_pictures_and_strips_show_it(tmp_path):
    motion = on("rough:0.05,0.2")
    still_picture(motion).savefig(tmp_path / "a.png")
    strip_picture(motion, frames=3).savefig(tmp_path / "b.png")
    given = setting(motion, [0])
    assert given.pieces is not None and len(given.outline) == 4 + 4 * len(given.pieces.quads)
    assert setting(made(), [0]).pieces is None


@pytest.mark.parametrize("heading", [0.0, 30.0])
@pytest.mark.parametrize("name", [*NAMES, "patches:0.5,2,0.2"])
def test_pages_have_the_ground_that_is_seen(name, heading):
    ground = relief(name, heading)
    motion = made(ground=GroundPlane(LEVEL, heading=heading, relief=ground))
    (about,) = json.loads(re.search(r'id="about"[^>]*>([^<]+)<', page(motion))[1])
    shown, told = about["ground"], about["ground"]["relief"]
    heights = np.reshape(told["heights"], told["counts"])
    x, y = (start + told["spacing"] * np.arange(n) for start, n in zip(told["origin"], told["counts"], strict=True))
    assert heights.size <= MOST_NODES
    assert np.abs(heights - ground.height(*np.meshgrid(x, y, indexing="ij"))).max() <= 0.5e-5 + 1e-9
    along = np.array(about["along"])
    frame = np.stack([along, [-along[1], along[0]]])
    assert along == pytest.approx([np.cos(np.deg2rad(heading)), np.sin(np.deg2rad(heading))])
    signs = np.array([[a, b] for a in (-0.5, 0.5) for b in (-0.5, 0.5)])
    corners = shown["middle"] + signs * shown["size"] @ frame
    assert (corners >= [x[0] - 1e-9, y[0] - 1e-9]).all() and (corners <= [x[-1] + 1e-9, y[-1] + 1e-9]).all()
    assert ("tints" in told) == name.startswith("patches")


def test_a_page_of_a_plane_has_no_relief():
    assert '"relief":' not in page(made())


@pytest.mark.kernels
def test_a_robot_is_shown_on_the_ground_that_it_walked_on():
    materials = np.full((3, 2, 2), walker.PASSIVE)
    materials[0], materials[1, :, 0] = walker.ACTIVE, walker.EMPTY
    drive, design = walker.WalkerActuation(cycles=1, settling=0.1), walker.WalkerDesign(materials)
    terrain = Terrain.parse("hill:5+rough:0.01,0.03")
    result = walker.simulate(design, terrain, actuation=drive, precision="f32", record_every=40, threads=1)
    motion = lattice_robot_motion(result, walker.walker_robot(design, actuation=drive), terrain)
    ground, lattice = motion.ground, motion.lattice
    assert ground.relief is not None and ground.slope == 5 and lattice is not None and lattice.relief is ground.relief
    lowest = motion.translation - [0, 0, lattice.body.voxel_size / 2]
    over = lowest[..., 2] - ground.level - ground.relief.height(lowest[..., 0], lowest[..., 1])
    assert lattice.on_floor()[-1].any() and np.abs(over[-1][lattice.on_floor()[-1]]).max() < lattice.body.voxel_size / 4
