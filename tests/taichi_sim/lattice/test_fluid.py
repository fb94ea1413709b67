"""Drag of a fluid on voxels: its law, bodies that sink and coast against closed forms, wet and dry faces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.laws.fluid import drag, outer_faces

EDGE, DENSITY, GRAVITY = 0.01, 3000.0, 9.80665
MASS = DENSITY * EDGE**3
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
PRESSURE, FRICTION = 600.0, 10.0  # half the density of water times coefficients of 1.2 and 0.02


def body(voxels):
    return LatticeBody(
        voxels=voxels, materials=(Material(4e5, DENSITY),), material_index=[0] * len(voxels), voxel_size=EDGE
    )


def in_water(shape, steps, gravity=0.0, velocity=None, resistance=(PRESSURE, FRICTION), **options):
    """Poses at the end and velocities of a body that starts upright, shape (V, 3) each, and the time."""
    lab = LatticeEngine(shape, 1, fluid=True, gravity=gravity, time_step=1e-4, **options)
    if velocity is not None:
        count = shape.voxel_count
        lab.set_state(
            LatticeState(
                shape.start_positions[None],
                np.tile(UPRIGHT, (1, count, 1)),
                np.tile(velocity, (1, count, 1)),
                np.zeros((1, count, 3)),
            )
        )
    builder = ProgramBuilder(1)
    for part, value in enumerate(resistance):
        builder.set(Quantity.RESISTANCE + part, value, regions=np.arange(shape.region_count))
    result = lab.run(builder.build([steps], [[steps]]))
    assert result.status.tolist() == ["ok"]
    return result.positions[0, 0], lab.state().velocities[0]


# the law


@given(st.tuples(*[st.floats(-1, 1)] * 4), st.tuples(*[st.floats(-1, 1)] * 3), st.tuples(*[st.integers(0, 2)] * 3))
def test_drag_never_drives(rotation, momentum, faces):
    rotation = np.array(rotation) + 1e-3
    rotation /= np.linalg.norm(rotation)
    force = np.array(drag(*rotation, *momentum, 1 / MASS, 0.01, 0.012, 0.008, PRESSURE, FRICTION, *map(float, faces)))
    assert force @ np.array(momentum) <= 1e-9
    assert any(faces) or not force.any()


@pytest.mark.parametrize("turns", [0.0, 0.3, 1.0])
def test_a_cube_feels_one_half_rho_c_a_u_squared_along_its_axis(turns):
    """Pressure drag of front and back, friction of the four other sides."""
    speed, half = 0.5, turns * np.pi / 4
    rotation = (np.cos(half), 0.0, 0.0, np.sin(half))
    along = np.array([np.cos(2 * half), np.sin(2 * half), 0.0])
    force = drag(*rotation, *(MASS * speed * along), 1 / MASS, EDGE, EDGE, EDGE, PRESSURE, FRICTION, 2.0, 2.0, 2.0)
    assert np.allclose(force, -(PRESSURE + 4 * FRICTION) * EDGE**2 * speed**2 * along, rtol=1e-12, atol=1e-15)


# faces


def test_a_fluid_reaches_the_outside_only():
    shell = np.array([v for v in np.ndindex(3, 3, 3) if v != (1, 1, 1)])
    faces = outer_faces(shell)
    assert faces.sum() == 6 * 9 and faces.max() == 1
    assert outer_faces(np.array([[0, 0, 0]])).tolist() == [[2, 2, 2]]
    opened = shell[~(shell == [1, 1, 2]).all(axis=1)]
    assert outer_faces(opened).sum() == 6 * 9 - 1 + 4 + 5  # a hole lets it in: its rim and the cavity's other walls


def test_a_body_too_spread_out_for_a_fluid_is_refused_in_one_line():
    with pytest.raises(ValueError, match=r"^voxels: a box of 1003 x 1003 x 1003 cells is too large for a [^\n]*$"):
        outer_faces(np.array([[0, 0, 0], [1000, 1000, 1000]]))


# motion


@pytest.mark.kernels
def test_a_sinking_block_reaches_the_terminal_velocity_of_the_drag_law():
    """u = u_t tanh(g t / u_t), u_t^2 = m g / (half rho C A): pressure drag of two sides, friction of four."""
    shape, steps = body(np.argwhere(np.ones((2, 2, 2)))), 8000
    resistance = PRESSURE * 4 * EDGE**2 + FRICTION * 16 * EDGE**2
    terminal = np.sqrt(8 * MASS * GRAVITY / resistance)
    _, velocities = in_water(shape, steps, gravity=GRAVITY)
    expected = terminal * np.tanh(GRAVITY * steps * 1e-4 / terminal)
    assert expected > 0.99 * terminal
    assert velocities.mean(axis=0) == pytest.approx([0, 0, -expected], rel=2e-3, abs=1e-9)


@pytest.mark.kernels
def test_a_coasting_voxel_slows_down_as_one_over_time():
    """1/u = 1/u0 + k t, x = ln(1 + k u0 t) / k."""
    start, steps, k = 0.8, 3000, (PRESSURE + 4 * FRICTION) * EDGE**2 / MASS
    places, velocities = in_water(body([[0, 0, 0]]), steps, velocity=[start, 0, 0])
    assert velocities[0] == pytest.approx([1 / (1 / start + k * steps * 1e-4), 0, 0], rel=2e-3)
    assert places[0] == pytest.approx([np.log(1 + k * start * steps * 1e-4) / k, 0, 0], rel=2e-3)


@pytest.mark.kernels
def test_a_plate_is_slowed_less_edge_on():
    plate = body(np.argwhere(np.ones((1, 6, 6))))
    _, broad = in_water(plate, 1000, velocity=[0.5, 0, 0])
    _, edge_on = in_water(plate, 1000, velocity=[0, 0.5, 0])
    assert broad[:, 0].mean() < 0.6 * edge_on[:, 1].mean()


@pytest.mark.kernels
def test_no_resistance_is_no_fluid():
    shape = body(np.argwhere(np.ones((2, 1, 1))))
    _, velocities = in_water(shape, 500, velocity=[0.3, -0.2, 0.1], resistance=(0.0, 0.0))
    assert np.allclose(velocities, [0.3, -0.2, 0.1], rtol=1e-12)


@pytest.mark.kernels
def test_every_driver_gives_the_same_bits():
    shape = body(np.argwhere(np.ones((3, 2, 2))))
    runs = [
        in_water(shape, 400, gravity=GRAVITY, velocity=[0.3, 0.1, 0.2], driver=driver)
        for driver in ("packed", "stepped")
    ]
    for places, velocities in runs[1:]:
        assert np.array_equal(places, runs[0][0]) and np.array_equal(velocities, runs[0][1])
