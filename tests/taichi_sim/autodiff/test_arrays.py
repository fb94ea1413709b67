"""Reverse mode on NumPy arrays: against differences, against torch, and on laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.arrays import cosine, placed, revalued, sine, trace, value_of
from taichi_sim.autodiff.tracing import select

CHOSEN = np.array([0, 2, 2])

# Functions of two arrays x (2, 3) and y (3,), all numbers between 0.5 and 2.
FUNCTIONS = {
    "arithmetic": lambda x, y: (2.0 * x - y) / (y + 3.0) + x * 5.0 - (1.0 - y) / x,
    "powers": lambda x, y: x**y + x**2 + 2.0**x,
    "elementary": lambda x, y: np.sqrt(x) + np.exp(-y) * np.log(x) + np.sin(x) * np.cos(y) + np.tanh(x - y),
    "degrees": lambda x, y: np.square(np.deg2rad(x)) + abs(x - y),
    "of math": lambda x, y: sine(x) * cosine(y),
    "extremes": lambda x, y: np.maximum(x, y) - np.minimum(x, 1.2),
    "choice": lambda x, y: np.where(x > y, x * y, 0.5 * y),
    "choice of a plain number": lambda x, y: np.where(x > y, 0.0, y),
    "sums": lambda x, y: x.sum(axis=0) * y + np.mean(x, axis=(0, 1)) + x.sum(axis=1, keepdims=True).mean(),
    "running sums": lambda x, y: np.cumsum(x, axis=1) + np.diff(np.cumsum(x, axis=0), axis=0) * y,
    "largest and smallest": lambda x, y: (
        x.max(axis=1)[:, None] * y - np.min(x) + np.max(x, axis=(0, -1), keepdims=True)
    ),
    "spread": lambda x, y: x.var(axis=0, ddof=1) * np.std(x, axis=-1, keepdims=True) + np.std(y) + y.var(),
    "lengths": lambda x, y: np.linalg.norm(x, axis=-1, keepdims=True) * y + np.linalg.norm(x) + np.hypot(x, y),
    "bounds": lambda x, y: np.clip(x, 0.8, y) * np.clip(y, None, 1.5) + np.clip(x, a_min=1.0, a_max=None) + x.clip(1.0),
    "angles": lambda x, y: np.tan(x / 2) + np.arcsin(x / 3) * np.arccos(y / 3) + np.degrees(np.radians(np.arctan(x))),
    "growth": lambda x, y: np.sinh(x) + np.cosh(y) * np.expm1(x) + np.logaddexp(x, y) + np.rad2deg(np.log1p(y)),
    "matrices": lambda x, y: (x @ x.T) @ x + x @ np.diag(np.arange(3.0)) + y @ (x.T @ x) + (x[:, None] @ x.T)[0] @ x,
    "cross products": lambda x, y: np.cross(x, y) * np.cross(np.ones(3), x),
    "indices": lambda x, y: x[:, CHOSEN] * y[::-1] + x[0] + x[..., 1:2] + y[None, CHOSEN],
    "shapes": lambda x, y: np.moveaxis(x, 0, 1).reshape(3, 2) * y[:, None] + x.T + np.swapaxes(x, 0, 1),
    "repetitions": lambda x, y: np.repeat(x, 2, axis=0) + np.tile(y, (4, 1)) + np.roll(np.repeat(y, 3), 2)[:3],
    "joints": lambda x, y: np.concatenate([x, y[None], np.ones((1, 3))]) * np.stack([y, y, 2.0 * y, y]),
    "broadcasting": lambda x, y: np.broadcast_to(y, (4, 2, 3)) * x,
    "along an axis": lambda x, y: np.take_along_axis(x, np.array([[2, 0], [1, 1]]), axis=1) + y[:2],
    "places": lambda x, y: placed((3, 5), (slice(0, 2), [0, 4, 1]), x * y) * 2.0,
    "unpacking": lambda x, y: sum(row * part for row, part in zip(x, y, strict=False)),
    "unused": lambda x, y: y + 0.0 * value_of(x),
}


def arrays(seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return generator.uniform(0.5, 2.0, (2, 3)), generator.uniform(0.5, 2.0, 3)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_values_keep_their_bits_and_derivatives_agree_with_differences(name):
    function, given_arrays = FUNCTIONS[name], arrays(1)
    found, pull_back = trace(function, *given_arrays)
    assert np.array_equal(found, function(*given_arrays)) and type(found) is np.ndarray
    generator, h = np.random.default_rng(2), 1e-6
    seeds = generator.normal(size=found.shape)
    gradients = pull_back(seeds)
    assert [g.shape for g in gradients] == [a.shape for a in given_arrays]
    for i, gradient in enumerate(gradients):
        direction = generator.normal(size=gradient.shape)
        sides = [
            (function(*(a + sign * h * direction if i == j else a for j, a in enumerate(given_arrays))) * seeds).sum()
            for sign in (1, -1)
        ]
        assert (gradient * direction).sum() == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-7, abs=1e-7)


@pytest.mark.long
@given(st.integers(0, 1000))
def test_a_composition_against_torch(seed):
    torch = pytest.importorskip("torch")

    def function(x, y):
        middle = (x * y).sum(-1) / (1.0 + x[:, 0] ** 2)
        return middle[:, None] * y + x[:, [2, 0, 0]] / y

    x, y = arrays(seed)
    _, pull_back = trace(function, x, y)
    seeds = np.random.default_rng(seed).normal(size=(2, 3))
    tensors = [torch.tensor(a, requires_grad=True) for a in (x, y)]
    (function(*tensors) * torch.from_numpy(seeds)).sum().backward()
    for gradient, tensor in zip(pull_back(seeds), tensors, strict=True):
        np.testing.assert_allclose(gradient, tensor.grad.numpy(), rtol=1e-12, atol=1e-12)


def test_laws_run_on_traced_arrays():
    quaternions, vectors = np.random.default_rng(3).normal(size=(4, 5)), np.random.default_rng(4).normal(size=(3, 5))

    def turned(q, v):
        return select(q[0] > 0.0, np.stack(rotations.rotate(*q, *v)), v)

    found, pull_back = trace(turned, quaternions, vectors)
    by_quaternions, by_vectors = pull_back(np.ones((3, 5)))
    back = np.stack(rotations.rotate_back(*quaternions, *np.ones((3, 5))))
    scale = np.abs(by_vectors).max()
    assert found.shape == (3, 5)
    unit = np.where(quaternions[0] > 0, back, 1.0)
    assert by_vectors == pytest.approx(unit, abs=1e-12 * scale)
    assert (by_quaternions[:, quaternions[0] <= 0] == 0).all() and (by_quaternions[:, quaternions[0] > 0] != 0).all()


def test_several_results_and_several_ways_back():
    (total, product), pull_back = trace(lambda x, y: (x + y, x * y), 2.0, 3.0)
    assert (total, product) == (5.0, 6.0)
    assert pull_back(1.0, None) == (1.0, 1.0)
    assert pull_back(None, 1.0) == (3.0, 2.0)
    assert pull_back(1.0, 1.0) == (4.0, 3.0)
    with pytest.raises(ValueError, match="cotangents: 1 are not allowed; give one for each of 2 results"):
        pull_back(1.0)


def test_other_values_keep_the_derivatives():
    found, pull_back = trace(lambda x: revalued(2.0 * x, np.ones(2)) * 3.0, np.zeros(2))
    assert found.tolist() == [3.0, 3.0] and pull_back(np.ones(2))[0].tolist() == [6.0, 6.0]
    assert revalued(np.zeros(2), np.ones(2)).tolist() == [1.0, 1.0]


def test_what_is_not_known_is_refused():
    with pytest.raises(TypeError):
        trace(np.arctanh, np.ones(2) / 2)
    with pytest.raises(TypeError):
        trace(np.median, np.ones(2))
    with pytest.raises(TypeError, match=r"^an array that is traced does not become a plain one; use NumPy's functions"):
        trace(lambda x: np.array([each * 2 for each in x]), np.ones(2))
    with pytest.raises(TypeError, match=r"^norm: ord 1 along None is not traced; give lengths of vectors$"):
        trace(lambda x: np.linalg.norm(x, 1), np.ones(2))


def test_where_there_is_no_derivative_it_is_zero():
    assert trace(np.hypot, np.zeros(2), np.zeros(2))[1](np.ones(2))[1].tolist() == [0.0, 0.0]
    for function in (np.std, np.linalg.norm):
        assert trace(function, np.zeros(3))[1](1.0)[0].tolist() == [0.0, 0.0, 0.0]
    assert trace(np.max, np.array([1.0, 2.0, 2.0]))[1](1.0)[0].tolist() == [0.0, 1.0, 0.0]
