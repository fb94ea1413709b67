"""Uneven ground by name, and robots that stand and move on it."""

import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from optim.doubts import doubts_before
from optim.problems.inflatable.problem import GaitProblem
from robots.batches import batch_key
from robots.course import Course
from robots.ground import Ground
from robots.ground_files import kept_in
from robots.ground_kinds import COVERS, GROUNDS, HEIGHT, Cover, GroundKind, Number, described, ways
from robots.inflatable import ROLLING, simulate
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.journeys import Leg, simulate_journey
from robots.robot import KINDS
from robots.view.uneven import node_tints
from robots.world import Terrain, medium_of, one_each, standing
from taichi_sim.base.files import copy_in, write_bytes
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Water

EDGE = 0.01


def height(text: str, x, y, heading: float = 0.0):
    return Ground(text).relief(heading, EDGE).height(x, y)


def test_named_grounds_are_what_they_say():
    """At nodes of the grid."""
    x = np.array([0.1, 0.35, 0.45, 0.95])
    assert np.allclose(height("stairs:0.01,0.1", x, 0.0), [0, 0.01, 0.02, 0.07])
    assert np.allclose(height("ramp:10,0.2", x, 0.3), np.tan(np.radians(10)) * np.maximum(x - 0.2, 0))
    assert np.allclose(height("gap:0.1,0.01", x, 0.0), [0, -0.01, 0, 0])
    assert np.allclose(height("wave:0.02,0.2", [0.1, 0.2, 0.05], 0.0), [0.02, 0, 0.01])
    blocks = height("blocks:0.01,0.1", [0.025, 0.075, 0.125], 0.05)
    assert blocks[0] == blocks[1] != blocks[2] and blocks.min() >= 0 and blocks.max() <= 0.01


def test_hills_are_smooth_bounded_and_always_the_same():
    """Another seed gives others."""
    x, y = np.meshgrid(np.linspace(-0.5, 2, 60), np.linspace(-1, 1, 50))
    one = height("rough:0.02,0.1", x, y)
    assert 0 <= one.min() < 0.005 and 0.015 < one.max() <= 0.02
    assert np.array_equal(one, height("rough:0.02,0.1,0", x, y))
    assert np.abs(one - height("rough:0.02,0.1,1", x, y)).max() > 0.01
    assert Ground("rough:0.02,0.1").relief(0, EDGE).steepness < 1 / np.cos(np.radians(40))


@pytest.mark.long
@pytest.mark.parametrize("text", ["rough:0.01", "stairs:0.01,0.1", "wave:0.01,0.3"])
def test_ground_turns_with_the_heading(text):
    """What lies ahead of a robot that heads to the left lies along y."""
    there, turned = height(text, 0.5, -0.2), height(text, 0.2, 0.5, 90.0)
    assert np.isclose(there, turned, atol=1e-9)
    slanted = height(text, 0.57 * np.sqrt(0.5), 0.57 * np.sqrt(0.5), 45.0)  # along the way, on another grid
    assert np.isclose(slanted, height(text, 0.57, 0.0), atol=5e-4)


def test_patches_change_friction_alone():
    """Between the two factors."""
    relief = Ground("patches:0.5,1,0.1").relief(0, EDGE)
    assert not relief.heights.any() and relief.friction is not None
    assert 0.5 <= relief.friction.min() < 0.6 and 0.9 < relief.friction.max() <= 1


def test_files_of_heights(tmp_path):
    """An array, and the brightness of an image, whose upper side is to the left."""
    from matplotlib.image import imsave

    table = np.zeros((5, 3))
    table[4, 0] = 0.02
    np.save(tmp_path / "hills.npy", table)
    ground = Ground(f"{tmp_path / 'hills.npy'}:0.1").relief(0, EDGE)
    assert np.isclose(ground.height(0.2, -0.1), 0.02) and np.isclose(ground.height(-0.2, 0.1), 0)
    picture = np.zeros((3, 5))
    picture[0, 4] = 1.0  # top right
    imsave(tmp_path / "hills.png", picture, cmap="gray", vmin=0, vmax=1)
    ground = Ground(f"{tmp_path / 'hills.png'}:0.03,0.1").relief(0, EDGE)
    assert np.isclose(ground.height(0.2, 0.1), 0.03, rtol=0.01) and np.isclose(ground.height(0.2, -0.1), 0, atol=1e-3)


