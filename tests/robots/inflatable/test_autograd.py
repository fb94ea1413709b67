"""The lattice as a function of torch tensors."""

import numpy as np
import pytest
import torch
from gradient_scene import TIME_STEP, body

from taichi_sim.lattice import LatticeBody, Material, ProgramBuilder, Quantity
from taichi_sim.lattice.autograd import run

pytestmark = pytest.mark.kernels

GRAVITY = 9.80665


def bar() -> LatticeBody:
    """Three voxels of two materials that slide on the floor."""
    materials = (Material(2e5, 2000, kinetic_friction=0.3), Material(3e5, 3000, kinetic_friction=0.4))
    return LatticeBody(
        voxels=[(0, 0, 0), (1, 0, 0), (2, 0, 0)], materials=materials, material_index=[0, 1, 1], voxel_size=0.01
    )


def program(steps: int = 20):
    builder = ProgramBuilder(1)
    builder.set(Quantity.ACCELERATION, 3.0, regions=[0, 1])
    builder.set(Quantity.ACCELERATION + 2, -GRAVITY, regions=[0, 1])
    builder.set(Quantity.SCALE, 1.0, rate=1e-3, regions=[0])
    return builder.build(steps, [[steps // 2, steps]])


def test_gradcheck():
    """torch's own check, by all kinds of inputs at once; units make every number of order one."""
    shape, plan = bar(), program()
    positions = torch.tensor(shape.start_positions[None] - [0, 0, 1e-4])
    velocities = torch.full((1, 3, 3), 0.2, dtype=torch.float64)
    velocities[..., 2] = 0.0

    def outcome(values, rates, moved, pushed, stiffer, heavier):
        found = run(
            shape,
            plan,
            values=torch.tensor(plan.events["value"]) + values,
            rates=torch.tensor(plan.events["rate"]) + 1e-3 * rates,
            state={"positions": positions + 1e-3 * moved, "velocities": velocities + 0.1 * pushed},
            materials={
                "youngs_modulus": torch.tensor([[2e5, 3e5]]) * (1 + stiffer),
                "density": torch.tensor([[2e3, 3e3]]) * (1 + heavier),
            },
            floor=True,
            time_step=TIME_STEP,
        )
        return found.positions / 1e-3, found.strains / 1e-2, found.final_velocities, found.final_orientations

    sizes = (plan.events.shape, plan.events.shape, (1, 3, 3), (1, 3, 3), (1, 2), (1, 2))
    inputs = tuple(torch.zeros(size, dtype=torch.float64, requires_grad=True) for size in sizes)
    assert torch.autograd.gradcheck(outcome, inputs, eps=1e-6, atol=1e-5, rtol=1e-4)


def test_a_torch_optimiser_aims_a_throw():
    """Adam finds the push with which the bar comes to rest at a mark."""
    shape, plan = bar(), program(150)
    push = torch.tensor([0.1], dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.Adam([push], lr=0.05)
    values = torch.tensor(plan.events["value"])
    costs = []
    for _ in range(40):
        moving = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64) * push
        start = {"velocities": moving.expand(1, 3, 3)}
        end = run(shape, plan, values=values, state=start, floor=True, time_step=TIME_STEP).final_positions
        cost = ((end[0, :, 0].mean() - 0.02) / 0.01) ** 2
        optimiser.zero_grad()
        cost.backward()
        optimiser.step()
        costs.append(cost.item())
    assert costs[-1] < 1e-2 * costs[0]


def test_single_precision_tensors_and_no_gradient():
    """Gradients come in the type of their input; without any the run is not recorded."""
    shape, plan = bar(), program()
    values = torch.tensor(plan.events["value"], dtype=torch.float32, requires_grad=True)
    run(shape, plan, values=values, time_step=TIME_STEP).final_positions.sum().backward()
    assert values.grad.dtype == torch.float32 and values.grad.abs().max() > 0
    assert not run(shape, plan, time_step=TIME_STEP).final_positions.requires_grad


def test_bad_input():
    """One line each."""
    shape, plan = bar(), program()
    with pytest.raises(ValueError, match=r"^values: shape \(2,\) is not allowed; give"):
        run(shape, plan, values=torch.zeros(2))
    with pytest.raises(ValueError, match=r"^state: 'speed' is unknown; choose from positions"):
        run(shape, plan, state={"speed": torch.zeros(1)})
    with pytest.raises(ValueError, match=r"^materials.density: shape \(2,\) is not allowed; give \(1, 2\)"):
        run(shape, plan, materials={"density": torch.zeros(2)}, time_step=TIME_STEP)
    with pytest.raises(ValueError, match=r"^materials: 'mass' is unknown; choose from youngs_modulus, density"):
        run(shape, plan, materials={"mass": torch.zeros(1, 2)})
    with pytest.raises(ValueError, match=r"^time_step: none given; with materials as tensors"):
        run(shape, plan, materials={"density": torch.ones(1, 2)})
    with pytest.raises(ValueError, match=r"^memory: -1 is not allowed; give a positive number of bytes"):
        run(shape, plan, memory=-1)
    builder = ProgramBuilder(1)
    builder.set(Quantity.FORCE, 1e6, regions=[2])
    with pytest.raises(ValueError, match=r"^robot 0: diverged at step \d+; it has no result"):
        run(body(), builder.build(100), time_step=np.float64(TIME_STEP))
