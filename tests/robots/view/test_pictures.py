"""Pictures, film strips and films of all robots."""

import sys
from contextlib import closing
from dataclasses import replace
from itertools import pairwise

import motions
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from robots.lattice_robot import Drive, LatticeRobot
from robots.view import film
from robots.view.colouring import FLOOR, GRIPS, PLAIN, SEEN_THROUGH, SLIDES, colouring
from robots.view.film import pictures, poses_of, save_gif, save_mp4, save_strip, strip_picture
from robots.view.mesh import BOX_CELLS, faces
from robots.view.motion import BALL, Channel, Motion, Node
from robots.view.picture import draw_channels
from robots.view.scene import Camera, paint
from robots.view.still import default_camera, draw_motion, save_still, setting, still_picture
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array
from taichi_sim.rigid import Box, Capsule

pytestmark = pytest.mark.kernels


def solid(shape, scale=1.0) -> Motion:
    one = np.ones((1, 1))
    return Motion(
        "solid",
        [0.0],
        (Node("a", shape, (1.0, 0, 0)),),
        one[..., None] * [0.0, 0, 2.0],
        one[..., None] * [1.0, 0, 0, 0],
        one[..., None] * ([scale] * 3),
        [[0.0, 0, 2.0]],
    )


def area_and_volume(quads):
    """Of a closed surface, by the divergence theorem."""
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]) / 2
    return np.linalg.norm(normals, axis=1).sum(), (normals * quads.mean(axis=1)).sum() / 3


@pytest.mark.parametrize(
    ("shape", "scale", "area", "volume"),
    [
        (Box((1.0, 2.0, 3.0)), 1.0, 22.0, 6.0),
        (BALL, 2.0, 4 * np.pi, 4 / 3 * np.pi),
        (Capsule(0.5, 2.0), 1.0, 3 * np.pi, np.pi / 2 + np.pi / 6),
    ],
)
def test_solids_are_closed_and_seen_from_outside(shape, scale, area, volume):
    quads, owners = faces(solid(shape, scale))
    assert not owners.any()
    found = area_and_volume(quads)
    exact = isinstance(shape, Box)
    assert found == pytest.approx((area, volume), rel=1e-12 if exact else 0.04)
    assert found[1] <= volume * (1 + 1e-12)
    assert len(quads) == 6 * BOX_CELLS**2 or not exact


def test_a_skin_has_the_faces_of_the_lattice():
    motion = motions.inflatable()
    quads, owners = faces(motion, 0)
    assert np.array_equal(owners, motion.lattice.body.topology.faces[:, 0])
    assert np.ptp(quads[..., 2]) < 2 * np.ptp(motion.lattice.positions[0, :, 2]) + motions.TINY.voxel_size


@pytest.mark.parametrize("made", motions.ALL)
def test_every_robot_has_a_picture(made, tmp_path):
    motion = made()
    size = save_still(motion, tmp_path / "a.png")
    assert size == (tmp_path / "a.png").stat().st_size
    with Image.open(tmp_path / "a.png") as picture:
        seen = np.asarray(picture.convert("RGB"))
    coloured = (seen.max(axis=2).astype(int) - seen.min(axis=2) > 40).any(axis=1)
    assert picture.width == 960 and coloured.mean() > 0.05, "the robot is hardly there"
    for edge in (seen[:, :3], seen[:, -3:], seen[:3], seen[-3:]):
        assert (edge > 250).all(), "something is cut off at an edge"


