"""Robots that swell in water take time steps that are stable there; on the ground theirs stay."""

import dataclasses

import numpy as np
import pytest

from robots.freeform import FreeformRobot
from robots.lattice_robot import Drive, Free, LatticeRobot, Reflexes
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.simulation import simulate
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, Material

EDGE = 0.01
LIGHT = Material(1e5, 600.0, static_friction=1.0, kinetic_friction=0.8, name="light")
WATER = Terrain.water()


def block(size, *drives, material=LIGHT, **fields):
    voxels = np.argwhere(np.ones(size))
    body = LatticeBody(voxels, (material,), [0] * len(voxels), EDGE, regions=voxels[:, 0] >= size[0] // 2)
    return LatticeRobot(body, drives, **{"cycles": 1, "settling": 0.1, **fields})


def size_of(*drives, material=LIGHT, **fields):
    return block((2, 1, 1), *drives, material=material, **fields).size_range[1]


@pytest.mark.kernels
@pytest.mark.parametrize(("mean", "amplitude"), [(1.15, 0.05), (1.0, 0.2), (1.0, 0.3), (1.3, 0.2)])
def test_half_the_step_changes_little_in_water(mean, amplitude):
    robot = block((5, 5, 5), Drive("all", (0, 1), mean=mean, amplitude=amplitude, phase=(0.1, 0.4)), perturbation=1e-5)
    both = (robot, dataclasses.replace(robot, time_step_safety=2.6))
    found = [simulate(each, terrain=WATER).measures for each in both]
    assert found[0]["energy"] == pytest.approx(found[1]["energy"], rel=2e-3)
    assert found[0]["distance"] == pytest.approx(found[1]["distance"], rel=1e-2, abs=1e-6)


@pytest.mark.kernels
def test_a_swollen_plate_has_the_draught_of_archimedes():
    robot = block((8, 8, 3), Drive("all", (0, 1), mean=1.2), settling=4.0, cycles=1, frequency=2.0)
    found = simulate(robot, terrain=Terrain.parse("flat+water:0.2"), record_every=100)
    x = found.frames[0].positions[-1, 0]
    weight, area = 600.0 * 8 * 8 * 3 * EDGE**3, np.prod(np.ptp(x[:, :2], axis=0) + 1.2 * EDGE)
    lower = x[:, 2].mean() - 1.5 * 1.2 * EDGE
    assert 0.2 - EDGE / 2 - lower == pytest.approx(weight / 1000.0 / area, abs=3e-4)


def test_sizes_are_the_largest_that_drives_and_answers_reach():
    assert size_of(Drive("a", (0,), amplitude=(Free(-0.3, 0.2),))) == 1.3
    assert size_of(Drive("a", (0,), mean=(Free(0.9, 1.1),), amplitude=0.1)) == pytest.approx(1.2)
    assert size_of(Drive("a", (0,), mean=0.8, amplitude=0.1)) == 1.0  # it settles from its own size
    assert size_of(Drive("a", (0,), amplitude=0.1, knots=(0.0, Free(-3.0, 1.0)))) == pytest.approx(1.3)
    assert size_of(Drive("a", (0,), amplitude=0.1, axes="zx", proportions=(1.0, -2.0))) == pytest.approx(1.2)
    assert size_of(Drive("a", (0,), "friction", mean=0.5)) == 1.0
    warm = dataclasses.replace(LIGHT, thermal_expansion=0.01, scale=(1.0, 1.1, 1.0))
    hot = Drive("a", (0,), "temperature", amplitude=20.0)
    assert size_of(hot, material=warm) == pytest.approx(1.1 * 1.2)
    swung = Drive("a", (0,), amplitude=0.1)
    assert size_of(swung, reflexes=Reflexes(gain=0.05)) == pytest.approx(1.15)
    assert size_of(swung, reflexes=Reflexes(gain=0.5, kind="oscillators")) == pytest.approx(1.15)


def test_steps_are_shorter_in_water_alone_and_those_of_the_search():
    robot = block((2, 1, 1), Drive("a", (0,), amplitude=Free(0.0, 0.3)))
    stable = robot.body.recommended_time_step / 1.3
    for ground in ("flat", "sand:2e5", "hill:5"):
        assert robot.on(Terrain.parse(ground)).cycle == robot.cycle
    assert stable * 0.99 < robot.cycle.time_step <= stable
    for wet in (WATER, Terrain.parse("flat+water:0.2")):
        assert 0.98 * stable / 1.89 < robot.on(wet).cycle.time_step <= stable / 1.89
    design = robot.filled([0.1])
    assert design.on(WATER).cycle == robot.on(WATER).cycle
    assert robot_of_record(design.describe()).on(WATER).cycle == robot.on(WATER).cycle
    still = block((2, 1, 1), Drive("a", (0,), amplitude=0.1))
    assert "highest_size" not in still.describe() and still.on(WATER).on(Terrain()).cycle == still.cycle
    with pytest.raises(ValueError, match="highest_size"):
        dataclasses.replace(robot, highest_size=0.0)


def test_designs_of_freeform_robots_keep_the_steps_of_all():
    robot = FreeformRobot()
    assert robot.largest_size == pytest.approx(1.2, abs=1e-3)
    assert robot.cycle_on(Terrain()) == robot.cycle
    share = robot.cycle.time_step / robot.cycle_on(WATER).time_step
    assert share == pytest.approx(1.64, abs=0.03)
    built = robot.design(robot.start)
    assert built.on(WATER).cycle == robot.cycle_on(WATER) and built.cycle == robot.cycle


@pytest.mark.kernels
@pytest.mark.parametrize("least", [0.3, 0.2])
def test_robots_whose_voxels_shrink_much_gain_no_energy(least):
    robot = block(
        (6, 3, 2), Drive("all", (0, 1), mean=least + 0.2, amplitude=0.2, phase=(0.1, 0.35)), cycles=2, frequency=1.0
    )
    both = (robot, dataclasses.replace(robot, time_step_safety=2.6))
    found = [simulate(each).measures for each in both]
    assert found[0]["energy"] == pytest.approx(found[1]["energy"], rel=0.02)


def test_the_smallest_sizes_are_those_that_drives_and_answers_reach():
    wide = block((2, 1, 1), Drive("a", (0,), amplitude=(Free(0.1, 0.7),)))
    assert wide.size_range == (pytest.approx(0.3), 1.7)
    assert block((2, 1, 1), Drive("a", (0,), amplitude=0.95)).size_range[0] == 0.1  # smaller ones are refused
    small = dataclasses.replace(LIGHT, scale=(1.0, 0.4, 1.0))
    assert block((2, 1, 1), Drive("a", (0,), "friction", mean=0.5), material=small).size_range[0] == 0.4
    design = wide.design([0.2])
    assert design.size_range == wide.size_range and design.cycle.time_step == wide.cycle.time_step
    usual = block((2, 1, 1), Drive("a", (0,), amplitude=0.5))
    assert usual.cycle.time_step == block((2, 1, 1), Drive("a", (0,), amplitude=0.1)).cycle.time_step
