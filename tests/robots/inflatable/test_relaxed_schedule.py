import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.inflatable import INCHING, ROLLING
from robots.inflatable.relaxed_schedule import RelaxedDesign, RelaxedSchedule
from robots.inflatable.schedule import ROWS, GaitSchedule

columns = st.integers(1, 5)
binary_schedules = st.builds(GaitSchedule, columns.flatmap(lambda n: arrays(bool, (ROWS, n))), st.integers(1, 3))
levels = columns.flatmap(lambda n: arrays(float, (ROWS, n), elements=st.floats(0, 1)))


def relaxed(table: np.ndarray, repeats: int = 2) -> RelaxedSchedule:
    return RelaxedSchedule(table[:8], table[8:], repeats)


HALF = RelaxedSchedule(np.full((8, 3), 0.5), np.full((2, 3), 0.5))


@given(binary_schedules, st.floats(0.01, 1))
def test_a_binary_gait_survives_relaxation(schedule, threshold):
    gait = RelaxedSchedule.from_schedule(schedule)
    assert gait.project(threshold) == schedule
    assert gait.indecision == 0.0
    assert gait.columns == schedule.columns


@pytest.mark.parametrize("design", [INCHING, ROLLING])
def test_a_design_survives_relaxation(design):
    assert RelaxedDesign.from_design(design).project() == design


@given(levels, st.floats(0, 1))
def test_projection_is_on_where_levels_reach_the_threshold(table, threshold):
    assert np.array_equal(relaxed(table).project(threshold).bits, table >= threshold)


@given(levels, st.floats(0, 200))
def test_sharpening_moves_levels_away_from_the_middle_and_keeps_their_order(table, sharpness):
    sharp = relaxed(table).sharpened(sharpness).levels
    assert (np.sign(table - 0.5) * (sharp - table) >= -1e-12).all()
    assert ((sharp >= 0) & (sharp <= 1)).all()
    order = np.argsort(table, axis=None)
    assert (np.diff(sharp.ravel()[order]) >= -1e-15).all()
    assert relaxed(table).sharpened(sharpness).indecision <= relaxed(table).indecision + 1e-12


@given(st.floats(1e-3, 500))
def test_sharpening_keeps_off_halfway_and_on(sharpness):
    table = np.tile([0.0, 0.5, 1.0], (ROWS, 1))
    assert relaxed(table).sharpened(sharpness).levels.tolist() == table.tolist()


@given(levels)
def test_no_sharpness_is_the_identity_and_little_nearly_so(table):
    gait = relaxed(table)
    assert np.array_equal(gait.sharpened(0.0).levels, table)
    assert gait.sharpened(1e-4).levels == pytest.approx(table, abs=1e-8)
    assert gait.sharpening_slope(1e-4) == pytest.approx(gait.sharpening_slope(0.0), abs=1e-8)


def test_great_sharpness_decides():
    assert HALF.sharpened(1e3).indecision == 1.0
    almost = RelaxedSchedule(np.full((8, 1), 0.52), np.full((2, 1), 0.47)).sharpened(1e3)
    assert almost.inflation == pytest.approx(1.0) and almost.grip == pytest.approx(0.0)


@given(st.integers(0, 1000), st.floats(0, 30))
def test_the_slope_of_sharpening_agrees_with_differences(seed, sharpness):
    table, h = np.random.default_rng(seed).uniform(0.01, 0.99, (ROWS, 2)), 1e-6
    change = relaxed(table + h).sharpened(sharpness).levels - relaxed(table - h).sharpened(sharpness).levels
    assert relaxed(table).sharpening_slope(sharpness) == pytest.approx(change / (2 * h), rel=1e-6, abs=1e-8)


def test_sharpening_keeps_the_core_pressure_and_projection_refuses_it():
    gait = dataclasses.replace(HALF, pressure=[0.0, 1e3, 2e3])
    assert gait.sharpened(3.0).pressure.tolist() == [0.0, 1e3, 2e3]
    with pytest.raises(ValueError, match=r"^pressure: one per column is not allowed; .*$"):
        RelaxedDesign(0.0, 0.0, gait).project()


def test_tables_are_read_only_copies():
    table = np.full((ROWS, 2), 0.3)
    gait = relaxed(table)
    table[:] = 1.0
    assert (gait.levels == 0.3).all()
    for kept in (gait.inflation, gait.grip):
        with pytest.raises(ValueError, match="read-only"):
            kept[0, 0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: RelaxedSchedule(np.zeros((7, 2)), np.zeros((2, 2))), r"inflation: shape \(7, 2\) is not allowed"),
        (lambda: RelaxedSchedule(np.zeros((8, 0)), np.zeros((2, 0))), r"inflation: shape \(8, 0\) is not allowed"),
        (lambda: RelaxedSchedule(np.zeros((8, 2)), np.zeros((2, 3))), r"grip: shape \(2, 3\) is not .*give .*\(2, 2\)"),
        (lambda: RelaxedSchedule("much", np.zeros((2, 2))), "inflation: str is not allowed"),
        (lambda: RelaxedSchedule(np.full((8, 1), 1.1), np.zeros((2, 1))), "inflation: 1.1 is not allowed; .* 0 to 1"),
        (lambda: RelaxedSchedule(np.zeros((8, 1)), np.full((2, 1), np.nan)), "grip: nan is not allowed"),
        (lambda: dataclasses.replace(HALF, repeats=0), "repeats: 0 is not allowed"),
        (lambda: dataclasses.replace(HALF, pressure=[1.0]), r"pressure: shape \(1,\) is not allowed; .*\(3,\)"),
        (lambda: dataclasses.replace(HALF, pressure=[0.0, 0.0, 15_001.0]), "pressure: 15001.0 is not .* 0 to 15000"),
        (lambda: HALF.sharpened(-1.0), "sharpness: -1.0 is not allowed"),
        (lambda: HALF.sharpening_slope(np.inf), "sharpness: inf is not allowed"),
        (lambda: HALF.project(1.5), "threshold: 1.5 is not allowed"),
        (lambda: RelaxedDesign(-1.0, 0.0, HALF), "pressure: -1.0 is not allowed"),
        (lambda: RelaxedDesign(0.0, 90.5, HALF), "orientation: 90.5 is not allowed"),
        (lambda: RelaxedDesign(0.0, 0.0, INCHING.schedule), "schedule: GaitSchedule is not allowed"),
    ],
)
def test_bad_values_are_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=f"^{message}.*$"):
        build()