def friction_map(folder, factors, heights=0.0) -> str:
    """The name of ground of a file with factors of friction, 1 cm apart."""
    factors = np.asarray(factors, float)
    np.save(folder / "map.npy", np.stack([np.broadcast_to(heights, factors.shape), factors]))
    return f"{folder / 'map.npy'}:0.01"


def test_files_of_heights_and_friction(tmp_path):
    """The second table has factors of friction, at the places of the heights, and pictures show it as patches."""
    factors, heights = np.ones((5, 3)), np.zeros((5, 3))
    factors[4, 0], heights[0, 2] = 0.25, 0.005
    relief = Ground(friction_map(tmp_path, factors, heights)).relief(0, EDGE)
    assert relief.factor([0.02, 0.5, 0, 0.015], [-0.01, -0.5, 0, -0.01]) == pytest.approx([0.25, 0.25, 1, 0.625])
    assert relief.height([0.02, -0.02], [-0.01, 0.01]) == pytest.approx([0, 0.005])
    shades = node_tints(relief, relief).reshape(*relief.heights.shape, 3)[..., 0]
    assert np.array_equal(np.argsort(shades, axis=None), np.argsort(-relief.friction, axis=None))
    factors = np.where(np.arange(9)[:, None] < 5, 1.0, 0.5) + np.zeros(3)
    assert Ground(friction_map(tmp_path, factors)).level_until(-0.02, -0.01) == pytest.approx(0.0, abs=2e-3)


def sliding(terrain: Terrain, steps: int = 400):
    """State of a block of one material that was thrown along its ground."""
    body = LatticeBody(
        np.argwhere(np.ones((5, 3, 2))),
        (Material(1e5, 1e3, static_friction=0.4, kinetic_friction=0.4),),
        np.zeros(30, int),
        EDGE,
    )
    engine = LatticeEngine(body, gravity=9.80665, **medium_of([terrain], [0.0], EDGE))
    engine.run(ProgramBuilder(1).build(2000))
    at = engine.state()
    engine.set_state(replace(at, velocities=at.velocities + np.array([0.3, 0, 0])))
    engine.run(ProgramBuilder(1).build(steps))
    return engine.state(), 0.3 - engine.state().velocities[0, :, 0].mean()


@pytest.mark.kernels
def test_a_map_of_friction_is_what_a_block_slides_on(tmp_path):
    """A factor of 1 on level ground is the plane, bit for bit; half of it brakes half as much."""
    plane, slowed = sliding(Terrain())
    same, _ = sliding(Terrain.parse(friction_map(tmp_path, np.ones((3, 3)))))
    for part in plane.__dataclass_fields__:
        assert np.array_equal(getattr(plane, part), getattr(same, part))
    _, half = sliding(Terrain.parse(friction_map(tmp_path, np.full((4, 3), 0.5))))
    assert 0 < slowed < 0.3 and half / slowed == pytest.approx(0.5, rel=0.01)


def test_terrains_with_uneven_ground_are_written_and_read():
    """By name and by record; earlier records stay as they were."""
    for text in ("rough:0.01", "hill:5+stairs:0.01,0.1", "patches:0.5,1", "sand:200000", "ramp:-5+sand:2e5+water:0"):
        terrain = Terrain.parse(text)
        assert terrain.name == text and Terrain.parse(terrain.name) == terrain
        assert Terrain(**json.loads(json.dumps(terrain.document))) == terrain
    assert "ground" not in Terrain().document
    assert "smooth random hills" in Terrain.parse("hill:5+rough:0.01").spoken
    assert Terrain(5.0).spoken == "up a slope of 5°" and Terrain().spoken == "on flat ground"


