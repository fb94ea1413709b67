"""The forward stage of a link does what is taken backwards as one function, in every branch."""

import numpy as np
import pytest

from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeState, Material, ProgramBuilder
from taichi_sim.lattice.laws import link as laws
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.link import BENDING, whole_link

EDGE, TURNS = 0.01, {"small angles": 0.005, "both regimes": 0.05, "large angles": 0.6}


def shaken(turn: float, fluid: bool, poissons_ratio: float) -> LatticeEngine:
    """A cube of two materials, its voxels moved and turned at random, after a step; so links remember something."""
    voxels = np.argwhere(np.ones((3, 3, 3)))
    tissues = Material(4e5, 3e3, poissons_ratio), Material(2e5, 2e3, internal_damping=0.2)
    body = LatticeBody(voxels, tissues, (voxels[:, 0] > 1).astype(int), EDGE)
    lab = LatticeEngine(body, 1, fluid=fluid, driver="stepped", precision="f64", self_contact=False, floor=False)
    rng, shape = np.random.default_rng(0), (1, len(voxels), 3)
    turns = np.concatenate([np.ones((*shape[:2], 1)), rng.normal(0, turn, shape)], axis=2)
    turns /= np.linalg.norm(turns, axis=2, keepdims=True)
    places = body.start_positions + rng.normal(0, 0.5 * turn * EDGE, shape)
    lab.set_state(LatticeState(places, turns, rng.normal(0, 0.1, shape), rng.normal(0, 10.0, shape)))
    lab.run(ProgramBuilder(1).build(1))
    return lab


@pytest.mark.kernels
@pytest.mark.parametrize("poissons_ratio", [0.0, 0.3])
@pytest.mark.parametrize("fluid", [False, True])
@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_both_ways_have_one_law(turn, fluid, poissons_ratio):
    lab = shaken(turn, fluid, poissons_ratio)
    sections = memory.VOXEL, memory.LINK, memory.REST, memory.BEAM, memory.STRAIN
    voxels, links, rests, beams, strains = (lab._driver.read(section)[0] for section in sections)
    lab.run(ProgramBuilder(1).build(1))
    forces, after = (lab._driver.read(section)[0] for section in (memory.FORCE, memory.LINK))
    tables, regimes = lab.tables, set()
    voxel_rows = tables.voxel.reshape(-1, columns.VOXEL_COLUMNS)
    for number, row in enumerate(tables.link.reshape(-1, columns.LINK_COLUMNS)):
        axes = row[[columns.LINK_ALONG, columns.LINK_SIDE_1, columns.LINK_SIDE_2]]
        ends = row[[columns.LINK_FIRST, columns.LINK_SECOND]]
        pose = [voxels[end, [*axes, 3, *(4 + axes)]] for end in ends]
        rest = rests[row[columns.LINK_REST] // memory.REST_WIDTH]
        beam = beams[row[columns.LINK_BEAM] // beams.shape[1]]
        section = 0.0, 1.0
        if poissons_ratio:
            gauges = voxel_rows[ends, columns.GAUGE] // memory.STRAIN_WIDTH
            section = laws.cross_section(*strains[gauges][:, 3 + axes[1:]].ravel())
        past, before = links[number, :6], links[number, 6]
        straight = before == laws.SMALL and laws.stays_small(*laws.relative_pose(*pose[0], *pose[1])[:3], rest[0])
        numbers = *pose[0], *pose[1], *past, *rest, *beam[:2], *beam[list(BENDING)], *section
        expected = np.array(whole_link(*numbers, EDGE, before, fluid, not straight))
        found = forces[number].reshape(4, 3)[:, axes].ravel()
        for got, wanted in zip(np.split(found, 4), np.split(expected[:12], 4), strict=True):
            assert got == pytest.approx(wanted, rel=1e-11, abs=1e-12 * np.abs(expected[:12]).max())
        assert after[number, :6] == pytest.approx(expected[12:], rel=1e-11, abs=1e-14)
        regimes.add(bool(straight))
    assert regimes == {TURNS["small angles"]: {True}, TURNS["large angles"]: {False}}.get(turn, {True, False})
