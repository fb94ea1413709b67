"""Quadrupeds and rovers as kinds of robots: the numbers of their own functions, gradients, designs, motions."""

import numpy as np
import pytest

from robots import quadruped, rover
from robots.control.lights import LightAt
from robots.quadruped.body import ENVIRONMENTS
from robots.robot import KINDS, Place, find_robot, load_design, make_robot
from taichi_sim.base.compute import Compute

HERE = Compute(threads=1)


def robot_of(source: str, **options):
    kind, found = find_robot(source)
    return make_robot(kind, found, options)


def some_points(robot, count: int) -> np.ndarray:
    return np.random.default_rng(2).uniform(-1, 1, (count, len(robot.parameters)))


@pytest.mark.kernels
def test_a_quadruped_does_what_its_function_does():
    robot, light = robot_of("whegged", looks=31, torque=9.0), LightAt(2.0, 1.0)
    points = some_points(robot, 3)
    outcome = robot.differentiate(points, light, compute=HERE)
    body = quadruped.Quadruped("whegged", torque=9.0)
    own = quadruped.differentiate(body, points.reshape(3, 5, 8), [(2.0, 1.0)], steps=31, threads=1)
    assert np.array_equal(outcome.measures["light"], own.light[:, 0]) and set(outcome.steps) == {30}
    assert outcome.measures["approach"] == pytest.approx(np.sqrt(5) - own.distance[:, 0])
    assert np.array_equal(outcome.gradients["light"], own.gradient.reshape(3, 40))


@pytest.mark.kernels
def test_a_rover_does_what_its_function_does():
    robot, light = robot_of("rover-best", looks=61), LightAt(1.0, 1.5)
    points = some_points(robot, 2)
    outcome = robot.differentiate(points, light, compute=HERE)
    own = rover.differentiate(rover.Rover(rover.BEST), points, [(1.0, 1.5)], steps=61, threads=1)
    assert outcome.measures["approach"] == pytest.approx(np.hypot(1, 1.5) - own.distance[:, 0])
    assert outcome.measures["reached"].tolist() == own.success[:, 0].tolist()
    assert np.array_equal(outcome.gradients["approach"], -own.gradient[:, 0])


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("source", "options"), [("legged", {"limb_length": 0.25}), ("rover", {"sensors": (0, 0.5, 0.5, 0)})]
)
def test_a_design_is_saved_read_and_shown(tmp_path, source, options):
    robot = robot_of(source, looks=21, **options)
    point, light = some_points(robot, 1)[0], robot.worlds[-1]
    robot.save(point, tmp_path / "design.json")
    design = load_design(tmp_path / "design.json")
    assert design.robot.describe() == robot.describe() and np.array_equal(design.point, point)
    replay = design.replay((), light, frames=6, compute=HERE)
    assert replay.motion.name == robot.name and len(replay.motion.lights) == 1
    same = robot.simulate(point, light, compute=HERE)
    for name, values in replay.outcome.measures.items():
        assert np.array_equal(same.measures[name], values)
    said, longer = robot.at_horizon(2)
    assert said == "2 seconds" and longer.looks == 41


def test_worlds_are_places_of_the_light():
    kind = KINDS["quadruped"]
    light = kind.world("9,-0.5")
    assert light == LightAt(9.0, -0.5) and kind.world_of(kind.world_record(light)) == light
    assert light.spoken == "to a light at (9, -0.5) m"
    assert [each.name for each in robot_of("rover").worlds] == ["4,4", "-4,4", "-4,-4", "4,-4"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: KINDS["rover"].world("9"), "light: '9' is not allowed; give its place in metres, such as 9,0"),
        (lambda: robot_of("legged").simulate(np.zeros((1, 40)), Place("hill")), "light: 'hill' is not allowed"),
        (lambda: robot_of("legged").simulate(np.zeros((1, 4)), LightAt(1, 1)), "points: shape (1, 4) is not allowed"),
        (lambda: robot_of("legged", variant="x"), "variant: 'x' is unknown; choose one of as-run, text"),
        (lambda: robot_of("legged", mass=-1.0), "mass: -1.0 is not allowed"),
        (lambda: robot_of("rover", looks=1), "looks: 1 is not allowed; give a whole number, at least 2"),
        (lambda: robot_of("rover", sensors=(0, 2, 0, 0)), "sensors: 2 is not allowed"),
        (lambda: KINDS["quadruped"].build("six", {}), "robot: 'six' is no quadruped; choose one of legged"),
    ],
)
def test_bad_input_is_told_in_one_line(make, message):
    with pytest.raises(ValueError) as raised:
        make()
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


@pytest.mark.parametrize("place", [(9.0, 0.0), (9.0000123456, -0.0), (1 / 3, -1e300), (123.4567, 8.0)])
def test_the_record_of_a_light_is_exact(place):
    kind, light = KINDS["quadruped"], LightAt(*place)
    assert kind.world_of(kind.world_record(light)) == light == kind.world(light.name)


def test_names_of_published_lights_are_short():
    assert [LightAt(*place).name for place in ENVIRONMENTS] == ["9,0", "0,9", "-9,0", "0,-9"]
