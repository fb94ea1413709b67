"""Bodies: what follows from their voxels, and one clear line for every mistake."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.materials import STIFF, TWIST, beam_constants

RUBBER = Material(4e5, 3000)


def block(*size: int, **options) -> LatticeBody:
    voxels = np.argwhere(np.ones(size))
    given = {"voxels": voxels, "materials": (RUBBER,), "material_index": np.zeros(len(voxels)), "voxel_size": 0.01}
    return LatticeBody(**given | options)


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4))
def test_a_block_has_the_links_and_faces_of_a_block(x, y, z):
    topology = block(x, y, z).topology
    assert len(topology.links) == (x - 1) * y * z + x * (y - 1) * z + x * y * (z - 1)
    assert len(topology.faces) == 2 * (x * y + y * z + z * x)
    assert (topology.links[:, 0] < topology.links[:, 1]).all()


@given(st.permutations(range(12)))
def test_links_do_not_depend_on_the_order_of_voxels(order):
    body = block(3, 2, 2)
    shuffled = block(3, 2, 2, voxels=body.voxels[list(order)])
    links = {tuple(map(tuple, body.voxels[pair].tolist())) for pair in body.topology.links}
    assert links == {tuple(map(tuple, shuffled.voxels[pair].tolist())) for pair in shuffled.topology.links}


def test_cut_links_are_gone():
    assert len(block(3, 1, 1, cut_links=[(1, 2)]).topology.links) == 1


def test_voxels_within_five_links_never_collide():
    """In a bar all are surface; the exclusion ends exactly after five links."""
    excluded = block(9, 1, 1).topology.excluded
    distance = np.abs(np.subtract.outer(np.arange(9), np.arange(9)))
    assert np.array_equal(excluded, distance <= 5)


def test_recommended_time_step():
    """1 / (2 pi sqrt(E h / m))."""
    assert block(2, 1, 1).recommended_time_step == pytest.approx(1 / (2 * np.pi * np.sqrt(4e5 * 0.01 / 0.003)))


def test_beam_constants_of_two_materials():
    """Springs in series; torsion of a square beam shares the bending constant E h^4 / 12 / h."""
    row = beam_constants(Material(1e5, 1000), Material(3e5, 1000), 0.01, 1e-4)
    assert row[STIFF] == pytest.approx(1.5e5 * 0.01)
    assert row[TWIST] == pytest.approx(1.5e5 * 0.01**3 / 12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"voxels": np.zeros((0, 3)), "material_index": []}, "voxels: the body is empty"),
        ({"voxels": [(0, 0, 0), (0, 0, 0)], "material_index": [0, 0]}, r"voxels: 2 voxels at \(0, 0, 0\)"),
        ({"voxels": [(0, 0, 0.5), (0, 0, 1)], "material_index": [0, 0]}, "voxels: only whole numbers"),
        ({"voxels": [(0, 0, np.nan), (0, 0, 1)], "material_index": [0, 0]}, "voxels: only whole numbers"),
        ({"voxel_size": -0.01}, "voxel_size: -0.01 is not allowed"),
        ({"voxel_size": np.nan}, "voxel_size: nan is not allowed"),
        ({"material_index": [0, 1]}, r"material_index: must lie in 0..0"),
        ({"cut_links": [(0, 1), (0, 5)]}, r"cut_links: \(0, 5\) are not neighbouring voxels"),
        ({"cut_links": [(0, 0)]}, r"cut_links: \(0, 0\) are not neighbouring voxels"),
        ({"regions": [0, -1]}, "regions: label -1 is not allowed; give 0 to 99999"),
        ({"chambers": [0, 100_000]}, "chambers: label 100000 is not allowed; give 0 to 99999"),
        ({"fixed": [True, False]}, r"fixed: shape \(2,\) is not allowed"),
        ({"pressure_normals": [(0, 0, 2), (0, 0, 0)]}, "pressure_normals: entries must be"),
    ],
)
def test_bad_bodies_are_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=message) as caught:
        block(2, 1, 1, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"youngs_modulus": 0}, "youngs_modulus: 0 is not allowed"),
        ({"density": -1}, "density: -1 is not allowed"),
        ({"density": np.nan}, "density: nan is not allowed; give a positive finite number"),
        ({"youngs_modulus": True}, "youngs_modulus: True is not allowed; give a positive finite number"),
        ({"youngs_modulus": "1e6"}, "youngs_modulus: '1e6' is not allowed; give a positive finite number"),
        ({"density": None}, "density: None is not allowed"),
        ({"kinetic_friction": False}, "kinetic_friction: False is not allowed; give a finite number, at least 0"),
        ({"temperature": "warm"}, "temperature: 'warm' is not allowed; give a finite number"),
        ({"scale": "111"}, "scale: '111' is not allowed; give numbers of shape (3,)"),
        ({"scale": None}, "scale: shape () is not allowed; give (3,)"),
        ({"scale": (1, 1, True)}, "scale: (1, 1, True) is not allowed"),
        ({"poissons_ratio": 0.5}, "poissons_ratio: 0.5 is not allowed"),
        ({"static_friction": -0.1}, "static_friction: -0.1 is not allowed"),
        ({"scale": (1, 1, 0)}, "scale: "),
        ({"thermal_expansion": 0.1, "temperature": -20}, "temperature: -20"),
    ],
)
def test_bad_materials_are_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        Material(**{"youngs_modulus": 1e5, "density": 1e3} | options)
