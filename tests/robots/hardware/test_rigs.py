import pickle
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.hardware import CHANNELS, KPA_PER_UNIT, PRESETS, Channel, LineMap, PneumaticRig, gait_table
from robots.hardware.channel_table import PressureScale, Rhythm, Wave, channel_table
from robots.hardware.stream import Sample, stream_of
from robots.hardware.units import Unit, refused
from robots.inflatable import ROLLING
from taichi_sim.base.arrays import Floats


@pytest.mark.long
@given(delay=st.floats(0, 5), still=st.floats(0.01, 5), core=st.floats(1, 50))
def test_a_rig_survives_its_file(tmp_path_factory, delay, still, core):
    default = PneumaticRig()
    channels = tuple(replace(channel, valve_delay_s=delay) for channel in default.channels)
    rig = PneumaticRig("mine", 60.0, -90.0, channels, still, LineMap(core_kpa=core))
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    rig.save(path)
    assert PneumaticRig.load(path) == rig


def test_a_rigs_file_is_what_earlier_versions_wrote(tmp_path):
    PneumaticRig().save(tmp_path / "rig.toml")
    head = (tmp_path / "rig.toml").read_text().partition("\n[map]")[0].splitlines()
    assert head[:5] == [
        'units = "kpa"',
        'name = "dissertation"',
        "supply_kpa = 50.0",
        "vacuum_kpa = -80.0",
        "shortest_state_s = 0.1",
    ]


def test_a_map_of_earlier_tables_has_the_defaults_of_later_fields():
    text = LineMap().to_text()
    assert text == (
        '{"simulated_pa": 12000.0, "core_kpa": 50.0, "flat_kpa": -80.0, '
        f'"on_kpa": {[20.0] * 8 + [50.0] * 2}, "off_kpa": {[0.0] * 8 + [-80.0] * 2}}}'
    )
    assert LineMap.from_text(text) == LineMap()
    with pytest.raises(ValueError, match="map: give a JSON object with all of its fields"):
        LineMap.from_text('{"ramp_pa": 0.0}')


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_known_by_their_names(name):
    assert PneumaticRig.load(name) == PRESETS[name] and PRESETS[name].name == name


def test_a_rig_file_may_hold_only_what_differs(tmp_path):
    (tmp_path / "rig.toml").write_text(
        'name = "mine"\nshortest_state_s = 0.5\n'
        "[channels.bladder3]\nrise_s = 3.0\n[channels.bladder]\nrise_s = 2.5\nvalve_delay_s = 0.1\n"
        "[map]\nflat_kpa = 0.0\n"
    )
    rig = PneumaticRig.load(tmp_path / "rig.toml")
    rises = dict(zip(CHANNELS, (channel.rise_s for channel in rig.channels), strict=True))
    assert (rises["core"], rises["bladder1"], rises["bladder3"], rises["foot1"]) == (11.5, 2.5, 3.0, 1.0)
    assert rig.channels[3].valve_delay_s == 0.1 and rig.channels[3].fall_s == 2.0
    assert (rig.shortest_state_s, rig.line_map) == (0.5, LineMap(flat_kpa=0.0))


def test_a_rig_without_a_name_is_named_as_its_file_is_called(tmp_path):
    """Tables know their rig by its name, and would take a preset's limits for it."""
    (tmp_path / "mine.toml").write_text("supply_kpa = 60\n")
    assert PneumaticRig.load(tmp_path / "mine.toml").name == "mine"
    PneumaticRig().save(tmp_path / "own.toml")
    assert PneumaticRig.load(tmp_path / "own.toml") == PRESETS["dissertation"]


def test_full_vacuum_in_psi_is_allowed(tmp_path):
    (tmp_path / "mine.toml").write_text('units = "psi"\nvacuum_psi = -14.7\n')
    assert PneumaticRig.load(tmp_path / "mine.toml").vacuum_kpa == pytest.approx(-101.353, abs=1e-3)


