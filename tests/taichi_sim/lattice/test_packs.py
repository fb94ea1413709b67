"""Voxels in packs: every lane finds its neighbours, however the body looks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.drivers.packs import ALIGNED, GATHER, NEXT, NOTHING, lay_out
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.tables import build_tables

RUBBER = Material(1e5, 1e3)


def laid_out(voxels, width):
    body = LatticeBody(voxels, (RUBBER,), np.zeros(len(voxels), int), 0.01)
    tables = build_tables([body], 1e-4)
    return tables, lay_out(tables, body.voxels[body.topology.order], width)


def reached(kind, target, element, own, step):
    """Lane numbers that a kernel gets at, by the kind."""
    width = len(element)
    if kind == ALIGNED:
        return target * width + np.arange(width)
    if kind == NEXT:
        lanes = np.roll(own, -step)
        lanes[-1 if step > 0 else 0] = target
        return lanes
    return element if kind == GATHER else np.full(width, -1)


@given(st.integers(0, 2**32 - 1), st.sampled_from([4, 8, 16]), st.floats(0.3, 1.0))
def test_lanes_reach_their_neighbours_and_nothing_else(seed, width, filling):
    generator = np.random.default_rng(seed)
    voxels = np.argwhere(generator.random((7, 5, 4)) < filling)
    tables, packs = laid_out(voxels if len(voxels) else np.zeros((1, 3), int), width)
    assert sorted(packs.voxel[packs.voxel >= 0]) == list(range(len(tables.group)))
    assert sorted(packs.link[packs.link >= 0]) == list(range(len(tables.link_ends)))
    ends = packs.voxel_place[tables.link_ends]
    for q, (pack, _) in enumerate(packs.link_pack):
        there = packs.link[q] >= 0
        lanes = pack * width + np.arange(width)
        found = reached(packs.plus.kind[q], packs.plus.target[q], packs.plus.element[q], lanes, 1)
        assert (ends[packs.link[q, there], 0] == lanes[there]).all()
        assert (ends[packs.link[q, there], 1] == found[there]).all()
    own = {(pack, axis): q for q, (pack, axis) in enumerate(packs.link_pack.tolist())}
    for pack in range(len(packs.voxel)):
        for axis in range(3):
            row = 3 * pack + axis
            q = own.get((pack, axis), -1)
            lanes = q * width + np.arange(width) if q >= 0 else np.full(width, -1)
            found = reached(packs.minus.kind[row], packs.minus.target[row], packs.minus.element[row], lanes, -1)
            links = np.where(found >= 0, packs.link.ravel()[found], -1) if len(packs.link) else found
            for lane, voxel in enumerate(packs.voxel[pack]):
                before = tables.link_ends[:, 1] == voxel
                wanted = [x for x in np.flatnonzero(before) if axis_of(tables, x) == axis]
                assert [links[lane]] == wanted if wanted else links[lane] == -1


def axis_of(tables, link):
    return tables.link.reshape(-1, columns.LINK_COLUMNS)[link, columns.LINK_ALONG]


def test_a_block_needs_no_gathers_and_fills_its_packs():
    _, packs = laid_out(np.argwhere(np.ones((16, 4, 3))), 16)
    assert (packs.voxel >= 0).all() and len(packs.voxel) == 12
    assert set(packs.plus.kind) == {ALIGNED, NEXT} and GATHER not in packs.minus.kind


def test_a_body_full_of_holes_still_fills_its_packs_of_links():
    voxels = np.argwhere(np.random.default_rng(0).random((9, 9, 9)) < 0.7)
    tables, packs = laid_out(voxels, 16)
    assert (packs.voxel >= 0).mean() > 0.95
    assert len(tables.link_ends) > 0.9 * packs.link.size


@pytest.mark.parametrize("count", [1, 2, 17])
def test_a_single_row_is_a_run(count):
    _, packs = laid_out([(x, 0, 0) for x in range(count)], 8)
    assert len(packs.voxel) == -(-count // 8) and set(packs.plus.kind) <= {NEXT, NOTHING, ALIGNED}
