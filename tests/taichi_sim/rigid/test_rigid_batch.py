"""Batches of rigid robots: neighbours, lanes, threads, order and layout change no bit; failures stay where they are."""

from dataclasses import fields, replace

import numpy as np
import pytest

from robots.quadruped import LEGGED, TWO_ENVIRONMENTS, WHEELED, WHEGGED, Quadruped, simulate
from taichi_sim import runtime
from taichi_sim.rigid import (
    Body,
    Box,
    Capsule,
    Hinge,
    Motor,
    Physics,
    RigidEngine,
    RigidResult,
    Senses,
    Tree,
)

pytestmark = pytest.mark.kernels

ROBOTS = LEGGED, WHEELED, WHEGGED
EACH_ROBOT = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.kind)
PRECISIONS = pytest.mark.parametrize("precision", ["f32", "f64"])
ARRAYS = [each.name for each in fields(RigidResult) if each.name != "frames"]
WEIGHTS = np.random.default_rng(1).uniform(-1, 1, (21, 5, 8))
STEPS = 200


def run(robot, weights=WEIGHTS, **settings):
    return simulate(
        robot, weights, TWO_ENVIRONMENTS, steps=STEPS, **{"precision": "f32", "threads": 1, **settings}
    ).rollouts


def same(first, second, rows=slice(None)):
    return all(np.array_equal(getattr(first, n), getattr(second, n)[rows], equal_nan=n != "status") for n in ARRAYS)


@PRECISIONS
def test_width_order_and_neighbours_change_no_bit(precision):
    backwards = np.arange(42).reshape(21, 2)[::-1].ravel()
    for robot in ROBOTS:
        whole = run(robot, precision=precision)
        assert same(run(robot, precision=precision, width=1), whole)
        assert same(run(robot, WEIGHTS[::-1], precision=precision), whole, backwards)
        assert same(run(robot, WEIGHTS[4:9], precision=precision), whole, slice(8, 18))


def test_threads_change_no_bit():
    one = [run(robot) for robot in ROBOTS]
    two = [run(robot, threads=2) for robot in ROBOTS]
    assert all(map(same, one, two))


@PRECISIONS
def test_so_it_is_with_momenta_coulomb_friction_and_bodies_that_differ(precision):
    sizes = np.linspace(0.2, 0.4, 12)
    trees = [Quadruped("legged", limb_length=size, mass=1 + size).tree() for size in sizes]
    commands = np.random.default_rng(0).uniform(-1, 1, (12, 5, 8))

    def run_some(chosen, **settings):
        engine = RigidEngine(
            [trees[n] for n in chosen],
            Physics(0.02, slip=1e-3, friction=0.7),
            LEGGED.senses(),
            precision=precision,
            threads=1,
            **settings,
        )
        return engine.run(150, commands=commands[chosen], hold=30)

    whole = run_some(np.arange(12))
    assert np.ptp(whole.position[:, 2]) > 1e-3
    for chosen in (np.arange(12)[::-1], np.array([3]), np.array([7, 2, 11])):
        assert same(run_some(chosen), whole, chosen)
        assert same(run_some(chosen, width=1), whole, chosen)


@PRECISIONS
def test_the_layout_of_a_gpu_gives_the_same_bits(precision, monkeypatch):
    """Slots lie one after the other there, robots side by side; here a CPU runs it, a robot a thread."""
    expected = run(WHEGGED, precision=precision)
    begin = runtime.start
    monkeypatch.setattr(runtime, "start", lambda compute: begin(replace(compute, device="cpu", threads=1)))
    assert same(expected, run(WHEGGED, precision=precision, device="cuda"))


