"""Graded gaits for the hardware: tables, and back from the header and from the rows alone."""

import dataclasses

import numpy as np
import pytest
from graded import QUICK, TINY, graded_designs, settling, tabled, unskipped
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.hardware import PneumaticRig, RigViolation, export_csv, gait_table, read_csv, write_csv
from robots.hardware.gait_commands import rig_report
from robots.hardware.table import TIME_STEP
from robots.inflatable import ACTUATION, INCHING, simulation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.on_rig import gait_of_table
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import durations
from robots.world import Terrain

HALVES = np.array([*[[0.5, 0.0]] * 4, *[[0.0, 0.25]] * 4, [1.0, 0.5], [0.0, 1.0]])


def graded(gait: GaitSchedule, pressure: float = 6e3) -> InflatableDesign:
    return InflatableDesign(pressure, 30.0, gait)


def lasting(table) -> list[float]:
    return [state.end_s - state.start_s for state in table.timing]


def test_rows_play_the_very_numbers_of_the_design(tmp_path):
    """Though they have nine digits: also of numbers that six decimals hardly tell apart."""
    drawn = np.random.default_rng(3)
    for number in range(20):
        levels = drawn.uniform(0.0, 1.0, (10, 4))
        levels[0, 1] = levels[0, 0] + 4e-7
        design = graded(GaitSchedule(np.clip(levels, 0.0, 1.0)), float(drawn.uniform(2e3, 12e3)))
        table = gait_table(design, PneumaticRig(), on_violation="clip")
        export_csv(design, tmp_path / f"{number}.csv", on_violation="clip")
        for each in (table, read_csv(tmp_path / f"{number}.csv")):
            played = each.played()
            assert np.array_equal(played.schedule.levels, design.schedule.levels)
            assert played.pressure == design.pressure


@pytest.mark.long
@settings(max_examples=40)
@given(graded_designs, st.sampled_from(["kpa", "psi"]), st.sampled_from([None, 50.0]))
def test_any_graded_design_survives_its_table(tmp_path_factory, design, units, rate):
    """Of the header exactly; of the rows as finely as their digits tell."""
    path = tmp_path_factory.mktemp("gait") / "gait.csv"
    export_csv(design, path, units=units, rate=rate)
    read = read_csv(path)
    gait, played = design.schedule, read.played().schedule
    assert read.design == InflatableDesign(design.pressure, design.orientation, gait)
    np.testing.assert_allclose(played.levels, gait.levels, atol=1e-6)
    assert (played.repeats, played.has_own_times) == (gait.repeats, gait.has_own_times)
    assert (played.core_pressure is None) == (gait.core_pressure is None)
    if gait.core_pressure is not None:
        np.testing.assert_allclose(played.core_pressure, gait.core_pressure, atol=6e-4)
    assert read.played().pressure == pytest.approx(design.pressure, abs=6e-4)
    at_once = read.played_at_once().schedule
    for told, found in ((gait.motion_steps, at_once.motion_steps), (gait.settle_steps, at_once.settle_steps)):
        assert (told is None) == (found is None) and np.array_equal(told, found)


def test_pressures_lie_between_off_and_on():
    table = gait_table(graded(settling(HALVES, [0, 0])))
    ends = table.pressures[np.flatnonzero(np.diff(table.states))]
    first, second = ends[1].tolist(), ends[2].tolist()
    assert first == [25.0, *[10.0] * 4, *[0.0] * 4, 50.0, -80.0]
    assert second == [25.0, *[0.0] * 4, *[5.0] * 4, -15.0, 50.0]


def test_a_stroke_takes_the_part_of_the_time_that_the_level_changes_by():
    """From the shaping, in which feet grip: bladders go half their way of 2 s, then foot 2 its whole way of 1 s."""
    table = gait_table(graded(settling(HALVES, [0, 0])))
    np.testing.assert_allclose(lasting(table), [11.5, 1.0, 1.0, 1.0, 1.0, 4.7])
    slowly = settling(np.repeat([[0.1, 0.3]], 10, axis=0), [0, 0])
    table = gait_table(graded(slowly))
    np.testing.assert_allclose(lasting(table)[1:-1], [0.9, 0.4, 0.4, 0.4])
    assert [state.slowest for state in table.timing][1:3] == ["foot1", "bladder1"]


