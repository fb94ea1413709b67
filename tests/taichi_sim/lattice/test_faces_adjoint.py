"""Derivatives of a body's surface by what its voxels do, against differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.inflatable import InflatableGeometry
from taichi_sim.autodiff.arrays import trace
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners

BODY = InflatableGeometry(bladder_columns=1, rows=7, foot_rows=2, voxel_size=0.02).body
BATCH = (2, 3)


def surroundings(seed: int) -> tuple[np.random.Generator, list[np.ndarray], list[np.ndarray]]:
    """A generator, the arguments (positions, orientations, strains, sizes) of a surface, and a direction for each."""
    generator = np.random.default_rng(seed)
    n = BODY.voxel_count
    shapes = [(n, 3), (n, 4), (len(BODY.topology.links),), (n, 3)]
    arguments = [generator.normal(size=(*BATCH, *shape)) for shape in shapes]
    arguments[1] /= np.linalg.norm(arguments[1], axis=-1, keepdims=True)
    arguments[3] = 0.01 + 0.02 * np.abs(arguments[3])
    return generator, arguments, [generator.normal(size=a.shape) for a in arguments]


def middle(positions, orientations, strains, sizes) -> np.ndarray:
    return mean_of_face_corners(BODY, positions, orientations, half_extents(BODY, strains, sizes))


@pytest.mark.long
@given(st.integers(0, 1000))
def test_the_pull_back_of_the_middle_agrees_with_differences_in_every_argument(seed):
    """Free directions: turned quaternions leave the unit sphere, and the strains of links differ in their moduli."""
    generator, arguments, directions = surroundings(seed)
    cotangents = generator.normal(size=(*BATCH, 3))
    found, pull_back = trace(middle, *arguments)
    assert np.array_equal(found, middle(*arguments))
    gradients = pull_back(cotangents)
    h = 1e-5
    for i, (gradient, direction) in enumerate(zip(gradients, directions, strict=True)):
        assert gradient.shape == arguments[i].shape
        sides = []
        for sign in (1, -1):
            moved = [*arguments[:i], arguments[i] + sign * h * direction, *arguments[i + 1 :]]
            sides.append((middle(*moved) * cotangents).sum())
        assert (gradient * direction).sum() == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-7, abs=1e-9)


def test_a_robot_of_a_batch_has_its_own_derivatives():
    _, arguments, _ = surroundings(0)
    cotangents = np.zeros((*BATCH, 3))
    cotangents[1, 2] = 1.0
    _, pull_back = trace(middle, *arguments)
    for gradient in pull_back(cotangents):
        touched = np.abs(gradient).sum(axis=tuple(range(2, gradient.ndim))) > 0
        assert np.argwhere(touched).tolist() == [[1, 2]]