def test_sand_and_water_lie_on_ground_of_any_kind(tmp_path):
    """Level ground needs no name; names of files may have a plus."""
    np.save(tmp_path / "a+b.npy", np.zeros((3, 3)))
    for solid in ("", "rough:0.01", f"{tmp_path / 'a+b.npy'}:0.1"):
        ground = Ground("+".join([*filter(None, [solid]), "sand:2e5", "water:0.02,1025"]))
        relief = ground.relief(0, EDGE)
        assert ground.solid == solid and relief.yield_per_depth == 2e5
        assert relief.water is not None and (relief.water.level, relief.water.density) == (0.02, 1025.0)
        assert np.array_equal(relief.heights, Ground(solid).relief(0, EDGE).heights if solid else 0 * relief.heights)
    assert Terrain.parse("water:0.02,1025").resistance == pytest.approx((0.5 * 1025 * 1.2, 0.5 * 1025 * 0.02))
    for text in (f"{tmp_path / 'a+b.npy'}:0.1{cover}" for cover in ("+sand:2e5", "+water:0.005", "+sand:2e5+water:0")):
        terrain = Terrain.parse(text)
        assert terrain == Terrain(ground=text) and Terrain.parse(f"hill:0+{text}") == terrain
        assert Terrain.parse(f"{text}+light:0.5,0.1").ground == text
    assert Ground("rough:0.01+sand:2e5").spoken == "smooth random hills of sand (rough:0.01+sand:2e5)"


def test_wet_and_dry_ground_are_not_in_one_batch():
    """In one line."""
    with pytest.raises(ValueError, match=r"^terrain: ground and a fluid are not allowed in one batch"):
        one_each([Terrain.parse("water:0.02"), Terrain()], 2)


def test_every_kind_is_offered():
    """With its help."""
    with pytest.raises(ValueError, match="is unknown; give") as refused:
        Terrain.parse("hills:1")
    assert all(f"{kind}:" in str(refused.value) for kind in GROUNDS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rough", "'rough' lacks HEIGHT"),
        ("rough:", "'rough:' lacks HEIGHT"),
        ("rough:a", "'a' of 'rough:a' is not allowed"),
        ("rough:nan", "'nan' of 'rough:nan' is not allowed"),
        ("rough:1,2,3,4", "at most 3 numbers"),
        ("rough:-1", "HEIGHT -1 of 'rough:-1' is not allowed; give at least 0"),
        ("stairs:0.1,0", "RUN 0 of 'stairs:0.1,0' is not allowed; give at least 0.0001"),
        ("no.npy:0.1", "'no.npy' is no file"),
        ("hill:5+no.npy:0.1", "'no.npy' is no file"),
        ("no.npy:0.1+sand:2e5", "'no.npy' is no file"),
        ("no.npy", "'no.npy' is not allowed; give FILE.npy:SPACING"),
        ("no.png:0.1:0.2+sand:2e5", "'0.1:0.2' of 'no.png:0.1:0.2+sand:2e5' is not allowed; give at most 2 numbers"),
        ("no.npy:0.1+sand", "'no.npy:0.1+sand' lacks YIELD; give sand:YIELD"),
        ("no.png:0.1", "'no.png:0.1' is not allowed; give FILE.png:HEIGHT,SPACING"),
        ("water+rough:0.01", "ground: rough:0.01 is not allowed in a fluid"),
        ("rough:0.01+sand", "'rough:0.01+sand' lacks YIELD; give sand:YIELD"),
        ("sand:0", "YIELD 0 of 'sand:0' is not allowed; give more than 0"),
        ("sand:1+sand:2", "'sand:1+sand:2' is not allowed; give each of sand, water once"),
        ("flat+water:0,-1", "DENSITY -1 of 'water:0,-1' is not allowed; give more than 0"),
        ("hill:5+water:0", "slope: 5.0 is not allowed with water"),
    ],
)
def test_bad_input(text, message):
    """One line."""
    with pytest.raises(ValueError, match=message.replace("+", r"\+")):
        Terrain.parse(text)


