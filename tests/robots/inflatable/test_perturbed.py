"""Bladders that inflate less or more, slower or faster than they are told."""

import dataclasses

import numpy as np
import pytest

from robots.inflatable import ROLLING, InflatableActuation, InflatableDesign, InflatableGeometry, simulate
from robots.inflatable.gradient import differentiate
from robots.inflatable.perturbed import level_slopes, perturbed_design, perturbed_drive
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import counted_steps, gait_steps, nominal_steps
from robots.uncertainty import Perturbation
from robots.world import Terrain

QUICK = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=200, settle_steps=100)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
HILL = Terrain(5.0)
MORE = Perturbation(levels=(1.05,) * 8)


def graded(seed: int, columns: int = 2, **tables) -> InflatableDesign:
    levels = np.random.default_rng(seed).uniform(0.1, 0.9, (10, columns))
    return InflatableDesign(2e3, 40.0, GaitSchedule(levels, 1, skip_idle=False, **tables))


def events(design: InflatableDesign, actuation: InflatableActuation) -> np.ndarray:
    return build_program([design], HILL, actuation).events


@pytest.mark.parametrize("design", [graded(1), ROLLING])
@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_levels_are_those_multiplied_by_hand(design, factor):
    levels = design.schedule.levels.copy()
    levels[:8] = np.minimum(levels[:8] * factor, 1.0)
    by_hand = GaitSchedule(levels, design.schedule.repeats, skip_idle=False)
    found = perturbed_design(design, Perturbation(levels=(factor,) * 8))
    assert found == dataclasses.replace(design, schedule=by_hand)
    assert np.array_equal(events(found, QUICK), events(dataclasses.replace(design, schedule=by_hand), QUICK))


def test_every_bladder_has_a_factor_of_its_own_and_none_more_than_full():
    factors = tuple(np.linspace(0.8, 1.2, 8).tolist())
    found = perturbed_design(graded(1), Perturbation(levels=factors)).schedule
    told = graded(1).schedule
    assert np.array_equal(found.inflation, np.minimum(told.inflation * np.array(factors)[:, None], 1.0))
    assert np.array_equal(found.grip, told.grip) and (found.inflation <= 1).all()


def test_nothing_drawn_changes_nothing():
    assert perturbed_design(ROLLING, Perturbation(sliding=0.9)) is ROLLING
    assert perturbed_drive(QUICK, Perturbation(slope=1.0)) is QUICK


def test_strokes_and_waits_last_as_long_as_drawn():
    slow, own = Perturbation(timing=1.2), graded(1, motion_steps=[50, 60], settle_steps=[100, 5])
    drive = perturbed_drive(QUICK, slow)
    assert (drive.inflation_rate, drive.settle_steps) == (pytest.approx(0.025), 120)
    found = perturbed_design(own, slow).schedule
    assert found.motion_steps.tolist() == [60, 72] and found.settle_steps.tolist() == [120, 6]
    # Published gaits have no times of their own: their speed is counted by those of the robot that plays them.
    assert counted_steps(ROLLING.schedule, drive) == nominal_steps(16, drive) > nominal_steps(16, QUICK)
    assert gait_steps(ROLLING.schedule, drive) == pytest.approx(1.2 * gait_steps(ROLLING.schedule, QUICK), rel=0.02)


def test_slopes_are_the_factors_where_bladders_are_not_cut():
    design = graded(1)
    drawn = Perturbation(levels=(0.9, *(1.3,) * 7))
    move = 1e-7 * np.ones_like(design.schedule.levels)
    up, down = (
        perturbed_design(dataclasses.replace(design, schedule=GaitSchedule(design.schedule.levels + m, 1)), drawn)
        for m in (move, -move)
    )
    expected = (up.schedule.levels - down.schedule.levels) / 2e-7
    assert level_slopes(design, drawn) == pytest.approx(expected, abs=1e-6)
    assert np.isin([0.0, 0.9, 1.3], level_slopes(design, drawn)[:8]).all()


@pytest.mark.kernels
def test_a_batch_with_drives_of_its_own_does_what_each_does_alone():
    drawn = [Perturbation(timing=0.95, levels=(1.05,) * 8), Perturbation(timing=1.05, levels=(0.95,) * 8)]
    designs = [perturbed_design(graded(2), one) for one in drawn]
    drives = [perturbed_drive(QUICK, one) for one in drawn]
    together = simulate(designs, HILL, geometry=TINY, actuation=drives)
    run = differentiate(designs, HILL, geometry=TINY, actuation=drives)
    assert np.array_equal(run.result.distance, together.distance)
    for n, (design, drive) in enumerate(zip(designs, drives, strict=True)):
        alone = simulate(design, HILL, geometry=TINY, actuation=drive)
        assert (alone.distance[0], alone.speed[0]) == (together.distance[n], together.speed[n])
        slopes = differentiate([design], HILL, geometry=TINY, actuation=drive)
        assert np.array_equal(slopes.levels[0], run.levels[n])


def test_bad_drives_are_refused_in_one_line():
    for given, message in (
        ([QUICK], "actuation: 1 are not allowed for 2 designs; give one, or one each"),
        ([QUICK, None], "actuation: None is not allowed; give an InflatableActuation, such as ACTUATION"),
    ):
        with pytest.raises(ValueError) as error:
            simulate([ROLLING, ROLLING], HILL, geometry=TINY, actuation=given)
        assert str(error.value) == message
