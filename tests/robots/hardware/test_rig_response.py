"""The rig model against closed forms, and tables that are played through it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from graded import TINY

from robots.hardware import LineMap, PneumaticRig, export_csv, gait_table, read_csv
from robots.hardware.rig_play import Play, check_strokes, commanded, play_table, play_tables
from robots.hardware.rig_response import (
    AS_COMMANDED,
    CAUSES,
    LAG,
    WHOLE_RESPONSE,
    causes_of,
    lagged,
    line_pressures,
    slew_limited,
)
from robots.inflatable import INCHING, NAMED_GEOMETRIES, ROLLING
from robots.inflatable.on_rig import speed_lines
from robots.world import Terrain
from taichi_sim.base.short_text import decimal

AT = np.arange(0.0, 10.0, 0.01)
SHORT = replace(INCHING, schedule=INCHING.schedule.cut(2, 1))


def without(*names):
    return frozenset(cause for cause in CAUSES if cause.name not in names)


def rig_with(**changes):
    rig = PneumaticRig()
    return replace(rig, channels=tuple(replace(channel, **changes) for channel in rig.channels))


def test_a_lag_answers_a_ramp_as_its_closed_form_says():
    tau, rate = 0.7, 3.0
    exact = rate * (AT - tau * (1 - np.exp(-AT / tau)))
    assert np.abs(lagged(rate * AT, AT, tau) - exact).max() < 1e-11


def test_a_lag_answers_a_step_as_its_closed_form_says():
    step = np.where(AT > 0, 5.0, 0.0)  # linear within the first sample
    late = lagged(step, AT, 0.5)[1:]
    assert np.allclose(late, 5.0 - (5.0 - late[0]) * np.exp(-(AT[1:] - AT[1]) / 0.5), atol=1e-12)


def test_no_lag_leaves_the_line_as_it_is():
    line = np.sin(AT)
    assert lagged(line, AT, 0.0) is line


def test_a_slew_limit_turns_a_step_into_a_ramp():
    step = np.where(AT > 0, 12.0, 0.0)
    assert np.allclose(slew_limited(step, AT, 4.0), np.minimum(4.0 * AT, 12.0), atol=1e-6)


def test_a_valve_delays_and_a_regulator_limits():
    rig = rig_with(valve_delay_s=0.5, maximum_kpa=15.0, slew_kpa_per_s=1e6)
    rows = np.repeat(np.array([[0.0], [20.0]]), 11, axis=1)
    found = line_pressures(np.array([0.0, 4.0]), rows, rig, AT)
    assert np.allclose(found[:, 1], np.minimum(np.clip((AT - 0.5) / 4.0, 0, 1) * 20.0, 15.0))
    unlimited = line_pressures(np.array([0.0, 4.0]), rows, rig, AT, without("delay", "slew"))
    assert np.allclose(unlimited[:, 1], np.minimum(AT / 4.0 * 20.0, 15.0))


def test_a_regulator_takes_commands_in_steps():
    rig = rig_with(resolution_kpa=2.0, slew_kpa_per_s=1e6)
    rows = np.repeat(np.array([[0.0], [20.0]]), 11, axis=1)
    found = line_pressures(np.array([0.0, 8.0]), rows, rig, AT)[:, 1]
    ramp = np.minimum(AT / 8.0 * 20.0, 20.0)
    assert set(np.round(found, 9)) == set(np.arange(0.0, 21.0, 2.0)) and np.abs(found - ramp).max() <= 1.0 + 1e-9
    smooth = line_pressures(np.array([0.0, 8.0]), rows, rig, AT, without("resolution"))[:, 1]
    assert np.allclose(smooth, ramp)


def test_the_causes_of_a_rig_are_those_that_it_has():
    def names(rig):
        return [cause.name for cause in causes_of(rig)]

    assert names(PneumaticRig()) == ["slew"]
    assert names(rig_with(valve_delay_s=0.1, resolution_kpa=1.0)) == ["delay", "resolution", "slew"]
    assert names(PneumaticRig.load("dissertation-lag")) == ["slew", "lag"]


def test_each_cause_alone_does_what_its_parameter_says_and_none_does_nothing():
    rig = rig_with(valve_delay_s=0.5, resolution_kpa=2.0, slew_kpa_per_s=1.5, lag_s=0.7)
    times, rows = np.array([0.0, 8.0]), np.repeat(np.array([[0.0], [20.0]]), 11, axis=1)
    ramp = np.minimum(AT / 8.0 * 20.0, 20.0)

    def alone(*causes):
        return line_pressures(times, rows, rig, AT, frozenset(causes))[:, 1]

    expected = {
        "delay": np.clip((AT - 0.5) / 8.0, 0, 1) * 20.0,
        "resolution": np.round(ramp / 2.0) * 2.0,
        "slew": slew_limited(ramp, AT, 1.5),
        "lag": lagged(ramp, AT, 0.7),
    }
    assert np.array_equal(alone(), ramp) and {cause.name for cause in CAUSES} == set(expected)
    for cause in CAUSES:
        assert np.allclose(alone(cause), expected[cause.name], atol=1e-12) and not np.array_equal(alone(cause), ramp)


def test_speeds_on_a_rig_are_told_with_all_that_lines_as_commanded_lack():
    rig = rig_with(resolution_kpa=1.0, lag_s=0.1)
    speeds = {"simulated": 0.1, "without_lag": 0.2, "as_commanded": 0.3, "designed": 0.5}
    speeds |= {"with_resolution": 0.29, "with_slew": 0.28, "with_lag": 0.27}
    text = speed_lines(rig, {f"speed_{name}": value for name, value in speeds.items()})
    assert text == (
        f"on the rig {rig.name}, in its time: 0.1000 BL/s; without lag 0.2000, without delays of valves, steps of "
        "regulators, limits of rate and lag 0.3000\n"
        "designed 0.5000; of it the rig's longer strokes take 0.2000, then each alone: steps of regulators 0.0100, "
        "limits of rate 0.0200, lag 0.0300"
    )


def test_commands_are_the_prefix_and_every_loop():
    table = gait_table(SHORT)
    times, pressures, shaped, first = commanded(table)
    lengths = table.durations
    assert times[-1] == pytest.approx(lengths["prefix"] + table.loops * lengths["main"])
    assert (np.diff(times) > 0).all() and len(pressures) == len(times) and 0 < shaped < first < times[-1]


@pytest.mark.parametrize("rate", [None, 7.0])
def test_exported_rows_are_strokes(rate, tmp_path):
    check_strokes(gait_table(SHORT, rate=rate))
    export_csv(SHORT, tmp_path / "gait.csv", units="psi", rate=rate)
    check_strokes(read_csv(tmp_path / "gait.csv"))


@pytest.mark.parametrize(("rate", "pressure"), [(100.0, 0.0), (200.0, 500.0), (50.0, 3.0)])
def test_rounded_rows_that_follow_closely_are_strokes(rate, pressure, tmp_path):
    """The first rows of a stroke hardly differ, so rounding of the pressures in psi shows in their rates."""
    design = replace(INCHING, pressure=pressure)
    export_csv(design, tmp_path / "gait.csv", units="psi", rate=rate)
    check_strokes(read_csv(tmp_path / "gait.csv"))


def test_rows_beside_a_stroke_are_no_strokes():
    table = gait_table(SHORT, rate=10.0)
    pressures = table.pressures.copy()
    row = np.flatnonzero(table.states == 1)[5]
    pressures[row, 1] += 3.0
    with pytest.raises(ValueError, match=r"ideal.*bladder1.*beside the stroke of state 1"):
        check_strokes(replace(table, pressures=pressures))


def test_a_negative_lag_is_refused():
    with pytest.raises(ValueError, match="lag_s: -1"):
        rig_with(lag_s=-1.0)


def test_a_lag_survives_a_rigs_file(tmp_path):
    rig = replace(rig_with(lag_s=0.25), name="mine")
    rig.save(tmp_path / "rig.toml")
    assert PneumaticRig.load(tmp_path / "rig.toml") == rig


@pytest.mark.kernels
def test_a_lag_of_nothing_changes_no_bit_and_lags_change_the_way():
    short = replace(SHORT, schedule=SHORT.schedule.cut(1, 1))
    rig = rig_with(lag_s=0.3)
    responses = (WHOLE_RESPONSE, WHOLE_RESPONSE - {LAG}, AS_COMMANDED)
    played = play_table(gait_table(short), rig, None, responses, geometry=TINY, precision="f32")
    assert list(played.status) == ["ok"] * 3
    assert played.distance[1] == played.distance[2] != played.distance[0]


@pytest.mark.slow
@pytest.mark.kernels
def test_tables_of_a_batch_are_played_as_alone():
    """Other lengths, grounds, rigs and starts beside each other change no bit."""
    small, rig = NAMED_GEOMETRIES["small"], PneumaticRig()
    gaits = zip((INCHING, ROLLING), (1, 2), strict=True)
    tables = [gait_table(replace(gait, schedule=gait.schedule.cut(columns, 1))) for gait, columns in gaits]
    plays = [
        Play(tables[0], rig, copy=1),
        Play(tables[1], PneumaticRig.load("dissertation-lag"), Terrain(5.0, 0.7, 0.56)),
    ]
    settings = {"geometry": small, "precision": "f32", "perturbation": 1e-6}
    both = play_tables(plays, **settings)
    alone = [play_tables([play], **settings) for play in plays]
    assert list(both.distance) == [one.distance[0] for one in alone] and len(set(both.steps)) == 2
    with pytest.raises(ValueError, match="record_every: 100 is not allowed for tables of different lengths"):
        play_tables(plays, record_every=100, **settings)


@pytest.mark.kernels
@pytest.mark.parametrize("found", [pytest.param(False, marks=pytest.mark.slow), True])
def test_an_ideal_rig_plays_the_designs_bits(morpholab, tmp_path, monkeypatch, found):
    """Also of pressures and levels that a search has found, which have more digits than a table."""
    if found:
        monkeypatch.setitem(NAMED_GEOMETRIES, "small", TINY)
    short = replace(SHORT, schedule=SHORT.schedule.cut(1, 1)) if found else SHORT
    levels = np.where(short.schedule.levels > 0, 0.1 + np.pi / 100, 0.0)
    searched = replace(short, pressure=1081.893712345678, schedule=replace(short.schedule, levels=levels))
    export_csv(searched if found else short, tmp_path / "gait.csv")
    options = "--geometry small --precision f32 --json"
    outs = [morpholab(f"simulate {what} {options}")[1] for what in ("--gait gait.csv", "--table gait.csv --rig ideal")]
    assert json.loads(outs[0]) == json.loads(outs[1])
    code, out, _ = morpholab(f"simulate --table gait.csv --rig dissertation-lag {options}")
    found = json.loads(out)
    assert code == 0 and found["rig"] == "dissertation-lag"
    assert {"speed_without_lag", "speed_as_commanded"} <= set(found)
    designed = json.loads(outs[0])["speed_simulated"]
    assert found["speed_designed"] == designed and found["speed_with_slew"] == found["speed_as_commanded"]
    assert found["speed_with_lag"] == found["speed_simulated"] and "speed_with_delay" not in found
    times, _, shaped, _ = commanded(read_csv("gait.csv"))
    played = (times[-1] - shaped) * NAMED_GEOMETRIES["small"].body_length
    assert found["speed"] == found["speed_simulated"] == pytest.approx(found["distance"] / played, rel=1e-3)
    out = morpholab(f"simulate --table gait.csv --rig dissertation-lag {options.removesuffix('--json')}")[1]
    assert f"speed {decimal(found['speed'])} BL/s (in the rig's time)\n" in out and "convention" not in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--table gait.csv", "rig: none is given"),
        ("--gait inching --rig ideal", "rig: ideal is not allowed without --table"),
        ("--table gait.csv --gait inching --rig ideal", "table: gait.csv is not allowed with --gait"),
        ("--table gait.json --rig ideal", "table: 'gait.json' is not allowed"),
        ("--table gait.csv --rig none", "rig: 'none' is neither a preset"),
        ("--table gait.csv --rig ideal --repeats 3", "repeats: is not allowed with --table"),
        ("--table gait.csv --rig ideal --from-rows", "from-rows: is not allowed with --table"),
        ("--table gait.csv --rig dissertation --judge", "judge: is not allowed with --table"),
        ("--table gait.csv --rig dissertation --uncertain slope=1", "uncertain: is not allowed with --table"),
        ("--table gait.csv --rig dissertation --out there", "out: there is not allowed with --table"),
    ],
)
def test_bad_input_gets_one_line(morpholab, tmp_path, options, message):
    export_csv(SHORT, tmp_path / "gait.csv")
    code, _, error = morpholab(f"simulate {options}")
    assert code == 2 and message in error and error.count("\n") == 1


def test_a_ramp_of_the_core_has_no_jump_and_comes_back():
    ramp, pressures = LineMap(ramp_pa=1000.0), np.linspace(0.0, 12e3, 1201)
    lines = ramp.lines(pressures, np.zeros((10, len(pressures))))
    assert lines[0, 0] == -80.0 and lines[-1, 0] == 50.0 and np.diff(lines[:, 0]).max() < 1.0
    assert np.allclose(ramp.simulated(lines)[0], pressures, atol=1e-2)
    assert LineMap.from_text(ramp.to_text()) == ramp and "ramp_pa" not in LineMap().to_text()


def test_presets_have_no_jump_and_tables_tell_their_ramp_only_where_it_is_played(tmp_path):
    gait = replace(SHORT, pressure=400.0)
    rig, low = PneumaticRig(), gait_table(gait)
    assert rig.line_map.ramp_pa == PneumaticRig.load("dissertation-gentle").line_map.ramp_pa == 1000.0
    assert low.line_map == rig.line_map and low.pressures[low.states == 1][-1, 0] == pytest.approx(-46.33, abs=0.01)
    export_csv(gait, tmp_path / "gait.csv")
    assert read_csv(tmp_path / "gait.csv").played().pressure == pytest.approx(400.0, abs=0.01)
    assert gait_table(SHORT).line_map == gait_table(replace(SHORT, pressure=1000.0)).line_map == LineMap()
    columns = np.full(SHORT.schedule.columns, 400.0)
    changing = replace(SHORT, schedule=replace(SHORT.schedule, core_pressure=columns))
    assert gait_table(changing).line_map.ramp_pa == 1000.0
    (tmp_path / "rig.toml").write_text("shortest_state_s = 0.2\n")
    assert PneumaticRig.load(tmp_path / "rig.toml").line_map == LineMap()