def test_frames_are_the_states_of_shorter_runs():
    whole = simulate(
        LEGGED, WEIGHTS[:3], TWO_ENVIRONMENTS, steps=61, record_every=20, precision="f32", threads=1
    ).rollouts
    assert whole.frames.times.tolist() == [0, 1, 2, 3]
    for frame, steps in enumerate((0, 20, 40, 60)):
        part = simulate(LEGGED, WEIGHTS[:3], TWO_ENVIRONMENTS, steps=steps + 1, precision="f32", threads=1).rollouts
        for name in ("position", "orientation", "angles", "readings"):
            assert np.array_equal(getattr(whole.frames, name)[frame], getattr(part, name))


# failures


def spinner(fastest=5.0):
    trunk = Body("trunk", (0, 0, 0.3), 1.0, [Box((0.3, 0.2, 0.1))])
    blade = Body("blade", (0.2, 0, 0.4), 0.5, [Capsule(0.02, 0.3, (1, 0, 0))])
    return Tree([trunk, blade], [Hinge("trunk", "blade", (0.1, 0, 0.4), (0, 0, 1), Motor.velocity(fastest, 1e6))])


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
@PRECISIONS
def test_a_robot_that_explodes_is_reported_and_neighbours_keep_their_bits(precision, integration):
    """One motor is asked for a rate whose square is infinite."""
    world, senses = Physics(0.01, integration=integration), Senses(["blade"], [("blade", (0, 0, 0))])
    commands = np.zeros((20, 30, 1))
    commands[:, 12:] = np.linspace(0.1, 1, 20)[:, None, None]

    def run_some(trees):
        return RigidEngine(trees, world, senses, precision=precision, threads=1).run(
            30, commands=commands, lights=np.array([[3.0, 0, 0]]), record_every=1
        )

    sound = run_some([spinner()] * 20)
    trees = [spinner()] * 20
    trees[5] = spinner({"f32": 1e30, "f64": 1e200}[precision])
    found, others = run_some(trees), np.arange(20) != 5
    assert found.status.tolist() == ["diverged" if n == 5 else "ok" for n in range(20)]
    assert found.steps[5] == 12 and set(found.steps[others]) == {30}
    for name in ARRAYS:
        numbers = getattr(found, name).dtype.kind == "f"
        assert np.array_equal(getattr(found, name)[others], getattr(sound, name)[others], equal_nan=numbers)
        assert not numbers or np.isnan(getattr(found, name)[5]).all()
    for each in fields(found.frames)[1:]:
        assert np.array_equal(getattr(found.frames, each.name)[:, others], getattr(sound.frames, each.name)[:, others])


def controllers(count, generator):
    """A third random, a third that a hundred mutations led away from such, a third of enormous weights."""
    third = count // 3
    shape = (third, 5, 8)
    mutated = generator.uniform(-1, 1, shape) + generator.normal(0, 0.05 * np.sqrt(100), shape)
    return np.concatenate([generator.uniform(-1, 1, shape), mutated, generator.uniform(-30, 30, shape)])


def nothing_explodes(robot, count, precision, threads, seed=0):
    weights = controllers(count, np.random.default_rng(seed))
    done = simulate(robot, weights, [(9, 0)], steps=301, precision=precision, threads=threads, record_every=50)
    assert set(done.status.ravel()) == {"ok"}
    frames, velocities = done.rollouts.frames, done.rollouts.velocities
    speeds = np.linalg.norm(np.diff(frames.position, axis=0), axis=-1) / np.diff(frames.times)[:, None]
    assert speeds.max() < 1.5 and np.abs(velocities[..., 3:]).max() < 3 and np.abs(velocities[..., :3]).max() < 15
    assert frames.position[..., 2].min() > 0 and frames.position[..., 2].max() < 1
    assert np.mean(done.rollouts.residual > 0) < 1e-3


@EACH_ROBOT
def test_nothing_explodes_in_two_thousand_controllers(robot):
    nothing_explodes(robot, 720, "f32", 1)


@pytest.mark.slow
@EACH_ROBOT
@PRECISIONS
def test_nothing_explodes_in_a_hundred_thousand_controllers(robot, precision):
    """Of all robots and precisions together."""
    nothing_explodes(robot, 17_000, precision, None, seed=1)
