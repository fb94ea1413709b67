"""Pictures of the environments' robots."""

import gymnasium
import numpy as np
import pytest

import robots.gym
from robots.braitenberg import PUBLISHED
from robots.gym.lattice_robot import LatticeRobotEnvironment
from robots.gym.vehicle import VehicleEnvironment, VehicleVector
from robots.inflatable import SMALL, InflatableActuation
from robots.lattice_robot.presets import soft_quadruped
from robots.view.onlooker import HEIGHT, WIDTH
from taichi_sim.vehicle import VehicleTask

assert robots.gym.ENVIRONMENTS
QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
PANCAKE = {"geometry": SMALL, "actuation": QUICK, "threads": 1}
LATTICE = {"robot": soft_quadruped(1), "threads": 1}
CASES = {
    "morpholab/Pancake-v0": PANCAKE,
    "morpholab/Vehicle-v0": {},
    "morpholab/LeggedQuadruped-v0": {},
    "morpholab/WheeledQuadruped-v0": {},
    "morpholab/WheggedQuadruped-v0": {},
    "morpholab/LatticeRobot-v0": {**LATTICE, "world": "hill:5+rough:0.004+box:0.02,0.02,0.02,0.07,0"},
    "morpholab/Light-v0": LATTICE,
}


@pytest.mark.kernels
@pytest.mark.parametrize("name", CASES)
def test_one_robot_and_many_are_drawn_alike(name):
    many = gymnasium.make_vec(name, num_envs=2, render_mode="rgb_array", **CASES[name])
    one = gymnasium.make(name, render_mode="rgb_array", **CASES[name])
    one.action_space.seed(1)
    actions = np.array([[one.action_space.sample() for _ in range(2)] for _ in range(2)])
    many.reset(seed=4)
    begun = many.render()
    for action in actions:
        many.step(action)
    pictures = many.render()
    for robot in range(2):
        one.reset(seed=4 + robot)
        assert np.array_equal(one.render(), begun[robot])
        for action in actions:
            one.step(action[robot])
        assert np.array_equal(one.render(), pictures[robot])
        assert pictures[robot].shape == (HEIGHT, WIDTH, 3) and pictures[robot].dtype == np.uint8
        assert 0.005 < (pictures[robot] < 200).any(axis=-1).mean() < 0.5  # something is on the ground
    assert isinstance(pictures, tuple) and not np.array_equal(pictures[0], begun[0])
    assert one.metadata["render_fps"] == many.metadata["render_fps"] == pytest.approx(1 / one.unwrapped._batch.seconds)


@pytest.mark.parametrize(("name", "rate"), [("Vehicle", 20.0), ("LeggedQuadruped", 20.0)])
def test_films_play_at_the_pace_of_the_robot(name, rate):
    assert gymnasium.make(f"morpholab/{name}-v0", render_mode="rgb_array").metadata["render_fps"] == pytest.approx(rate)


def test_the_light_is_where_the_vehicle_goes():
    """It stays where it is on the picture while the vehicle comes nearer."""
    environment = VehicleEnvironment(task=VehicleTask(np.array([[-3.0, 0.0, 0.0]])), render_mode="rgb_array")
    environment.reset()
    pictures = [environment.render()]
    for _ in range(20):
        environment.step(np.ones(2))
    pictures.append(environment.render())
    lights, wheels = [], []
    for red, green, blue in (np.moveaxis(picture.astype(int), -1, 0) for picture in pictures):
        lights.append(np.argwhere((red > 200) & (blue < 120) & (green > 150)).mean(axis=0))
        wheels.append(np.argwhere((blue > red) & (red < 110) & (green < 120)).mean(axis=0))
    assert lights[0] == pytest.approx(lights[1], abs=1)
    assert wheels[1][1] - wheels[0][1] > 50 and wheels[1][0] == pytest.approx(wheels[0][0], abs=3)


def test_what_diverged_is_drawn_where_it_was():
    environment = VehicleEnvironment(fastest=1e308, render_mode="rgb_array")
    environment.reset(seed=0)
    before = environment.render()
    *_, ended, _, info = environment.step(np.ones(2))
    assert ended and info["diverged"]
    assert (environment.render() != before).mean() < 0.01  # but for the time


def test_other_render_modes_are_refused_in_one_line():
    message = "^render_mode: 'human' is unknown; choose one of rgb_array[^\n]*$"
    for make in (VehicleEnvironment, VehicleVector):
        with pytest.raises(ValueError, match=message):
            make(render_mode="human")
    assert VehicleEnvironment.metadata["render_modes"] == VehicleVector.metadata["render_modes"] == ["rgb_array"]


def test_nothing_is_drawn_unasked_or_before_the_first_episode():
    environment = VehicleEnvironment()
    environment.reset()
    assert environment.render() is None and VehicleVector(2).render() is None
    with pytest.raises(RuntimeError, match="reset the environment before"):
        VehicleVector(2, task=PUBLISHED, render_mode="rgb_array").render()


@pytest.mark.kernels
def test_a_lattice_robot_that_diverges_is_drawn_where_it_was():
    environment = LatticeRobotEnvironment(render_mode="rgb_array", **LATTICE)
    environment.reset()
    engine = environment._batch.episodes._rollout.engine
    state = engine.state()
    state.velocities[:] = 1e12
    engine.set_state(state)
    *_, ended, _, info = environment.step(np.zeros(environment.action_space.shape))
    assert ended and info["diverged"] and environment.render().shape == (HEIGHT, WIDTH, 3)
