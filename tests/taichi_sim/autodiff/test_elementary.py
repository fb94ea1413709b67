"""Elementary functions against NumPy's, on plain numbers and in kernels of scalars and native vectors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim import runtime
from taichi_sim.autodiff import elementary
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.runtime import ti

EPSILON = {"f32": 1.2e-7, "f64": 2.3e-16}


@given(st.floats(-1e4, 1e4))
def test_sine_and_cosine_are_exact_to_rounding(angle):
    angles = np.array([angle, angle / 1e4, np.pi / 4 * round(angle)])
    sine, cosine = elementary.sine_cosine(angles)
    assert np.abs(sine - np.sin(angles)).max() < 3e-16 and np.abs(cosine - np.cos(angles)).max() < 3e-16


def test_angles_without_meaning_have_the_sine_and_cosine_of_none():
    with np.errstate(over="ignore", invalid="ignore"):
        sine, cosine = elementary.sine_cosine(np.array([1e12, -1e300, np.inf]))
    assert sine.tolist() == [0, 0, 0] and cosine.tolist() == [1, 1, 1]


@given(st.floats(-30, 30), st.floats(-300, 0))
def test_the_hyperbolic_tangent_is_exact_to_rounding(x, exponent):
    """Small numbers, too, keep all their digits."""
    points = np.array([x, x / 30, 10.0**exponent])
    assert np.allclose(elementary.hyperbolic_tangent(points), np.tanh(points), rtol=8 * EPSILON["f64"], atol=1e-300)


def test_the_hyperbolic_tangent_is_odd_never_beyond_one_and_saturates():
    points = np.concatenate([np.linspace(0, 25, 10_001), [1e3, 1e300, np.inf]])
    found = elementary.hyperbolic_tangent(points)
    assert np.array_equal(elementary.hyperbolic_tangent(-points), -found)
    assert found.max() <= 1 and np.all(found[points >= 20] == 1)
    assert np.all(np.diff(found) > -8 * EPSILON["f64"])


def test_the_hyperbolic_tangent_of_nan_is_nan():
    assert np.isnan(elementary.hyperbolic_tangent(np.array([np.nan]))).all()


@given(st.floats(-19, 19))
def test_the_reverse_pass_finds_the_derivative_of_the_hyperbolic_tangent(x):
    (found,) = pull_back(elementary.hyperbolic_tangent, (x,), (), (1.0,))
    assert found == pytest.approx(1 / np.cosh(x) ** 2, rel=1e-9, abs=1e-14)


def in_a_kernel(points, real):
    """Sine, cosine and hyperbolic tangent, (3, number)."""
    reals = ti.types.ndarray(dtype=real.type, ndim=1)

    @ti.kernel
    def kernel(given: reals, sines: reals, cosines: reals, tangents: reals):
        for i in given:
            sine, cosine = elementary.sine_cosine(given[i])
            sines[i], cosines[i] = sine, cosine
            tangents[i] = elementary.hyperbolic_tangent(given[i])

    runtime.start("cpu", real.precision, 1)
    given = real.array((len(points) // real.width,))
    given[:] = points.reshape(given.shape)
    out = [real.array(given.shape[:1]) for _ in range(3)]
    kernel(real.reals(given), *map(real.reals, out))
    return np.stack([each.ravel() for each in out])


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_kernels_find_the_same_in_scalars_and_in_vectors(precision):
    real = Real(precision, NATIVE_WIDTH[precision])
    points = np.random.default_rng(1).uniform(-1, 1, 3200) * np.repeat([1e-3, 1.0, 30.0, 1000.0], 800)
    points = points.astype(real.numpy)
    scalars, vectors = in_a_kernel(points, Real(precision, 1)), in_a_kernel(points, real)
    assert np.array_equal(scalars, vectors)
    exact = points.astype(float)
    assert np.abs(vectors[:2] - [np.sin(exact), np.cos(exact)]).max() < 2 * EPSILON[precision]
    assert np.allclose(vectors[2], np.tanh(exact), rtol=8 * EPSILON[precision], atol=0)
    if precision == "f64":
        assert np.array_equal(vectors, [*elementary.sine_cosine(exact), elementary.hyperbolic_tangent(exact)])
