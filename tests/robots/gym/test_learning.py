"""A library of reinforcement learning learns in the environments as they are."""

import gymnasium
import numpy as np
import pytest

import robots.gym
from taichi_sim.vehicle import VehicleTask

NAME, STEPS = "morpholab/Vehicle-v0", 200  # of an episode
LONGEST_STEP = 0.05  # m
BOX = gymnasium.spaces.Box(-5.0, 5.0, (2,), np.float32)
TRAINED, HELD_OUT = range(64), range(10_000, 10_012)  # seeds of starts

assert NAME in robots.gym.ENVIRONMENTS


def seen(readings):
    """What a network takes: how bright it is, over decades, and on which side."""
    left, right = readings
    return np.array([np.log10(left + right + 1e-3), 5 * (left - right) / (left + right + 1e-9)], np.float32)


def make(seeds):
    task = VehicleTask(np.array([start(seed) for seed in seeds]))
    environment = gymnasium.make(NAME, max_episode_steps=STEPS, task=task)
    environment = gymnasium.wrappers.TransformObservation(environment, seen, BOX)
    return gymnasium.wrappers.TransformReward(environment, lambda metres: metres / LONGEST_STEP)


def start(seed):
    """A place 2 to 5 m from the light, and a heading."""
    distance, angle, heading = np.random.default_rng(seed).uniform([2.0, 0.0, 0.0], [5.0, 2 * np.pi, 2 * np.pi])
    return distance * np.cos(angle), distance * np.sin(angle), heading


def approaches(policy):
    """How much of the way to the light the policy goes, from each of the starts that are held out."""
    environment, found = make(HELD_OUT), []
    for number in range(len(HELD_OUT)):
        observed, begun = environment.reset(options={"start": number})
        over = False
        while not over:
            observed, _, ended, cut, info = environment.step(policy.predict(observed, deterministic=True)[0])
            over = ended or cut
        found.append(1 - info["distance"] / begun["distance"])
    return np.array(found)


@pytest.mark.slow
def test_ppo_learns_to_steer_to_the_light():
    """In 60,000 steps, for starts that it has never seen; untrained it goes nowhere."""
    learning = pytest.importorskip("stable_baselines3")
    environments = learning.common.env_util.make_vec_env(make, n_envs=8, seed=0, env_kwargs={"seeds": TRAINED})
    settings = {"n_steps": 256, "batch_size": 256, "gamma": 0.98, "learning_rate": lambda left: 1e-3 * left}
    model = learning.PPO("MlpPolicy", environments, seed=0, device="cpu", **settings)
    before = approaches(model)
    model.learn(60_000)
    after = approaches(model)
    assert abs(before.mean()) < 0.1 and after.mean() > 0.5 and (after > before).all()
