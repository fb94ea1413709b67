"""Robots of files as environments: against what ``simulate`` gives, and against themselves in batches."""

import copy
import dataclasses
import math
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from articulated_files import CRAWLER
from gymnasium.utils.env_checker import check_env

import robots.gym  # registers the environments
from robots.articulated import ArticulatedRobot, simulate
from robots.articulated.reflexes import DriveReflexes
from robots.articulated.simulation import rhythm
from robots.gym.articulated import ArticulatedEnvironment, ArticulatedVector
from robots.own_measures import OwnMeasure
from robots.world import Terrain

NAME = "morpholab/ArticulatedRobot-v0"
PRECISE = {"precision": "f64", "threads": 1}
HIGH = OwnMeasure("high", "m", law=lambda motion: motion.places[:, 0, 2])
pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")


def crawler(**settings) -> ArticulatedRobot:
    """Three bodies with two drives, for 13 commands, the last of them shorter."""
    return ArticulatedRobot(CRAWLER, **{"duration": 0.25, "friction": 0.8, **settings})


def moved(robot: ArticulatedRobot) -> np.ndarray:
    """A point of the robot at which it moves."""
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + (high - low) * np.random.default_rng(1).uniform(0.3, 0.7, len(low))


def played(environment, actions) -> tuple[float, np.ndarray, dict]:
    """The sum of rewards, all observations, and the last ``info``."""
    observation, _ = environment.reset(seed=0)
    gained, seen = 0.0, [observation]
    for number, action in enumerate(actions):
        observation, reward, terminated, truncated, info = environment.step(action)
        gained, seen = gained + reward, [*seen, observation]
        assert not terminated and truncated == (number == len(actions) - 1)
    return gained, np.array(seen), info


@pytest.mark.kernels
@pytest.mark.parametrize("world", ["flat", "hill:6", "rough:0.01,0.2", "ramp:-5+water:0.05", "flat+sand:3e4"])
def test_no_difference_plays_the_rhythm(world):
    robot = crawler(own_measures=(HIGH,))
    point, terrain = moved(robot), Terrain.parse(world)
    whole = simulate(robot, point[None], terrain=terrain, **PRECISE)
    environment = ArticulatedEnvironment(robot.design(point), world, actions="differences", **PRECISE)
    gained, _, info = played(environment, np.zeros((13, 2)))
    assert info["distance"] == whole.distance[0] and info["high"] == whole.own["high"][0]
    assert info["speed"] == whole.distance[0] / 0.25 and info["left"] == 0
    assert info["energy"] == whole.energy[0] > 0
    again = environment.reset()[1]
    begun = again["distance"]
    assert again["energy"] == 0
    assert gained * robot_length(environment) == pytest.approx(whole.distance[0] - begun, rel=1e-9)


def robot_length(environment: ArticulatedEnvironment) -> float:
    """In which rewards are told [m]."""
    return environment._batch._anatomy.length


@pytest.mark.kernels
def test_commands_of_a_rhythm_move_the_robot_as_the_rhythm_does():
    robot = crawler()
    point = moved(robot)
    environment = ArticulatedEnvironment(robot, **PRECISE)
    _, seen, info = played(environment, rhythm(robot, point[None])[0])
    assert info["distance"] == simulate(robot, point[None], **PRECISE).distance[0]
    assert seen.shape == (14, 2 + 2 + 2 + 2)  # angles, tilt, velocity, touch
    assert np.abs(seen[-1, :2]).max() > 0.05 and set(np.unique(seen[:, 6:])) <= {0.0, 1.0}


@pytest.mark.kernels
def test_it_passes_the_check_of_gymnasium():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="model: ignored.*")
        check_env(gymnasium.make(NAME, robot=crawler(), render_mode="rgb_array", **PRECISE).unwrapped)


def ahead_less_lean(info):
    """What a function of a user's own says that robots have gained."""
    return info["distance"] - 0.01 * info["lean"]


