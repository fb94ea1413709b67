"""Worlds of different ground, slope and light in one batch."""

import dataclasses

import numpy as np
import pytest

from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.lattice_robot import simulation as trying
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.scenes import sharing
from robots.robot import Compute, Trial
from robots.uncertainty import Perturbation
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array

SOFT = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, collision_damping=0.5)
LIGHTS = "light:0.05,0.02", "light:0.04,-0.03", "light:-0.05,0.01", "light:0.1,0.0"


def crawler(**settings) -> LatticeRobot:
    """Five voxels in two muscles that feel the ground and the light."""
    array = np.ones((3, 2, 1), int)
    array[2, 1, 0] = 0
    body = body_from_array(array, SOFT, 0.01, regions=np.array([0, 1, 0, 1, 1, 0]).reshape(3, 2, 1))
    drive = Drive("legs", (0, 1), amplitude=Free(0, 0.2, 0.15), phase=(0.1, Free(0, 1, 0.4)))
    given = {"cycles": 1, "settling": 0.02, "frequency": 20.0, "reflexes": Reflexes(("touch", "slip", "light"))}
    return LatticeRobot(body, (drive,), **{**given, **settings})


def lit(*grounds: str) -> list[Terrain]:
    """Worlds of grounds, each with a light of its own."""
    return [Terrain.parse(f"{ground}+{light}") for ground, light in zip(grounds, LIGHTS, strict=False)]


def test_worlds_share_a_batch_unless_water_sand_or_a_light_part_them():
    """Flat, sloping, uneven and slippery ground do; so do two kinds of sand."""
    names = "flat", "hill:5", "sand:2e5", "rough:0.01", "water:0.01", "rough:0.01+sand:1e5", "water:0.02", "water"
    worlds = [*map(Terrain.parse, names), Terrain(static_friction=0.5, kinetic_friction=0.4), Terrain(light=(1, 0))]
    assert sharing([crawler(reflexes=None)] * len(worlds), worlds) == [[0, 1, 3, 8], [2, 5], [4, 6], [7], [9]]


FIRM = "flat", "hill:3", "rough:0.002,0.03", "patches:0.5,1,0.01"
SANDY = "sand:1e5", "rough:0.002,0.03+sand:3e4"
SLOPES = "distance", "remaining"


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("grounds", "gradients"),
    [
        (FIRM, SLOPES),
        *(pytest.param(grounds, (), marks=pytest.mark.slow) for grounds in (FIRM, SANDY)),
        pytest.param(SANDY, SLOPES, marks=pytest.mark.slow),
    ],
)
def test_a_batch_of_worlds_has_the_bits_of_one_after_the_other(grounds, gradients, monkeypatch):
    """Measures, steps and gradients, in one go, of robots that start with noise."""
    robot, worlds = crawler(perturbation=2e-5), lit(*grounds)
    generator = np.random.default_rng(3)
    points = np.stack([robot.start + generator.normal(0.0, 0.02, len(robot.start)) for _ in range(2)])
    trial = Trial(worlds[0], Compute(threads=1), gradients=gradients)
    batches, told = [], []
    moved = trying._moved
    monkeypatch.setattr(trying, "_moved", lambda *given: batches.append(len(given[1])) or moved(*given))
    together = robot.run_in(points, worlds, dataclasses.replace(trial, progress=told.append))
    assert batches == [2 * len(worlds)] and told == sorted(told) and told[-1] == pytest.approx(1.0)
    for world, found in zip(worlds, together, strict=True):
        alone = robot.run(points, dataclasses.replace(trial, world=world))
        assert found.status.tolist() == ["ok", "ok"] and np.array_equal(found.steps, alone.steps)
        for mine, other in ((found.measures, alone.measures), (found.gradients, alone.gradients)):
            assert mine.keys() == other.keys()
            for name in mine:
                assert np.array_equal(mine[name], other[name]), (world.name, name)
    assert len({found.measures["distance"][0] for found in together}) == len(worlds)


@pytest.mark.kernels
def test_measures_are_in_the_order_of_the_worlds_whatever_shares_a_batch():
    """Of a robot without reflexes, on sand between firm grounds."""
    robot, worlds = crawler(reflexes=None), [Terrain.parse(name) for name in ("flat", "sand:1e5", "hill:3")]
    found = robot.run_in(robot.start[None], worlds, Trial(worlds[0], Compute(threads=1)))
    for world, outcome in zip(worlds, found, strict=True):
        assert outcome.measures["distance"][0] == robot.simulate(robot.start[None], world).measures["distance"][0]


