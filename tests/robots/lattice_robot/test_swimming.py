"""Robots in water: what floats stays, nothing travels in vacuum, gaits swim, and gradients know of it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from graded import tabled, unskipped
from matplotlib.collections import PolyCollection

from optim.cli import main
from robots.inflatable import InflatableActuation, InflatableDesign, InflatableGeometry, load_design, simulate
from robots.inflatable.gradient import differentiate
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.view.motion import inflatable_motion
from robots.inflatable.view.picture import inflatable_picture
from robots.lattice_robot import simulate as simulate_robot
from robots.lattice_robot.walker import ACTIVE, WalkerActuation, WalkerDesign, walker_robot
from robots.lattice_robot.walker import simulate as simulate_walker
from robots.view.film import strip_picture
from robots.view.player import page
from robots.view.still import still_picture
from robots.world import Terrain

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2)
QUICK = InflatableActuation(inflation_rate=0.003, pressure_ramp=20.0, hold_steps=500, settle_steps=300)
VACUUM = Terrain(fluid_density=0.0)
OPTIONS = {"geometry": TINY, "actuation": QUICK, "threads": 1}


def gaits(count: int, columns: int = 3) -> list[GaitSchedule]:
    bits = np.random.default_rng(3).random((count, 10, columns)) < 0.5
    bits[:, 0] = np.arange(columns) % 2 == 0  # a full stroke in every column
    return [GaitSchedule(b, 1) for b in bits]


def middle(result) -> np.ndarray:
    """Centre of mass of every robot in every frame, shape (F, B, 3); all voxels weigh the same."""
    return result.frames.positions.mean(axis=2)


@pytest.mark.kernels
def test_a_robot_that_does_nothing_neither_sinks_nor_swims():
    """It coasts on what its inflation left it, which quadratic drag hardly slows: never faster than at first."""
    still = GaitSchedule(np.zeros((10, 2), bool), 1)
    result = simulate(InflatableDesign(6e3, 45.0, still), Terrain.water(), record_every=100, **OPTIONS)
    places = middle(result)[:, 0]
    assert result.status[0] == "ok" and abs(result.distance[0]) < 1e-3 * TINY.body_length
    moves = np.linalg.norm(np.diff(places[:-1], axis=0), axis=1)
    assert moves[-1] <= moves[0] < 0.02 * TINY.voxel_size


@pytest.mark.kernels
def test_in_vacuum_no_gait_travels_at_any_pressure():
    """The robot changes its shape, but nothing is there to push against, as there is in water."""
    designs = [InflatableDesign(p, 45.0, g) for p, g in zip((0.0, 4e3, 8e3, 12e3), gaits(4), strict=True)]
    wet, dry = (simulate(designs, t, record_every=200, **OPTIONS) for t in (Terrain.water(), VACUUM))
    assert (wet.status == "ok").all() and (dry.status == "ok").all()
    assert np.nanmax(np.linalg.norm(middle(dry) - middle(dry)[0], axis=2)) < 1e-14
    assert np.nanmax(np.linalg.norm(middle(wet) - middle(wet)[0], axis=2), axis=0).min() > 1e-5
    shape = dry.frames.positions - middle(dry)[:, :, None]
    assert np.nanmax(np.abs(shape - shape[0]), axis=(0, 2, 3)).min() > 0.5 * TINY.voxel_size


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_gait_without_idle_columns_swims_as_far_to_the_bit(precision):
    designs = [InflatableDesign(p, 30.0, g) for p, g in zip((0.0, 5e3), gaits(2), strict=True)]
    binary = simulate(designs, Terrain.water(), precision=precision, **OPTIONS)
    relaxed = simulate([unskipped(d) for d in designs], Terrain.water(), precision=precision, **OPTIONS)
    assert (np.abs(binary.distance) > 1e-5).all()
    assert np.array_equal(relaxed.distance, binary.distance)


@pytest.mark.kernels
def test_the_gradient_of_the_distance_in_water_agrees_with_differences():
    rates = {"inflation_rate": 0.02, "pressure_ramp": 50.0, "ramp_steps": 100}
    quick = InflatableActuation(**rates, hold_steps=100, settle_steps=50)
    options = OPTIONS | {"actuation": quick}
    levels = np.random.default_rng(0).uniform(0.2, 0.8, (10, 2))

    def design(pressure: float) -> InflatableDesign:
        return InflatableDesign(pressure, 40.0, tabled(levels[:8], levels[8:], 1))

    slope = differentiate([design(3e3)], Terrain.water(), **options).pressure[0]
    step = 1e-4  # Pa; larger ones cross jumps, where links change to large angles
    ends = simulate([design(3e3 + step), design(3e3 - step)], Terrain.water(), **options).distance
    assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=2e-3)


@pytest.mark.kernels
def test_a_walker_swims_and_in_vacuum_it_does_not():
    """A bar that swells at one end more than at the other, with a foot there."""
    table = np.zeros((4, 1, 2), int)
    table[:, 0, 1] = table[0, 0, 0] = ACTIVE
    quick = WalkerActuation(settling=0.0, cycles=1)
    wet, dry = (
        simulate_walker(WalkerDesign(table), t, actuation=quick, threads=1).distance[0]
        for t in (Terrain.water(), VACUUM)
    )
    assert abs(dry) < 1e-9 and abs(wet) > 1e-5


def test_water_has_a_name_and_what_it_needs():
    water = Terrain.parse("water")
    assert water == Terrain.water() and water.name == "water" and water.where == "in water"
    assert water.resistance == (600.0, 10.0) and Terrain().resistance == (0.0, 0.0)
    assert Terrain(fluid_density=800.0, pressure_drag=2.0, friction_drag=0.1).resistance == (800.0, 40.0)
    assert Terrain().where == "on flat" and not Terrain().is_fluid and VACUUM.is_fluid
    assert [t.spoken for t in (water, Terrain(), Terrain(3.0), Terrain(-3.0))] == [
        "in water",
        "on flat ground",
        "up a slope of 3°",
        "down a slope of 3°",
    ]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fluid_density": -1}, "fluid_density: -1 is not allowed"),
        ({"fluid_density": 1e3, "slope": 5}, "slope: 5.0 is not allowed in a fluid"),
        ({"fluid_density": 1e3, "high_friction": 1}, "high_friction: 1.0 is not allowed in a fluid"),
        ({"pressure_drag": 1}, "pressure_drag: 1.0 is not allowed without a fluid"),
        ({"fluid_density": 1e3, "friction_drag": np.nan}, "friction_drag: nan is not allowed"),
    ],
)
def test_terrains_that_contradict_themselves_are_refused_in_one_line(given, message):
    with pytest.raises(ValueError, match=rf"^{re.escape(message)}[^\n]*$"):
        Terrain(**given)


def painted(axes) -> tuple[bool, bool]:
    """Whether a picture has a shadow and a ground: of one polygon."""
    sizes = [len(c.get_paths()) for c in axes.collections if isinstance(c, PolyCollection)]
    return 0 not in sizes, 1 in sizes


@pytest.mark.kernels
def test_a_picture_in_water_has_no_ground():
    design = InflatableDesign(4e3, 45.0, gaits(1)[0])
    for terrain in (Terrain(), Terrain.water()):
        result = simulate(design, terrain, record_every=300, precision="f32", **OPTIONS)
        motion = inflatable_motion(result, design, terrain, actuation=QUICK, name=f"robot {terrain.where}")
        for drawn in (still_picture(motion), strip_picture(motion, frames=3)):
            assert painted(drawn.axes[0]) == (not terrain.is_fluid,) * 2
            assert terrain.where in drawn.texts[0].get_text()
        about = re.search(r'<script id="about" type="application/json">(.*?)</script>', page(motion))
        ground = json.loads(about[1])[0]["ground"]
        assert ground["solid"] != terrain.is_fluid
        lowest = motion.lattice.positions[..., 2].min()
        assert (ground["level"] < lowest - 0.5 * TINY.voxel_size) == terrain.is_fluid
        figure = inflatable_picture(result, design, terrain, actuation=QUICK, frames=3)
        assert painted(figure.axes[0]) == (not terrain.is_fluid,) * 2
        assert figure.texts[0].get_text().partition(";")[0].endswith(terrain.spoken)


@pytest.mark.parametrize("name", ["2-kpa", "10-kpa"])
def test_the_page_describes_the_designs_beside_it(name):
    docs = Path(__file__).parents[3] / "docs"
    design = load_design(docs / f"data/swimming/{name}.json")
    text = (docs / "swimming.md").read_text()
    (row,) = (line for line in text.splitlines() if line.startswith(f"| `docs/data/swimming/{name}"))
    assert f"| {design.pressure / 1000:.0f} kPa | {design.orientation:.0f}° |" in row
    assert (design.schedule.columns, design.schedule.repeats) == (3, 3)


@pytest.mark.kernels
def test_the_command_takes_a_terrain_or_a_slope(capsys):
    robot = ["--geometry", "small", "--columns", "1", "--repeats", "1", "--precision", "f32"]
    gait = ["simulate", "--gait", "rolling", "--pressure", "0", *robot]
    assert main([*gait, "--terrain", "water"]) == 0
    assert capsys.readouterr().out.startswith("rolling in water: ok after ")
    assert main([*gait, "--terrain", "water", "--slope", "3"]) == 2
    assert "slope: 3 is not allowed beside --terrain water; give one of them" in capsys.readouterr().err


@pytest.mark.kernels
@pytest.mark.parametrize("name", ["flat", "water", "ramp:-10,0.05+water:-0.005"])
def test_a_walker_has_the_time_steps_of_the_same_lattice_robot(name):
    """Its batch reckoned with swellings that no walker has, and its times were those of dry ground."""
    terrain, drive = Terrain.parse(name), WalkerActuation(cycles=1)
    body = WalkerDesign(np.random.default_rng(0).integers(1, 4, (4, 2, 2)))
    walked = simulate_walker([body], terrain, actuation=drive)
    alike = simulate_robot(walker_robot(body, actuation=drive), terrain=terrain)
    assert walked.steps == alike.steps and walked.distance == alike.distance
    assert walked.steps[0] * walked.time_step == pytest.approx(drive.settling + (drive.cycles + 1) / drive.frequency)
