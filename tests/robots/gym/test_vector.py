"""Environments of many robots as one batch."""

import dataclasses
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NumpyToTorch
from gymnasium.wrappers.vector import NumpyToTorch as VectorNumpyToTorch
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import robots.gym
from robots.gym.batch import FAILED_RETURN, checked_actions
from robots.gym.inflatable import PancakeEnvironment, PancakeVector
from robots.gym.lattice_robot import LatticeRobotVector
from robots.gym.vehicle import VehicleVector
from robots.inflatable import SMALL, InflatableActuation
from robots.lattice_robot.presets import soft_quadruped
from taichi_sim.vehicle import VehicleTask

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
PANCAKE = {"geometry": SMALL, "actuation": QUICK, "threads": 1}
LATTICE = {"robot": soft_quadruped(1), "threads": 1}
CASES = {
    **{name: PANCAKE if "Pancake" in name else {} for name in robots.gym.ENVIRONMENTS},
    "morpholab/LatticeRobot-v0": LATTICE,
    "morpholab/Light-v0": {**LATTICE, "world": "flat+light:0.1,0.05+box:0.02,0.02,0.02,0.07,0"},
}


@pytest.mark.kernels
@pytest.mark.parametrize("name", CASES)
def test_a_robot_of_a_batch_does_what_it_does_alone(name):
    """To the bit, through two episodes, of which the second begins as each robot's own random numbers say."""
    noisy = {"perturbation": 1e-4} if "Pancake" in name else {}
    if "robot" in CASES[name]:
        noisy = {"robot": dataclasses.replace(LATTICE["robot"], perturbation=1e-4)}
    settings, steps, count = {"max_episode_steps": 4, **CASES[name], **noisy}, 4, 5
    many = gymnasium.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **settings)
    many.action_space.seed(2)
    found = [many.reset(seed=7)]
    draws = []
    for _ in range(2 * steps + 1):  # the one in the middle begins anew
        draws.append(many.action_space.sample())
        found.append(many.step(draws[-1]))
    one = gymnasium.make(name, **settings)
    for robot in range(count):
        alone = [one.reset(seed=7 + robot)]
        for number, action in enumerate(draws):
            alone.append(one.step(action[robot]) if number != steps else one.reset())
        for together, mine in zip(found, alone, strict=True):
            seen = together[0][robot], mine[0]  # sums over voxels are rounded as the batch is large
            assert np.allclose(*seen, 0.0, 1e-12) if "robot" in noisy else np.array_equal(*seen)
            assert {key: np.asarray(value).tolist() for key, value in mine[-1].items()} == {
                key: np.asarray(together[-1][key][robot]).tolist() for key in mine[-1]
            }
            if len(mine) == len(together) == 5:
                assert [each[robot] for each in together[1:4]] == list(mine[1:4])
        assert found[steps][3][robot] and found[-1][3][robot] and not found[steps + 1][3][robot]
        assert found[steps + 1][1][robot] == 0.0


def test_each_vehicle_begins_anew_when_it_has_come_to_its_light():
    task = VehicleTask(np.array([[-0.2, 0.0, 0.0], [-0.4, 0.0, 0.0]]))
    many = VehicleVector(3, task=task, max_episode_steps=12)
    observed, _ = many.reset(options={"start": [0, 1, 1]})
    ahead = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
    ends, cuts, anew = [], [], []
    for _ in range(14):
        observed, gained, ended, cut, info = many.step(ahead)
        ends.append(ended), cuts.append(cut), anew.append(gained == 0.0)
        assert many.observation_space.contains(observed) and info["distance"].shape == (3,)
    assert [int(np.argmax(column)) for column in np.transpose(ends)[:2]] == [2, 6]
    assert not np.transpose(ends)[2].any() and np.flatnonzero(np.transpose(cuts)[2]).tolist() == [11]
    assert np.transpose(anew)[0][3] and np.transpose(anew)[1][7] and not np.transpose(anew)[1][:7].any()


def test_vehicles_that_diverge_never_win_and_disturb_no_other():
    many = VehicleVector(2, fastest=1e308)
    many.reset(seed=0)
    still = np.zeros((2, 2))
    first, *_ = many.step(still)
    observed, gained, ended, _, info = many.step(np.array([[1.0, 1.0], [0.0, 0.0]]))
    assert ended.tolist() == [True, False] and gained.tolist() == [FAILED_RETURN, 0.0]
    assert info["diverged"].tolist() == [True, False] and np.array_equal(observed, first)
    _, gained, ended, _, info = many.step(still)
    assert not ended.any() and not gained.any() and info["diverged"].tolist() == [False, False]


@pytest.mark.kernels
def test_a_lattice_robot_that_diverges_rests_and_disturbs_no_other():
    many, undisturbed = (LatticeRobotVector(2, max_episode_steps=4, **LATTICE) for _ in range(2))
    many.reset(), undisturbed.reset()
    actions = np.random.default_rng(0).uniform(-1, 1, (5, *many.action_space.shape))
    gained, seen = np.zeros(2), []
    for number, action in enumerate(actions[:4]):
        if number == 2:
            engine = many._batch.episodes._rollout.engine
            state = engine.state()
            state.velocities[0] = 1e12
            engine.set_state(state)
            engine = undisturbed._batch.episodes._rollout.engine
            engine.set_state(engine.state())
        observed, reward, ended, cut, info = many.step(action)
        other = undisturbed.step(action)
        assert observed[1].tolist() == other[0][1].tolist() and reward[1] == other[1][1]
        gained += reward
        seen.append(observed[0].tolist())
        assert info["diverged"].tolist() == [number >= 2, False]
        assert ended.tolist() == [number == 3, False] and cut.tolist() == [False, number == 3]
    assert gained[0] == pytest.approx(FAILED_RETURN) and seen[1] == seen[2] == seen[3]
    many.step(actions[4])
    *_, ended, _, info = many.step(actions[4])
    assert not ended.any() and info["diverged"].tolist() == [False, False]


