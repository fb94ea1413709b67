"""Schedules with levels between 0 and 1."""

import dataclasses

import numpy as np
import pytest
from graded import tabled
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.inflatable import INCHING
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import ROWS, GaitSchedule

columns = st.integers(1, 5)
on_off_schedules = st.builds(GaitSchedule, columns.flatmap(lambda n: arrays(bool, (ROWS, n))), st.integers(1, 3))
levels = columns.flatmap(lambda n: arrays(float, (ROWS, n), elements=st.floats(0, 1)))


def of_levels(table: np.ndarray, repeats: int = 2) -> GaitSchedule:
    return tabled(table[:8], table[8:], repeats)


HALF = tabled(np.full((8, 3), 0.5), np.full((2, 3), 0.5))


@given(on_off_schedules, st.floats(0.01, 1))
def test_on_and_off_are_levels(schedule, threshold):
    assert schedule.is_on_off and schedule.skip_idle and not schedule.has_own_times
    assert schedule.indecision == 0.0
    waiting = dataclasses.replace(schedule, skip_idle=False)
    assert waiting != schedule and waiting.project(threshold) == schedule
    assert waiting.is_on_off and np.array_equal(waiting.bits, schedule.bits)


def test_only_plain_schedules_of_on_and_off_skip_idle_columns():
    plain = INCHING.schedule
    assert plain.skip_idle
    others = {"core_pressure": np.ones(8), "motion_steps": np.ones(8), "settle_steps": np.ones(8)}
    assert not any(dataclasses.replace(plain, **{name: table}).skip_idle for name, table in others.items())
    assert not dataclasses.replace(plain, levels=plain.levels / 2).skip_idle


def test_levels_between_have_no_bits():
    with pytest.raises(ValueError, match=r"^schedule: levels between 0 and 1 are no bits; .*$"):
        _ = HALF.bits
    with pytest.raises(ValueError, match=r"^schedule: levels between 0 and 1 are no bits; .*$"):
        HALF.to_codes()


@given(levels, st.floats(0, 1))
def test_projection_is_on_where_levels_reach_the_threshold(table, threshold):
    assert np.array_equal(of_levels(table).project(threshold).bits, table >= threshold)


@given(levels, st.floats(0, 200))
def test_sharpening_moves_levels_away_from_the_middle_and_keeps_their_order(table, sharpness):
    sharp = of_levels(table).sharpened(sharpness).levels
    assert (np.sign(table - 0.5) * (sharp - table) >= -1e-12).all()
    assert ((sharp >= 0) & (sharp <= 1)).all()
    order = np.argsort(table, axis=None)
    assert (np.diff(sharp.ravel()[order]) >= -1e-15).all()
    assert of_levels(table).sharpened(sharpness).indecision <= of_levels(table).indecision + 1e-12


@given(st.floats(1e-3, 500))
def test_sharpening_keeps_off_halfway_and_on(sharpness):
    table = np.tile([0.0, 0.5, 1.0], (ROWS, 1))
    assert of_levels(table).sharpened(sharpness).levels.tolist() == table.tolist()


@given(levels)
def test_no_sharpness_is_the_identity_and_little_nearly_so(table):
    gait = of_levels(table)
    assert np.array_equal(gait.sharpened(0.0).levels, table)
    assert gait.sharpened(1e-4).levels == pytest.approx(table, abs=1e-8)
    assert gait.sharpening_slope(1e-4) == pytest.approx(gait.sharpening_slope(0.0), abs=1e-8)


def test_great_sharpness_decides():
    assert HALF.sharpened(1e3).indecision == 1.0
    almost = tabled(np.full((8, 1), 0.52), np.full((2, 1), 0.47)).sharpened(1e3)
    assert almost.inflation == pytest.approx(1.0) and almost.grip == pytest.approx(0.0)


@given(st.integers(0, 1000), st.floats(0, 30))
def test_the_slope_of_sharpening_agrees_with_differences(seed, sharpness):
    table, h = np.random.default_rng(seed).uniform(0.01, 0.99, (ROWS, 2)), 1e-6
    change = of_levels(table + h).sharpened(sharpness).levels - of_levels(table - h).sharpened(sharpness).levels
    assert of_levels(table).sharpening_slope(sharpness) == pytest.approx(change / (2 * h), rel=1e-6, abs=1e-8)


def test_sharpening_keeps_the_core_pressure_and_projection_refuses_it():
    gait = dataclasses.replace(HALF, core_pressure=[0.0, 1e3, 2e3])
    assert gait.sharpened(3.0).core_pressure.tolist() == [0.0, 1e3, 2e3]
    with pytest.raises(ValueError, match=r"^core_pressure: one per column is not allowed; .*$"):
        gait.project()


def test_tables_are_read_only_copies():
    table = np.full((ROWS, 2), 0.3)
    gait = of_levels(table)
    table[:] = 1.0
    assert (gait.levels == 0.3).all()
    for kept in (gait.inflation, gait.grip):
        with pytest.raises(ValueError, match="read-only"):
            kept[0, 0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: tabled(np.zeros((7, 2)), np.zeros((2, 2))), r"inflation: shape \(7, 2\) is not allowed"),
        (lambda: tabled(np.zeros((8, 0)), np.zeros((2, 0))), r"inflation: shape \(8, 0\) is not allowed"),
        (
            lambda: tabled(np.zeros((8, 2)), np.zeros((2, 3))),
            r"grip: shape \(2, 3\) is not .*give .*\(2, 2\)",
        ),
        (lambda: tabled("much", np.zeros((2, 2))), "inflation: 'much' is not allowed"),
        (
            lambda: tabled(np.full((8, 1), 1.1), np.zeros((2, 1))),
            "inflation: 1.1 of bladder1, column 1 is not allowed; .* 0 to 1",
        ),
        (lambda: tabled(np.zeros((8, 1)), np.full((2, 1), np.nan)), "grip: nan is not allowed"),
        (lambda: dataclasses.replace(HALF, repeats=0), "repeats: 0 is not allowed"),
        (
            lambda: dataclasses.replace(HALF, core_pressure=[1.0]),
            r"core_pressure: shape \(1,\) .*\(3,\)",
        ),
        (
            lambda: dataclasses.replace(HALF, core_pressure=[0.0, 0.0, 15_001.0]),
            "core_pressure: 15001.0 of column 3 is not",
        ),
        (lambda: HALF.sharpened(-1.0), "sharpness: -1.0 is not allowed"),
        (lambda: HALF.sharpening_slope(np.inf), "sharpness: inf is not allowed"),
        (lambda: HALF.project(1.5), "threshold: 1.5 is not allowed"),
        (lambda: InflatableDesign(-1.0, 0.0, HALF), "pressure: -1.0 is not allowed"),
        (lambda: InflatableDesign(0.0, 90.5, HALF), "orientation: 90.5 is not allowed"),
        (lambda: InflatableDesign(0.0, 0.0, HALF.levels), "schedule: ndarray is not allowed; give a GaitSchedule"),
    ],
)
def test_bad_values_are_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}.*$"):
        build()
