"""The robot as a function of torch tensors, and a network that learns through it."""

import numpy as np
import pytest
import torch
from graded import tabled

from robots.inflatable import InflatableActuation, InflatableGeometry
from robots.inflatable.autograd import travel
from robots.inflatable.design import InflatableDesign
from robots.inflatable.gradient import differentiate
from robots.world import Terrain

pytestmark = pytest.mark.kernels

# Small, quick and with feet that reach the ground.
ROBOT = InflatableGeometry(bladder_columns=1, rows=12, foot_rows=4, bladder_layers=1, voxel_size=0.02)
ACTUATION = InflatableActuation(
    inflation_rate=0.03, pressure_ramp=50.0, ramp_steps=100, hold_steps=400, settle_steps=100, deflated=0.05
)
OPTIONS = {"geometry": ROBOT, "actuation": ACTUATION, "repeats": 1}


def tensors(batch: int, columns: int = 2):
    generator = torch.Generator().manual_seed(0)
    levels = 0.2 + 0.6 * torch.rand(batch, 10, columns, generator=generator, dtype=torch.float64)
    pressure = torch.linspace(1e3, 3e3, batch, dtype=torch.float64)
    parts = (pressure, torch.full((batch,), 60.0, dtype=torch.float64), levels[:, :8], levels[:, 8:])
    return tuple(part.clone().requires_grad_() for part in parts)


def test_gradients_are_those_of_the_robot():
    """Each robot on its own terrain, weighted by what the loss makes of it."""
    parts = tensors(3)
    terrains = [Terrain(), Terrain(slope=5.0), Terrain()]
    found = travel(*parts, terrains=terrains, **OPTIONS)
    weights = torch.tensor([1.0, -2.0, 3.0], dtype=torch.float64)
    (found * weights).sum().backward()
    options = {k: v for k, v in OPTIONS.items() if k != "repeats"}
    for robot, terrain in enumerate(terrains):
        values = [p.detach().numpy()[robot] for p in parts]
        design = InflatableDesign(values[0], values[1], tabled(values[2], values[3], 1))
        alone = differentiate(design, terrain, **options)
        assert found[robot].item() == alone.result.distance[0]
        for tensor, part in zip(parts, ("pressure", "orientation", "inflation", "grip"), strict=True):
            assert np.array_equal(tensor.grad[robot].numpy(), weights[robot].item() * getattr(alone, part)[0])
    with torch.no_grad():
        assert torch.equal(travel(*parts, terrains=terrains, **OPTIONS), found)


def test_a_network_learns_a_gait_from_the_slope():
    """A perceptron sees the slope and sets inflation and grip; through the simulator it learns to travel further."""
    torch.manual_seed(1)
    slopes = [-10.0, -5.0, 0.0, 5.0, 10.0, 2.5, -2.5, 7.5]
    terrains = [Terrain(slope=s) for s in slopes]
    features = torch.tensor(slopes, dtype=torch.float64)[:, None] / 10
    network = torch.nn.Sequential(torch.nn.Linear(1, 8), torch.nn.Tanh(), torch.nn.Linear(8, 20)).double()
    optimiser = torch.optim.Adam(network.parameters(), lr=0.1)
    pressure = torch.full((len(slopes),), 2e3, dtype=torch.float64)
    heading = torch.full((len(slopes),), 90.0, dtype=torch.float64)
    means = []
    for _ in range(6):
        levels = torch.sigmoid(network(features)).reshape(-1, 10, 2)
        distance = travel(pressure, heading, levels[:, :8], levels[:, 8:], terrains=terrains, **OPTIONS)
        loss = -distance.mean() / ROBOT.body_length
        optimiser.zero_grad()
        loss.backward()
        assert all(torch.isfinite(p.grad).all() and p.grad.abs().max() > 0 for p in network.parameters())
        optimiser.step()
        means.append(-loss.item())
    assert means == sorted(means) and means[-1] - means[0] > 5e-4, means


def test_bad_input():
    """One line."""
    with pytest.raises(ValueError, match=r"^terrain: 2 are not allowed for 3 designs; give one, or one each"):
        travel(*tensors(3), terrains=[Terrain()] * 2, **OPTIONS)