def test_a_mark_of_byte_order_is_no_part_of_a_rig(tmp_path):
    (tmp_path / "mine.toml").write_bytes(b"\xef\xbb\xbfsupply_kpa = 60\n")
    assert PneumaticRig.load(tmp_path / "mine.toml").supply_kpa == 60


@pytest.mark.parametrize("kind", [int, float, np.float64, np.float32, np.int64])
def test_a_number_in_psi_may_be_of_any_kind(kind):
    """Those of NumPy were left as they are, as if they were none."""
    unit = Unit("psi")
    assert unit.kpa(kind(2)) == pytest.approx(2 * KPA_PER_UNIT["psi"]) and unit.shown(kind(2)) == "0.29008"
    assert [unit.kpa(value) for value in (True, "2", 10**400)] == [True, "2", 10**400]


def test_a_rig_file_may_be_in_psi(tmp_path):
    (tmp_path / "rig.toml").write_text(
        'units = "psi"\nsupply_psi = 10.0\n[channels.foot]\nmaximum_psi = 8.0\nslew_psi_per_s = 20.0\n'
        f"[map]\non_psi = {[3.0] * 8 + [7.0] * 2}\n"
    )
    rig, psi = PneumaticRig.load(tmp_path / "rig.toml"), KPA_PER_UNIT["psi"]
    assert rig.supply_kpa == 10 * psi and rig.channels[-1].maximum_kpa == 8 * psi
    assert rig.channels[-1].slew_kpa_per_s == 20 * psi and rig.line_map.on_kpa[-1] == 7 * psi


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "Invalid statement"),
        ("channel = 1", "rig: 'channel' is unknown; give units, name, supply_kpa"),
        ("channels = 1", "channels: give a table with bladder, foot, core"),
        ("[channels]\nhand = 1", "channels: 'hand' is unknown; give bladder, foot, core"),
        ("[channels.core]\nrise = 1", "core: 'rise' is unknown; give rise_s"),
        ("shortest_state_s = 0", "shortest_state_s: 0 is not allowed; give a positive finite number"),
        ("supply_kpa = 40", "core: maximum_kpa: 50 is not allowed; the supply has 40 kPa"),
        ("vacuum_kpa = -10", "core: minimum_kpa: -80 is not allowed; the vacuum has -10 kPa"),
        ("vacuum_kpa = 10", "vacuum_kpa: 10 is not allowed; give a number from -101.4 to 0"),
        ("[channels.foot]\nminimum_kpa = 50", "foot: minimum_kpa: 50 is not allowed; it must be below maximum_kpa, 50"),
        ("[channels.foot]\nminimum_kpa = 5", "foot: minimum_kpa: 5 is not allowed; lines are vented, give at most 0"),
        (
            "[channels.core]\nmaximum_kpa = -5",
            "core: maximum_kpa: -5 is not allowed; lines are vented, give at least 0",
        ),
        ("[channels.core]\nfall_s = -1", "core: fall_s: -1 is not allowed; give a positive finite number"),
        (
            "[channels.core]\nslew_kpa_per_s = nan",
            "core: slew_kpa_per_s: nan is not allowed; give a positive finite number",
        ),
        (
            "[channels.bladder]\nvalve_delay_s = 250",
            "bladder: valve_delay_s: 250 is not allowed; give a number from 0 to",
        ),
        ("[channels.core]\nvalve_delay_s = -1", "core: valve_delay_s: -1 is not allowed; give a number from 0 to 10 s"),
        ('[channels.core]\nrise_s = "1"', "core: rise_s: '1' is not allowed; give a positive finite number"),
        ("[map]\ncore_kpa = 0", "map: core_kpa: 0 is not allowed; give a positive finite number"),
        ("[map]\nflat_kpa = 1", "map: flat_kpa: 1 is not allowed; give a number from -101.4 to 0"),
        ("[map]\nflat_kpa = -800", "map: flat_kpa: -800 is not allowed; give a number from -101.4 to 0"),
        ("vacuum_kpa = -800", "vacuum_kpa: -800 is not allowed; give a number from -101.4 to 0"),
        ("[channels.core]\nlag_s = 1e9", "core: lag_s: 1000000000.0 is not allowed; give a number from 0 to 3600"),
        (
            'name = "dissertation"\nsupply_kpa = 60',
            "name: 'dissertation' is not allowed; it is a preset with other values, write another name = into",
        ),
        ("[map]\non_kpa = [1, 2]", r"map: on_kpa: \[1, 2\] is not allowed; give 10 pressures, bladders then feet"),
        (f"[map]\non_kpa = {[0] * 10}", "map: off_kpa: 0 of bladder1 is not allowed; it must be below its on_kpa, 0"),
        ('units = "bar"', "units: 'bar' is not allowed; give one of kpa, psi"),
        ('units = "psi"\nsupply_kpa = 1', "supply_kpa: is not allowed, as the units are psi; give supply_psi"),
        ('name = "a\\nb"', r"name: 'a\\nb' is not allowed; give a text of one line"),
    ],
)
def test_a_bad_rig_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: {message}[^\n]*$"):
        PneumaticRig.load(path)


