"""Derivatives of rollouts of rigid robots against central differences, contacts, stops and motors' limits included."""

from dataclasses import replace

import numpy as np
import pytest

from robots.quadruped import (
    AS_RUN,
    ENVIRONMENTS,
    LEGGED,
    WHEELED,
    WHEGGED,
    Quadruped,
    differentiate,
    engine,
    simulate,
)
from taichi_sim.ground import Relief
from taichi_sim.rigid import Body, Capsule, Hinge, Motor, Network, Physics, RigidEngine, Sphere, Tree

pytestmark = pytest.mark.kernels

ROBOTS = 4
LIGHT = np.array([[3.0, 1.0, 0.15]])
SHIFT = 1e-6


def weights_of(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (ROBOTS, 5, 8))


def differences(cost, value: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Central differences of costs (B,) along a direction."""
    return (cost(value + SHIFT * direction) - cost(value - SHIFT * direction)) / (2 * SHIFT)


@pytest.mark.parametrize("robot", [LEGGED, WHEELED, WHEGGED], ids=lambda robot: robot.kind)
def test_derivatives_by_weights_and_light_agree_with_differences_over_twenty_steps(robot):
    """From the start inside the ground, which throws robots up, motors at their limits."""
    rng, steps, given = np.random.default_rng(1), 20, weights_of(3)
    robots = engine(robot, precision="f64", threads=1)
    of_position, of_light = rng.normal(size=3), 1.7

    def cost(weights=given, lights=LIGHT):
        done = robots.run(steps, weights=weights, lights=lights)
        return done.position @ of_position + of_light * done.readings[:, 4]

    tape = robots.record(steps, weights=given, lights=LIGHT)
    readings = np.tile([0, 0, 0, 0, of_light], (ROBOTS, 1))
    gradient = tape.pull_back(position=np.tile(of_position, (ROBOTS, 1)), readings=readings)
    direction = rng.normal(size=given.shape)
    found, expected = (gradient.weights * direction).sum((1, 2)), differences(cost, given, direction)
    assert np.abs(found / expected - 1).max() < 1e-6
    along = rng.normal(size=(1, 3))
    expected = differences(lambda lights: cost(lights=lights), LIGHT, along)
    assert np.abs(gradient.lights @ along[0] / expected - 1).max() < 1e-6


@pytest.mark.parametrize("name", ["mass", "body_width", "limb_length", "limb_radius", "wheel_radius"])
def test_derivatives_by_sizes_and_masses_agree_with_differences(name):
    steps, given, aim = 20, weights_of(3), np.random.default_rng(2).normal(size=3)

    def design(value: float) -> Quadruped:
        return replace(WHEGGED, **{name: value})

    def cost(value: float) -> np.ndarray:
        robots = engine(design(value), precision="f64", threads=1)
        return robots.run(steps, weights=given, lights=LIGHT).position @ aim

    value = getattr(WHEGGED, name)
    tape = engine(WHEGGED, precision="f64", threads=1).record(steps, weights=given, lights=LIGHT)
    gradient = tape.pull_back(position=np.tile(aim, (ROBOTS, 1)))
    shift = SHIFT * value
    expected = (cost(value + shift) - cost(value - shift)) / (2 * shift)
    found = gradient.by_design(lambda x: design(x).tree(AS_RUN), value)
    assert np.abs(found / expected - 1).max() < 1e-6


@pytest.mark.parametrize("integration", ["momentum", pytest.param("velocity", marks=pytest.mark.slow)])
def test_derivatives_of_pose_and_angles_and_by_commands(integration):
    """Open-loop commands, a second robot that falls over; both ways to carry motion on."""
    rng, steps = np.random.default_rng(4), 20
    world = Physics(0.05, -1.0, 0.01, integration=integration)
    robots = RigidEngine(LEGGED.tree(), world, LEGGED.senses(), Network(), precision="f64", threads=1)
    commands = rng.uniform(-1, 1, (2, 4, 8))
    for name, size in (("orientation", 4), ("angles", 8)):
        aim, direction = rng.normal(size=size), rng.normal(size=commands.shape)

        def cost(given: np.ndarray, name=name, aim=aim) -> np.ndarray:
            return getattr(robots.run(steps, commands=given, hold=5), name) @ aim

        tape = robots.record(steps, commands=commands, hold=5)
        gradient = tape.pull_back(**{name: np.tile(aim, (2, 1))})
        found, expected = (gradient.commands * direction).sum((1, 2)), differences(cost, commands, direction)
        assert np.abs(found / expected - 1).max() < 1e-6


def ball(radius: float) -> Tree:
    """A ball that starts a little inside the ground."""
    return Tree([Body("ball", (0, 0, 0.0999), 1.0, [Sphere(radius)])])


def arm(length: float) -> Tree:
    """An arm on a fixed base, too heavy for its motor."""
    hinge = Hinge("base", "arm", (0, 0, 1), (0, 1, 0), Motor.position(-1, 1, 2, 0.5))
    base = Body("base", (0, 0, 1), 1.0, [Sphere(0.05)])
    return Tree([base, Body("arm", (length / 2, 0, 1), 0.5, [Capsule(0.02, length, (1, 0, 0))])], [hinge], fixed=True)


def slow_arm(fastest: float) -> Tree:
    """An arm whose motor is strong, and slower than its angle asks for at first."""
    tree = arm(0.4)
    motor = Motor(100.0, 0.0, -8.0, 2.0, fastest)
    return replace(tree, joints=[replace(joint, motor=motor) for joint in tree.hinges])


def stopped_arm(stop: float) -> Tree:
    """An arm that falls upon a stop."""
    tree = arm(0.4)
    return replace(tree, joints=[replace(joint, stops=(-1.0, stop)) for joint in tree.hinges])


def leaning_arm(lean: float) -> Tree:
    """An arm whose axis is not level."""
    tree = arm(0.4)
    return replace(tree, joints=[replace(joint, axis=(0.0, 1.0, lean)) for joint in tree.hinges])


@pytest.mark.parametrize("integration", ["momentum", "velocity"])
@pytest.mark.parametrize(
    "tree, value, name",
    [
        (ball, 0.1, "position"),
        (arm, 0.4, "angles"),
        (slow_arm, 1.3, "angles"),
        (stopped_arm, 0.2, "angles"),
        (leaning_arm, 0.5, "angles"),
    ],
)
def test_derivatives_of_a_body_without_hinges_and_of_a_fixed_one(tree, value, name, integration):
    def robots(x: float) -> RigidEngine:
        return RigidEngine(tree(x), Physics(0.01, integration=integration), precision="f64", threads=1)

    def cost(x: float) -> float:
        return getattr(robots(x).run(20), name)[0, -1]

    tape = robots(value).record(20)
    aim = np.zeros_like(getattr(tape.result, name))
    aim[0, -1] = 1
    found = tape.pull_back(**{name: aim}).by_design(tree, value)
    expected = (cost(value + 1e-6) - cost(value - 1e-6)) / 2e-6
    assert abs(expected) > 0.01 and abs(found[0] / expected - 1) < 1e-7


@pytest.mark.parametrize("ground", [None, Relief(np.zeros((2, 2)), 1.0, (-0.5, -0.5))])
@pytest.mark.parametrize("fixed", [False, True])
def test_derivatives_by_a_mass_know_that_slip_falls_with_it(monkeypatch, fixed, ground):
    """With a creep that is large enough to matter; a base that is fixed does not count."""
    monkeypatch.setattr("taichi_sim.rigid.model.settings.CREEP", 1.0)

    def tree(mass: float) -> Tree:
        base, arm = (Body(name, (0, 0, 0.1), 1.0, [Sphere(0.1001)]) for name in ("base", "arm"))
        foot = Body("foot", (0.2, 0, 0.1), mass, [Sphere(0.1001)])
        turning = Hinge("base", "arm", (0, 0, 0.1), (0, 0, 1), Motor.velocity(5.0, 1.0))
        return Tree([base, arm, foot], [turning, Hinge("arm", "foot", (0.05, 0, 0.3), (0, 1, 0))], fixed=fixed)

    def robots(mass: float) -> RigidEngine:
        return RigidEngine(tree(mass), Physics(0.01), ground=ground, precision="f64", threads=1)

    def cost(mass: float) -> float:
        return robots(mass).run(30, commands=np.ones((1, 1, 1))).angles[0, 0]

    tape = robots(0.7).record(30, commands=np.ones((1, 1, 1)))
    found = tape.pull_back(angles=np.array([[1.0, 0.0]])).by_design(tree, 0.7)
    expected = (cost(0.7 + 1e-6) - cost(0.7 - 1e-6)) / 2e-6
    assert abs(expected) > 1e-3 and abs(found[0] / expected - 1) < 1e-6


def test_neighbours_and_lanes_change_no_bit_of_a_gradient():
    given, aim = weights_of(5), np.ones((ROBOTS, 3))
    lanes, scalars = (engine(WHEGGED, precision="f64", threads=1, width=width) for width in (8, 1))
    all_four = lanes.record(50, weights=given, lights=LIGHT).pull_back(position=aim)
    alone = scalars.record(50, weights=given[2:3], lights=LIGHT).pull_back(position=aim[:1])
    assert np.array_equal(all_four.weights[2], alone.weights[0])


def test_what_has_no_derivative_is_refused_in_one_line():
    robots = RigidEngine(LEGGED.tree(), Physics(friction=0.5), LEGGED.senses(), precision="f64", threads=1)
    with pytest.raises(ValueError, match=r"^friction: 0\.5 has no derivatives"):
        robots.record(5)
    tape = engine(LEGGED, precision="f64", threads=1).record(2)
    with pytest.raises(ValueError, match=r"^position: shape \(2, 3\) is not allowed; give \(1, 3\)"):
        tape.pull_back(position=np.ones((2, 3)))
    placed = engine(LEGGED, precision="f64", threads=1)
    slopes = placed.record(2, start=placed.rest()).pull_back(position=np.ones((1, 3)))
    with pytest.raises(ValueError, match=r"^start: derivatives by a design are those"):
        slopes.by_design(lambda mass: Quadruped("legged", mass=mass).tree(), 1.0)


def test_a_tape_repeats_the_run_that_it_was_made_of():
    given = weights_of(6)
    robots = engine(WHEGGED, precision="f64", threads=1)
    done = robots.run(30, weights=given, lights=LIGHT)
    assert np.array_equal(robots.record(30, weights=given, lights=LIGHT).result.position, done.position)


def test_derivatives_of_light_readings_by_the_weights_of_each_environment():
    given, direction = weights_of(7)[:2], np.random.default_rng(8).normal(size=(2, 5, 8))
    settings = {"steps": 16, "precision": "f64", "threads": 1}
    done = differentiate(WHEGGED, given, ENVIRONMENTS[:3], **settings)
    slopes = done.gradient
    assert done.light.shape == (2, 3) and slopes.shape == (2, 3, 5, 8)
    assert np.array_equal(done.light, simulate(WHEGGED, given, ENVIRONMENTS[:3], **settings).light)
    exact = replace(AS_RUN, quantum=0.0)

    def cost(weights: np.ndarray) -> np.ndarray:
        return simulate(WHEGGED, weights, ENVIRONMENTS[:3], variant=exact, **settings).light

    expected = differences(cost, given, direction)
    assert np.abs((slopes * direction[:, None]).sum((2, 3)) / expected - 1).max() < 1e-5
