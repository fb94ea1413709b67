import re
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from robots import quadruped
from robots.braitenberg import BASELINE, PUBLISHED, contralateral, trace
from robots.gym import ENVIRONMENTS
from robots.gym.batch import FAILED_RETURN
from robots.gym.policies import LinearPolicy, NeuronPolicy, RandomPolicy, episode
from robots.gym.quadruped import QuadrupedEnvironment, QuadrupedVector
from robots.inflatable import INCHING, ROLLING, SMALL, InflatableActuation, InflatableDesign, simulate
from robots.inflatable.schedule import GaitSchedule
from taichi_sim.vehicle import VehicleTask

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
PANCAKE = {"geometry": SMALL, "actuation": QUICK, "threads": 1}


def make(name, **settings):
    quick = PANCAKE if "Pancake" in name else {}
    return gymnasium.make(name, **{"max_episode_steps": 6, **quick, **settings})


def played(name, seed, **settings):
    """Everything that two episodes of random actions return."""
    environment = make(name, **settings)
    environment.action_space.seed(5)
    found = []
    for reset in (seed, None):
        observation, info = environment.reset(seed=reset)
        found.append((observation, info))
        over = False
        while not over:
            *now, terminated, truncated, info = environment.step(environment.action_space.sample())
            found.append((*now, terminated, truncated, info))
            over = terminated or truncated
    return found


