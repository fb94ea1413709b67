"""Light robots on the ground: entries of their contact matrix are large, and so is what rounding leaves of them."""

import numpy as np
import pytest

from taichi_sim.rigid import Body, Box, Hinge, Motor, RigidEngine, Tree, World
from taichi_sim.rigid import engine as engine_module

pytestmark = pytest.mark.kernels

MASSES = 1e-8, 1e-7, 1e-4, 0.005, 0.05, 0.35, 5.0, 50.0  # kg
HEIGHT = 0.08  # m


def stool(mass: float) -> Tree:
    """A robot on six feet that are boxes: 24 points in a plane."""
    bodies, hinges = [Body("base", (0, 0, HEIGHT), 0.7 * mass, [Box((0.1, 0.06, 0.02))])], []
    for n in range(6):
        x, y = 0.05 * (n // 2 - 1), 0.03 * (-1) ** n
        bodies.append(Body(f"leg {n}", (x, y, 0.035), 0.05 * mass, [Box((0.02, 0.02, 0.07))]))
        motor = Motor.position(-1, 1, 20.0, 5 * mass)
        hinges.append(Hinge("base", f"leg {n}", (x, y, 0.07), (0, 1, 0), motor, n))
    return Tree(bodies, hinges)


def stand(precision: str, steps: int, time_step: float = 0.002):
    world = World(time_step=time_step, friction=0.5)
    robots = RigidEngine([stool(mass) for mass in MASSES], world, precision=precision, threads=1)
    return robots.run(steps)


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_robots_stand_whatever_they_weigh(precision):
    """Below 0.05 kg they fell through the ground in single precision, below 1e-6 kg in double."""
    found = stand(precision, 100)
    assert set(found.status) == {"ok"} and not found.residual.any()
    assert np.abs(found.position[:, 2] / HEIGHT - 1).max() < 1e-4


def test_robots_that_have_no_solution_in_single_precision_do_not_pass_as_solved(monkeypatch):
    """Without compliance the matrix is as singular as rounding makes it, and its factor has a NaN."""
    monkeypatch.setattr(engine_module, "ROUNDINGS", 0)
    monkeypatch.setitem(engine_module.COMPLIANCE, "f32", 0.0)
    found = stand("f32", 60, time_step=0.01)
    lost = ~(found.position[:, 2] > 0.9 * HEIGHT)
    assert lost.any() and (found.status[lost] == "diverged").all()
