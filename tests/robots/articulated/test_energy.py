"""Work of the drives of robots from files: what it is, its derivatives, and searches for robots that need little."""

import json
import math

import mujoco
import numpy as np
import pytest
from articulated_files import CRAWLER
from crawlers import HERE, QUICK, some_points

from robots.articulated import ArticulatedRobot, DriveReflexes
from robots.articulated.simulation import rhythm, simulate
from robots.free import Free
from robots.own_measures import OwnMeasure
from robots.world import Terrain
from taichi_sim.base.compute import Compute

pytestmark = pytest.mark.kernels

RUBS = CRAWLER.replace('axis="0 1 0" range', 'axis="0 1 0" frictionloss="0.1" damping="0.02" range')
SPRINGY = CRAWLER.replace('axis="0 1 0" range', 'axis="0 1 0" stiffness="2" armature="0.01" range')
STOPPED = CRAWLER.replace('"-60 60"', '"-12 12"')
WEAK = CRAWLER.replace("-8 8", "-1 1")
IDEAL = {"speed": 10.0, "fastest": 10.0}
SENSES = DriveReflexes.parse("touch,tilt,angles,velocity")


def robot_of(text=CRAWLER, **given):
    return ArticulatedRobot(text, **{**QUICK, **given})


def energies(robot, points, terrain=None):
    return simulate(robot, points, **HERE, **({} if terrain is None else {"terrain": terrain})).energy


def test_energy_is_the_work_of_torques_in_the_way_that_hinges_turn():
    """Of servos: from the angles after every step, and the law of the file, bounds included."""
    for text, limit in ((CRAWLER, 8.0), (WEAK, 1.0)):
        robot = robot_of(text)
        points = some_points(robot, 3)
        found = simulate(robot, points, record_every=1, **HERE)
        step = robot.physics.time_step
        angles = found.runs[0].frames.angles  # (steps + 1, 3, 2), at the ends of steps
        rates = np.diff(angles, axis=0) / step
        before = np.concatenate([np.zeros_like(rates[:1]), rates[:-1]])
        wanted = 0.8 * np.repeat(rhythm(robot, points).transpose(1, 0, 2), robot.hold, axis=0)[: len(rates)]
        gained = 0.25 * step * step * 30
        push = step * 30 * (wanted - angles[:-1]) + gained * (before - rates)
        work = np.maximum(0, np.clip(push, -step * limit, step * limit) * (before + rates) / 2).sum((0, 2))
        assert found.energy == pytest.approx(work, rel=1e-6)