@pytest.mark.kernels
@pytest.mark.parametrize(("precision", "gain"), [("f32", "light"), ("f64", "progress"), ("f64", ahead_less_lean)])
def test_robots_of_a_batch_move_as_they_do_alone(precision, gain):
    robot = crawler(light=(1.0, 0.5, 0.1), heading=30.0)
    given = {"robot": robot, "gain": gain, "precision": precision}
    many = gymnasium.make_vec(NAME, num_envs=3, vectorization_mode="vector_entry_point", **given)
    assert isinstance(many, ArticulatedVector)
    actions = np.random.default_rng(0).uniform(-1, 1, (13, 3, 2))
    many.reset(seed=0)
    together = [many.step(action) for action in actions]
    for robot in range(3):
        alone = ArticulatedEnvironment(**given)
        alone.reset(seed=robot)
        for action, (observations, rewards, *_, infos) in zip(actions, together, strict=True):
            observation, reward, _, _, info = alone.step(action[robot])
            np.testing.assert_array_equal(observation, observations[robot])
            assert reward == rewards[robot]
            assert {name: infos[name][robot].tolist() for name in info} == {
                name: np.asarray(value).tolist() for name, value in info.items()
            }


@pytest.mark.kernels
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))])
def test_a_copy_goes_on_from_the_midst_of_an_episode(copied):
    environment = ArticulatedEnvironment(crawler(), actions="differences", **PRECISE)
    environment.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (13, 2))
    for action in actions[:5]:
        environment.step(action)
    other = copied(environment)
    for action in actions[5:]:
        first, again = environment.step(action), other.step(action)
        np.testing.assert_equal(first, again)


@pytest.mark.kernels
def test_who_leans_too_far_has_fallen():
    environment = ArticulatedEnvironment(crawler(), most_lean=1.0, **PRECISE)
    environment.reset()
    ended, lean = False, 0.0
    while not ended:
        assert lean <= 1.0
        _, _, ended, cut, info = environment.step(np.array([1.0, -1.0]))
        lean = info["lean"]
        assert not cut or ended
    assert lean > 1.0 and not info["diverged"]


@pytest.mark.kernels
def test_who_has_fallen_in_a_batch_rests():
    """Nothing more is told of it until the episodes of all are over, and it has no measures."""
    many = ArticulatedVector(2, crawler(own_measures=(HIGH,), speed=10.0), most_lean=1.0, **PRECISE)
    many.reset(seed=0)
    told = [many.step(np.array([[1.0, -1.0], [0.0, 0.0]])) for _ in range(13)]
    leans = np.array([infos["lean"] for *_, infos in told])
    fell = int(np.argmax(leans[:, 0] > 1.0))
    assert 0 < fell < 12 and leans[:, 1].max() < 1.0
    for name in ("lean", "position", "distance"):
        assert all((infos[name][0] == told[fell][-1][name][0]).all() for *_, infos in told[fell:])
    assert all(rewards[0] == 0.0 for _, rewards, *_ in told[fell + 1 :])
    _, _, ended, cut, infos = told[-1]
    assert ended.tolist() == [True, False] and cut.tolist() == [False, True]
    for name in ("speed", "high"):
        assert np.isnan(infos[name]).tolist() == [True, False]


@pytest.mark.kernels
def test_a_robot_that_diverges_loses_all(monkeypatch):
    many = ArticulatedVector(2, crawler(), **PRECISE)
    alone = ArticulatedEnvironment(crawler(), **PRECISE)
    many.reset(seed=0)
    alone.reset(seed=1)
    actions, gained = np.random.default_rng(0).uniform(-1, 1, (13, 2, 2)), np.zeros(2)
    for number, action in enumerate(actions):
        session = many._batch._session

        def broken(commands, steps, session=session):
            found = type(session).advance(session, commands, steps)
            status, position = found.status.copy(), found.position.copy()
            status[0], position[0] = "diverged", np.nan
            return dataclasses.replace(found, status=status, position=position)

        if number >= 4:
            monkeypatch.setattr(session, "advance", broken)
        observed, rewards, ended, _, infos = many.step(action)
        gained += rewards
        assert np.isfinite(observed).all() and infos["diverged"].tolist() == [number >= 4, False]
        observation, reward, *_ = alone.step(action[1])
        assert reward == rewards[1] and (observation == observed[1]).all()
    assert gained[0] == pytest.approx(-1.0) and ended.tolist() == [True, False]


