"""Lattice robots as environments, one and a batch, and those of tasks."""

import dataclasses
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import robots.gym
from robots.gym.batch import gained_by
from robots.gym.lattice_robot import GAINS, LatticeRobotEnvironment, LatticeRobotVector
from robots.lattice_robot import Drive, LatticeRobot, simulate
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.presets import feeling_quadruped, soft_quadruped
from robots.tasks import builtin_tasks
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, Material, ProgramBuilder

assert robots.gym.ENVIRONMENTS
QUICK = {"robot": soft_quadruped(1), "threads": 1}
SOON = ("light", "push", "shoreline")  # with a light, with props, in water; the checker takes a second for each
CHECKED = (
    "LatticeRobot",
    *(pytest.param(name.capitalize(), marks=[] if name in SOON else pytest.mark.slow) for name in builtin_tasks()),
)


def test_every_task_is_registered():
    for name, task in builtin_tasks().items():
        spec = gymnasium.spec(f"morpholab/{name.capitalize()}-v0")
        assert spec.kwargs["gain"] in GAINS and spec.vector_entry_point
        assert Terrain.parse(spec.kwargs["world"]) == task.worlds[0]


@pytest.mark.kernels
def test_a_new_sense_does_not_change_what_is_felt_by_default():
    """Policies that were learned go on working; who asks for it feels it."""
    usual = ("strain", "touch", "tilt", "slip", "velocity", "clock")
    default = LatticeRobotEnvironment(**QUICK)
    assert default._batch.episodes.senses == usual
    lit = LatticeRobotEnvironment(world="flat+light:0.1,0.05", **QUICK)
    assert lit._batch.episodes.senses == (*usual[:-1], "light", "clock")
    asked = LatticeRobotEnvironment(senses=("acceleration",), **QUICK)
    actions, felt = np.zeros(asked.action_space.shape), [asked.reset()[0]]
    felt += [asked.step(actions)[0] for _ in range(2)]
    assert not np.any(felt[:2]) and felt[2].shape == (3,) and felt[2].all()


