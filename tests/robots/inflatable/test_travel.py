"""The inflatable robot as a function of torch tensors: types, shapes and options of what is given."""

import re

import pytest
import torch

from robots.inflatable import SMALL, InflatableActuation
from robots.inflatable.autograd import travel

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
OPTIONS = {"geometry": SMALL, "actuation": QUICK, "repeats": 1}


def tensors(columns: int = 1) -> dict[str, torch.Tensor]:
    """Two designs, in double precision."""
    random = torch.Generator().manual_seed(0)
    levels = torch.rand(2, 10, columns, dtype=torch.float64, generator=random)
    return {
        "pressure": torch.tensor([2000.0, 3008.0], dtype=torch.float64),
        "orientation": torch.tensor([80.0, 30.0], dtype=torch.float64),
        "inflation": levels[:, :8],
        "grip": levels[:, 8:],
    }


@pytest.mark.kernels
def test_distances_have_the_widest_type_of_the_tensors():
    """They had that of the pressures: 0 m for whole ones, without a gradient, and three digits in half precision."""
    inputs, distances, slopes = tensors(), [], []
    for kind in (torch.float64, torch.int64, torch.bfloat16):
        given = {**inputs, "pressure": inputs["pressure"].to(kind), "inflation": inputs["inflation"].clone()}
        given["inflation"].requires_grad_()
        distance = travel(**given, **OPTIONS)
        distance.sum().backward()
        distances.append(distance)
        slopes.append(given["inflation"].grad)
    assert distances[0].dtype == torch.float64 and (distances[0] != 0).all() and slopes[0].abs().max() > 0
    assert all(map(torch.equal, distances, distances[1:])) and all(map(torch.equal, slopes, slopes[1:]))


@pytest.mark.kernels
def test_distances_of_whole_numbers_alone_are_float64():
    """None of the tensors floats."""
    inputs = {name: tensor.round().long() for name, tensor in tensors().items()}
    single = travel(**{name: tensor.float() for name, tensor in inputs.items()}, **OPTIONS)
    found = travel(**inputs, **OPTIONS)
    assert single.dtype == torch.float32 and found.dtype == torch.float64 and torch.equal(found.float(), single)


@pytest.mark.parametrize("memory", [-1, 0, float("nan"), "much", True, None])
def test_a_bound_on_memory_is_checked_without_a_gradient(memory):
    """It was only looked at where something was to be kept."""
    with pytest.raises(ValueError, match=r"^memory: \S+ is not allowed; give a positive number of bytes$"):
        travel(**tensors(), **OPTIONS, memory=memory)


@pytest.mark.parametrize(
    ("name", "shape", "allowed"),
    [
        ("pressure", (), "(B,) or (B, N)"),
        ("pressure", (2, 1, 1), "(B,) or (B, N)"),
        ("pressure", (0,), "(B,) or (B, N)"),
        ("orientation", (), "(2,)"),
        ("orientation", (3,), "(2,)"),
        ("inflation", (2, 7, 3), "(2, 8, T)"),
        ("inflation", (8, 3), "(2, 8, T)"),
        ("inflation", (2, 8, 0), "(2, 8, T)"),
        ("grip", (2, 3, 3), "(2, 2, 3)"),
        ("grip", (2, 2, 4), "(2, 2, 3)"),
        ("core_pressure", (2,), "(2, 3) or (2, N, 3)"),
        ("core_pressure", (3, 3), "(2, 3) or (2, N, 3)"),
        ("core_pressure", (2, 2, 4), "(2, 3) or (2, N, 3)"),
    ],
)
def test_shapes_that_do_not_fit_are_refused_in_one_line(name, shape, allowed):
    """Seven bladders and three feet were eight and two, and other shapes ended within NumPy."""
    told = re.escape(f"{name}: shape {shape} is not allowed; give {allowed}")
    with pytest.raises(ValueError, match=f"^{told}$"):
        travel(**{**tensors(columns=3), name: torch.zeros(shape)}, **OPTIONS)


@pytest.mark.kernels
def test_core_pressures_of_columns_have_a_gradient():
    """One for all cores, or a row for each, here of the one core."""
    core, found = torch.full((2, 1), 1000.0, dtype=torch.float64), []
    for given in (core.requires_grad_(), core.detach()[:, None].requires_grad_()):
        distance = travel(**tensors(), core_pressure=given, **OPTIONS)
        distance.sum().backward()
        found.append((distance, given.grad.reshape(2, 1)))
    assert found[0][1].abs().max() > 0 and all(map(torch.equal, *found))