@pytest.mark.kernels
def test_the_last_command_may_be_shorter_than_the_others():
    """Velocities are those of its own time, accelerations differences of these between the middles of both times."""
    robot, senses = crawler(command_rate=50.0, duration=0.25), ("velocity", "clock", "acceleration")
    environment = ArticulatedEnvironment(robot, senses=senses, actions="differences", **PRECISE)
    _, seen, info = played(environment, np.zeros((13, 2)))
    places = [environment.reset()[1]["position"], *(environment.step(np.zeros(2))[-1]["position"] for _ in range(13))]
    last = robot.steps - 12 * robot.hold
    assert 0 < last < robot.hold
    expected = (places[-1] - places[-2])[:2] / (robot_length(environment) * last * robot.physics.time_step)
    np.testing.assert_allclose(seen[-1, :2], expected, rtol=1e-12)
    turned = 2 * np.pi * robot.start[0] * robot.duration
    np.testing.assert_allclose(seen[-1, 2:4], [np.sin(turned), np.cos(turned)], atol=1e-12)
    between = (last + robot.hold) / 2 * robot.physics.time_step
    np.testing.assert_allclose(seen[-1, 4:6], (seen[-1, :2] - seen[-2, :2]) / between, rtol=1e-9)
    assert info["left"] == 0


@pytest.mark.kernels
@pytest.mark.parametrize("many", [False, True])
def test_an_interruption_in_the_users_own_law_is_noticed(many):
    def law(motion):
        if interrupting:
            raise KeyboardInterrupt
        return motion.places[:, 0, 2]

    interrupting, robot = False, crawler(own_measures=(OwnMeasure("own", law=law),), duration=0.04)
    environment = ArticulatedVector(2, robot, **PRECISE) if many else ArticulatedEnvironment(robot, **PRECISE)
    action = np.zeros((2, 2) if many else 2)
    environment.reset(seed=0)
    environment.step(action)
    interrupting = True
    with pytest.raises(KeyboardInterrupt):
        environment.step(action)
    with pytest.raises(RuntimeError, match="after one that was interrupted"):
        environment.step(action)
    interrupting = False
    environment.reset(seed=0)
    environment.step(action)


@pytest.mark.kernels
def test_pictures_show_the_robot_on_its_ground():
    environment = ArticulatedEnvironment(crawler(light=(0.6, 0.3, 0.1)), "hill:10", render_mode="rgb_array", **PRECISE)
    environment.reset()
    first = environment.render()
    environment.step(np.array([1.0, -1.0]))
    assert first.shape == (360, 640, 3) and (environment.render() != first).any()


def test_what_is_wrong_is_told():
    robot = crawler()
    for given, told in (
        ({"robot": None}, "robot: None is no articulated robot"),
        ({"robot": "rolling"}, "robot: 'rolling' is no articulated robot"),
        ({"gain": "light"}, "gain: light is not allowed without one"),
        ({"gain": "fame"}, "gain: 'fame'"),
        ({"actions": "forces"}, "actions: 'forces'"),
        ({"senses": ("light",)}, "senses: light is not allowed without sensors"),
        ({"senses": ("smell",)}, "senses: 'smell'"),
        ({"senses": "tilt"}, "senses: 'tilt' is not allowed; give one or more"),
        ({"senses": 5}, "senses: 5 is not allowed; give one or more"),
        ({"robot": crawler(own_measures=(OwnMeasure("lean", law=HIGH.law),))}, "own_measures: lean is not allowed"),
        ({"world": "flat+light:1,1"}, "world: "),
        ({"world": ["flat", "hill:3"]}, "world: "),
        ({"most_lean": 400}, "most_lean: 400"),
        ({"robot": crawler(controller="network")}, "robot: one with a network is not allowed"),
    ):
        with pytest.raises(ValueError, match=told):
            ArticulatedEnvironment(**{"robot": robot, **given})
    with pytest.warns(UserWarning, match="do not act in an environment"):
        ArticulatedEnvironment(crawler(reflexes=DriveReflexes(("tilt",), weights=(0.1,) * 6)))


def test_its_entry_is_registered():
    assert (
        robots.gym.ENVIRONMENTS
        and NAME in gymnasium.registry
        and math.isclose(ArticulatedEnvironment(crawler()).metadata["render_fps"], 50.0)
    )
