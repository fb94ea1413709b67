"""A gait in several worlds, in one batch where they can share one."""

from dataclasses import replace

import numpy as np
import pytest

from robots.inflatable import ROLLING, InflatableActuation, InflatableGeometry, simulate
from robots.inflatable.robot import InflatableRobot
from robots.robot import Compute, Trial
from robots.uncertainty import Perturbation
from robots.world import Terrain

SHORT = replace(ROLLING, schedule=ROLLING.schedule.cut(2, 1))
QUICK = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=200, settle_steps=100)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
WORLDS = [*map(Terrain.parse, ("flat", "hill:5", "water", "rough:0.004")), Terrain(high_friction=0.7, low_friction=0.5)]
DRAWS = [
    Perturbation(levels=(0.9,) * 8),
    Perturbation(timing=0.9),
    Perturbation(timing=1.1),
    Perturbation(),
    Perturbation(gripping=0.9),
]


@pytest.mark.kernels
@pytest.mark.parametrize(("copies", "noise"), [(1, 1e-5), (2, 1e-5), (2, 0.0)])
@pytest.mark.parametrize("draws", [[], DRAWS])
def test_a_batch_of_worlds_has_the_bits_of_one_after_the_other(copies, noise, draws):
    """Measures, steps and frames; with noise, each of several copies has its own in every world."""
    robot = InflatableRobot(SHORT, perturbation=noise)
    vars(robot)["parts"] = TINY, QUICK
    points, trial = np.zeros((copies, 0)), Trial(WORLDS[0], Compute(threads=1), record_every=500)
    variants = [robot.perturbed(drawn) for drawn in draws]
    for variant in variants:
        vars(variant)["parts"] = TINY, QUICK
    found = robot.run_in(points, WORLDS, trial, variants)
    for number, (world, mine) in enumerate(zip(WORLDS, found, strict=True)):
        one = variants[number] if variants else robot
        alone = one.run(points, replace(trial, world=world))
        assert mine.status.tolist() == ["ok"] * copies and np.array_equal(mine.steps, alone.steps)
        for one, other in ((mine.measures, alone.measures), (mine.frames, alone.frames)):
            assert one.keys() == other.keys() and one
            assert all(np.array_equal(one[name], other[name]) for name in one)
    if not draws and copies == 1:
        plain = simulate(SHORT, WORLDS[-1], geometry=TINY, actuation=QUICK, perturbation=noise, threads=1)
        assert np.array_equal(found[-1].measures["distance"], plain.distance)
    assert len({float(each.measures["distance"][0]) for each in found}) == len(WORLDS)