@pytest.mark.parametrize("made", motions.ALL)
def test_robots_are_within_their_axes(made):
    motion = made()
    for frame in (0, len(motion.times) // 2):
        figure = still_picture(motion, at=motion.times[frame])
        axes = figure.axes[0]
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        corners = default_camera(motion).project(faces(motion, frame)[0]).reshape(-1, 2)
        assert left < corners[:, 0].min() and corners[:, 0].max() < right
        assert bottom < corners[:, 1].min() and corners[:, 1].max() < top


@pytest.mark.parametrize("colour", ["strain", "contact", "friction", "beams"])
def test_lattices_have_more_colours(colour):
    figure = still_picture(motions.inflatable(), at=0.0, colour=colour)
    bars = [axes for axes in figure.axes if axes.get_xlabel() == "strain of links [%]"]
    assert len(bars) == (colour in ("strain", "beams")) and len(figure.legends) == (colour in ("contact", "friction"))


def test_beams_are_links_and_arrows_are_pressure():
    motion, axes = motions.inflatable(), Figure().add_subplot()
    given = setting(motion, [0], colour="beams")
    draw_motion(axes, given, 0)
    links = len(motion.lattice.body.topology.links)
    lines = [c for c in axes.collections if isinstance(c, LineCollection) and len(c.get_segments()) == links]
    assert len(lines) == 2, "beams and their shadows"
    assert len(np.unique(lines[1].get_colors(), axis=0)) > 20
    heads = [len(c.get_paths()) for c in axes.collections if isinstance(c, PolyCollection)][-2:]
    assert sum(heads) == 2 * motions.TINY.columns * motions.TINY.rows
    flat = replace(motion, lattice=replace(motion.lattice, pressure=0.0))
    bare = Figure().add_subplot()
    draw_motion(bare, setting(flat, [0], colour="beams"), 0)
    assert len(bare.collections) == len(axes.collections) - 4


def test_strains_have_one_scale_and_two_hues():
    motion = motions.inflatable()
    colours = colouring(motion, "strain", [0, 5])
    strains = motion.lattice.part([0, 5]).voxel_strains()
    assert colours.limit == pytest.approx(np.percentile(np.abs(strains), 99), rel=0.06)
    of = colours.of(5)
    most, least = strains[1].argmax(), strains[1].argmin()
    assert of[most, 0] > of[most, 2] and of[least, 2] > of[least, 0]


def test_colours_of_contact_and_friction():
    motion = motions.inflatable()
    contact = colouring(motion, "contact").of(0)
    floor = motion.lattice.part([0]).on_floor()[0]
    assert floor.any() and np.allclose(contact[floor], FLOOR) and np.allclose(contact[~floor], PLAIN)
    channels = {channel.name: n for n, channel in enumerate(motion.channels)}
    friction = colouring(motion, "friction")
    first = np.array([node.channel == channels["foot 1"] for node in motion.nodes])
    other = np.array([node.channel not in (channels["foot 1"], channels["foot 2"]) for node in motion.nodes])
    last = len(motion.times) - 1
    assert np.allclose(friction.of(0)[first], SLIDES) and np.allclose(friction.of(last)[first], GRIPS)
    assert np.allclose(friction.of(last)[other], PLAIN)


def test_feet_are_what_the_nodes_say_and_not_what_rows_are_called():
    motion = motions.inflatable()
    channels = tuple(replace(each, name=f"a {n}", group="") for n, each in enumerate(motion.channels))
    renamed = replace(motion, channels=channels)
    last = len(motion.times) - 1
    assert np.array_equal(colouring(renamed, "friction").of(last), colouring(motion, "friction").of(last))
    without = replace(motion, nodes=[replace(node, foot=None) for node in motion.nodes])
    with pytest.raises(ValueError, match="which has no feet that grip and slide"):
        colouring(without, "friction")


def test_switches_of_a_group_are_labelled_by_what_follows_its_name():
    named = (
        ("leg 1", "leg"),
        ("leg 2", "leg"),
        ("arm left", "arm"),
        ("arm right", "arm"),
        ("valve 7", ""),
        ("valve 8", ""),
    )
    switches = [Channel(name, "", [0.0, 1.0], [0.0, 1.0], switch=True, group=group) for name, group in named]
    axes = Figure().add_subplot()
    draw_channels(axes, tuple(switches))
    told = [label.get_text() for label in axes.get_yticklabels()]
    assert told == ["leg 1", "2", "arm left", "right", "valve 7", "valve 8"]
    with pytest.raises(ValueError, match=r"^arm: group: 'leg' is not allowed; give how the name begins$"):
        Channel("arm", "", [0.0], [1.0], group="leg")


def test_levels_of_channels():
    times = np.array([0.0, 0.5, 1.0, 1.5])
    switch = Channel("s", "", [0.0, 1.0, 2.0], [0.0, 1.0, 1.0], switch=True)
    assert switch.levels(times).tolist() == [0, 0, 1, 1]
    assert Channel("l", "", [0.0, 2.0], [5.0, 7.0]).levels(times) == pytest.approx([0, 0.25, 0.5, 0.75])
    logarithmic = Channel("g", "", [0.0, 2.0], [1.0, 100.0], logarithmic=True)
    assert logarithmic.levels(times) == pytest.approx([0, 0.25, 0.5, 0.75])
    assert Channel("c", "", [0.0], [3.0]).levels(times).tolist() == [1, 1, 1, 1]


def test_what_is_nearer_is_painted_later():
    quads = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]]]) + np.array([0.0, 1.0, 0.0])[None, None] * [
        [[3]],
        [[0]],
        [[1]],
    ]
    painted = paint(quads, np.eye(3), Camera(), 0.0).colours
    assert painted.argmax(axis=1).tolist() == [0, 2, 1]


