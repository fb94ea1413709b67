"""Strains, contacts and pressure of recorded lattices."""

import motions
import numpy as np
import pytest

from robots.inflatable import InflatableActuation, InflatableDesign, simulate
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.view.motion import inflatable_motion
from robots.view.lattice_states import LatticeStates
from taichi_sim.lattice import LatticeBody, Material

EDGE = 0.01


def bar(voxels, moduli=(1e5, 1e5), **more) -> LatticeBody:
    materials = tuple(Material(modulus, 1000.0) for modulus in moduli)
    return LatticeBody(np.array(voxels), materials, np.arange(len(voxels)) % 2, EDGE, **more)


def states(body, positions=None, sizes=EDGE, extents=None, turn=(1.0, 0, 0, 0), pressure=0.0) -> LatticeStates:
    places = body.start_positions[None] if positions is None else np.asarray(positions, float)[None]
    rest = np.broadcast_to(sizes, (*places.shape[:2], 3)).astype(float)
    reach = np.repeat(rest, 2, axis=-1) / 2 if extents is None else np.asarray(extents, float)[None]
    return LatticeStates(body, places, np.broadcast_to(turn, (*places.shape[:2], 4)), reach, rest, pressure)


@pytest.mark.kernels
def test_strains_are_those_of_the_distances_between_voxels():
    """Against |d| / L0 - 1 of the beam model; the engine takes d.x of nearly straight links, a step before."""
    slow = InflatableActuation(inflation_rate=2e-3, pressure_ramp=10.0, hold_steps=800, settle_steps=30)
    design = InflatableDesign(6e3, 0.0, GaitSchedule(np.eye(10)[:, [0]], repeats=1))
    result = simulate(design, geometry=motions.TINY, actuation=slow, precision="f32", record_every=200, threads=1)
    lattice = inflatable_motion(result, design, actuation=slow).lattice
    minus, plus = lattice.body.topology.links.T
    axis = lattice.body.topology.link_axes
    rest = (lattice.sizes[:, minus, axis] + lattice.sizes[:, plus, axis]) / 2
    stretched = np.linalg.norm(lattice.positions[:, plus] - lattice.positions[:, minus], axis=-1) / rest - 1
    strains = lattice.strains()
    assert np.abs(strains).max() > 0.1
    assert np.abs(strains - stretched).max() < 5e-3 and np.median(np.abs(strains - stretched)) < 1e-3


def test_a_stiff_end_takes_the_smaller_share_of_a_strain():
    body = bar([(0, 0, 0), (1, 0, 0)], (1e5, 3e5))
    extents = np.full((2, 6), EDGE / 2)
    strain = 0.04
    extents[0, 1] *= 1 + strain * 1.5  # 2 E2 / (E1 + E2)
    extents[1, 0] *= 1 + strain * 0.5
    assert states(body, extents=extents).strains() == pytest.approx(np.array([[strain]]))


def test_voxels_have_the_mean_strain_of_their_links():
    body = bar([(0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 0, 0)])
    extents = np.full((4, 6), EDGE / 2)
    extents[0, 1], extents[1, 1] = EDGE / 2 * 1.1, EDGE / 2 * 0.7
    assert states(body, extents=extents).voxel_strains()[0] == pytest.approx([0.1, -0.1, -0.3, 0.0])


def test_voxels_on_the_floor_are_those_that_it_pushes():
    body = bar([(0, 0, 0), (3, 0, 0), (6, 0, 0)])
    places = [[0, 0, 0], [0.03, 0, 1e-6], [0.06, 0, 1e-6]]
    sizes = np.full((1, 3, 3), EDGE)
    sizes[0, 2] = 1.5 * EDGE, EDGE, EDGE
    assert states(body, places, sizes).on_floor().tolist() == [[True, False, True]]


def test_voxels_touch_others_that_they_are_not_joined_to():
    body = bar([(0, 0, 0), (1, 0, 0), (4, 0, 0), (7, 0, 0)])
    reach = 1.25 * EDGE
    places = np.array([[0, 0, 0], [EDGE, 0, 0], [EDGE + 0.99 * reach, 0, 0], [EDGE + 2.01 * reach, 0, 0]])
    assert states(body, places).on_itself().tolist() == [[False, True, True, False]]


@pytest.mark.kernels
def test_joined_voxels_never_touch():
    lattice = motions.soft_walker().lattice
    assert not lattice.on_itself().any() and lattice.on_floor().any(axis=1).all()


@pytest.mark.parametrize("side", [-1, 1])
def test_pressure_pushes_along_the_normals_of_turned_faces(side):
    body = bar([(0, 0, 0)], pressure_normals=np.array([[0, 0, side]]))
    quarter = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])  # about x: z becomes -y
    places, forces = states(body, sizes=(0.02, 0.01, 0.01), turn=quarter, pressure=5e3).pressure_forces(0)
    assert forces == pytest.approx(np.array([[0, -side * 5e3 * 0.02 * 0.01, 0]]))
    assert places == pytest.approx(np.array([[0, -side * 0.005, 0]]))


@pytest.mark.kernels
def test_pressure_acts_on_every_voxel_of_the_skin_and_nearly_cancels_out():
    lattice = motions.inflatable().lattice
    places, forces = lattice.pressure_forces(0)
    skin = 2 * motions.TINY.columns * motions.TINY.rows
    assert places.shape == forces.shape == (skin, 3)
    sizes = np.linalg.norm(forces, axis=1)
    assert sizes == pytest.approx(6e3 * motions.TINY.voxel_size**2, rel=0.3)
    assert np.linalg.norm(forces.sum(axis=0)) < 0.01 * sizes.sum()  # not 0, as each voxel's faces turn by themselves
    outward = ((places - places.mean(axis=0)) * forces).sum(axis=1)
    assert (outward > 0).mean() > 0.9


@pytest.mark.kernels
def test_a_part_has_its_own_frames():
    lattice = motions.inflatable().lattice
    part = lattice.part([3, 7])
    assert np.array_equal(part.strains(), lattice.strains()[[3, 7]])
    assert np.array_equal(motions.inflatable().every(4).lattice.positions[1], lattice.positions[4])