@pytest.mark.kernels
@pytest.mark.parametrize("gradients", [(), pytest.param(("speed",), marks=pytest.mark.slow)])
def test_draws_share_a_batch_with_the_bits_of_one_after_the_other(gradients, monkeypatch):
    """Other friction, other amplitudes of each muscle, other slopes; another period has a batch of its own."""
    robot, point = crawler(reflexes=None), crawler(reflexes=None).start[None]
    draws = [
        Perturbation(gripping=0.8, sliding=0.8, levels=(0.9, 1.1)),
        Perturbation(slope=1.5, levels=(1.1, 0.9)),
        Perturbation(gripping=1.2, sliding=1.2, timing=0.8),
    ]
    worlds = [robot.drawn_terrain(Terrain(), draw) for draw in draws]
    trial, sizes, moved = Trial(worlds[0], Compute(threads=1), gradients=gradients), [], trying._moved
    monkeypatch.setattr(trying, "_moved", lambda *given: sizes.append(len(given[1])) or moved(*given))
    together = robot.run_in(point, worlds, trial, [robot.perturbed(draw) for draw in draws])
    assert sizes == [2, 1]
    for draw, world, found in zip(draws, worlds, together, strict=True):
        alone = robot.perturbed(draw).run(point, dataclasses.replace(trial, world=world))
        for mine, other in ((found.measures, alone.measures), (found.gradients, alone.gradients)):
            assert mine.keys() == other.keys() and all(np.array_equal(mine[name], other[name]) for name in mine)
    assert len({float(found.measures["distance"][0]) for found in together}) == 3


@pytest.mark.kernels
def test_recorded_worlds_share_a_batch_with_the_frames_of_one_after_the_other():
    """Of a robot with reflexes on level and on uneven ground."""
    robot, worlds = crawler(), lit(*FIRM[:3])
    trial = Trial(worlds[0], Compute(threads=1), record_every=20)
    for world, found in zip(worlds, robot.run_in(robot.start[None], worlds, trial), strict=True):
        alone = robot.run(robot.start[None], dataclasses.replace(trial, world=world))
        assert found.frames.keys() == alone.frames.keys() and found.frames
        assert all(np.array_equal(found.frames[name], alone.frames[name]) for name in found.frames)


UNEVEN = "flat", "rough:0.03,0.05,3", "stairs:0.02,0.2,-0.05", "ramp:15,-0.1", "hill:5+rough:0.02,0.05"


def clamped(reflexes=None) -> LatticeRobot:
    """A crawler whose rear two voxels the world holds, in regions of voxels that it does not."""
    robot = crawler(reflexes=reflexes)
    fixed = np.repeat((robot.body.start_positions[:, 0] < 0.005)[:, None], 6, axis=1)
    return dataclasses.replace(robot, body=dataclasses.replace(robot.body, fixed=fixed))


@pytest.mark.kernels
@pytest.mark.parametrize("prop", ["", "+wall:0.02,0.02,0.02,0.1,0"])
def test_held_voxels_are_held_where_uneven_ground_has_raised_them(prop):
    """They sprang back to level ground, which tore robots; worlds of a batch have the bits of one after the other."""
    robot, worlds = clamped(), [Terrain.parse(f"{name}{prop}") for name in UNEVEN]
    trial = Trial(worlds[0], Compute(threads=1), record_every=20)
    level, held = robot.body.start_positions, np.asarray(robot.body.fixed)[:, 0]
    together = robot.run_in(robot.start[None], worlds, trial)
    for world, found in zip(worlds, together, strict=True):
        raised = 0.0 if world.uneven is None else world.uneven.relief(0.0, 0.01).rise(level, 0.01)
        assert (raised > 0.004) == (world.uneven is not None)
        alone = robot.run(robot.start[None], dataclasses.replace(trial, world=world))
        assert all(np.array_equal(found.frames[name], alone.frames[name]) for name in found.frames)
        places, start = found.result.frames[0].positions[:, 0, : len(level)], np.add(level, [0, 0, raised])
        assert places[:, held] == pytest.approx(np.broadcast_to(start, places.shape)[:, held], abs=1e-12)
        assert 1e-3 < np.abs(places - start)[:, ~held].max() < 0.012  # these move


@pytest.mark.kernels
def test_gradients_of_robots_that_are_held_on_uneven_ground_are_exact():
    """Of one that feels, against central differences."""
    robot, world = clamped(Reflexes(("strain", "touch"), gain=0.05)), Terrain.parse("rough:0.03,0.05,3")
    generator = np.random.default_rng(1)
    point = robot.start + np.where(np.arange(len(robot.start)) > 1, generator.normal(0.0, 0.1, len(robot.start)), 0.0)
    found = robot.differentiate(point, world, measures=SLOPES[:1], compute=Compute(threads=1))
    directions, exact = generator.normal(size=(4, len(point))), found.gradients["distance"][0]
    errors = []
    for step in (1e-6, 1e-7, 1e-8):
        points = point + step * np.concatenate([directions, -directions])
        plus, minus = np.split(robot.simulate(points, world, compute=Compute(threads=1)).measures["distance"], 2)
        errors.append(np.abs((plus - minus) / (2 * step) - directions @ exact) / np.abs(directions @ exact).max())
    assert np.min(errors, axis=0).max() < 1e-5