def test_the_camera_follows_the_way():
    assert default_camera(motions.inflatable()).heading == 30.0
    assert default_camera(motions.two_wheels()).heading == pytest.approx(
        np.rad2deg(np.arctan2(*np.diff(motions.two_wheels().path[[0, -1], :2], axis=0)[0][::-1]))
    )
    assert default_camera(solid(BALL)).heading == 0.0


def test_far_ways_are_cut_and_near_ones_are_not():
    motion = solid(BALL)
    motion = replace(
        motion,
        times=[0.0, 1.0],
        path=[[-50.0, 0, 2], [0, 0, 2]],
        **{field: np.repeat(getattr(motion, field), 2, axis=0) for field in ("translation", "rotation", "scale")},
    )
    near, far = (setting(motion, [1], reach=reach).area[0] for reach in (6.0, np.inf))
    assert np.ptp(near) == pytest.approx(6.5) and np.ptp(far) == pytest.approx(51.0)


def test_strips_of_all_kinds(tmp_path):
    for made in (motions.inflatable, motions.two_wheels):
        figure = strip_picture(made(), frames=4)
        *times, bar = figure.axes[0].texts
        told = [float(text.get_text().removesuffix(" s")) for text in times]
        assert len(set(told)) == 4 and told[-1] == pytest.approx(made().times[-1], abs=0.05)
        assert bar.get_text().endswith("m")
    assert save_strip(motions.vehicle(), tmp_path / "a.png", frames=3) > 5000


def test_times_below_poses_are_told_in_as_many_digits_as_tell_them_apart():
    motion = motions.two_wheels()
    swift = replace(motion, times=motion.times / motion.times[-1] * 0.05)
    told = [text.get_text() for text in strip_picture(swift, frames=6).figure.axes[0].texts[:-1]]
    assert float(told[-1].removesuffix(" s")) == 0.05 and len(set(told)) == len(told)


def of_channels(cells, drives) -> Motion:
    """A body of cells, a region for each number from 1 on, with drives and a resting pose."""
    body = body_from_array(cells > 0, [Material(1e5, 1e3, name="foam")], 0.01, regions=np.maximum(cells - 1, 0))
    robot = LatticeRobot(body, drives, cycles=1, settling=0.01)
    found = robot.simulate((), Terrain(), record_every=10_000)
    return robot.motion(found, Terrain(), "robot")


