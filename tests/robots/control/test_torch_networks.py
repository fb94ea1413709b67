"""Networks in the loop as torch modules, and back."""

import dataclasses

import numpy as np
import pytest
import torch
from torch import nn

from robots.control.networks import LayeredNetwork
from robots.control.torch_networks import from_torch, to_torch
from robots.lattice_robot import Reflexes
from taichi_sim.lattice import Material, body_from_array


@pytest.mark.parametrize("hidden", [(), (7,), (5, 6)])
def test_there_and_back_and_the_same_answers(hidden):
    """Weights to the bit, answers to the last digits."""
    network = LayeredNetwork(9, 4, hidden, gain=0.2)
    weights = tuple(np.random.default_rng(0).normal(size=network.weight_count).tolist())
    module = to_torch(network, weights)
    assert from_torch(module, gain=0.2) == (network, weights)
    felt = np.random.default_rng(1).normal(size=(50, 9))
    answers = network.answer(np.tile(weights, (50, 1)), felt)
    assert 0.2 * module(torch.from_numpy(felt)).detach().numpy() == pytest.approx(answers, abs=1e-12, rel=1e-12)
    assert all(each.requires_grad and each.dtype == torch.float64 for each in module.parameters())


def test_a_module_makes_reflexes():
    """Their layers and weights, from f32 too."""
    reflexes = Reflexes(("tilt", "clock"), hidden=(3,))
    module = nn.Sequential(nn.Linear(4, 3), nn.Tanh(), nn.Linear(3, 2), nn.Tanh())
    network, weights = from_torch(module)
    made = dataclasses.replace(reflexes, hidden=network.hidden, weights=weights)
    body = body_from_array(np.ones((2, 1, 1)), Material(1e5, 1e3), 0.01, regions=[[[0]], [[1]]])
    made.check(body, (0, 1))
    assert weights[4] == module[0].bias[0].item() and made.network(body, (0, 1)).inputs == network.inputs


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (nn.Linear(2, 1), "module: Linear is not allowed; give a Sequential of Linear layers"),
        (nn.Sequential(), "module: Sequential is not allowed"),
        (nn.Sequential(nn.Linear(2, 1)), "module: Sequential is not allowed"),
        (nn.Sequential(nn.Linear(2, 1), nn.ReLU()), "module: ReLU at place 1 is not allowed"),
        (nn.Sequential(nn.Conv1d(2, 1, 1), nn.Tanh()), "module: Conv1d at place 0 is not allowed"),
        (nn.Sequential(nn.Linear(2, 1, bias=False), nn.Tanh()), "module: Linear at place 0 .* each with a bias"),
        (nn.Sequential(nn.Linear(2, 3), nn.Tanh(), nn.Linear(2, 1), nn.Tanh()), "module: Linear at place 2"),
        (None, "module: NoneType is not allowed"),
    ],
)
def test_other_modules_are_refused(module, message):
    """In one line."""
    with pytest.raises(ValueError, match="^" + message):
        from_torch(module)


def test_bad_weights_are_refused():
    """Both ways."""
    module = nn.Sequential(nn.Linear(2, 1), nn.Tanh())
    with torch.no_grad():
        module[0].bias.fill_(torch.nan)
    with pytest.raises(ValueError, match=r"^weights: nan"):
        from_torch(module)
    with pytest.raises(ValueError, match=r"^weights: shape \(2,\) is not allowed; give \(3,\)"):
        to_torch(LayeredNetwork(2, 1), (1.0, 2.0))
