"""Copied and unpickled environments go on as the first ones do, and disturb them not."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

import robots.gym
from robots.inflatable import SMALL, InflatableActuation

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
CASES = {
    "Pancake": {"geometry": SMALL, "actuation": QUICK, "perturbation": 1e-4},
    **{name: {} for name in ("Vehicle", "LeggedQuadruped", "Push", "Walk")},
}
WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda environment: pickle.loads(pickle.dumps(environment))}

assert robots.gym.ENVIRONMENTS


@pytest.mark.kernels
@pytest.mark.parametrize("many", [False, True], ids=["one", "many"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", CASES)
def test_a_copy_goes_on_with_the_same_bits(name, way, many):
    settings = {"render_mode": "rgb_array", **CASES[name]}
    if many:
        settings |= {"num_envs": 3, "vectorization_mode": "vector_entry_point", "max_episode_steps": 4}
    environment = (gymnasium.make_vec if many else gymnasium.make)(f"morpholab/{name}-v0", **settings)
    untouched = WAYS[way](environment)
    untouched.reset(seed=2)
    environment.reset(seed=2), environment.action_space.seed(0)
    draws = [environment.action_space.sample() for _ in range(7)]
    for draw in draws[:2]:
        environment.step(draw)
    copied = WAYS[way](environment)
    found = {each: [each.step(draw) for draw in draws[2:4]] for each in (copied, environment)}
    np.testing.assert_equal(found[copied], found[environment])
    np.testing.assert_equal(np.array(copied.render()), np.array(environment.render()))
    again = [untouched.step(draw) for draw in draws[:4]][2:]
    np.testing.assert_equal(again, found[environment])
    for each in (copied, environment):  # through the next episode, with the same random numbers
        found[each] = [each.step(draw) if many else each.reset() for draw in draws[4:]]
    np.testing.assert_equal(found[copied], found[environment])