def test_channels_are_coloured_and_shine_through_what_nothing_drives(tmp_path):
    cells = np.ones((5, 3, 3), int)
    cells[1:3, 1, 1], cells[3, 1, 1] = 2, 3  # two muscles within the body
    motion = of_channels(cells, (Drive("bar", (1,), amplitude=0.1), Drive("a very long name", (2,), amplitude=0.1)))
    found = colouring(motion, "channel")
    colours, driven = found.of(0), cells[tuple(motion.lattice.body.voxels.T)] - 2
    assert [name for name, _ in found.key] == ["bar scale", "a very long nam…", "not driven"]
    for channel, (_, colour) in zip((0, 1, -1), found.key, strict=True):
        assert (colours[driven == channel] == colour).all() and (driven == channel).any()
    assert (found.opacity[driven >= 0] == 1).all() and (found.opacity[driven < 0] < 0.5).all()
    voxels, sides = found.inner.T
    assert (driven[voxels] >= 0).all() and len(voxels) == 10 + 6  # those of a bar of two and of a cube
    places = motion.lattice.body.voxels[voxels] + np.array([-1, 1])[sides % 2, None] * np.eye(3, dtype=int)[sides // 2]
    assert (cells[tuple(places.T)] - 2 != driven[voxels]).all()
    drawn = setting(motion, [0], colour="channel").polygons(0)
    plain = setting(motion, [0]).polygons(0)
    assert set(drawn.colours[:, 3]) == {1.0, SEEN_THROUGH} and len(drawn.corners) > len(plain.corners)
    assert plain.colours.shape[1] == 3 and save_still(motion, tmp_path / "a.png", colour="channel") > 1000
    assert save_strip(motion, tmp_path / "b.png", colour="channel", frames=2) > 1000


def test_many_channels_differ_and_the_key_has_room():
    cells = np.arange(1, 15).reshape(7, 2, 1)
    motion = of_channels(cells, tuple(Drive(f"m{n}", (n,), amplitude=0.1) for n in range(14)))
    found = colouring(motion, "channel")
    assert len(np.unique(found.of(0), axis=0)) == 14 and (found.opacity == 1).all()
    assert [name for name, _ in found.key] == [*(f"m{n} scale" for n in range(9)), "5 more"]
    still = of_channels(np.ones((2, 1, 1), int), (Drive("rest", (0,)),))
    with pytest.raises(ValueError, match=r"^colour: channel is not allowed for robot, which nothing drives; give"):
        colouring(still, "channel")


def test_poses_of_a_cycle_are_spread_over_its_phases():
    """A gait of 1 Hz of 5 s would be shown at 0, 1, ... 5 s, always in one phase, as if it did not move."""
    walker = motions.soft_walker()
    places = np.arange(501) % len(walker.times)

    def poses(period, count=6):
        several = {name: getattr(walker, name)[places] for name in ("translation", "rotation", "scale", "path")}
        seen = replace(walker, times=0.01 * np.arange(501), lattice=None, centre_of_mass=(), period=period, **several)
        return [round(0.01 * frame, 2) for frame in poses_of(seen, count)]

    for period in (0.0, 0.7, 5.0, 100.0):
        assert poses(period) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    for period in (0.25, 0.5, 1.0, 0.99, 2.0):
        times = poses(period)
        phases = np.sort(np.array(times) / period % 1)
        assert times[0] == 0 and 5.0 - period <= times[-1] <= 5.0
        assert np.diff(phases, append=1).min() > 0.1 and np.ptp(np.diff(times)) <= 0.011
    assert len(poses(0.01)) == 6 and poses(1.0, 2) == [0.0, 5.0]


def test_a_film_is_as_long_as_told():
    robots = [motions.inflatable(), motions.soft_walker()]
    drawn = list(pictures(robots, seconds=1.0, rate=4.0, width=201))
    assert len(drawn) == 4 and {p.shape for p in drawn} == {drawn[0].shape}
    height, width, _ = drawn[0].shape
    assert width == 200 and height % 2 == 0
    assert all((a != b).any() for a, b in pairwise(drawn))


def test_films_have_a_key_of_their_colours():
    bare, keyed = (
        next(pictures([motions.inflatable()], seconds=0.2, rate=10.0, colour=colour))
        for colour in ("material", "strain")
    )
    assert keyed.shape[0] == bare.shape[0] + 48
    below = keyed[-48:].astype(int)
    assert (below[..., 0] - below[..., 2] > 100).any() and (below[..., 2] - below[..., 0] > 80).any()


def test_poses_of_another_body_are_refused():
    motion = motions.inflatable()
    with pytest.raises(
        ValueError, match=r"^lattice: poses of shape \(2, 236, 3\) are not allowed; give \(24, 236, 3\)$"
    ):
        replace(motion, lattice=motion.lattice.part([0, 1]))


def test_a_gif_moves_in_few_colours(tmp_path):
    size = save_gif(motions.vehicle(), tmp_path / "a.gif", seconds=0.5, rate=10.0, width=200, colours=16)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 5 and gif.info["duration"] == 100 and gif.info["loop"] == 0
        first = gif.convert("RGB")
        gif.seek(4)
        last = gif.convert("RGB")
    assert first.getpixel((1, 1)) == (255, 255, 255) and len(first.getcolors(999)) <= 16
    assert (np.asarray(first) != np.asarray(last)).any() and size < 30_000


def test_the_same_gif_twice(tmp_path):
    for name in ("a.gif", "b.gif"):
        save_gif(motions.soft_walker(), tmp_path / name, seconds=0.3, rate=10.0, width=120)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_video_has_its_pictures(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    save_mp4(motions.vehicle(), tmp_path / "a.mp4", seconds=0.5, rate=10.0, width=200)
    with closing(ffmpeg.read_frames(str(tmp_path / "a.mp4"))) as reader:
        about = next(reader)
        assert about["size"][0] == 200 and sum(1 for _ in reader) == 5


def test_a_video_that_is_not_complete_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    draw, drawn = film._drawn, []

    def stopping(*arguments):
        drawn.append(arguments)
        if len(drawn) == 3:
            raise KeyboardInterrupt
        return draw(*arguments)

    monkeypatch.setattr(film, "_drawn", stopping)
    with pytest.raises(KeyboardInterrupt):
        save_mp4(motions.vehicle(), tmp_path / "a.mp4", seconds=0.5, rate=10.0, width=200)
    assert not any(tmp_path.iterdir())


def test_without_ffmpeg_videos_are_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"^mp4: imageio-ffmpeg is missing; install the extra video "):
        save_mp4(motions.vehicle(), tmp_path / "a.mp4")


NO_LATTICE = "which has no lattice; give material"
REFUSED = [
    (lambda p: save_still(motions.vehicle(), p), "path: .* exists; name a new file"),
    (lambda p: save_strip(motions.vehicle(), p), "path: .* exists; name a new file"),
    (lambda p: save_gif(motions.vehicle(), p), "path: .* exists; name a new file"),
    (lambda p: save_still(motions.vehicle(), p.with_suffix(".doc")), "path: .* that ends in .png, .pdf or .svg"),
    (lambda p: still_picture(motions.vehicle(), colour="strain"), f"colour: strain is not allowed .*, {NO_LATTICE}"),
    (lambda p: still_picture(motions.legged(), colour="beams"), f"colour: beams is not allowed .*, {NO_LATTICE}"),
    (lambda p: still_picture(motions.soft_walker(), colour="friction"), "colour: friction .* for walker, .* no feet"),
    (lambda p: still_picture(motions.vehicle(), colour="red"), "colour: 'red' is not allowed; give material, strain,"),
    (lambda p: still_picture(motions.vehicle(), at=1e3), "at: 1000.0 is not allowed; give a number from 0 to"),
    (lambda p: still_picture(motions.vehicle(), reach=0.5), "reach: 0.5 is not allowed; give .* at least 1$"),
    (lambda p: strip_picture(motions.vehicle(), frames=1), "frames: 1 is not allowed; give a whole number, at least 2"),
    (lambda p: strip_picture(motions.inflatable(), colour="beams"), "colour: beams is not allowed for a strip"),
    (lambda p: pictures([]), "motions: there are none; give at least one"),
    (lambda p: pictures([motions.vehicle()], rate=0.0), "rate: 0.0 is not allowed"),
]


@pytest.mark.parametrize("case", range(len(REFUSED)))
def test_bad_input_is_told_in_one_line(case, tmp_path):
    call, line = REFUSED[case]
    (tmp_path / "a.png").write_text("mine")
    with pytest.raises(ValueError, match=f"^{line}") as error:
        call(tmp_path / "a.png")
    assert "\n" not in str(error.value) and (tmp_path / "a.png").read_text() == "mine"