@pytest.mark.kernels
@pytest.mark.parametrize("name", CHECKED)
def test_the_checker_of_gymnasium_passes(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*not symmetric.*")
        check_env(gymnasium.make(f"morpholab/{name}-v0", render_mode="rgb_array", **QUICK).unwrapped)


@pytest.mark.kernels
@pytest.mark.parametrize("world", ["flat", "hill:3+rough:0.004+box:0.02,0.02,0.02,0.07,0"])
def test_no_action_plays_the_waves(world):
    """To the bit of a simulation."""
    environment = LatticeRobotVector(2, world=world, precision="f64", **QUICK)
    for _ in range(2):  # the second episode begins as the first
        environment.reset()
        total, over = np.zeros(2), np.zeros(2, bool)
        while not over.any():
            observed, gained, ended, over, _ = environment.step(np.zeros(environment.action_space.shape))
            total += gained
            assert not ended.any() and environment.observation_space.contains(observed)
    robot, terrain = QUICK["robot"], Terrain.parse(world)
    found = simulate(robot, None, terrain, record_every=robot.cycle.segment * 16, threads=1)
    end = found.frames[0].positions[-1, 0]
    assert np.array_equal(environment._batch.episodes.positions, [end, end])
    began, own = found.frames[0].positions[0, 0], robot.body.voxel_count
    for name, told in environment._batch.episodes.measures.items():
        assert np.array_equal(told, np.repeat(found.measures[name], 2)), name
    assert abs(total[0]) < 2 and total[0] == total[1]
    assert total[0] * robot.length == pytest.approx((end - began)[:own, 0].mean(), abs=0.002)  # but the first piece


@pytest.mark.kernels
@pytest.mark.parametrize("frequency, steps", [(100.0, 2), (60.0, 2), (40.0, 3)])
def test_measures_are_those_of_a_simulation_where_steps_are_long(frequency, steps):
    """A sixteenth of a cycle has fewer steps than moments."""
    jelly = Material(5e3, 1e3, static_friction=1.0, kinetic_friction=0.8, name="jelly")
    voxels = np.argwhere(np.ones((4, 2, 1)))
    body = LatticeBody(voxels, (jelly,), np.zeros(8, int), 0.01, regions=np.repeat(np.arange(4), 2))
    muscles = Drive("muscles", (0, 1, 2, 3), amplitude=0.1, phase=(0.0, 0.2, 0.4, 0.6))
    robot = LatticeRobot(body, (muscles,), frequency=frequency, cycles=2)
    assert robot.cycle.segment == steps
    episodes = Episodes(robot, Terrain(), 1, ("clock",), Compute())
    episodes.begin()
    for _ in range(episodes.steps):
        episodes.advance(np.zeros((1, 4)))
    found = simulate(robot, None, Terrain()).measures
    assert all(told == found[name] for name, told in episodes.measures.items())


@pytest.mark.kernels
def test_a_robot_of_a_batch_does_what_it_does_alone():
    alone, batch = LatticeRobotEnvironment(**QUICK), LatticeRobotVector(3, **QUICK)
    draws = np.random.default_rng(0).uniform(-1, 1, (5, 3, *alone.action_space.shape))
    first, _ = batch.reset()
    for robot in range(3):
        observed, _ = alone.reset()
        assert observed == pytest.approx(first[robot], abs=1e-12)
    together = [batch.step(action) for action in draws]
    alone.reset()
    for action, (observed, gained, *_) in zip(draws, together, strict=True):
        mine = alone.step(action[1])
        assert mine[0] == pytest.approx(observed[1], abs=1e-12) and mine[1] == gained[1]
    assert np.array_equal(alone._batch.episodes.positions[0], batch._batch.episodes.positions[1])
    assert np.ptp(together[-1][0], axis=0).max() > 0


@pytest.mark.kernels
def test_episodes_end_with_the_cycles_and_begin_anew():
    batch = LatticeRobotVector(2, max_episode_steps=3, **QUICK)
    first, _ = batch.reset(seed=0)
    still = np.zeros(batch.action_space.shape)
    cut = [batch.step(still)[3].tolist() for _ in range(3)]
    assert cut == [[False] * 2, [False] * 2, [True] * 2]
    observed, gained, *_ = batch.step(still)
    assert np.array_equal(observed, first) and not gained.any()
    alone = LatticeRobotEnvironment(**QUICK)
    alone.reset()
    ends = [alone.step(still[0])[3] for _ in range(2 * 16 - 1)]
    assert ends == [False] * 30 + [True]
    with pytest.raises(RuntimeError, match="its episode is over"):
        alone.step(still[0])


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("gain", "world"),
    [
        ("light", "flat+light:0.1,0.05"),
        ("prop", "flat+box:0.02,0.02,0.01,0,0,0.0325"),
        ("turn", "flat"),
        ("rise", "flat"),
    ],
)
def test_rewards(gain, world):
    environment = LatticeRobotVector(2, world=world, gain=gain, strength=0.3, **QUICK)
    environment.reset()
    draws = np.random.default_rng(1).uniform(-1, 1, (12, *environment.action_space.shape))
    gained = np.array([environment.step(action)[1] for action in draws])
    assert np.isfinite(gained).all() and np.abs(gained).max() > 1e-6
    assert gain != "rise" or gained.min() >= 0


