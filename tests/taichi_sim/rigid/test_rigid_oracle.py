"""The rigid engine against a second implementation of its step, of dense matrices."""

from pathlib import Path

import numpy as np
import pytest
from rigid_oracle import Oracle

from robots.quadruped import GRAVITY, LEGGED, SLIP, TIME_STEP, WHEELED, WHEGGED
from taichi_sim.rigid import RigidEngine, State, World

pytestmark = pytest.mark.kernels

REFERENCE = np.load(Path(__file__).parents[2] / "data/quadruped_runs.npz")
COMMANDS = dict(zip(REFERENCE["cases"], REFERENCE["commands"], strict=True))
STEPS = 200


def disagreement(robot, world, commands, steps=STEPS, start=None, beyond=None):
    """Largest difference of position [m] or angles [rad] at any step; in a list, how far friction was off its law."""
    tree = robot.tree()
    engine = RigidEngine(tree, world, robot.senses(), precision="f64", threads=1)
    found = engine.run(steps, commands=commands[None], start=start, record_every=1)
    oracle, worst = Oracle(tree, world, start or engine.rest()), 0.0
    for step in range(steps + 1):
        ours = np.append(found.frames.position[step, 0], found.frames.angles[step, 0])
        worst = max(worst, np.abs(ours - np.append(oracle.position, oracle.angles)).max())
        oracle.step(commands[min(step, len(commands) - 1)])
        if beyond is not None:
            beyond.append(oracle.excess)
    assert found.residual[0] == 0
    return worst


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
@pytest.mark.parametrize(
    ("robot", "case"),
    [(robot, case) for robot in (LEGGED, WHEELED, WHEGGED) for case in ("mixed", "mixed2")],
    ids=lambda value: getattr(value, "kind", value),
)
def test_the_engine_is_its_dense_oracle_to_1e_9_over_200_steps(robot, case, integration):
    """Rounding is all that differs: 1e-13 is measured.

    So it does under the other commands, but for "second_joints_plus" of whegged robots integrated by momentum. They
    touch down with exactly no velocity there, so that rounding decides which of four wheels pushes, and so rubs.
    """
    world = World(TIME_STEP, GRAVITY, SLIP, integration=integration)
    assert disagreement(robot, world, COMMANDS[case][None]) < 1e-9


@pytest.mark.parametrize(("friction", "tolerance"), [(np.inf, 1e-10), (0.4, 1e-6)])
def test_the_engine_is_its_dense_oracle_for_robots_thrown_about_with_changing_commands(friction, tolerance):
    """Stops, torque limits, flight and landings on any side.

    Coulomb's cone is found in eight repetitions: in all but one of twenty steps, of impacts, to 1 % of what holds.
    """
    rng, beyond = np.random.default_rng(3), []
    for _ in range(4):
        turn = rng.normal(size=(1, 4))
        start = State(
            np.array([[0, 0, 0.8]]),
            turn / np.linalg.norm(turn),
            rng.uniform(-0.7, 0.7, (1, 8)),
            rng.normal(size=(1, 6)),
            rng.normal(size=(1, 8)),
        )
        world = World(0.02, -9.81, SLIP, friction)
        assert disagreement(LEGGED, world, rng.uniform(-1, 1, (40, 8)), 40, start, beyond) < tolerance
    assert np.mean(np.array(beyond) > 0.01) < 0.06