def test_energy_in_the_air_is_that_of_mujoco():
    text = CRAWLER.replace('timestep="0.01"', 'timestep="0.0005" gravity="0 0 0"').replace('"0 0 0.1"', '"0 0 9"')
    robot = robot_of(text)
    points = some_points(robot, 4)
    found = energies(robot, points)
    theirs, commands = mujoco.MjModel.from_xml_string(text), rhythm(robot, points)
    for row, energy in enumerate(found):
        data, work = mujoco.MjData(theirs), 0.0
        for step in range(robot.steps):
            data.ctrl[:] = 0.8 * commands[row, step // robot.hold]
            before = data.qvel[6:].copy()
            mujoco.mj_step(theirs, data)
            work += theirs.opt.timestep * np.maximum(0, data.actuator_force * (before + data.qvel[6:]) / 2).sum()
        assert energy == pytest.approx(work, rel=0.02)


@pytest.mark.parametrize(
    ("given", "world"),
    [
        ({}, None),
        ({"text": WEAK}, None),
        ({"text": RUBS}, None),
        ({"text": SPRINGY}, "water:1"),
        ({"text": STOPPED}, None),
        (IDEAL, None),
        ({"text": WEAK, **IDEAL}, "rough:0.02"),
        ({"text": RUBS, **IDEAL}, None),
        ({"text": STOPPED, **IDEAL}, "sand:2e4"),
        ({"text": RUBS.replace('"-60 60"', '"-12 12"'), **IDEAL}, None),
        ({"reflexes": SENSES}, None),
        ({"controller": "network", "light": (2.0, 0.0, 0.0), **IDEAL}, None),
        ({"body_sizes": {"front": Free(0.5, 2.0)}, "hinge_stiffness": {"rear": Free(0.5, 2.0)}}, None),
        ({"body_sizes": {"*": Free(0.5, 2.0)}, **IDEAL}, None),
    ],
)
def test_derivatives_agree_with_differences(given, world):
    robot, terrain = robot_of(**given), None if world is None else Terrain.parse(world)
    points = some_points(robot, 2, seed=3)
    outcome = robot.differentiate(points, terrain or robot.worlds[0], measures=["energy"], compute=Compute.given(HERE))
    assert outcome.measures["energy"] == pytest.approx(energies(robot, points, terrain), rel=1e-9)
    direction = np.random.default_rng(3).normal(size=points.shape[1])
    slopes = outcome.gradients["energy"] @ direction
    near = []
    for step in (1e-5, 1e-6, 1e-7):  # an event within the longer ones is a kink
        ahead, behind = (energies(robot, points + side * step * direction, terrain) for side in (1, -1))
        near.append(np.abs((ahead - behind) / (2 * step) - slopes) / np.abs(slopes))
    assert (np.min(near, axis=0) < 2e-5).all()


def test_a_search_finds_gaits_that_need_less(tmp_path, morpholab):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    line = "codesign --robot crawler.xml --duration 0.3 --friction inf --method gradient --quiet --generations 4"
    for name, more in (("fast", ""), ("thrifty", "--objective minimise:0.1*energy")):
        code, _, error = morpholab(f"{line} --objective speed {more} --out {name}")
        assert code == 0, error
    used = {}
    for name in ("fast", "thrifty"):
        code, out, error = morpholab(f"simulate --robot {name} --json")
        assert code == 0, error
        used[name] = json.loads(out)["energy"]
    assert 0 < used["thrifty"] < 0.5 * used["fast"] and math.isfinite(used["fast"])


def cost_of_transport(motion):
    """Energy for a weight and a metre; of robots that hardly move that for a centimetre."""
    way = (motion.centres(motion.ended) - motion.centres(motion.began)) @ motion.heading
    return motion.energy / (9.81 * motion.masses.sum() * np.sqrt(way**2 + 1e-4))


def test_a_measure_of_ones_own_may_have_the_energy():
    robot = robot_of(own_measures=(OwnMeasure("cost", law=cost_of_transport),), body_sizes={"front": Free(0.5, 2.0)})
    points = some_points(robot, 2, seed=3)
    world, compute = robot.worlds[0], Compute.given(HERE)
    outcome = robot.differentiate(points, world, measures=["cost"], compute=compute)
    masses = np.array([tree.masses.sum() for tree in outcome.result.trees])
    way = np.sqrt(outcome.measures["distance"] ** 2 + 1e-4)
    assert outcome.measures["cost"] == pytest.approx(outcome.measures["energy"] / (9.81 * masses * way))
    direction = np.random.default_rng(3).normal(size=points.shape[1])
    ahead, behind = (
        robot.simulate(points + side * 1e-6 * direction, world, compute=compute).measures["cost"] for side in (1, -1)
    )
    assert outcome.gradients["cost"] @ direction == pytest.approx((ahead - behind) / 2e-6, rel=2e-5)


def test_a_measure_of_ones_own_may_be_called_energy_as_those_of_older_runs_are():
    robot = robot_of(own_measures=(OwnMeasure("energy", law=lambda motion: 2.0 * motion.energy),))
    points = some_points(robot, 2)
    assert [measure.name for measure in robot.measures] == ["speed", "distance", "mass", "torque_limits", "energy"]
    found = robot.differentiate(points, robot.worlds[0], measures=["energy"], compute=Compute.given(HERE))
    plain = robot_of().differentiate(points, robot.worlds[0], measures=["energy"], compute=Compute.given(HERE))
    assert found.measures["energy"] == pytest.approx(2 * plain.measures["energy"])
    assert found.gradients["energy"] == pytest.approx(2 * plain.gradients["energy"])
