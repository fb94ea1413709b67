"""Freeform robots whose friction, muscles and period are not known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from robots.freeform import FreeformActuation, FreeformRobot, Grid
from robots.robot import Trial
from robots.uncertainty import Perturbation
from robots.world import Terrain
from taichi_sim.base.compute import Compute

HILL = Terrain(5.0)


def robot(amplitude: float = 0.25, full: bool = True) -> FreeformRobot:
    muscles = FreeformActuation(amplitude=amplitude, cycles=1, settling=0.02)
    return FreeformRobot(Grid((3, 2, 2)), actuation=muscles, full=full)


def drawn(level: float, **more) -> Perturbation:
    return Perturbation(levels=(level,) * 12, **more)


def test_amplitudes_friction_and_period_are_multiplied():
    point = robot().start
    fixed, changed = (
        each.design(point) for each in (robot(), robot().perturbed(drawn(1.5, gripping=0.8, timing=1.25)))
    )
    assert changed.frequency == pytest.approx(fixed.frequency / 1.25)
    for name in ("static_friction", "kinetic_friction"):
        assert getattr(changed.body.materials[0], name) == 0.8 * getattr(fixed.body.materials[0], name)
    amplitudes = [[np.max(drive.amplitude) for drive in each.drives] for each in (fixed, changed)]
    assert np.array_equal(amplitudes[1], 1.5 * np.array(amplitudes[0]))


@pytest.mark.kernels
def test_a_search_draws_what_a_judge_draws():
    """Of muscles that may go further than most, too."""
    strong, draw = robot(0.45), drawn(1.4)
    point = strong.start[None]
    searched = strong.perturbed(draw).run(point, Trial(HILL))
    judged = strong.design(point[0]).perturbed(draw).simulate(np.zeros((1, 0)), HILL)
    assert searched.status[0] == "ok" and searched.measures["speed"][0] == judged.measures["speed"][0]


def test_what_is_drawn_is_no_part_of_a_description():
    assert robot().describe() == robot().perturbed(drawn(1.1)).describe()


@pytest.mark.kernels
@pytest.mark.parametrize("full", [True, False])
def test_levels_are_those_of_the_actuation_multiplied_by_hand(full):
    found, expected = (
        each.run(each.start[None], Trial(HILL, gradients=("speed",), sharpness=np.inf if full else 2.0))
        for each in (robot(full=full).perturbed(drawn(1.5)), robot(0.375, full))
    )
    assert found.status[0] == "ok"
    assert np.array_equal(found.measures["speed"], expected.measures["speed"])
    # Amplitudes are told in edges: the same change of one is a larger change of what muscles do.
    by_hand = [1.5 if "amplitude" in parameter.name else 1.0 for parameter in robot(full=full).parameters]
    assert found.gradients["speed"] == pytest.approx(expected.gradients["speed"] * by_hand, rel=1e-9)


@pytest.mark.kernels
@pytest.mark.parametrize("gradients", [(), ("speed",)])
@pytest.mark.parametrize("sharpness", [np.inf, 2.0])
def test_draws_in_several_worlds_share_a_batch_with_the_bits_of_one_after_the_other(sharpness, gradients):
    """Of two designs of other cells, and of mixtures; on a hill, and on ground with a friction of its own."""
    free, generator = robot(full=False), np.random.default_rng(2)
    ends = np.array([(each.low, each.high) for each in free.parameters]).T
    points = generator.uniform(*ends, (2, len(free.parameters)))
    draws = [drawn(0.8, gripping=0.7, slope=1.0), drawn(1.2), drawn(1.1, timing=0.8)]
    grounds = [HILL, Terrain(static_friction=0.6, kinetic_friction=0.4), HILL]
    worlds = [free.drawn_terrain(ground, draw) for draw, ground in zip(draws, grounds, strict=True)]
    trial = Trial(HILL, Compute(threads=1), gradients=gradients, sharpness=sharpness)
    variants = [free.perturbed(draw) for draw in draws]
    for draw, world, found in zip(draws, worlds, free.run_in(points, worlds, trial, variants), strict=True):
        alone = free.perturbed(draw).run(points, replace(trial, world=world))
        assert found.status.tolist() == alone.status.tolist() and "ok" in found.status
        for mine, other in ((found.measures, alone.measures), (found.gradients, alone.gradients)):
            assert mine.keys() == other.keys()
            assert all(np.array_equal(mine[name], other[name], equal_nan=True) for name in mine)
