"""The inflatable robot with several cores: body, program, derivatives, simulation, files."""

import dataclasses
import functools
import hashlib
import json

import numpy as np
import pytest
from graded import QUICK, pulled_back, tabled, unskipped
from graded import TINY_TWO as TINY
from program_values import values_after

from optim.problems.inflatable.problem import GaitProblem
from robots import inflatable
from robots.hardware import gait_table
from robots.hardware.gait_commands import rig_report
from robots.inflatable import (
    INCHING,
    PUBLISHED,
    ROLLING,
    TWO_CORE,
    InflatableDesign,
    InflatableGeometry,
    predicted_steps,
    simulate,
)
from robots.inflatable.body import FIRST_BLADDER, FOOT_1, FOOT_2, FOOT_SEAM, REGION_COUNT, SEAM, cores_of, kinds_of
from robots.inflatable.design import (
    checked_pressure,
    common_pressure,
    core_shapes,
    kilopascals,
    load_design,
    save_design,
)
from robots.inflatable.gradient import differentiate
from robots.inflatable.program import RobotEvents, build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import gait_timeline
from robots.inflatable.view.motion import inflatable_motion
from robots.inflatable.view.shape import height
from robots.world import Terrain
from taichi_sim.lattice import LatticeEngine, ProgramBuilder, Quantity
from taichi_sim.lattice.laws.enclosure import closed_surface, enclosed_volume

THREE = dataclasses.replace(PUBLISHED, cores=3)
STEADY = dataclasses.replace(QUICK, hold_steps=400)
IDLE = GaitSchedule(np.zeros((10, 1)), repeats=1)
FULL = 12e3
SHAPES = [(0.0, 0.0), (FULL, 0.0), (0.0, FULL), (FULL, FULL)]


def events_of(program, quantity, regions):
    """The events of some regions, without their names, sorted."""
    events = program.events[(program.events["quantity"] == quantity) & np.isin(program.events["region"], regions)]
    return sorted(zip(*(events[name].tolist() for name in ("robot", "step", "value", "rate")), strict=True))


# body


@pytest.mark.parametrize(
    ("rows", "cores", "lengths"),
    [(22, 1, [22]), (22, 2, [11, 11]), (22, 3, [7, 8, 7]), (22, 4, [5, 6, 6, 5]), (21, 2, [10, 11]), (22, 7, None)],
)
def test_cores_share_the_rows_as_equally_as_can_be_and_the_same_from_either_end(rows, cores, lengths):
    parts = InflatableGeometry(rows=rows, cores=cores).core_rows
    assert [row for part in parts for row in part] == list(range(1, rows + 1))
    found = [len(part) for part in parts]
    assert max(found) - min(found) <= 1 and lengths in (None, found)
    assert found == found[::-1] or (rows % 2 and cores % 2 == 0)


@pytest.mark.parametrize("geometry", [TWO_CORE, THREE, TINY], ids=["two", "three", "tiny"])
def test_skins_are_joined_along_the_long_edges_and_at_the_walls(geometry):
    body = geometry.body
    ends = body.voxels[body.topology.links]
    low, high = geometry.bladder_layers, geometry.bladder_layers + 1
    joined = {tuple(e) for e in ends[(ends[:, 0, 2] == low) & (ends[:, 1, 2] == high)][:, 0, :2].tolist()}
    walls = {rows[0] for rows in geometry.core_rows[1:]} | {rows[-1] for rows in geometry.core_rows[:-1]}
    plan = [(x, y) for x in range(1, geometry.columns + 1) for y in range(1, geometry.rows + 1)]
    assert joined == {(x, y) for x, y in plan if x in (1, geometry.columns) or y in walls}
    assert geometry.wall_rows == tuple(sorted(walls))


