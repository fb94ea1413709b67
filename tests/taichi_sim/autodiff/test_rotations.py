"""Rotations against scipy's, in kernels on scalars and on native vectors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichi_sim import runtime
from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.lanes import Real
from taichi_sim.runtime import ti

pytestmark = pytest.mark.kernels

VECTORS = np.random.default_rng(0).uniform(-1, 1, (64, 3)) * np.linspace(1e-9, np.pi / np.sqrt(3), 64)[:, None]


def quaternions(vectors: np.ndarray) -> np.ndarray:
    """Scipy's (x, y, z, w) as (w, x, y, z), in this sign."""
    return np.roll(Rotation.from_rotvec(vectors).as_quat(), 1, axis=-1)


def evaluate(real: Real, function: str, columns: np.ndarray, results: int) -> np.ndarray:
    """Apply a function of the module to columns of numbers, ``width`` rows at a time."""
    array = ti.types.ndarray(dtype=real.type, ndim=2)
    apply = getattr(rotations, function)
    count = columns.shape[1]

    @ti.kernel
    def kernel(given: array, out: array):
        for i in range(given.shape[0]):
            if ti.static(count == 1):
                out[i, 0] = apply(given[i, 0])
            elif ti.static(count == 3):
                a, b, c, d = apply(given[i, 0], given[i, 1], given[i, 2])
                out[i, 0] = a
                out[i, 1] = b
                out[i, 2] = c
                out[i, 3] = d
            else:
                a, b, c = apply(given[i, 0], given[i, 1], given[i, 2], given[i, 3])
                out[i, 0] = a
                out[i, 1] = b
                out[i, 2] = c

    blocks = len(columns) // real.width
    given, out = real.array((blocks, count)), real.array((blocks, results))
    given[...] = np.moveaxis(columns.reshape(blocks, real.width, count), 1, -1)
    kernel(real.reals(given), real.reals(out))
    return np.moveaxis(out, -1, 1).reshape(-1, results)


@pytest.fixture(params=[("f64", 1, 1e-15), ("f64", 8, 1e-15), ("f32", 16, 2e-7)], ids=str)
def real(request):
    precision, width, accuracy = request.param
    runtime.start(precision=precision)
    return Real(precision, width), accuracy


def test_quaternion_of_a_rotation_vector(real):
    kind, accuracy = real
    found = evaluate(kind, "from_large_rotation_vector", VECTORS, 4)
    assert np.abs(found - quaternions(VECTORS)).max() < 100 * accuracy
    small = VECTORS * 0.05
    assert np.abs(evaluate(kind, "from_rotation_vector", small, 4) - quaternions(small)).max() < 2 * accuracy


def test_rotation_vector_of_a_quaternion(real):
    kind, accuracy = real
    found = evaluate(kind, "to_rotation_vector", quaternions(VECTORS), 3)
    assert np.abs(found - VECTORS).max() < 100 * accuracy


def test_rotation_vector_factor_jumps_where_the_engine_does(real):
    """2 acos(w)/sqrt(1 - w^2) for all angles up to almost a full turn, but 2 sqrt(2/(1 + w)) below 1 - w^2 = 2.4e-3."""
    kind, accuracy = real
    half = np.linspace(1e-3, 2.8, 64)
    found = evaluate(kind, "rotation_vector_factor", np.cos(half)[:, None], 1)[:, 0]
    exact = np.where(np.sin(half) ** 2 < 2.4e-3, 2 * np.sqrt(2 / (1 + np.cos(half))), 2 * half / np.sin(half))
    exact[np.cos(half) > 1 - 1.2e-3] = (2 * np.sqrt(2 / (1 + np.cos(half))))[np.cos(half) > 1 - 1.2e-3]
    assert np.abs(found / exact - 1).max() < 100 * accuracy
    just = np.array([np.sqrt(1 - 2.5e-3), np.sqrt(1 - 2.3e-3)] * 32)
    jump = np.diff(evaluate(kind, "rotation_vector_factor", just[:, None], 1)[:2, 0])
    angles = np.arccos(just[:2])
    assert jump == pytest.approx(2 * np.sqrt(2 / (1 + just[1])) - 2 * angles[0] / np.sin(angles[0]), abs=100 * accuracy)


def test_matrix_and_products_agree_with_scipy():
    """The plain functions work on NumPy arrays too."""
    a, b = quaternions(VECTORS), quaternions(VECTORS[::-1])
    product = np.stack(rotations.multiply(*a.T, *b.T), axis=1)
    expected = (Rotation.from_rotvec(VECTORS) * Rotation.from_rotvec(VECTORS[::-1])).as_matrix()
    entries = np.stack(rotations.matrix(*product.T), axis=1).reshape(-1, 3, 3)
    assert np.abs(entries - expected).max() < 1e-14
    f = VECTORS[::-1]
    turned = np.stack(rotations.rotate(*a.T, *f.T), axis=1)
    assert np.abs(turned - Rotation.from_rotvec(VECTORS).apply(f)).max() < 1e-14
    back = np.stack(rotations.rotate_back(*a.T, *turned.T), axis=1)
    assert np.abs(back - f).max() < 1e-14
    undone = np.stack(rotations.multiply_conjugate(*a.T, *product.T), axis=1)
    assert np.abs(undone - b).max() < 1e-14
