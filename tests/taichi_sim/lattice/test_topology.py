"""Links and contact exclusions of bodies with holes, beside those found voxel by voxel."""

import numpy as np
import pytest

from taichi_sim.lattice.topology import CONTACT_EXCLUSION_LINKS, build_topology


def links_of(voxels, cut):
    """Ends and axis of the links of voxels, by x, y and z of the first end, then by axis."""
    index = {tuple(place): number for number, place in enumerate(voxels.tolist())}
    parted, found = {frozenset(pair) for pair in cut.tolist()}, []
    for place in sorted(index):
        for axis in range(3):
            beyond = index.get(tuple(np.add(place, np.eye(3, dtype=int)[axis]).tolist()))
            if beyond is not None and frozenset((index[place], beyond)) not in parted:
                found.append((index[place], beyond, axis))
    return np.array(found).reshape(-1, 3)


def distances(count, links, start):
    """Links from one voxel to each, by breadth-first search; infinite without a way."""
    found, front = {start: 0}, [start]
    while front:
        voxel = front.pop(0)
        for a, b in [*links.tolist(), *links[:, ::-1].tolist()]:
            if a == voxel and b not in found:
                found[b] = found[voxel] + 1
                front.append(b)
    return [found.get(voxel, np.inf) for voxel in range(count)]


@pytest.mark.parametrize("seed", range(4))
def test_links_and_exclusions_are_those_found_voxel_by_voxel(seed):
    """With holes, several parts, a random order and cut links, named from either end."""
    generator = np.random.default_rng(seed)
    voxels = generator.permutation(np.argwhere(generator.random((6, 3, 2)) < 0.7)) - [2, 0, 1]
    whole = links_of(voxels, np.zeros((0, 2), int))
    cut = generator.permutation(whole)[:3, :2]
    cut[0] = cut[0, ::-1]
    links, found = links_of(voxels, cut), build_topology(voxels, cut)
    assert np.array_equal(np.column_stack([found.links, found.link_axes]), links) and len(links) == len(whole) - 3
    near = [[distances(len(voxels), links[:, :2], a)[b] for b in found.surface] for a in found.surface]
    assert np.array_equal(found.excluded, np.array(near) <= CONTACT_EXCLUSION_LINKS)