@pytest.mark.parametrize("geometry", [TWO_CORE, THREE], ids=["two", "three"])
def test_every_voxel_of_the_skin_belongs_to_one_core(geometry):
    body, plain = geometry.body, PUBLISHED.body
    regions, kinds = np.asarray(body.regions), kinds_of(np.asarray(body.regions))
    skin = kinds < FIRST_BLADDER
    rows = [set(part) for part in geometry.core_rows]
    assert all(y in rows[core] for y, core in zip(body.voxels[skin, 1], cores_of(regions[skin]), strict=True))
    assert body.region_count == REGION_COUNT + FIRST_BLADDER * (geometry.cores - 1)
    assert np.array_equal(body.voxels, plain.voxels) and np.array_equal(body.pressure_normals, plain.pressure_normals)
    moved = kinds != plain.regions  # walls are seams, and nothing else changes
    assert set(kinds[moved]) == {SEAM} and set(body.voxels[moved, 1]) == set(geometry.wall_rows)
    feet = [set(body.voxels[kinds == foot, 1]) for foot in (FOOT_1, FOOT_2)]
    assert feet == [{1, 2, 3}, {20, 21, 22}]


@pytest.mark.parametrize("geometry", [TWO_CORE, THREE], ids=["two", "three"])
def test_every_core_is_closed_by_itself(geometry):
    """So in a fluid pressure on it neither pushes nor turns the robot; a voxel is pressed by its own core alone."""
    body, squares = geometry.body, closed_surface(geometry.body)
    cores = cores_of(np.asarray(body.regions))[squares]
    assert (cores == cores[:, :1]).all()
    across, h = geometry.columns - 1, geometry.voxel_size
    for core, rows in enumerate(geometry.core_rows):
        mine = squares[cores[:, 0] == core]
        assert enclosed_volume(mine, body.start_positions) == pytest.approx(across * (len(rows) - 1) * h**3)