def test_states_dwell_as_long_as_columns_settle():
    settle, motion = [3000, 0], [0, 20_000]
    table = gait_table(graded(settling(HALVES, settle, 2, motion)))
    first, second = 1.0 + 3000 * TIME_STEP, 20_000 * TIME_STEP
    np.testing.assert_allclose(lasting(table), [11.5, first, second, first, second, 4.7], atol=2e-6)
    # Rows do not tell time in motion from settling.
    assert table.played().schedule.settle_steps.tolist() == [3000, round((second - 1.0) / TIME_STEP)]
    assert not table.played().schedule.motion_steps.any()


def test_a_state_without_change_lasts_as_long_as_its_column_or_the_rig_needs():
    still = np.repeat([[0.5, 0.5]], 10, axis=0)
    table = gait_table(graded(settling(still, [5000, 10])))
    np.testing.assert_allclose(lasting(table)[2:5], [0.1, 5000 * TIME_STEP, 0.1], atol=2e-6)
    assert table.played().schedule.settle_steps.tolist() == [5000, round(0.1 / TIME_STEP)]


def test_without_times_of_its_own_states_last_as_those_of_the_binary_gait():
    binary = INCHING
    ours, theirs = (gait_table(design) for design in (unskipped(binary), binary))
    np.testing.assert_array_equal(ours.times, theirs.times)
    np.testing.assert_array_equal(ours.pressures, theirs.pressures)
    assert not ours.played().schedule.has_own_times
    assert ours.played().schedule == unskipped(binary).schedule


def test_half_of_the_times_given_means_the_other_as_published():
    levels = HALVES
    gait = tabled(levels[:8], levels[8:], 1, settle_steps=[100, 200])
    least = [motion * TIME_STEP for motion, _ in durations(gait, ACTUATION)]
    expected = [max(1.0, least[0]) + 100 * TIME_STEP, max(1.0, least[1]) + 200 * TIME_STEP]
    np.testing.assert_allclose(lasting(gait_table(graded(gait)))[1:3], expected, atol=2e-6)


def test_the_main_loops_and_sampled_rows_dwell_to_whole_samples():
    design = graded(settling(HALVES, [3000, 1000], 3))
    table = gait_table(design, rate=20.0)
    sections = np.array(table.sections)
    main = table.pressures[sections == "main"]
    np.testing.assert_array_equal(main[0], main[-1])
    assert table.loops == 2
    found = table.played().schedule.settle_steps * TIME_STEP
    np.testing.assert_allclose(found, np.array([3000, 1000]) * TIME_STEP, atol=0.051)


def test_core_pressures_of_columns_are_on_the_line():
    gait = dataclasses.replace(settling(HALVES, [0, 0]), core_pressure=[12e3, 0.0])
    table = gait_table(graded(gait))
    ends = table.pressures[np.flatnonzero(np.diff(table.states)), 0]
    assert ends.tolist() == [25.0, 50.0, -80.0, 50.0, -80.0]
    assert table.played().schedule.core_pressure.tolist() == [12e3, 0.0]


def test_limits_hold_for_graded_gaits():
    rig = PneumaticRig()
    low = dataclasses.replace(rig.channels[1], maximum_kpa=8.0)
    tight = dataclasses.replace(rig, channels=(rig.channels[0], low, *rig.channels[2:]))
    design = graded(settling(HALVES, [0, 0]))
    with pytest.raises(RigViolation, match=r"^bladder1: 10 kPa at 12.3 s is not allowed; the rig's limit is 8 kPa"):
        gait_table(design, tight)
    clipped = gait_table(design, tight, on_violation="clip")
    assert clipped.pressures[:, 1].max() == 4.0 and clipped.played().schedule == design.schedule
    assert not rig_report(design).exceeded and rig_report(design, tight).exceeded
    report = rig_report(graded(settling(HALVES, [3000, 0], 2)))
    assert report.playing_s == pytest.approx(4 + 2 * 3000 * TIME_STEP, abs=1e-4) and report.states == 4


