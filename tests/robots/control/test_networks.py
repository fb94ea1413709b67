"""Networks in the loop: answers by hand, each robot's own weights, and derivatives."""

import numpy as np
import pytest

from robots.control.networks import LayeredNetwork
from taichi_sim.autodiff.arrays import trace


def drawn(network: LayeredNetwork, batch: int = 3, seed: int = 0):
    """Weights and feelings of a batch."""
    generator = np.random.default_rng(seed)
    return generator.normal(size=(batch, network.weight_count)), generator.normal(size=(batch, network.inputs))


def test_an_answer_is_what_matrices_say():
    """With a row of weights for each node, its bias last."""
    network = LayeredNetwork(2, 2, (3,), gain=0.5)
    assert network.shapes == [(3, 3), (2, 4)] and network.weight_count == 17
    weights, felt = drawn(network)
    for row, heard, found in zip(weights, felt, network.answer(weights, felt), strict=True):
        first, last = row[:9].reshape(3, 3), row[9:].reshape(2, 4)
        hidden = np.tanh(first @ [*heard, 1.0])
        assert found == pytest.approx(0.5 * np.tanh(last @ [*hidden, 1.0]), rel=1e-14)
    assert not network.answer(0 * weights, felt).any()


def test_a_robot_answers_in_a_batch_as_alone():
    """To the bit."""
    network = LayeredNetwork(5, 3, (4, 2))
    weights, felt = drawn(network)
    alone = [network.answer(weights[n : n + 1], felt[n : n + 1])[0] for n in range(3)]
    assert np.array_equal(network.answer(weights, felt), alone)


@pytest.mark.parametrize("hidden", [(), (4,), (4, 3)])
def test_derivatives_are_those_of_differences(hidden):
    """By weights, and through what is felt."""
    network = LayeredNetwork(3, 2, hidden)
    inputs = drawn(network)
    _, back = trace(network.answer, *inputs)
    seed = np.random.default_rng(1).normal(size=(3, 2))
    for place, (values, slope) in enumerate(zip(inputs, back(seed), strict=True)):
        step = np.random.default_rng(2).normal(size=values.shape)
        sides = [[x + sign * 1e-6 * step if n == place else x for n, x in enumerate(inputs)] for sign in (1, -1)]
        high, low = (network.answer(*side) for side in sides)
        assert (slope * step).sum() == pytest.approx((seed * (high - low)).sum() / 2e-6, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inputs": 0}, "inputs: 0"),
        ({"outputs": 1.5}, "outputs: 1.5"),
        ({"hidden": 8}, "hidden: 8 is not allowed; give nodes of each layer"),
        ({"hidden": (0,)}, "hidden: 0"),
        ({"gain": -1.0}, "gain: -1"),
    ],
)
def test_bad_input(given, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        LayeredNetwork(**{"inputs": 2, "outputs": 1, **given})