@pytest.mark.kernels
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_environment_passes_the_check(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*not symmetric.*")
        check_env(make(name, render_mode="rgb_array").unwrapped)


@pytest.mark.kernels
@pytest.mark.parametrize("many", [False, True])
def test_a_step_that_was_interrupted_must_be_followed_by_a_reset(many, monkeypatch):
    """The robot stands between two steps then; going on would give wrong numbers without a word."""
    one, several = QuadrupedEnvironment(), QuadrupedVector(2)
    environment, action = (several, np.zeros((2, 8))) if many else (one, np.zeros(8))
    environment.reset(seed=0)
    before = environment.step(action)

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(environment._batch, "_observe", interrupted)
        with pytest.raises(KeyboardInterrupt):
            environment.step(action)
    with pytest.raises(RuntimeError, match="after one that was interrupted"):
        environment.step(action)
    with pytest.raises(ValueError, match="light"):
        environment.reset(options={"light": 7})
    environment.reset(seed=0)
    np.testing.assert_equal(environment.step(action), before)


@pytest.mark.kernels
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_episodes_repeat_by_their_seed(name):
    settings = {"perturbation": 1e-4} if "Pancake" in name else {}
    first, again, other = (played(name, seed, **settings) for seed in (3, 3, 4))
    np.testing.assert_equal(first, again)
    with pytest.raises(AssertionError):
        np.testing.assert_equal(first, other)


@pytest.mark.kernels
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_random_policy_runs(name):
    environment = make(name)
    policy = RandomPolicy(environment.action_space)
    gained, info = episode(environment, policy, seed=1)
    policy.reset()
    assert episode(environment, lambda observation: policy(observation), seed=1)[0] == gained  # a plain function
    assert np.isfinite(gained) and not info["diverged"]


@pytest.mark.kernels
@pytest.mark.parametrize("design", [INCHING, ROLLING], ids=["inching", "rolling"])
def test_columns_played_one_by_one_are_the_gait(design):
    schedule = GaitSchedule(design.schedule.bits[:, :3], repeats=2)
    whole = simulate(InflatableDesign(design.pressure, design.orientation, schedule), geometry=SMALL, actuation=QUICK)
    options = {"pressure": design.pressure, "orientation": design.orientation, "precision": "f64"}
    environment = make("morpholab/Pancake-v0", **options)
    for _ in range(2):  # the second reset goes back to what was saved
        environment.reset()
        gained = 0.0
        for bits in schedule.played.T:
            observation, reward, terminated, _, info = environment.step(bits.astype(np.int8))
            gained += reward
        assert info["distance"] == pytest.approx(whole.distance[0], rel=1e-12, abs=1e-15) and not terminated
        assert info["speed"] == pytest.approx(whole.speed[0]) and info["steps"] == whole.steps[0]
        assert gained * SMALL.body_length == pytest.approx(info["distance"])
        np.testing.assert_allclose(observation[:10], schedule.played[:, -1], atol=0.05)
        np.testing.assert_allclose(np.linalg.norm(observation[10:16].reshape(2, 3), axis=1), 1.0)


@pytest.mark.kernels
def test_numbers_above_a_half_are_on():
    bits, numbers = make("morpholab/Pancake-v0"), make("morpholab/Pancake-v0", actions="continuous")
    bits.reset(), numbers.reset()
    column = INCHING.schedule.bits[:, 0]
    first, second = bits.step(column.astype(np.int8)), numbers.step(np.where(column, 0.9, 0.2))
    np.testing.assert_equal(first, second)


@pytest.mark.kernels
def test_a_published_vehicle_controller_drives_as_it_did():
    weights = contralateral([0.6, 0.98])
    task = VehicleTask(PUBLISHED.starts, steps=60)
    whole = trace([BASELINE], weights[None, None], task)
    environment = make("morpholab/Vehicle-v0", max_episode_steps=60)
    policy = LinearPolicy(environment.action_space, np.column_stack([weights, np.zeros(2)]))
    for start in range(4):
        observation, info = environment.reset(options={"start": start})
        for step in range(60):
            np.testing.assert_allclose(info["pose"], whole.poses[0, 0, start, step], atol=1e-12)
            np.testing.assert_allclose(observation, whole.readings[0, 0, start, :, step], rtol=1e-12)
            observation, *_, info = environment.step(policy(observation))


@pytest.mark.kernels
@pytest.mark.parametrize("kind", ["legged", "wheeled", "whegged"])
def test_a_published_quadruped_controller_moves_as_it_did(kind):
    weights = np.random.default_rng(2).uniform(-1, 1, (5, 8))
    whole = quadruped.simulate(quadruped.Quadruped(kind), weights, steps=41, precision="f64", threads=1)
    environment = make(f"morpholab/{kind.capitalize()}Quadruped-v0", max_episode_steps=40)
    _, info = episode(environment, NeuronPolicy(weights), options={"light": 0})
    np.testing.assert_allclose(info["position"], whole.position[0, 0], atol=1e-6)
    assert info["light"] == pytest.approx(whole.light[0, 0], abs=1e-6)


def test_the_vehicle_stops_at_the_light():
    environment = make("morpholab/Vehicle-v0", task=VehicleTask(np.array([[-0.3, 0.0, 0.0]])), max_episode_steps=50)
    gained, info = episode(environment, LinearPolicy(environment.action_space, [[0, 0, 1.0]] * 2))
    assert info["distance"] < 0.075 and gained == pytest.approx(0.3 - info["distance"])


@pytest.mark.long
def test_hill_climbing_learns_to_reach_the_light_from_everywhere(capsys):
    """The example in the documentation."""
    text = (Path(__file__).parents[3] / "docs" / "gym.md").read_text()
    *_, example = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(compile(example, "gym.md", "exec"), {})
    first, last = map(float, re.findall(r"[\d.]+(?= m)", capsys.readouterr().out))
    assert first == 0.0 and last > 15.0


def test_a_simulation_that_diverges_ends_the_episode_and_never_wins():
    environment = make("morpholab/Vehicle-v0", fastest=1e308)
    environment.reset(seed=0)
    environment.step(np.array([0.0, 0.0]))
    observation, reward, terminated, _, info = environment.step(np.array([1.0, 1.0]))
    assert terminated and reward == FAILED_RETURN and info["diverged"]
    assert environment.observation_space.contains(observation)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: make("morpholab/Pancake-v0", actions="some"),
            "actions: 'some' is unknown; choose one of bits, continuous",
        ),
        (lambda: make("morpholab/Pancake-v0", geometry="big"), "geometry: 'big' is unknown; choose one of published"),
        (
            lambda: make("morpholab/Pancake-v0", pressur=1.0),
            "pressur: is unknown to PancakeEnvironment; give ",
        ),
        (lambda: make("morpholab/Pancake-v0", pressure=1e6), "pressure: 1000000.0 is not allowed"),
        (lambda: make("morpholab/Vehicle-v0", fastest=0.0), "fastest: 0.0 is not allowed"),
        (lambda: make("morpholab/Vehicle-v0").reset(options={"start": 4}), "start: 4 is not allowed; give a whole"),
        (lambda: make("morpholab/Vehicle-v0").reset(options={"place": 4}), "options: 'place' is unknown; give start"),
        (lambda: make("morpholab/Pancake-v0").reset(options={"start": 4}), "options: 'start' is unknown"),
        (lambda: make("morpholab/LeggedQuadruped-v0", lights=[(1, 2, 3)]), r"lights: shape \(1, 3\) is not allowed"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line(call, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        call()


@pytest.mark.parametrize("action", [np.array([2.0, 0.0]), np.zeros(3), np.array([np.nan, 0.0])])
def test_actions_outside_their_space_are_refused(action):
    environment = make("morpholab/Vehicle-v0").unwrapped
    environment.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action: .* is not allowed; give one of Box"):
        environment.step(action)