def test_how_far_ground_is_level_ahead_of_a_robot(tmp_path):
    """Up to where its height or friction changes; unknown where it does below the robot."""
    np.save(tmp_path / "flat.npy", np.zeros((3, 3)))
    for text, found in [
        ("stairs:0.01,0.1", 0.3),
        ("hill:5+stairs:0.01,0.1,0.13+sand:2e5", 0.13),
        ("gap:0.02", 0.3),
        ("course:1", Course(1, 0.2, 8.0, 0.004, 0.05).ends[0]),
        ("sand:2e5", np.inf),
        (f"{tmp_path / 'flat.npy'}:0.1", np.inf),
    ]:
        ground = Ground(Terrain.parse(text).ground)
        assert ground.level_until(-0.005, 0.115) == pytest.approx(found, abs=0.0011)
    for text in ("rough:0.01", "patches:0.5,1", "ramp:5,0.1", "ramp:5,-1"):
        assert Ground(text).level_until(-0.005, 0.115) is None
    assert Ground("gap:0.02+sand:2e5").beginning_at(0.13) == "gap:0.02,0.02,0.13+sand:2e5"
    assert Ground("rough:0.01").beginning_at(0.13) is None and Ground("sand:1").beginning_at(0.13) is None


def test_ground_of_one_height_is_level_whatever_else_it_is(tmp_path):
    """Friction, sand, water, how high a file raises it; a hill is not, nor is ground with any height."""
    np.save(tmp_path / "raised.npy", np.full((3, 3), 0.05))
    np.save(tmp_path / "patches.npy", np.stack([np.zeros((3, 3)), np.arange(9.0).reshape(3, 3)]))
    np.save(tmp_path / "uneven.npy", np.diag([0.0, 0.0, 1e-3]))
    files = [f"{tmp_path / name}.npy:0.1" for name in ("raised", "patches")]
    for text in ("flat", "sand:2e5", "patches:0.5,1", "patches:0.5,1+sand:2e5", "rough:0", "gap:0.1,0", *files):
        assert Terrain.parse(text).is_level
    made = ("rough:0.01", "ramp:-5", "stairs:0.01,0.1", "wave:0.01,0.1", "course:1", "course:1,0.2,0", "hill:5")
    for text in (*made, "hill:5+patches:0.5,1", f"{tmp_path / 'uneven.npy'}:0.1"):
        assert not Terrain.parse(text).is_level


def test_what_tells_of_a_ground_needs_no_file(tmp_path):
    """Records of runs are read after their file is gone; who names it, or stands on it, needs it."""
    text = f"{tmp_path / 'gone.npy'}:0.1+water:0.01"
    terrain = Terrain(ground=text)
    assert Terrain(**terrain.document) == terrain and terrain.name == text and "of a file" in terrain.spoken
    for needs in (lambda: Terrain.parse(text), lambda: Ground(text).relief(0, EDGE), lambda: Ground(text).content):
        with pytest.raises(ValueError, match=r"^terrain: '.*gone\.npy' is no file$"):
            needs()
    with pytest.raises(ValueError, match=r"gone\.npy' is no file, and .* keeps no copy of it$"):
        Ground(text, tmp_path).check_file()
    assert Ground("rough:0.01").content is None