@pytest.mark.kernels
def test_a_function_of_info_says_what_is_gained():
    given = {"strength": 0.3, "world": "flat+light:0.1,0.05", **QUICK}
    length = LatticeRobotVector(2, **given)._batch.episodes.robot.length
    draws = np.random.default_rng(1).uniform(-1, 1, (4, 2, 20))
    found = []
    for gain in ("light", lambda info: -info["light_distance"] / length):
        environment = LatticeRobotVector(2, gain=gain, **given)
        environment.reset()
        found.append([environment.step(action)[1] for action in draws])
    assert np.array_equal(*found) and np.abs(found).max() > 1e-6
    assert LatticeRobotEnvironment(gain=lambda info: info["left"], **QUICK).reset()
    for wrong, told in (
        (lambda info: 1.0, r"shape \(\); give a number for each robot, \(1,\)"),
        (lambda info: [np.nan], "a number that is not finite"),
    ):
        with pytest.raises(ValueError, match=f"^gain: the function gives {told}"):
            LatticeRobotEnvironment(gain=wrong, **QUICK).reset()
    with pytest.raises(ValueError, match=r"^gain: the function asks for 'nothing', which info does not have; left, "):
        LatticeRobotEnvironment(gain=lambda info: info["nothing"], **QUICK).reset()


def test_a_function_of_info_may_change_what_it_is_given():
    info = {"position": np.zeros((1, 3))}

    def shifted(given):
        given["position"] += 100.0
        return given["position"][:, 0]

    assert gained_by(shifted, info, np.zeros(1, bool)) == [100.0] and not info["position"].any()


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f32", "f64"])
@pytest.mark.parametrize("world", ["flat", "hill:3+rough:0.004+light:0.1,0.05+box:0.02,0.02,0.02,0.07,0"])
def test_the_last_info_has_what_a_simulation_measures(world, precision):
    """To the bit where no action plays the waves; of the seed's noise."""
    noisy, terrain = dataclasses.replace(soft_quadruped(2), perturbation=1e-4), Terrain.parse(world)
    environment = LatticeRobotVector(2, world=world, precision=precision, robot=noisy, threads=1)
    environment.reset(seed=3)
    over, measures, infos = np.zeros(2, bool), {m.name for m in noisy.measures_in((terrain,))}, []
    while not over.all():
        *_, over, info = environment.step(np.zeros(environment.action_space.shape))
        infos.append(info)
    assert measures <= info.keys() and not any(measures & each.keys() for each in infos[:-1])
    for number in range(2):
        seed = np.random.default_rng(3 + number).integers(2**31)
        found = simulate(
            dataclasses.replace(noisy, seed=int(seed)), terrain=terrain, precision=precision, threads=1
        ).measures
        assert {name: info[name][number] for name in measures} == {name: found[name][0] for name in measures}
    *_, info = environment.step(np.zeros(environment.action_space.shape))
    assert not measures & info.keys()


@pytest.mark.kernels
def test_what_info_tells_of_where_the_robot_is():
    environment = LatticeRobotEnvironment(
        world="flat+light:0.1,0.05+box:0.02,0.02,0.02,0.07,0", gain="light", precision="f64", **QUICK
    )
    _, before = environment.reset()
    start, length = QUICK["robot"].body.start_positions.mean(axis=0), QUICK["robot"].length
    for _ in range(5):
        _, reward, *_, info = environment.step(np.ones(environment.action_space.shape))
        assert reward * length == pytest.approx(before["light_distance"] - info["light_distance"])
        to_light = info["position"][:2] - start[:2] - [0.1, 0.05]
        assert info["light_distance"] == pytest.approx(np.hypot(*to_light))
        assert info["prop_position"] == pytest.approx([start[0] + 0.07, start[1], 0.005], abs=0.002)
        before = info
    engine = environment._batch.episodes._rollout.engine
    there = engine.state().positions[0, : len(QUICK["robot"].body.voxels)].mean(axis=0)
    assert info["position"] == pytest.approx(there, abs=1e-12)
    step = QUICK["robot"].cycle.time_step
    engine.run(ProgramBuilder(1).build(1))
    after = engine.state().positions[0, : len(QUICK["robot"].body.voxels)].mean(axis=0)
    assert (after - there) / step == pytest.approx(info["velocity"], abs=0.02 * np.abs(info["velocity"]).max() + 1e-3)