def test_statistics_of_gymnasium_count_the_episodes():
    many = RecordEpisodeStatistics(VehicleVector(4, max_episode_steps=5))
    many.reset(seed=1)
    for _ in range(6 * 3):
        many.step(np.ones((4, 2)))
    assert len(many.return_queue) == 12 and set(many.length_queue) == {5}


@pytest.mark.kernels
def test_statistics_of_gymnasium_count_a_robot_that_rests_once():
    many = RecordEpisodeStatistics(LatticeRobotVector(2, max_episode_steps=4, **LATTICE))
    many.reset()
    for number in range(2 * 5):
        if number == 1:
            engine = many.unwrapped._batch.episodes._rollout.engine
            state = engine.state()
            state.velocities[0] = 1e12
            engine.set_state(state)
        many.step(np.zeros(many.action_space.shape))
    assert list(many.length_queue) == [4] * 4 and many.return_queue[0] == pytest.approx(FAILED_RETURN)


IN_PROCESSES_OF_THEIR_OWN = """
import gymnasium
import robots.gym

one = gymnasium.make("morpholab/Push-v0")
many = gymnasium.make_vec("morpholab/LeggedQuadruped-v0", num_envs=2, vectorization_mode="async")
many.reset(seed=0)
print(many.step(many.action_space.sample())[1].shape)
many.close()
"""


@pytest.mark.kernels
def test_environments_may_be_made_before_processes_are_forked():
    """Also others than those of the processes, whose kernels compile in less time."""
    command = [sys.executable, "-c", IN_PROCESSES_OF_THEIR_OWN]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "(2,)"), done.stderr


@pytest.mark.kernels
@pytest.mark.parametrize("name", ["Vehicle", "LeggedQuadruped", "Push"])
def test_all_that_environments_tell_converts_to_torch(name):
    torch = pytest.importorskip("torch")
    one = NumpyToTorch(gymnasium.make(f"morpholab/{name}-v0"))
    many = VectorNumpyToTorch(
        gymnasium.make_vec(f"morpholab/{name}-v0", num_envs=2, vectorization_mode="vector_entry_point")
    )
    for environment in (one, many):
        _, begun = environment.reset(seed=0)
        *_, info = environment.step(torch.zeros(environment.action_space.shape))
        assert begun.keys() == info.keys() >= {"diverged"}
        assert all(isinstance(value, torch.Tensor) for value in info.values())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: VehicleVector(0), "num_envs: 0 is not allowed"),
        (lambda: VehicleVector(2).reset(options={"start": [0, 1, 2]}), "start: 3 are not allowed for 2 robots"),
        (lambda: VehicleVector(2).reset(options={"start": [0, 4]}), "start: 4 is not allowed; give a whole number"),
        (lambda: VehicleVector(2).reset(options={"place": 0}), "options: 'place' is unknown; give start"),
        (lambda: VehicleVector(2).reset(seed=[1]), "seed: 1 are not allowed for 2 robots"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line(call, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        call()


def test_actions_outside_their_space_are_refused():
    many = VehicleVector(2)
    many.reset(seed=0)
    for action in (np.zeros(2), np.full((2, 2), 2.0), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match=r"^action: .* is not allowed; give one of Box"):
            many.step(action)


def test_seeds_are_whole_numbers():
    """One of 1.5 was that of every robot, and so was an array of a single number."""
    many = VehicleVector(3)

    def drawn(seed):
        many.reset(seed=seed)
        return [generator.integers(1000) for generator in many._generators]

    assert len({*drawn(3)}) == 3
    assert drawn(np.array(3)) == drawn(np.uint8(3)) == drawn([3, 4, 5]) == drawn(np.arange(3, 6)) == drawn(3)
    assert drawn([None, 4, None])[1] == drawn(3)[1]
    for seed in (1.5, np.array(1.5), [1, 1.5, 2], -1, True, "1"):
        with pytest.raises(ValueError, match=r"^seed: \S+ is not allowed; give a whole number, at least 0$"):
            many.reset(seed=seed)


@pytest.mark.kernels
def test_bits_are_0_or_1():
    """Others were cast before they were looked at: 0.5 and -0.9 were 0, and 257 was 1."""
    one, many = PancakeEnvironment(actions="bits", **PANCAKE), PancakeVector(2, actions="bits", **PANCAKE)
    one.reset(), many.reset()
    for wrong in (0.5, -0.9, 257, np.nan, -1):
        action = np.array([1.0] * 9 + [wrong])
        for environment, given in ((one, action), (many, np.stack([action * 0, action]))):
            with pytest.raises(ValueError, match=r"^action: .* is not allowed; give one of (Multi|Box)"):
                environment.step(given if wrong != 257 else given.astype(int))
    for kind in (np.int64, bool, float, np.float32):
        bits = np.array([0, 1] * 5).astype(kind)
        for space, given in ((one.action_space, bits), (many.action_space, np.stack([bits, 1 - bits * 1]))):
            found = checked_actions(space, given)
            assert found.dtype == np.float64 and np.array_equal(found, given)


def test_actions_are_rounded_to_the_precision_of_a_space():
    """A third is none of the numbers of single precision."""
    space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    assert checked_actions(space, np.array([1 / 3])) == np.float32(1 / 3)