def test_what_is_too_steep_or_no_table_is_refused(tmp_path):
    """Before any work."""
    with pytest.raises(ValueError, match=r"a slope of 89\.0 degrees is not allowed"):
        Ground("blocks:0.2,0.05").relief(0, EDGE)
    for table, found in (
        (np.array([[0.0, np.nan]]), "holds 1 of 2 values that are not finite"),
        (np.zeros((3, 4, 4)), "has shape (3, 4, 4)"),
        (np.zeros(4), "has shape (4,)"),
        (np.zeros((2, 4, 4), complex), "holds complex128"),
        (np.zeros((4, 4), bool), "holds bool"),
    ):
        np.save(tmp_path / "bad.npy", table)
        told = f"bad.npy' {found}; give a table of finite numbers, shape (X, Y), or (2, X, Y)"
        with pytest.raises(ValueError, match=re.escape(told)):
            Ground(f"{tmp_path / 'bad.npy'}:0.1").relief(0, EDGE)
    with pytest.raises(ValueError, match=r"^terrain: '.*map\.npy': friction: -0\.5 is not allowed; give .*at least 0$"):
        Ground(friction_map(tmp_path, np.full((3, 3), -0.5))).relief(0, EDGE)
    (tmp_path / "bad.png").write_text("no image")
    with pytest.raises(ValueError, match=r"^terrain: '.*bad\.png' is no PNG image$"):
        Ground(f"{tmp_path / 'bad.png'}:0.1,0.1").relief(0, EDGE)
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY\x01\x00\x08\x00{'descr(")
    with pytest.raises(ValueError, match="cannot be read as heights"):
        Ground(f"{tmp_path / 'bad.npy'}:0.1").relief(0, EDGE)


def image_named(folder, image, name="hills.png", **saved) -> str:
    """The name of ground of an image, 1 cm high and 10 cm apart."""
    image.save(folder / name, **saved)
    return f"{folder / name}:0.01,0.1"


GREY = Image.fromarray(np.arange(12, dtype=np.uint8).reshape(3, 4) * 20)


def palette_image() -> Image.Image:
    """One of a palette, whose first colour may be clear."""
    return GREY.convert("P")


@pytest.mark.parametrize("name", ["hills.jpg", "hills.tif"])
def test_images_of_other_formats_are_refused_but_in_folders_that_keep_them(name, tmp_path, monkeypatch):
    """Runs of earlier versions go on, from the copy that their folder has."""
    text = image_named(tmp_path, GREY, name)
    for make in (lambda: Terrain.parse(text), lambda: Ground(text).relief(0, EDGE), lambda: Ground(text).content):
        with pytest.raises(ValueError, match=rf"^terrain: '.*{name}' is no PNG image; give one"):
            make()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    write_bytes(copy_in(tmp_path / "run", name), (tmp_path / name).read_bytes())
    kept = kept_in(tmp_path / "run", Terrain(ground=f"{name}:0.01,0.1")).uneven.relief(0, EDGE)
    assert kept.heights.max() == pytest.approx(0.01 * 220 / 255, rel=0.1)


@pytest.mark.parametrize(
    ("image", "saved"),
    [
        (Image.merge("LA", [GREY, GREY.point(lambda value: 254 if value == 0 else 255)]), {}),
        (Image.merge("RGBA", [GREY] * 3 + [GREY.point(lambda value: 0 if value == 0 else 255)]), {}),
        (GREY, {"transparency": 0}),
        (GREY.convert("I;16"), {"transparency": 0}),
        (GREY.convert("RGB"), {"transparency": (0, 0, 0)}),
        (palette_image(), {"transparency": palette_image().getpixel((0, 0))}),
    ],
)
def test_images_with_pixels_that_are_not_opaque_are_refused(image, saved, tmp_path):
    """Of the colours that they hide, nobody knows which height they mean."""
    with pytest.raises(ValueError, match=r"^terrain: '.*hills\.png' has 1 pixels that are not opaque"):
        Terrain.parse(image_named(tmp_path, image, **saved))


def test_opaque_images_are_ground_with_and_without_transparency(tmp_path):
    opaque = Image.new("L", GREY.size, 255)
    reliefs = [
        Terrain.parse(image_named(tmp_path, image, f"{number}.png", **saved)).uneven.relief(0, EDGE)
        for number, (image, saved) in enumerate(
            [(GREY, {}), (Image.merge("RGBA", [GREY] * 3 + [opaque]), {}), (GREY, {"transparency": 3})]
        )
    ]
    for relief in reliefs:
        assert relief.heights.max() == pytest.approx(0.01 * 220 / 255, rel=1e-6)


def test_animated_images_are_refused(tmp_path):
    text = image_named(tmp_path, GREY, save_all=True, append_images=[GREY.rotate(180)])
    with pytest.raises(ValueError, match=r"^terrain: '.*hills\.png' has 2 frames; give a PNG image of one$"):
        Terrain.parse(text)


@pytest.mark.parametrize("side", [5100, 10_000, 14_000])
def test_images_of_too_many_pixels_are_not_unpacked(side, tmp_path):
    Image.new("1", (side, side)).save(tmp_path / "large.png")
    with pytest.raises(ValueError, match="pixels are not allowed, give at most 25000000"):
        Ground(f"{tmp_path / 'large.png'}:0.1,0.1").relief(0, EDGE)


def test_robots_are_raised_until_they_stand():
    """The lowest clearance is zero; others beside them on level ground stay."""
    terrains = [Terrain.parse("rough:0.02"), Terrain()]
    medium = medium_of(terrains, [0.0, 0.0], EDGE)
    centres = np.tile([[0.0, 0.0, 0.0], [0.05, 0.02, 0.0], [0.05, 0.02, 0.01]], (2, 1, 1))
    raised = standing(centres, medium, EDGE)
    relief = medium["floor"][0]
    clear = raised[0, :, 2] - relief.height(raised[0, :, 0], raised[0, :, 1])
    assert 0 <= clear.min() < 1e-3 and np.array_equal(raised[1], centres[1])


def test_journeys_keep_to_planes():
    """In one line."""
    with pytest.raises(ValueError, match=r"uneven ground .* is not allowed in a journey"):
        simulate_journey([Leg(ROLLING, Terrain.parse("rough:0.01"))])


@pytest.mark.slow
@pytest.mark.kernels
def test_inflatable_robots_on_sand_and_in_water():
    """It sinks in a little, or floats away from where it rolled, with a skin that pressure keeps closed."""
    gait = replace(ROLLING, schedule=ROLLING.schedule.cut(1, 1))
    options = {"geometry": NAMED_GEOMETRIES["small"], "precision": "f32"}
    found = [simulate([gait], Terrain.parse(text), **options) for text in ("flat", "sand:1e5", "water:0.05")]
    assert all((each.status == "ok").all() for each in found)
    assert len({round(float(each.distance[0]), 6) for each in found}) == 3


@pytest.mark.slow
@pytest.mark.kernels
def test_a_batch_of_inflatable_robots_has_ground_of_its_own():
    """Each as it is alone: on hills, on the plane, and on hills that it crosses."""
    gait = replace(ROLLING, schedule=ROLLING.schedule.cut(1, 1))
    designs = [gait, gait, replace(gait, orientation=30.0)]
    terrains = [Terrain.parse(text) for text in ("rough:0.01", "flat", "rough:0.01")]
    options = {"geometry": NAMED_GEOMETRIES["small"], "precision": "f32"}
    together = simulate(designs, terrains, **options)
    alone = [simulate([design], terrain, **options) for design, terrain in zip(designs, terrains, strict=True)]
    assert (together.status == "ok").all()
    assert np.allclose(together.distance, [each.distance[0] for each in alone], rtol=1e-3, atol=1e-5)
    assert np.ptp(together.distance) > 1e-3


def test_files_that_change_and_deep_images(tmp_path):
    """Heights are those of the file as it is now; the brightest that an image can say is 1."""
    file = tmp_path / "h.npy"
    np.save(file, np.zeros((3, 3)))
    ground = Ground(f"{file}:0.1")
    assert ground.relief(0, EDGE).height(0, 0) == 0
    np.save(file, np.full((3, 3), 0.01))
    os.utime(file, ns=(1, 1))
    assert ground.relief(0, EDGE).height(0, 0) == pytest.approx(0.01)
    (tmp_path / "empty.npy").write_bytes(b"")
    with pytest.raises(ValueError, match="cannot be read as heights"):
        Ground(f"{tmp_path / 'empty.npy'}:0.1").relief(0, EDGE)
    for text, message in (("rough:0.01,0.05,0.5", "SEED 0.5"), ("rough:0.01,0.05,1e12", "SEED 1e")):
        with pytest.raises(ValueError, match=message):
            Terrain.parse(text)
    with pytest.raises(ValueError, match=r"^ground: 5 is not allowed"):
        Terrain(ground=5)


def test_ground_that_is_no_text_is_refused_in_one_line():
    with pytest.raises(ValueError, match=r"^ground: array.* is not allowed; give a text such as 'rough"):
        Terrain(ground=np.zeros((9, 9)))


DUNES = GroundKind(
    "dunes",
    "dunes across the way",
    (HEIGHT, Number("BEGIN", 0.2, -math.inf, start=True), Number("RADIUS", 0.1)),
    lambda x, y, height, begin, radius: height * np.clip((x - begin) / radius, 0.0, 1.0),
)
MUD = Cover(
    "mud",
    "mud",
    (Number("DEPTH", low=-math.inf), Number("YIELD", 1e4)),
    "of mud",
    {"water": lambda depth, _: Water(depth, 1800.0), "yield_per_depth": lambda _, limit: limit},
)


def test_a_kind_of_ground_says_which_numbers_it_takes_and_where_it_begins(monkeypatch):
    """Whatever they are called: a radius of 0 is refused by name, and another start keeps what follows it."""
    monkeypatch.setitem(GROUNDS, "dunes", DUNES)
    for text, message in (
        ("dunes:0.01,0.3,0", "RADIUS 0 of 'dunes:0.01,0.3,0' is not allowed; give more than 0"),
        ("dunes", "'dunes' lacks HEIGHT; give dunes:HEIGHT[,BEGIN][,RADIUS]"),
    ):
        with pytest.raises(ValueError, match=f"^terrain: {re.escape(message)}$"):
            Terrain.parse(text)
    assert height("dunes:0.01", [0.2, 0.25, 0.5], 0.0) == pytest.approx([0.0, 0.005, 0.01])
    assert Ground("dunes:0.01").beginning_at(0.5) == "dunes:0.01,0.5,0.1"
    assert Ground("dunes:0.01,0.3,0.4+sand:1").beginning_at(0.5) == "dunes:0.01,0.5,0.4+sand:1"
    (far,) = doubts_before(GaitProblem((Terrain.parse("dunes:0.01,2,0.4"),), geometry="small"))
    assert re.search(r"; give its BEGIN, such as dunes:0\.01,0\.\d+,0\.4$", far)


def test_a_cover_says_what_it_does_to_robots(monkeypatch):
    """One entry of the table gives its laws, its words, its batches and its help; two never say the same."""
    monkeypatch.setitem(COVERS, "mud", MUD)
    mud, terrain = Ground("rough:0.01+mud:0.02"), Terrain.parse("rough:0.01+mud:0.02")
    relief = mud.relief(0, EDGE)
    assert (relief.water, relief.yield_per_depth) == (Water(0.02, 1800.0), 1e4)
    assert mud.spoken == "smooth random hills of mud (rough:0.01+mud:0.02)" and terrain.is_wet
    assert terrain.resistance == pytest.approx((0.5 * 1800 * 1.2, 0.5 * 1800 * 0.02))
    shore = Terrain.parse("water:0+sand:1")
    keys = [
        batch_key(each) for each in (terrain, shore, Terrain.parse("sand:1"), Terrain.parse("rough:0.01"), Terrain())
    ]
    assert keys[0] == keys[1] and keys[3] == keys[4] and len({*keys}) == 3
    assert "+mud:DEPTH[,YIELD]" in ways() and "mud:DEPTH[,YIELD] (mud)" in described()
    with pytest.raises(
        ValueError, match=r"^terrain: 'sand:1\+mud:0' is not allowed, as sand and mud both say its yield"
    ):
        Ground("sand:1+mud:0")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("rough:0.0001,1e-300", "SIZE 1e-300 of 'rough:0.0001,1e-300' is not allowed; give at least 0.0001"),
        ("blocks:0.001,1e-30", "SIZE 1e-30 of"),
        ("patches:0.5,1,1e-300", "SIZE 1e-300 of"),
        ("patches:0.5,1e7", "HIGH 1e+07 of 'patches:0.5,1e7' is not allowed; give at most 1e+06"),
        ("wave:0.0,1e-300", "LENGTH 1e-300 of"),
        ("stairs:1e300,1e-300", "RISE 1e+300 of 'stairs:1e300,1e-300' is not allowed; give at most 10000"),
        ("stairs:0.1,1e-300", "RUN 1e-300 of"),
        ("rough:1e300", "HEIGHT 1e+300 of"),
        ("ramp:5,1e300", "START 1e+300 of"),
        ("ramp:1e300", "DEGREES 1e+300 of"),
        ("water:1e300", "LEVEL 1e+300 of 'water:1e300' is not allowed; give at most 10000"),
        ("water:-1e300", "LEVEL -1e+300 of 'water:-1e300' is not allowed; give at least -10000"),
        ("sand:1e300", "YIELD 1e+300 of"),
    ],
)
def test_numbers_that_no_ground_has_are_refused_by_name(text, told):
    with pytest.raises(ValueError, match=f"^terrain: {re.escape(told)}"):
        Terrain.parse(text)