@pytest.mark.kernels
def test_where_a_robot_starts_varies_with_the_seed_if_it_has_noise():
    noisy = dataclasses.replace(QUICK["robot"], perturbation=1e-4)
    for robot, varies in ((noisy, True), (QUICK["robot"], False)):
        environment = LatticeRobotVector(2, robot=robot, threads=1)
        first, again, other = (environment.reset(seed=seed)[0] for seed in (1, 1, 2))
        assert np.array_equal(first, again)
        assert np.array_equal(first[1], other[0]) or not varies
        assert (np.array_equal(first, other), np.array_equal(*first)) == (not varies, not varies)


@pytest.mark.kernels
def test_cycles_are_the_length_of_an_episode():
    one = LatticeRobotEnvironment("soft-quadruped", cycles=1, threads=1)
    assert one.reset()[1]["left"] == 2 * 16 - 1
    many = gymnasium.make_vec(
        "morpholab/Push-v0", num_envs=2, vectorization_mode="vector_entry_point", cycles=3, threads=1
    )
    assert many.reset()[1]["left"].tolist() == [4 * 16 - 1] * 2


@pytest.mark.kernels
def test_what_the_way_to_a_light_is_worth_counts_from_where_the_robot_was_put():
    """A robot without grip slides down a hill before it begins."""
    slippery = dataclasses.replace(QUICK["robot"], settling=0.3)
    slippery = dataclasses.replace(
        slippery,
        body=slippery.body.with_materials(
            dataclasses.replace(m, static_friction=0.0, kinetic_friction=0.0) for m in slippery.body.materials
        ),
    )
    environment = LatticeRobotVector(1, world="hill:20+light:-0.3,0", gain="light", precision="f64", robot=slippery)
    environment.reset()
    episodes, gained, over = environment._batch.episodes, 0.0, np.zeros(1, bool)

    def away():
        middle = episodes.positions[0, : episodes.own].mean(axis=0) - episodes.start[0].mean(axis=0)
        return np.hypot(middle[0] + 0.3, middle[1]) / episodes.robot.length

    first = away()
    assert first < 0.3 / episodes.robot.length - 0.2
    while not over.any():
        _, reward, _, over, _ = environment.step(np.zeros(environment.action_space.shape))
        gained += reward[0]
    assert gained == pytest.approx(first - away(), rel=1e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gain": "gold"}, "gain: 'gold'"),
        ({"gain": "light"}, "gain: light is not allowed without one"),
        ({"gain": "prop"}, "gain: prop is not allowed without one"),
        ({"strength": 0.6}, "strength: 0.6"),
        ({"senses": ("smell",)}, "senses: 'smell'"),
        ({"senses": ("light",)}, "light: flat has none to feel"),
        ({"senses": ("pressure",)}, "senses: pressure is not allowed for a body without a chamber; give "),
        ({"robot": "vehicle"}, "robot: 'vehicle' is no lattice robot"),
        ({"robot": [QUICK["robot"]] * 2}, r"robot: \[LatticeRobot.* is no lattice robot; give a LatticeRobot, or its"),
        ({"robot": "nope"}, "robot: 'nope' is unknown; choose one of .*walker.* soft-quadruped"),
        ({"cycles": 0}, "cycles: 0 is not allowed"),
        ({"cycle": 3}, "cycle: is unknown to LatticeRobotEnvironment; give robot, .* cycles, .* precision, threads$"),
    ],
)
@pytest.mark.kernels
def test_bad_input(settings, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        LatticeRobotEnvironment(**{**QUICK, **settings})


WORLDS = (
    "flat+light:0.1,0.05",
    "rough:0.004+light:0.1,-0.05",
    Terrain(slope=4.0, static_friction=0.5, kinetic_friction=0.4, light=(0.1, 0.0)),
)


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_robots_of_a_batch_are_each_in_a_world(precision):
    """What each does, gains and measures is, to the bit, what it does alone in that world."""
    noisy = dataclasses.replace(soft_quadruped(1), perturbation=1e-4)
    given = {"robot": noisy, "gain": "light", "precision": precision, "threads": 1}
    batch = LatticeRobotVector(3, world=WORLDS, **given)
    observed, info = batch.reset(seed=5, options={"world": [2, 0, 1]})
    assert info["world"].tolist() == [2, 0, 1]
    draws = np.random.default_rng(0).uniform(-1, 1, (31, 3, *batch.single_action_space.shape))
    together = [(observed, np.zeros(3), info), *((o, g, i) for o, g, *_, i in map(batch.step, draws))]
    for place, number in enumerate([2, 0, 1]):
        alone = LatticeRobotEnvironment(world=WORLDS[number], **given)
        mine, told = alone.reset(options={}, seed=5 + place)
        steps = [(mine, 0.0, told), *((o, g, i) for o, g, *_, i in map(alone.step, draws[:, place]))]
        for (o, g, i), (os, gs, infos) in zip(steps, together, strict=True):
            assert o == pytest.approx(os[place], abs=1e-12) and g == gs[place]
            assert all(np.array_equal(value, infos[name][place]) for name, value in i.items())
        assert np.array_equal(alone._batch.episodes.positions[0], batch._batch.episodes.positions[place])
    assert {"speed", "remaining"} <= together[-1][2].keys()


@pytest.mark.kernels
def test_seeds_draw_worlds():
    """By chance, each robot its own; the same for the same seed, in a batch and alone; autoresets draw anew."""
    batch = LatticeRobotVector(6, world=WORLDS, max_episode_steps=1, **QUICK)
    first = batch.reset(seed=1)[1]["world"]
    assert len(set(first)) > 1 and np.array_equal(batch.reset(seed=1)[1]["world"], first)
    alone = LatticeRobotEnvironment(world=WORLDS, **QUICK)
    assert [alone.reset(seed=1 + robot)[1]["world"] for robot in range(6)] == first.tolist()
    still, seen = np.zeros(batch.action_space.shape), [first.tolist()]
    for _ in range(3):
        batch.step(still)
        seen.append(batch.step(still)[-1]["world"].tolist())
    assert len({tuple(each) for each in seen}) > 1


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ((), "world: none is not allowed; give at least one"),
        (("flat", "flat+water:0.01"), "world: water:0.01 is not allowed beside flat; give worlds that are all or none"),
        (("flat", "ramp:3+sand:1e6"), r"world: ramp:3\+sand:1e6 is not allowed beside flat"),
        (("flat", "flat+light:1,0"), r"world: flat\+light:1.0,0.0 is not allowed beside flat"),
        (("flat", "nowhere"), "world: 'nowhere' is unknown"),
        (("flat", 3), "world: 3 is not allowed; give a terrain"),
        (3, "world: 3 is not allowed; give a terrain, its name, or several"),
    ],
)
def test_worlds_that_cannot_share_a_batch_are_refused(world, message):
    with pytest.raises(ValueError, match=message):
        LatticeRobotVector(2, world=world, **QUICK)


def test_a_world_is_told_by_its_number():
    environment = LatticeRobotEnvironment(world=("flat", "hill:3"), **QUICK)
    with pytest.raises(ValueError, match="world: 2 is not allowed; give a whole number from 0 to 1"):
        environment.reset(options={"world": 2})
    with pytest.raises(ValueError, match="options: 'world' is unknown; there are none"):
        LatticeRobotEnvironment(**QUICK).reset(options={"world": 0})


@pytest.mark.kernels
def test_reflexes_that_do_not_act_are_told():
    free = feeling_quadruped(1)
    taught = free.filled(np.where([name.startswith("reflex_") for name in free.free], 0.1, free.start))
    with pytest.warns(UserWarning, match="the reflexes of feeling quadruped do not act in an environment"):
        LatticeRobotEnvironment(robot=taught, threads=1).close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        LatticeRobotEnvironment(robot=free, threads=1).close()