def test_tiny_changes_have_times_that_increase(tmp_path):
    levels = np.repeat([[0.5, 0.5 + 1e-9]], 10, axis=0)
    export_csv(graded(settling(levels, [0, 0])), tmp_path / "gait.csv")
    assert read_csv(tmp_path / "gait.csv").loops == 0


TIMED = {
    "settling": settling(HALVES, [3000, 10], 2),
    "held in motion": settling(HALVES, [3000, 0], 2, [0, 20_000]),
    "motion alone": tabled(HALVES[:8], HALVES[8:], 2, motion_steps=[0, 20_000]),
    "settling alone": tabled(HALVES[:8], HALVES[8:], 1, settle_steps=[3000, 0]),
    "idle for less than a rig's state": settling(np.repeat([[0.5, 0.5]], 10, axis=0), [0, 10]),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("gait", TIMED.values(), ids=TIMED)
@pytest.mark.parametrize("delay", [0.0, 0.7])
def test_an_ideal_rig_plays_gaits_with_times_of_their_own_as_designed(tmp_path, gait, delay):
    """Though states of the table wait for valves, for strokes and for the shortest state of the rig."""
    rig, design = PneumaticRig(), graded(gait)
    rig = dataclasses.replace(
        rig, channels=tuple(dataclasses.replace(each, valve_delay_s=delay) for each in rig.channels)
    )
    export_csv(design, tmp_path / "gait.csv", rig)
    assert gait_of_table(str(tmp_path / "gait.csv"), {"rig": "ideal"}) == (design, None, None)


def test_rows_that_play_another_gait_are_told(tmp_path):
    """Clipped pressures, and rows in which columns settle for less time than the header says; these are played."""
    rig = PneumaticRig()
    tight = dataclasses.replace(
        rig, channels=(dataclasses.replace(rig.channels[0], maximum_kpa=20.0), *rig.channels[1:])
    )
    export_csv(graded(settling(HALVES, [3000, 10])), tmp_path / "clipped.csv", tight, on_violation="clip")
    with pytest.warns(UserWarning, match=r"differ from the gait in its header in pressure; rows are played"):
        played, _, _ = gait_of_table(str(tmp_path / "clipped.csv"), {"rig": "ideal"})
    assert played.pressure == pytest.approx(4800.0) and played.schedule.settle_steps.tolist() == [3000, 10]
    table = gait_table(graded(settling(HALVES, [3000, 10])))
    write_csv(dataclasses.replace(table, design=graded(settling(HALVES, [4000, 10]))), tmp_path / "short.csv")
    with pytest.warns(UserWarning, match=r"header in settle_steps; rows are played"):
        played, _, _ = gait_of_table(str(tmp_path / "short.csv"), {"rig": "ideal"})
    assert played.schedule.settle_steps.tolist() == [3000, 10]


@pytest.mark.kernels
def test_rows_alone_reach_the_designed_speed(tmp_path):
    """In psi, sampled: states dwell to whole samples, as the rig would."""
    levels = np.random.default_rng(2).uniform(0, 1, (10, 2))
    design = InflatableDesign(2e3, 0.0, settling(levels, [400, 300], 2))
    export_csv(design, tmp_path / "gait.csv", units="psi", rate=1000.0)
    played = read_csv(tmp_path / "gait.csv").played()
    assert np.abs(played.schedule.settle_steps - design.schedule.settle_steps).max() < 20
    again = InflatableDesign(played.pressure, played.orientation, played.schedule)
    found = simulation.simulate([design, again], Terrain(), geometry=TINY, actuation=QUICK).speed
    assert abs(found[0]) > 1e-3 and found[1] == pytest.approx(found[0], rel=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda text: text.replace('"grip"', '"grips"'),
            r"header is damaged \(grips: is unknown; a gait's tables are ",
        ),
        (lambda text: text.replace('"settle_steps": [0', '"settle_steps": [1'), r"header is damaged \(robot_hash and"),
        (lambda text: text.replace("]}", "]"), r"header is damaged \(schedule: its text is damaged; give the tables"),
    ],
)
def test_a_damaged_header_is_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "gait.csv"
    export_csv(graded(settling(HALVES, [0, 0])), path)
    path.write_text(change(path.read_text()))
    with pytest.raises(ValueError, match=rf"^{path}: {message}[^\n]*$"):
        read_csv(path)
