"""Pressure on closed surfaces: it neither pushes nor turns a free body, and its work is P dV."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pouches import EDGE, RUBBER, TIME_STEP, lopsided, shell, two_boxes

from robots.inflatable import PUBLISHED, SMALL, InflatableGeometry
from taichi_sim.autodiff.arrays import trace
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, ProgramBuilder, Quantity
from taichi_sim.lattice.laws.enclosure import (
    chamber_surfaces,
    chambers_under_pressure,
    closed_surface,
    enclosed_volume,
    pressed_square,
)

PRESSURE = 3e3
TINY = InflatableGeometry(bladder_columns=1, rows=6, foot_rows=1)


BODIES = {"box": shell(), "slab": shell((3, 5, 3)), "pouch": lopsided(), "robot": TINY.body, "solid": shell((2, 2, 2))}


def forces(body, positions, pressures) -> np.ndarray:
    """On every voxel, shape (V, 3)."""
    squares = closed_surface(body)
    corners = pressed_square(*positions[squares].reshape(-1, 12).T, *pressures[squares].T)
    total = np.zeros_like(positions)
    np.add.at(total, squares, np.array(corners).T.reshape(-1, 4, 3))
    return total


# which way pressure pushes


@pytest.mark.kernels
@pytest.mark.parametrize(("fluid", "sides"), [(False, 4), (True, 3)], ids=["faces", "surface"])
def test_normals_away_from_the_cavity_inflate_a_closed_box(fluid, sides):
    """Its walls carry P A over their section; A is that of outer faces, or of the surface through the centres."""
    body, pressure, damped = shell((16, 4, 4)), 1e3, ProgramBuilder(1)
    engine = LatticeEngine(body, time_step=TIME_STEP, gravity=0.0, floor=False, fluid=fluid, self_contact=False)
    damped.set(Quantity.PRESSURE, pressure, regions=[0])
    damped.set(Quantity.GLOBAL_DAMPING, 0.05, regions=[0])
    engine.run(damped.build(5000))
    along, x = body.voxels[:, 0], engine.state().positions[0, :, 0]
    stretched = (x[along == 11].mean() - x[along == 4].mean()) / (7 * EDGE)
    assert stretched - 1 == pytest.approx(pressure * sides**2 / (RUBBER.youngs_modulus * 12), rel=0.02)


# the surface


@pytest.mark.parametrize("geometry", [PUBLISHED, SMALL], ids=["published", "small"])
def test_the_inflatable_robots_skins_close_around_its_core(geometry):
    """Both skins, the two long edges that join them, and the two mouths at its ends: a sphere, by Euler."""
    body, squares = geometry.body, closed_surface(geometry.body)
    across, along = geometry.columns - 1, geometry.rows - 1
    assert len(squares) == 2 * across * along + 2 * along + 2 * across
    edges = {tuple(sorted(e)) for s in squares.tolist() for e in zip(s, s[1:] + s[:1], strict=True)}
    assert len(np.unique(squares)) - len(edges) + len(squares) == 2
    assert enclosed_volume(squares, body.start_positions) == pytest.approx(across * along * geometry.voxel_size**3)


def test_each_part_of_a_body_has_a_surface_of_its_own():
    body, count = two_boxes(), shell((3, 3, 3)).voxel_count
    squares = closed_surface(body)
    inside = enclosed_volume(squares[squares[:, 0] < count], body.start_positions)
    assert inside == pytest.approx((2 * EDGE) ** 3)
    assert enclosed_volume(squares, body.start_positions) == pytest.approx(0.0, abs=1e-12)  # the other is inside out


def test_no_pressurised_voxels_are_no_surface():
    body = shell(pressure_normals=None)
    assert (
        closed_surface(body).shape == (0, 4) and not chamber_surfaces(body) and not len(chambers_under_pressure(body))
    )


def test_each_chamber_has_a_surface_of_its_own():
    """In the order of their labels, whatever that of their voxels; together they are the surface of the body."""
    count = shell((3, 3, 3)).voxel_count
    chambers = np.repeat([7, 0, 4], [count, 2, count])  # the bridge is under no pressure, so in none
    body = two_boxes(chambers=chambers)
    surfaces = chamber_surfaces(body)
    assert chambers_under_pressure(body).tolist() == [4, 7]
    assert [set(chambers[squares].ravel().tolist()) for squares in surfaces] == [{4}, {7}]
    volumes = [enclosed_volume(squares, body.start_positions) for squares in surfaces]
    assert volumes == pytest.approx([-((2 * EDGE) ** 3), (2 * EDGE) ** 3])
    assert np.array_equal(closed_surface(body), np.concatenate(surfaces))


def test_the_volume_of_a_turned_and_stretched_box_is_that_of_a_box():
    """Of a robot alone as of one in a batch, to the bit."""
    body, rng = shell((4, 3, 5)), np.random.default_rng(0)
    squares, built = closed_surface(body), 3 * 2 * 4 * EDGE**3
    changes = np.eye(3) + rng.normal(0, 0.3, (20, 3, 3))
    places = body.start_positions @ changes + rng.normal(0, 0.2, (20, 1, 3))
    found = enclosed_volume(squares, places)
    assert found == pytest.approx(built * np.linalg.det(changes), rel=1e-12)
    assert found.tolist() == [enclosed_volume(squares, each) for each in places]


def test_the_derivative_of_a_volume_is_the_force_of_one_pascal():
    body, rng = lopsided(), np.random.default_rng(0)
    squares = closed_surface(body)
    positions = body.start_positions + rng.normal(0, 0.4 * EDGE, (2, *body.voxels.shape))
    _, pull_back = trace(lambda places: enclosed_volume(squares, places), positions)
    expected = [forces(body, each, np.ones(body.voxel_count)) for each in positions]
    assert pull_back(np.ones(2))[0] == pytest.approx(np.array(expected), rel=1e-9, abs=1e-18)


@pytest.mark.kernels
@pytest.mark.parametrize("case", ["sheet", "hole", "thick", "two ways", "loose"])
def test_a_skin_that_does_not_close_is_refused_in_one_line(case):
    sheet = np.argwhere(np.ones((4, 4, 1)))
    body = LatticeBody(sheet, (RUBBER,), np.zeros(16, int), EDGE, pressure_normals=np.tile([0, 0, 1], (16, 1)))
    if case == "hole":
        normals = shell().pressure_normals.copy()
        normals[(shell().voxels == [3, 1, 1]).all(axis=1)] = 0
        body = shell(pressure_normals=normals)
    elif case == "thick":
        body = shell((2, 2, 3))
        body = LatticeBody(body.voxels, (RUBBER,), np.zeros(12, int), EDGE, pressure_normals=np.ones((12, 3), int))
    elif case == "two ways":
        box = shell()
        body = shell(pressure_normals=np.where(box.voxels[:, :1] > 1, -1, 1) * box.pressure_normals)
    elif case == "loose":
        box = shell()
        voxels = np.concatenate([box.voxels, [[4, 1, 1]]])
        body = LatticeBody(
            voxels,
            (RUBBER,),
            np.zeros(len(voxels), int),
            EDGE,
            pressure_normals=np.concatenate([box.pressure_normals, [[1, 0, 0]]]),
        )
    message = r"^pressure_normals: voxel \(\d, \d, \d\) is [^\n]*; in a fluid, give [^\n]*$"
    with pytest.raises(ValueError, match=message):
        LatticeEngine(body, 1, fluid=True)
    assert LatticeEngine(body, 1).tables.squares == 0  # without a fluid, faces bear pressure each for itself


# the forces


@settings(max_examples=30)
@given(st.sampled_from(sorted(BODIES)), st.integers(0, 2**32 - 1))
def test_forces_and_torques_add_up_to_nothing_and_do_the_work_of_a_volume(name, seed):
    body, rng = BODIES[name], np.random.default_rng(seed)
    squares = closed_surface(body)
    positions = body.start_positions + rng.normal(0, 0.4 * EDGE, body.voxels.shape)
    force = forces(body, positions, np.full(body.voxel_count, PRESSURE))
    scale = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() <= 1e-13 * scale
    assert np.abs(np.cross(positions, force).sum(axis=0)).max() <= 1e-13 * scale * np.abs(positions).max()
    move = rng.normal(size=positions.shape)
    step = 1e-5
    gain = enclosed_volume(squares, positions + step * move) - enclosed_volume(squares, positions - step * move)
    assert (force * move).sum() == pytest.approx(PRESSURE * gain / (2 * step), rel=1e-6, abs=1e-6 * scale)


def test_a_square_feels_the_mean_of_its_corners_pressures():
    body = shell()
    pressures = np.random.default_rng(0).uniform(0, 2 * PRESSURE, body.voxel_count)
    squares, force = closed_surface(body), forces(body, body.start_positions, pressures)
    corners = body.start_positions[squares]
    areas = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    expected = (pressures[squares].mean(axis=1)[:, None] * areas).sum(axis=0)
    assert force.sum(axis=0) == pytest.approx(expected, rel=1e-12)


# motion


def inflated(body, steps, pressure=PRESSURE, start=None, **options) -> LatticeState:
    """The state after the pressure has risen for half the steps; in a fluid without resistance by default."""
    lab = LatticeEngine(body, 1, time_step=TIME_STEP, **{"fluid": True} | options)
    if start is not None:
        lab.set_state(start)
    builder = ProgramBuilder(1)
    regions = np.arange(body.region_count)
    builder.set(Quantity.PRESSURE, 0.0, rate=pressure / (steps // 2), regions=regions)
    builder.set(Quantity.PRESSURE, pressure, regions=regions, step=steps // 2)
    assert lab.run(builder.build(steps)).status.tolist() == ["ok"]
    return lab.state()


@pytest.mark.kernels
def test_a_cube_at_pressure_swells_alike_on_all_sides():
    """To the accuracy to which links, whose frame is that of one end, are alike both ways."""
    body = shell((5, 5, 5))
    shape = body.voxels - 2
    grown = inflated(body, 1500, 8e3).positions[0] - 2 * EDGE - EDGE * shape
    faces = (np.abs(shape) == 2).sum(axis=1) == 1
    assert (grown * shape).sum(axis=1)[faces].min() > 0.05 * EDGE
    by_place = {tuple(v): g for v, g in zip(shape.tolist(), grown, strict=True)}
    for (x, y, z), growth in by_place.items():
        assert by_place[-x, y, z] == pytest.approx(growth * [-1, 1, 1], abs=0.03 * np.abs(grown).max())
        assert by_place[y, z, x] == pytest.approx(growth[[1, 2, 0]], abs=0.03 * np.abs(grown).max())


@pytest.mark.kernels
def test_pressure_does_not_move_a_free_body_without_symmetry():
    """Its centre stays where it is, as with pressure on the faces of each voxel it would not."""
    body = lopsided()
    state = inflated(body, 3000, 8e3)
    assert np.abs(state.positions[0] - body.start_positions).max() > 0.2 * EDGE
    assert np.abs((state.positions[0] - body.start_positions).mean(axis=0)).max() <= 1e-12 * EDGE
    assert np.abs(state.velocities[0].mean(axis=0)).max() <= 1e-14
    pushed = inflated(body, 3000, 8e3, fluid=False)
    assert np.abs((pushed.positions[0] - body.start_positions).mean(axis=0)).max() > 0.01 * EDGE


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_every_driver_gives_the_same_bits(precision):
    body = lopsided()
    rng = np.random.default_rng(0)
    count = body.voxel_count
    moving = LatticeState(
        body.start_positions[None] + rng.normal(0, 2e-4, (1, count, 3)),
        np.tile([1.0, 0, 0, 0], (1, count, 1)),
        rng.normal(0, 0.1, (1, count, 3)),
        np.zeros((1, count, 3)),
    )
    runs = [inflated(body, 300, 8e3, moving, precision=precision, driver=driver) for driver in ("packed", "stepped")]
    for state in runs[1:]:
        assert np.array_equal(state.positions, runs[0].positions)
        assert np.array_equal(state.velocities, runs[0].velocities)