def test_a_rig_file_of_another_kind_or_none_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"rig.toml: cannot be read \(No such file or directory\)$"):
        PneumaticRig.load(tmp_path / "rig.toml")
    with pytest.raises(ValueError, match=r"^rig: 'other' is neither a preset \(dissertation, .*\) nor a .toml file$"):
        PneumaticRig.load("other")


def test_a_rig_has_all_channels():
    with pytest.raises(ValueError, match=r"^channels: 1 are not allowed; give 11$"):
        PneumaticRig(channels=(Channel(1, 1, 0, 1, 1),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[channels.core]\nmaximum_psi = 9.0", "core: maximum_psi: 9 is not allowed; the supply has 7.2519 psi"),
        (
            "[channels.foot]\nminimum_psi = 1.5",
            "foot: minimum_psi: 1.5 is not allowed; lines are vented, give at most 0",
        ),
        ("[channels.bladder2]\nslew_psi_per_s = -2", "bladder2: slew_psi_per_s: -2 is not allowed"),
        ("[channels.core]\nrise_s = -2", "core: rise_s: -2 is not allowed"),
        ("[channels.core]\nmaximum_kpa = 9.0", "maximum_kpa: is not allowed, as the units are psi; give maximum_psi"),
        ("[map]\non_psi = [1, 2]", "map: on_psi: [1, 2] is not allowed; give 10 pressures, bladders then feet"),
        ("[map]\noff_psi = 3", "map: off_psi: 3 is not allowed; give 10 pressures, bladders then feet"),
        ('[channels.core]\nmaximum_psi = "99"', "core: maximum_psi: '99' is not allowed; give a finite number"),
        ("[channels.core]\nmaximum_psi = true", "core: maximum_psi: True is not allowed; give a finite number"),
        ("[channels.core]\nmaximum_psi = inf", "core: maximum_psi: inf is not allowed; give a finite number"),
        (f"[channels.core]\nmaximum_psi = 1{'0' * 400}", "core: maximum_psi: 1000"),
        ("[channels.core]\nminimum_psi = 5", "minimum_psi: 5 is not allowed; lines are vented, give at most 0"),
        (
            "[channels.foot]\nminimum_psi = 8",
            "foot: minimum_psi: 8 is not allowed; it must be below maximum_psi, 7",
        ),
        ("vacuum_psi = -20", "vacuum_psi: -20 is not allowed; give a number from -14.7068 to 0"),
        (
            "[channels.core]\nvalve_psi = 1",
            "core: 'valve_psi' is unknown; give rise_s, fall_s, minimum_psi,",
        ),
        (
            f"[map]\noff_psi = {[0] * 9 + [7.5]}",
            "map: off_psi: 7.5 of foot2 is not allowed; it must be below its on_psi, 7.2519",
        ),
    ],
)
def test_mistakes_of_a_rig_in_psi_are_told_in_psi(tmp_path, text, message):
    (tmp_path / "rig.toml").write_text(f'units = "psi"\n{text}\n')
    with pytest.raises(ValueError) as error:
        PneumaticRig.load(tmp_path / "rig.toml")
    assert message in str(error.value) and "\n" not in str(error.value)