@pytest.mark.parametrize("kind", [*GROUNDS.values(), *COVERS.values()], ids=lambda kind: kind.name)
def test_every_ground_and_cover_is_in_the_documents_and_in_the_help(kind):
    """A row of the table has it with its numbers, what it is, and what those are that may be left out."""
    assert f"{kind.way} ({kind.description})" in KINDS["walker"].world_options[0].help
    page = (Path(__file__).resolve().parents[2] / "docs/terrains.md").read_text()
    (row,) = (line for line in page.splitlines() if line.startswith(f"| `{kind.way}`"))
    assert kind.description in row.replace("[", "").replace("](#sand-and-water)", "")
    common = page.partition("Numbers are metres and degrees.")[2].partition("\n\n")[0]
    for number in kind.numbers:
        if number.default is not None:
            assert re.search(rf"(?<![\d.]){number.default:g}(?![\d.]*\d)", row + common) or (
                re.search(rf"(?<![\d.]){1000 * number.default:g} mm", row)
            )


def test_the_earlier_name_of_blocks_is_read():
    """Commands, and records of earlier versions: these stay as they are, so that runs of them are resumed."""
    record = {"slope": 5.0, "ground": "steps:0.01,0.1,3+sand:2e5"}
    old, new = Terrain(**record), Terrain.parse("hill:5+blocks:0.01,0.1,3+sand:2e5")
    assert old == Terrain.parse("hill:5+steps:0.01,0.1,3+sand:2e5") and old.name == "hill:5+steps:0.01,0.1,3+sand:2e5"
    assert {name: old.document[name] for name in record} == record
    assert np.array_equal(old.uneven.relief(30.0, EDGE).heights, new.uneven.relief(30.0, EDGE).heights)
    assert old.spoken == new.spoken.replace("blocks:", "steps:") and batch_key(old) == batch_key(new)
    with pytest.raises(ValueError, match=r"^terrain: 'steps' lacks HEIGHT; give blocks:HEIGHT\[,SIZE\]\[,SEED\]$"):
        Terrain.parse("steps")


