"""Oscillators: where they go by themselves, what they make of waves, and derivatives."""

import numpy as np
import pytest

from robots.control.networks import LayeredNetwork
from robots.control.oscillators import Oscillators, reach, waves_shifted
from taichi_sim.autodiff.arrays import trace

NODES = np.arange(16) / 16


def told(rates=(0, 0, 0), amplitudes=(0, 0, 0), phases=(0, 0, 0), coupling=0.5):
    """Three oscillators that a constant modulates: themselves, their weights, and what is felt."""
    oscillators = Oscillators(LayeredNetwork(1, 9, gain=0.4), coupling)
    biases = np.arctanh(np.concatenate([rates, amplitudes, phases]) / 0.4)
    weights = np.column_stack([np.zeros(9), biases]).reshape(1, -1)
    return oscillators, weights, np.zeros((1, 1))


def after(cycles: float, oscillators, weights, felt, span: float = 1 / 16):
    """Leads and growths after some cycles, and the largest growth on the way."""
    state, largest = oscillators.start(1), 0.0
    for _ in range(round(cycles / span)):
        state = oscillators.step(weights, felt, span, *state)
        largest = max(largest, np.abs(state[1]).max())
    return state[0][0], state[1][0], largest


def test_oscillators_go_where_they_are_told():
    """Leads differ as phases do, mean rates stay, growths are those told and never more."""
    lead, growth, largest = after(20, *told(amplitudes=(0.3, 0, -0.2), phases=(0.2, 0.0, -0.1)))
    assert lead - lead.mean() == pytest.approx(np.array([0.2, 0.0, -0.1]) - 0.1 / 3, abs=1e-6)
    assert growth == pytest.approx([0.3, 0, -0.2], abs=1e-12) and largest <= 0.3 + 1e-12
    lead, _, _ = after(10, *told(rates=(0.1, 0.1, 0.1)))
    assert lead == pytest.approx([1.0, 1.0, 1.0])
    alone, _, _ = after(10, *told(rates=(0.1, 0.0, -0.1), coupling=0.0))
    assert alone == pytest.approx([1.0, 0.0, -1.0])
    locked, _, _ = after(20, *told(rates=(0.1, 0.0, -0.1)))
    assert np.ptp(locked) < 0.1  # coupling holds together what would drift apart
    assert not any(np.any(each) for each in after(2, *told()))


def test_growth_is_that_of_the_equation():
    """Of second order, critically damped, whatever the step."""
    coarse, fine = (after(0.5, *told(amplitudes=(0.3, 0.1, 0)), span=span)[1] for span in (1 / 16, 1 / 1024))
    assert coarse == pytest.approx(fine, abs=1e-13)
    assert fine[0] == pytest.approx(0.3 * (1 - (1 + 5) * np.exp(-5)))


def test_waves_are_shifted_and_grow():
    """A sine exactly; any wave to its own nodes; exactly nothing without lead and growth."""
    sine = 2.0 + 0.3 * np.sin(2 * np.pi * NODES)[None, None]
    for node in range(16):
        added = waves_shifted(sine, node, np.full((1, 1), 0.13), np.full((1, 1), 0.5))
        expected = 2.0 + 0.45 * np.sin(2 * np.pi * (NODES[node] + 0.13))
        assert sine[:, :, node] + added == pytest.approx(np.array([[expected]]), abs=1e-14)
    rough = np.random.default_rng(0).normal(size=(2, 3, 16))
    later = waves_shifted(rough, 5, np.full((2, 3), 3 / 16), np.zeros((2, 3)))
    assert rough[:, :, 5] + later == pytest.approx(rough[:, :, 8], abs=1e-13)
    assert not waves_shifted(rough, 5, np.zeros((2, 3)), np.zeros((2, 3))).any()
    assert reach(sine[0, 0]) == pytest.approx(0.3)
    leads = np.linspace(0, 1, 97)[:, None]
    between = rough[:1, 0, 0] + waves_shifted(np.tile(rough[:1, :1], (97, 1, 1)), 0, leads, 0 * leads)
    assert np.abs(between - rough[0, 0].mean()).max() <= reach(rough[0, 0])


def test_derivatives_are_those_of_differences():
    """Over some steps: by weights, feelings and waves."""
    oscillators = Oscillators(LayeredNetwork(2, 9, (3,), gain=0.3))
    rng = np.random.default_rng(0)
    inputs = (
        rng.normal(size=(2, oscillators.network.weight_count)),
        rng.normal(size=(2, 2)),
        rng.normal(size=(2, 3, 16)),
    )

    def ends(weights, felt, waves):
        state = oscillators.start(2)
        for _ in range(5):
            state = oscillators.step(weights, felt, 1 / 16, *state)
        return waves_shifted(waves, 5, *state[:2])

    _, back = trace(ends, *inputs)
    seed = rng.normal(size=(2, 3))
    slopes, steps = back(seed), [rng.normal(size=each.shape) for each in inputs]
    sides = [ends(*(x + sign * 1e-6 * step for x, step in zip(inputs, steps, strict=True))) for sign in (1, -1)]
    expected = (seed * (sides[0] - sides[1])).sum() / 2e-6
    assert sum((g * step).sum() for g, step in zip(slopes, steps, strict=True)) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    ("outputs", "coupling", "message"),
    [(9, -1.0, "coupling: -1"), (9, 3.0, "coupling: 3"), (8, 0.5, "network: 8 outputs")],
)
def test_bad_input(outputs, coupling, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        Oscillators(LayeredNetwork(1, outputs), coupling)