def test_an_error_of_a_pressure_keeps_counts_and_times_and_survives_another_process():
    error = refused("slew_kpa_per_s", 50.0, lambda unit: f"in 3 s it has 8 steps of {unit.text(20.0)} {unit.spelling}")
    assert str(error) == "slew_kpa_per_s: 50 is not allowed; in 3 s it has 8 steps of 20 kPa"
    told = error.of("core").tell(Unit("psi"))
    assert told == "core: slew_psi_per_s: 7.2519 is not allowed; in 3 s it has 8 steps of 2.9008 psi"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_lines_take_the_rigs_times_and_no_less_than_their_limits_of_rate_ask():
    rig = PneumaticRig()
    steps = np.array([[60.0] + [15.0] * 8 + [-75.0] * 2, [-60.0] + [-30.0] * 8 + [0.0] * 2])
    assert rig.stroke_times(steps).tolist() == [[11.5] + [2.0] * 8 + [1.0] * 2, [4.7] + [2.0] * 8 + [1.0] * 2]
    assert rig.least_times(steps).tolist() == [[2.0] + [1.0] * 8 + [0.5] * 2, [2.0] + [2.0] * 8 + [0.0] * 2]


def test_venting_takes_the_longer_of_stroke_and_limit_of_rate():
    rig = PneumaticRig()
    slow = replace(rig, channels=tuple(replace(channel, slew_kpa_per_s=4.0) for channel in rig.channels))

    def lasting(line, kpa):
        stream = stream_of(gait_table(ROLLING, rig), rig, rate=100.0)
        pressures = [0.0] * 11
        pressures[line] = kpa
        last = Sample(0, 0.0, "main", tuple(pressures))
        return [list(replace(stream, rig=each).venting(last))[-1].time_s for each in (rig, slow)]

    assert lasting(0, 50.0) == pytest.approx([4.7, 12.5])
    assert lasting(0, -80.0) == pytest.approx([11.5, 20.0])
    assert lasting(9, 2.0) == pytest.approx([1.0, 1.0])


def test_what_a_rig_in_psi_refuses_is_told_in_psi(tmp_path):
    (tmp_path / "rig.toml").write_text('units = "psi"\n[channels.core]\nmaximum_psi = 5.0\n')
    rig = PneumaticRig.load(tmp_path / "rig.toml")
    with pytest.raises(ValueError, match=r"core: 7.25189 psi at .* s is not allowed; the rig's limit is 5 psi"):
        gait_table(ROLLING, rig)
    clipped = gait_table(ROLLING, rig, on_violation="clip").clipped
    assert clipped and all("psi" in line and "kPa" not in line for line in clipped)


def waiting(delays: dict[int, float], frequency: float = 1.7) -> Floats:
    """Pressures of two waves on the lines of a rig some of whose valves have delays [s]."""
    channels = list(PneumaticRig().channels)
    for line, channel in enumerate(channels):
        channels[line] = replace(channel, slew_kpa_per_s=1e4, valve_delay_s=delays.get(line, 0.0))
    values = np.sin(2 * np.pi * np.arange(16) / 16)
    waves = [Wave(name, values, PressureScale(-1.0, 1.0, 0.0, 20.0), {}) for name in ("legs", "arms")]
    rig = PneumaticRig(channels=tuple(channels))
    return channel_table("robot", waves, Rhythm(frequency, 2, 1.0, 16), rig).pressures


def test_valves_that_put_channels_out_of_phase_are_warned_of():
    """Rows wait for no valve, so a quarter of a second on one line of two is most of a half cycle."""
    told = r"^rig: bladder2 answers 0.25 s later than bladder1, 0.425 cycles, and rows make up for no delay, so lines"
    with pytest.warns(UserWarning, match=told):
        late = waiting({2: 0.25})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for alike in ({}, {1: 0.25, 2: 0.25}, {2: 0.01}, {0: 0.25, 7: 0.25}):  # no channel is on the last two
            assert np.array_equal(waiting(alike), late)
        waiting({2: 0.25}, frequency=0.05)