@pytest.mark.parametrize("name", ["stairs:0.01,0.06,0.13", "gap:0.03,0.01,0.19", "stairs:0.025,0.06,0.13"])
def test_edges_at_nodes_do_not_hang_on_rounding(name):
    """Edges that lie at nodes do so at all headings, so a turned robot meets the same ground."""
    ahead = np.arange(-0.1, 0.6, EDGE / 2)
    reliefs = [Ground(name).relief(heading, EDGE) for heading in (0.0, 90.0, 180.0, 360.0, -90.0)]
    expected = reliefs[0].height(ahead, np.zeros(len(ahead)))
    assert np.ptp(expected) > 0
    for relief, (x, y) in zip(reliefs, ((1, 0), (0, 1), (-1, 0), (1, 0), (0, -1)), strict=True):
        for aside in (-0.21, 0.0, 0.34):
            found = relief.height(x * ahead - y * aside, y * ahead + x * aside)
            np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize(
    "name, told",
    [
        (
            "gap:0.003,0.01",
            "WIDTH 0.003 of 'gap:0.003,0.01' is not allowed on this robot's grid of 5 mm; give at least 0.005",
        ),
        (
            "wave:0.004,0.009",
            "LENGTH 0.009 of 'wave:0.004,0.009' is not allowed on this robot's grid of 5 mm; give at least 0.01",
        ),
        ("blocks:0.001,0.004", "SIZE 0.004 of"),
        ("gap:0.002,0.001", r"WIDTH 0.002 of .* on this robot's grid of 5 mm; give at least 0.005$"),
        ("stairs:0.001,0.004", "RUN 0.004 of"),
    ],
)
def test_ground_that_its_grid_cannot_show_is_refused(name, told):
    with pytest.raises(ValueError, match=f"^terrain: {told}"):
        Ground(name).relief(0.0, 0.01)


def test_the_least_that_a_refusal_names_is_allowed():
    with pytest.raises(ValueError, match=r"grid of 3\.33 mm; give at least 0\.00334$"):
        Ground("gap:0.002,0.001").relief(0.0, 0.005)
    Ground("gap:0.00334,0.001").relief(0.0, 0.005)