def test_one_core_is_the_published_body():
    body = dataclasses.replace(PUBLISHED, cores=1).body
    content = (body.voxels, body.material_index, body.regions, body.cut_links, body.pressure_normals)
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in content))
    assert digest.hexdigest()[:16] == "c07ae443e119f4a6"  # of the body before there were several cores


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: InflatableGeometry(cores=0), "cores: 0 is not allowed; give a whole number, at least 1"),
        (lambda: InflatableGeometry(cores=1.5), "cores: 1.5 is not allowed; give a whole number, at least 1"),
        (lambda: InflatableGeometry(cores=8), "cores: 8 is not allowed; 22 rows have room for 1 to 7, each of 3 rows"),
        (lambda: checked_pressure(()), "pressure: none is given; give one for all cores, or one each"),
        (lambda: checked_pressure((1.0, -1.0)), "pressure: -1.0 is not allowed; give a number from 0 to 15000"),
        (lambda: checked_pressure([1.0, [2.0]]), r"pressure: \[2.0\] is not allowed"),
        (lambda: simulate(InflatableDesign((1.0, 2.0), 0.0, IDLE)), "pressure: 2 values are not allowed; give one"),
        (
            lambda: simulate(InflatableDesign((1.0, 2.0, 3.0), 0.0, IDLE), geometry=TINY),
            "pressure: 3 values are not allowed; give one, or 2, one a core",
        ),
        (lambda: core_shapes(TINY, 0.0), "pressure: 0.0 is not allowed; give one above 0 Pa"),
        (lambda: core_shapes(TINY, 16e3), "pressure: 16000.0 is not allowed"),
        (
            lambda: InflatableDesign((1.0, 2.0), 0.0, tabled(np.zeros((8, 1)), np.zeros((2, 1)), 1, [5.0])),
            "pressure: 2 values are not allowed with a gait that has core pressures of its columns; give one",
        ),
        (
            lambda: differentiate([graded(1.0), graded((1.0, 2.0))], geometry=TINY),
            "designs: a mixture is not allowed; give all one core pressure, or all one a core",
        ),
        (lambda: gait_table(InflatableDesign((9e3, 0.0), 0.0, IDLE)), "pressure: 9 and 0 kPa are not allowed; a rig"),
        (lambda: rig_report(InflatableDesign((9e3, 0.0), 0.0, IDLE)), "pressure: 9 and 0 kPa are not allowed; a rig"),
        (
            lambda: GaitProblem((Terrain(),), pressure=(1.0, 2.0)),
            "pressure: 2 values are not allowed; give one, for the one core",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        build()
    assert "\n" not in str(error.value)


# program


def test_a_pressure_for_all_is_the_same_one_for_each():
    designs = [InflatableDesign(p, 30.0, INCHING.schedule) for p in (7e3, (7e3, 7e3))]
    first, second = (build_program([d], Terrain(5.0), geometry=TWO_CORE) for d in designs)
    assert np.array_equal(first.events, second.events) and np.array_equal(first.lengths, second.lengths)
    graded_designs = [unskipped(d) for d in designs]
    first, second = (build_program([d], Terrain(5.0), geometry=TWO_CORE) for d in graded_designs)
    assert np.array_equal(first.events, second.events)


def test_regions_of_one_core_get_what_they_got_when_there_was_one():
    """To the bit; those of the other core get the same."""
    designs = [INCHING, ROLLING]
    before, now = build_program(designs, Terrain(10.0)), build_program(designs, Terrain(10.0), geometry=TWO_CORE)
    assert np.array_equal(now.events[now.events["region"] < REGION_COUNT], before.events)
    assert np.array_equal(now.lengths, before.lengths) and np.array_equal(now.snapshots, before.snapshots)
    for quantity in np.unique(before.events["quantity"]):
        for kind in range(FIRST_BLADDER):
            assert events_of(now, quantity, [REGION_COUNT + kind]) == events_of(before, quantity, [kind])


def test_each_core_stops_at_its_own_pressure_and_the_gait_waits_for_the_highest():
    design = InflatableDesign((2e3, 6e3), 0.0, INCHING.schedule)
    program = build_program([design], Terrain(), geometry=TWO_CORE)
    begin = inflatable.ACTUATION.initial_steps(6e3)
    steps = np.array([1, 3000, 4001, 4002, 9000, 12_001, begin]) + 1
    first, second = (values_after(program, 0, region, Quantity.PRESSURE, steps) for region in (0, REGION_COUNT))
    assert first.tolist() == [0.5, 1500.0, 2e3, 2e3, 2e3, 2e3, 2e3]
    assert second.tolist() == [0.5, 1500.0, 2000.5, 2001.0, 4500.0, 6e3, 6e3]
    assert program.snapshots[0, 0] == begin and predicted_steps(design) == program.lengths[0]


def test_bladders_lengthen_by_the_mean_pressure_over_the_rows_under_them():
    assert TWO_CORE.bladder_shares == [0.5, 0.5]
    assert THREE.bladder_shares == [4 / 16, 8 / 16, 4 / 16]
    felt = [
        RobotEvents.of(ProgramBuilder(1), 0, p, 0.0, Terrain(), geometry=THREE).felt for p in ((8e3, 4e3, 0.0), 5e3)
    ]
    assert felt == [4e3, 5e3]
    program = build_program([InflatableDesign((FULL, 0.0), 0.0, INCHING.schedule)], Terrain(), geometry=TWO_CORE)
    done = inflatable.ACTUATION.initial_steps(FULL) + 7668
    along = values_after(program, 0, FIRST_BLADDER, Quantity.SCALE + 1, np.array([done]))
    assert along == pytest.approx(1 + 2.3001 / (1.7 + 8.3 * 0.5))


def test_core_pressures_of_columns_are_those_of_all_cores():
    schedule = tabled(np.ones((8, 2)), np.ones((2, 2)), 1, [3e3, 9e3])
    program = build_program([InflatableDesign(1e3, 0.0, schedule)], Terrain(), geometry=TWO_CORE)
    first, second = (events_of(program, Quantity.PRESSURE, [region]) for region in (0, REGION_COUNT + FOOT_SEAM))
    assert first == second and first[-1][2] == 9e3


def graded(pressure) -> InflatableDesign:
    """A gait of two columns, between off and on."""
    generator = np.random.default_rng(3)
    return InflatableDesign(pressure, 40.0, tabled(*(generator.uniform(0.1, 0.9, (n, 2)) for n in (8, 2)), 1))


def test_events_have_a_derivative_by_the_pressure_of_each_core():
    """Against differences of the program, for a ramp that takes as long at any pressure."""
    weights = np.random.default_rng(0)
    actuation = dataclasses.replace(QUICK, ramp_steps=100)
    build = functools.partial(build_program, terrain=Terrain(), actuation=actuation, geometry=TINY)
    at = np.array([5e3, 9e3])
    designs = [graded(tuple(at))] * 2
    program = build(designs)
    values, rates = weights.normal(size=(2, len(program.events)))

    def cost(pressures):
        events = build([graded(tuple(pressures)), graded(tuple(at))]).events
        return float((values * events["value"] + rates * events["rate"]).sum())

    found = pulled_back(program, designs, Terrain(), actuation, values, rates, TINY)[0]["pressure"]
    differences = [(cost(at + step) - cost(at - step)) / 2.0 for step in np.eye(2)]
    assert found.shape == (2,) and found == pytest.approx(differences, rel=1e-6)


# simulation


@pytest.fixture(scope="module")
def inflated():
    """The four shapes of a small robot, each after its initialisation."""
    designs = [InflatableDesign(shape, 0.0, IDLE) for shape in SHAPES]
    return designs, simulate(designs, geometry=TINY, actuation=STEADY, record_every=50, threads=1)


def thickness(result, robot) -> np.ndarray:
    """Largest distance between the skins in every row [m], shape (rows,)."""
    body, places = result.body, result.frames.positions[0, robot]
    skins = [(body.voxels[:, 2] == z) for z in (TINY.bladder_layers, TINY.bladder_layers + 1)]
    rows = range(1, TINY.rows + 1)
    low, high = ([places[skin & (body.voxels[:, 1] == row), 2] for row in rows] for skin in skins)
    return np.array([(upper - lower).max() for lower, upper in zip(low, high, strict=True)])


@pytest.mark.kernels
def test_one_core_inflated_is_round_at_one_end_and_flat_at_the_other(inflated):
    _, result = inflated
    assert result.status.tolist() == ["ok"] * 4
    flat, first, second, both = (thickness(result, robot) for robot in range(4))
    wall = TINY.wall_rows[0]
    assert flat.max() < 0.03 and both[[0, -1]].min() > 0.05
    assert first[0] > 0.05 and first[wall:].max() < 0.03
    assert second[-1] > 0.05 and second[:wall].max() < 0.03
    assert both[[wall - 1, wall]].max() < 0.03  # the walls hold the skins together


@pytest.mark.kernels
def test_a_core_that_is_closed_at_one_end_only_does_not_drive_the_robot_along(inflated):
    """Pressure acts on closed surfaces; on faces alone, it would push towards the open end like a balloon let go."""
    _, result = inflated
    middles = result.frames.positions[0].mean(axis=1) - result.body.start_positions.mean(axis=0)
    assert np.abs(middles[:, :2]).max() < 0.005
    engines = [LatticeEngine(geometry.body, 1) for geometry in (TINY, dataclasses.replace(TINY, cores=1))]
    assert [engine.tables.squares > 0 for engine in engines] == [True, False]


@pytest.mark.kernels
def test_shapes_are_the_same_from_either_end(inflated):
    _, result = inflated
    _, first, second, both = (thickness(result, robot) for robot in range(4))
    assert both == pytest.approx(both[::-1], abs=1.5e-3)
    assert first == pytest.approx(second[::-1], abs=1.5e-3)


@pytest.mark.kernels
def test_single_precision_finds_the_same_shapes(inflated):
    designs, result = inflated
    single = simulate(designs, geometry=TINY, actuation=STEADY, record_every=50, precision="f32", threads=1)
    for robot in range(4):
        assert thickness(single, robot) == pytest.approx(thickness(result, robot), abs=1e-3)
        assert height(single, robot) == pytest.approx(height(result, robot), abs=1e-3)


@pytest.mark.kernels
def test_pictures_show_every_core(inflated):
    designs, result = inflated
    motion = inflatable_motion(result, designs[1], actuation=STEADY, robot=1)
    cores = [channel for channel in motion.channels if channel.name.startswith("core")]
    assert [(channel.name, *channel.values) for channel in cores] == [
        ("core pressure 1", 12.0, 12.0),
        ("core pressure 2", 0.0, 0.0),
    ]
    assert gait_timeline(designs[1], STEADY).pressures.tolist() == [[FULL, 0.0]] * 2
    starts, forces = motion.lattice.pressure_forces(0)
    pushed = np.linalg.norm(forces, axis=1) > 0
    assert pushed.any() and starts[pushed, 1].max() < starts[~pushed, 1].min()
    assert {node.channel for node in motion.nodes} == {None, *range(10)}


@pytest.mark.kernels
def test_the_exact_gradient_by_each_core_is_that_of_differences():
    """Over a few steps, where the motion is smooth."""
    brief = dataclasses.replace(QUICK, hold_steps=20, settle_steps=0, inflation_rate=0.2, ramp_steps=40)
    options = {"geometry": TINY, "actuation": brief, "threads": 1}
    at, width = np.array([4e3, 7e3]), 0.1  # wider ones reach a contact that comes or goes
    found = differentiate([graded(tuple(at))], **options)
    sides = [graded(tuple(at + sign * step)) for step in np.eye(2) * width for sign in (1, -1)]
    distance = simulate(sides, **options).distance
    differences = (distance[::2] - distance[1::2]) / (2 * width)
    assert found.pressure.shape == (1, 2) and found.pressure[0] == pytest.approx(differences, rel=1e-3)


# files, shapes


@pytest.mark.parametrize("design", [InflatableDesign((FULL, 0.0), 5.0, IDLE), graded((1e3, 2e3)), graded(1e3)])
def test_designs_survive_the_disk(tmp_path, design):
    save_design(design, tmp_path / "gait.json")
    assert load_design(tmp_path / "gait.json") == design
    written = json.loads((tmp_path / "gait.json").read_text())["pressure"]
    assert written == (list(design.pressure) if isinstance(design.pressure, tuple) else design.pressure)


def test_one_pressure_is_a_number_and_several_are_a_tuple():
    assert checked_pressure([9e3]) == 9e3 and isinstance(checked_pressure((9000,)), float)
    assert checked_pressure(np.array([1, 2])) == (1.0, 2.0) and checked_pressure(np.float64(3.0)) == 3.0
    assert [common_pressure(p) for p in (1.0, (2.0, 2.0), (2.0, 3.0))] == [1.0, 2.0, None]
    told = [kilopascals(p) for p in (12e3, (12e3, 0.0), (1e3, 2e3, 3e3))]
    assert told == ["12 kPa", "12 and 0 kPa", "1, 2 and 3 kPa"]


def test_cores_that_are_alike_are_played_by_a_rig():
    table = gait_table(dataclasses.replace(ROLLING, pressure=(9e3, 9e3)))
    assert np.array_equal(table.pressures, gait_table(dataclasses.replace(ROLLING, pressure=9e3)).pressures)


def test_shapes_count_in_binary_from_the_first_core():
    assert core_shapes(TWO_CORE, FULL) == SHAPES
    assert core_shapes(PUBLISHED, 5e3) == [(0.0,), (5e3,)]
    many = core_shapes(THREE, 1.0)
    assert [sum(int(p) << k for k, p in enumerate(shape)) for shape in many] == list(range(8))
