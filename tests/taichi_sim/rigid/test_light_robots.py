"""Light robots on the ground: entries of their contact matrix are large, and so is what rounding leaves of them."""

import numpy as np
import pytest

from taichi_sim.ground import Relief
from taichi_sim.rigid import Body, Box, Hinge, Motor, Physics, RigidEngine, Sphere, Tree
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
    world = Physics(time_step=time_step, friction=0.5)
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


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_light_boxes_topple_as_heavy_ones_do(precision):
    """Boxes of 3 kg and 3 mg on firm ground and sand, of one shape, under gravity across; a hundredth of the size."""
    for stress in (None, 1e7):
        ground = stress and Relief(np.zeros((2, 2)), 1.0, (-0.5, -0.5), yield_per_depth=stress)
        turned = []
        for scale in (1.0, 0.01):
            mass, slip = 3.0 * scale**3, 1e-4 * np.sqrt(scale) / (3.0 * scale**3 * 9.81)
            box = Tree([Body("box", (0, 0, 0.15 * scale), mass, [Box((0.1 * scale, 0.1 * scale, 0.3 * scale))])])
            world = Physics(1e-3 * np.sqrt(scale), gravity_across=(0.5 * 9.81, 0.0), slip=slip)
            found = RigidEngine(box, world, ground=ground, precision=precision, threads=1).run(250)
            assert found.status[0] == "ok" and found.residual[0] == 0
            turned.append(2 * np.degrees(np.arccos(abs(found.orientation[0, 0]))))
        assert turned[0] > 15 and turned[1] == pytest.approx(turned[0], abs=0.05)


@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_light_arms_fall_as_heavy_ones_do(share, precision):
    """Without a motor, and with one that bears half of their weight; in f32 those below 1 g stood still."""
    masses, length, steps, time_step = (1.0, 1e-3, 1e-5, 1e-8), 0.01, 20, 1e-3

    def arm(mass: float) -> Tree:
        motor = Motor.velocity(5.0, share * 9.81 * mass * length) if share else None
        bodies = [Body("base", (0, 0, 1), 1.0, [Box((0.01, 0.01, 0.01))])]
        bodies.append(Body("arm", (length, 0, 1), mass, [Sphere(length / 4)]))
        hinge = Hinge("base", "arm", (0, 0, 1), (0, 1, 0), motor, 0 if share else None)
        return Tree(bodies, [hinge], fixed=True)

    engine = RigidEngine([arm(mass) for mass in masses], Physics(time_step), precision=precision, threads=1)
    done = engine.run(steps, commands=np.zeros((1, 1, 1)) if share else None, hold=steps)
    first = (1 - share) * 9.81 / (length * (1 + 0.4 / 16)) * time_step**2 * steps * (steps + 1) / 2
    assert np.ptp(done.angles) < 1e-5 * first and done.angles[0, 0] == pytest.approx(first, rel=0.02)
    assert (done.residual == 0).all()


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_weak_motors_brake_no_faster_than_their_torque_allows(precision):
    """In single precision those below 1e-7 N m s in a step turned any arm around at once."""
    rate, torques, time_step, held = 5.0, (1.0, 1e-5, 1e-7, 1e-10), 1e-3, 10

    def arm(torque: float) -> Tree:
        inertia = 0.01 * torque * np.eye(3)  # so it changes its rate by 0.1 rad/s in a step
        bodies = [Body(name, (0, 0, 1), 1e-3, [Box((0.01, 0.01, 0.01))], inertia) for name in ("base", "arm")]
        motor = Motor.velocity(rate, torque)
        return Tree(bodies, [Hinge("base", "arm", (0, 0, 1), (0, 1, 0), motor, 0)], fixed=True)

    world = Physics(time_step, gravity=0.0)
    commands = np.append(np.ones(10), -1.0)[None, :, None]
    engine = RigidEngine([arm(torque) for torque in torques], world, precision=precision, threads=1)
    done = engine.run(11 * held, commands=commands, hold=held)
    assert done.velocities[:, 1, 1] == pytest.approx(rate - 0.1 * held, rel=1e-4)
    assert (done.residual == 0).all()
