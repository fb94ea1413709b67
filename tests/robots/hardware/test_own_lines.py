"""Rigs whose files name their own lines: files, tables of channels, and what refuses them."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optim.report.rig import rig_section
from robots.hardware import KPA_PER_UNIT, OwnLines, PneumaticRig, gait_table, read_channels, write_csv
from robots.hardware.channel_table import PressureScale, Rhythm, Wave, channel_report, channel_table
from robots.hardware.gait_chart import gait_chart
from robots.hardware.gait_commands import rig_report
from robots.hardware.lines import MOST_LINES
from robots.hardware.plain_files import write_c_header, write_plain
from robots.hardware.rig_play import Play
from robots.hardware.sample_rates import LONGER, fitting_rates
from robots.hardware.stream import CommaLines, read_any_table, stream_of
from robots.inflatable import ROLLING

ROOT = Path(__file__).parents[3]
NAMES = tuple(f"v{number}" for number in range(1, 7))
EXAMPLE = re.search(r'```toml\n(name = "six-valves"\n.*?)```', (ROOT / "docs/hardware.md").read_text(), re.DOTALL)[1]
RHYTHM = Rhythm(0.5, 2, 0.1, 4)
ABOUT = {"drive": "a", "quantity": "scale", "axes": "xyz", "regions": [1], "rest": 1.0, "relative": True}
word = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,31}", fullmatch=True).filter(
    lambda name: name not in ("default", "time_s", "section", "state")
)


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "six.toml").write_text(EXAMPLE)
    return PneumaticRig.load(tmp_path / "six.toml")


def waves(rig, count, values=(0.8, 1.0, 1.2, 1.1)):
    """So many waves, from off to on of their lines."""
    return [
        Wave(f"channel {n}", np.roll(values, n), PressureScale(0.8, 1.2, line.off_kpa, line.on_kpa), ABOUT)
        for n, line in enumerate(rig.channel_lines[:count])
    ]


def test_the_example_of_the_docs_is_a_rig_of_six_lines(rig, tmp_path):
    assert rig.channel_names == NAMES and rig.cores == 0 and rig.vacuum_kpa == 0
    assert [channel.maximum_kpa for channel in rig.channels] == [40] * 5 + [30]
    assert {channel.rise_s for channel in rig.channels} == {0.2} and rig.lines.on_kpa[-2:] == (40, 30)
    bare = re.sub(r"\[map\].*", "", EXAMPLE, flags=re.DOTALL)
    (tmp_path / "bare.toml").write_text(bare)
    assert PneumaticRig.load(tmp_path / "bare.toml") == rig  # a line is on at its highest pressure


@pytest.mark.long
@given(names=st.lists(word, min_size=1, max_size=MOST_LINES, unique=True), most=st.floats(1, 50), off=st.floats(-50, 0))
def test_a_rig_of_own_lines_survives_its_file(tmp_path_factory, names, most, off):
    channel = replace(PneumaticRig().channels[1], minimum_kpa=-60.0, maximum_kpa=most)
    lines = OwnLines.within(names, [(-60.0, most)] * len(names), off_kpa=off)
    rig = PneumaticRig("mine", channels=(channel,) * len(names), lines=lines)
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    rig.save(path)
    assert PneumaticRig.load(path) == rig and 'lines = [\n    "' in path.read_text()


@given(
    data=st.data(),
    names=st.lists(word, min_size=1, max_size=9, unique=True),
    units=st.sampled_from(sorted(KPA_PER_UNIT)),
    vacuum=st.booleans(),
)
def test_a_table_of_own_lines_read_back_gives_the_same_commands(tmp_path_factory, data, names, units, vacuum):
    channel = replace(PneumaticRig().channels[1], minimum_kpa=-60.0, slew_kpa_per_s=1e6)
    lines = OwnLines.within(names, [(-60.0, 20.0)] * len(names), on_kpa=-60.0 if vacuum else None)
    rig = PneumaticRig("mine", channels=(channel,) * len(names), lines=lines)
    count = data.draw(st.integers(1, len(names)))
    values = data.draw(st.lists(st.floats(0.8, 1.2), min_size=4, max_size=4))
    made = channel_table("robot", waves(rig, count, values), RHYTHM, rig, units)
    path = tmp_path_factory.mktemp("table") / "a.csv"
    write_csv(made, path)
    read = read_channels(path)
    assert read.channels == made.channels == tuple(names) and read.own_names == rig.own_names
    assert read.pressures.shape[1] == len(names) and not read.pressures[:, count:].any()
    assert np.allclose(read.pressures, made.pressures, rtol=1e-8, atol=1e-12) and (read.states == made.states).all()
    assert len(read.waves) == count and (read.rig, read.units, read.rhythm) == ("mine", units, RHYTHM)
    for ours, asked in zip(read.waves, made.waves, strict=True):
        assert np.allclose(ours.values, asked.values, atol=1e-7) and ours.calibration == asked.calibration
    again = path.with_name("b.csv")
    write_csv(read, again)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lines = 6", "lines: 6 is not allowed; give 1 to 64 names, such as"),
        ("lines = []", "lines: 0 are not allowed; give 1 to 64 names"),
        (f"lines = {[f'v{n}' for n in range(65)]}", "lines: 65 are not allowed; give 1 to 64 names"),
        ("lines = [1]", "lines: 1 is not allowed; give a word of letters"),
        ("lines = ['a b']", "lines: 'a b' is not allowed; give a word of letters"),
        ("lines = ['1a']", "lines: '1a' is not allowed; give a word of letters"),
        ("lines = ['é']", "lines: 'é' is not allowed; give a word of letters"),
        ("lines = ['a\\u000a']".replace("'", '"'), r"lines: 'a\\n' is not allowed; give a word of letters"),
        (f"lines = ['{'a' * 33}']", "lines: 'a*' is not allowed; .* at most 32 long"),
        ("lines = ['v1', 'v1']", "lines: 'v1' is not allowed twice"),
        ("lines = ['section']", "lines: 'section' is not allowed; no line may be called default, time_s"),
        ("lines = ['default']", "lines: 'default' is not allowed; no line may be called"),
        ("cores = 2\nlines = ['v1']", "cores: it is not allowed beside lines, which names all"),
        ("lines = ['v1']\n[channels.v2]\nrise_s = 1", "channels: 'v2' is unknown; give default, v1"),
        ("lines = ['v1']\n[channels.core]\nrise_s = 1", "channels: 'core' is unknown; give default, v1"),
        ("lines = ['v1']\n[channels.default]\nrise = 1", "default: 'rise' is unknown; give rise_s"),
        (
            "lines = ['v1']\n[channels.v1]\nmaximum_kpa = 70",
            "v1: maximum_kpa: 70 is not allowed; the supply has 50 kPa",
        ),
        ("lines = ['v1']\nsupply_kpa = -1", "supply_kpa: -1 is not allowed; give a finite number, at least 0"),
        ("lines = ['v1']\nsupply_kpa = 0", "v1: maximum_kpa: 20 is not allowed; the supply has 0 kPa"),
        (
            "lines = ['v1']\nsupply_kpa = 0\nvacuum_kpa = 0",
            "supply_kpa: 0 is not allowed; give it or vacuum_kpa, as both are 0",
        ),
        (
            "units = 'psi'\nlines = ['v1']\nsupply_psi = 0\nvacuum_psi = 0",
            "supply_psi: 0 is not allowed; give it or vacuum_psi, as both are 0",
        ),
        ("lines = ['v1']\n[map]\nflat_kpa = 0", "map: 'flat_kpa' is unknown; give off_kpa, on_kpa"),
        (
            "lines = ['v1']\n[map]\non_kpa = [1, 2]",
            r"map: on_kpa: \[1, 2\] is not allowed; give one pressure, or 1, in",
        ),
        ("lines = ['v1']\n[map]\non_kpa = 'x'", "map: on_kpa: 'x' is not allowed; give a finite number"),
        ("lines = ['v1']\n[map]\non_kpa = 0", "map: off_kpa: 0 of v1 is not allowed; it must differ from its on_kpa"),
        ("lines = ['v1']\n[map]\non_kpa = 30", "v1: on_kpa: 30 is not allowed; its limits are 0 and 20"),
        ("valves = 6", "rig: 'valves' is unknown; give .*lines"),
        (
            "units = 'psi'\nlines = ['v1']\n[map]\non_psi = 8",
            "v1: on_psi: 8 is not allowed; its limits are 0 and 2.9008",
        ),
    ],
)
def test_mistakes_in_a_file_of_own_lines_are_told_in_one_line(tmp_path, text, message):
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(tmp_path))}/rig.toml: {message}[^\n]*$"):
        PneumaticRig.load(tmp_path / "rig.toml")


def test_a_rig_has_a_channel_for_each_of_its_lines(rig):
    with pytest.raises(ValueError, match=r"^channels: 5 are not allowed; give one for each of 6 lines$"):
        replace(rig, channels=rig.channels[:5])
    with pytest.raises(ValueError, match=r"^channels: 6 are not allowed; give 11$"):
        replace(rig, lines=None)


def test_a_file_in_psi_may_name_its_lines(tmp_path):
    (tmp_path / "rig.toml").write_text('units = "psi"\nlines = ["a", "b"]\n[map]\noff_psi = 1.0\non_psi = [2.0, 2.5]\n')
    rig, psi = PneumaticRig.load(tmp_path / "rig.toml"), KPA_PER_UNIT["psi"]
    assert rig.lines == OwnLines(("a", "b"), (psi, psi), (2 * psi, 2.5 * psi)) and rig.units == "psi"


def test_a_line_that_sucks_is_on_at_its_lowest_pressure(tmp_path):
    """Vacuum drives some muscles; lines that are to begin and to vent take the times of their way."""
    text = 'lines = ["a"]\n[channels.a]\nminimum_kpa = -40\nmaximum_kpa = 0\nslew_kpa_per_s = 1e4\nfall_s = 4.0\n'
    (tmp_path / "rig.toml").write_text(text)
    rig = PneumaticRig.load(tmp_path / "rig.toml")
    assert rig.lines.on_kpa == (-40,) and rig.lines.off_kpa == (0,)
    table = channel_table("robot", waves(rig, 1, (1.0, 1.2, 1.0, 0.8)), RHYTHM, rig)
    assert table.pressures.min() == -40 and table.timing[0].end_s == pytest.approx(2.0)


def test_a_rig_of_vacuum_alone_needs_no_supply(tmp_path):
    limits = "minimum_kpa = -40\nmaximum_kpa = 0\nslew_kpa_per_s = 1e4"
    (tmp_path / "rig.toml").write_text(f'lines = ["a"]\nsupply_kpa = 0\nvacuum_kpa = -60\n[channels.a]\n{limits}\n')
    rig = PneumaticRig.load(tmp_path / "rig.toml")
    table = channel_table("robot", waves(rig, 1), RHYTHM, rig)
    assert (table.pressures.min(), table.pressures.max()) == (-40, 0)
    assert len(rig_section(channel_report(waves(rig, 1), RHYTHM, rig), False, 1.0)[1]["channels"]) == 1
    rig.save(tmp_path / "again.toml")
    assert PneumaticRig.load(tmp_path / "again.toml") == replace(rig, name="rig")


def test_own_lines_whose_valves_put_them_out_of_phase_are_told(rig):
    slow = (*rig.channels[:2], replace(rig.channels[2], valve_delay_s=0.2), *rig.channels[3:])
    channel_table("robot", waves(rig, 2), RHYTHM, replace(rig, channels=slow))  # v3 stays vented
    with pytest.warns(UserWarning, match=r"^rig: v3 answers 0.2 s later than v1, 0.1 cycles"):
        channel_table("robot", waves(rig, 3), RHYTHM, replace(rig, channels=slow))


@given(frequency=st.floats(0.05, 20.0), rate=st.floats(1.0, 900.0))
def test_fitting_rates_make_a_table_hardly_longer(frequency, rate):
    fast = replace(PneumaticRig().channels[1], slew_kpa_per_s=1e6)
    lines = OwnLines.within(("a",), [(0.0, 20.0)])
    rig, rhythm = PneumaticRig("mine", channels=(fast,), lines=lines), Rhythm(frequency, 3, 0.1, 16)

    def at(rate):
        return channel_table("robot", waves(rig, 1, np.linspace(0.8, 1.2, 16)), rhythm, rig, rate=rate)

    found = fitting_rates(at(None), rate, lambda other: at(other).seconds)
    assert all(at(each).seconds <= LONGER * at(None).seconds and f"{each:.3g}" == f"{each:g}" for each in found)
    assert [each > rate for each in found] in ([False, True], [True], [False], [])
    assert found or rate > 16 * frequency  # faster than the slowest that fits


def test_more_channels_than_lines_are_refused_with_both_numbers(rig):
    more = [*waves(rig, 6), waves(rig, 1)[0]]
    with pytest.raises(ValueError, match=r"^channels: 7 are not allowed; the rig six-valves has 6 lines for them: let"):
        channel_table("robot", more, RHYTHM, rig)
    with pytest.raises(ValueError, match=r"^channels: 0 are not allowed; give one at least$"):
        channel_table("robot", [], RHYTHM, rig)


def named_waves(rig, *names):
    return [replace(wave, name=name) for name, wave in zip(names, waves(rig, len(names)), strict=True)]


def test_channels_with_names_of_lines_are_on_these(rig, tmp_path):
    lines = replace(rig.lines, names=("front", "back", "left_leg", "v4", "v5", "v6"), on_kpa=(40, 30, 20, 40, 40, 30))
    own = replace(rig, lines=lines)
    given = [replace(wave, calibration=replace(wave.calibration, high_kpa=20.0)) for wave in waves(own, 3)]
    given = [replace(wave, name=name) for wave, name in zip(given, ("left leg", "back", "front"), strict=True)]
    table = channel_table("robot", given, RHYTHM, own)
    ordered = channel_table("robot", [given[2], given[1], given[0]], RHYTHM, own)
    assert table.pressures.tolist() == ordered.pressures.tolist() and table.pressures[:, :3].any(axis=0).all()
    write_csv(table, tmp_path / "a.csv")
    read = read_channels(tmp_path / "a.csv")
    assert read.played_by == ("left_leg", "back", "front")
    for wave, asked in zip(read.waves, given, strict=True):
        assert (wave.name, wave.values.tolist()) == (asked.name, pytest.approx(asked.values.tolist()))
    alone = channel_table("robot", [replace(given[0], name="back")], RHYTHM, own)
    assert alone.pressures.any(axis=0).tolist() == [False, True, False, False, False, False]


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("v2", "legs"), "v2 would be on the line v1 by order, though there is a line v2, as legs has no line of its"),
        (("legs", "v6", "v3"), "v6 would be on the line v2 by order, though there is a line v6, as legs has no line"),
        (
            ("V2", "v 1", "front"),
            "V2 would be on the line v1 by order, though there is a line v2, as front has no line",
        ),
        (("v2", "v2"), "v2 would be on the line v1 by order, .*, as two channels have names of one line; rename"),
    ],
)
def test_channels_that_would_be_on_lines_of_other_names_are_refused(rig, names, told):
    with pytest.raises(ValueError, match=rf"^channels: {told}[^\n]* or bring both into the same order$"):
        channel_table("robot", named_waves(rig, *names), RHYTHM, rig)
    with pytest.raises(ValueError, match=rf"^channels: {told}"):
        channel_report(named_waves(rig, *names), RHYTHM, rig)


def test_channels_of_other_names_stay_in_order(rig):
    for names in (("legs", "arms", "v3"), ("v1", "legs", "arms"), ("front", "V 2", "back")):
        table = channel_table("robot", named_waves(rig, *names), RHYTHM, rig)
        assert table.played_by == ("v1", "v2", "v3")
    usual = channel_table("robot", named_waves(PneumaticRig(), "a", "bladder2"), replace(RHYTHM, frequency=0.1))
    assert usual.played_by == ("bladder1", "bladder2")


def test_a_table_keeps_the_lines_of_its_header(rig, tmp_path):
    """Tables of earlier versions have channels on lines in order, whatever both are called."""
    write_csv(channel_table("robot", named_waves(rig, "a", "b"), RHYTHM, rig), tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text().replace('"channel": "a"', '"channel": "v2"')
    lines = [line for line in text.splitlines() if not line.startswith("# checksum=")]
    lines.insert(1, f"# checksum={hashlib.sha256(chr(10).join(lines).encode()).hexdigest()}")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    read = read_channels(tmp_path / "a.csv")
    assert [(wave.name, line) for wave, line in zip(read.waves, read.played_by, strict=True)] == [
        ("v2", "v1"),
        ("b", "v2"),
    ]


def test_gaits_of_the_inflatable_robot_refuse_a_rig_of_own_lines(rig):
    told = (
        "^rig: six-valves has lines of its own, v1 and on; a gait of the inflatable robot needs core, bladders and feet"
    )
    for refused in (gait_table, rig_report):
        with pytest.raises(ValueError, match=told):
            refused(ROLLING, rig)
    table = gait_table(ROLLING)
    with pytest.raises(ValueError, match=r"^rig: six-valves has 6 lines, the table has 11$"):
        stream_of(table, rig)
    with pytest.raises(ValueError, match=told):
        Play(table, rig)


def test_a_table_is_played_by_a_rig_with_its_lines(rig, tmp_path):
    table = channel_table("robot", waves(rig, 2), RHYTHM, rig)
    write_csv(table, tmp_path / "a.csv")
    read = read_any_table(tmp_path / "a.csv")
    stream = stream_of(read, rig, rate=50.0)
    assert CommaLines().header(stream).endswith(",v1,v2,v3,v4,v5,v6") and len(stream.sample(9).pressures) == 6
    assert [each[0] for each in stream.extremes()] == list(NAMES)
    assert all(not any(last.pressures) for last in [list(stream.venting(stream.sample(20)))[-1]])
    with pytest.raises(ValueError, match=r"^rig: dissertation has 11 lines, the table has 6$"):
        stream_of(read, PneumaticRig())
    other = replace(rig, lines=replace(rig.lines, names=(*NAMES[:5], "v9")))
    with pytest.raises(ValueError, match=r"^rig: six-valves has the line v9 where the table has v6; give the rig"):
        stream_of(read, other)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("# lines=v1,v2", "# lines=v1,v1", "lines: 'v1' is not allowed twice"),
        ("# lines=v1,v2,v3,v4,v5,v6\n", "", "column core_kPa is missing"),
        ("# lines=v1,v2,", "# lines=v2,v1,", "columns must be time_s,section,state,v2_kPa,v1_kPa"),
        ("v6_kPa", "v7_kPa", "column v6_kPa is missing"),
        ("# lines=v1", "# lines=core", "column core_kPa is missing"),
        ("channels-1", "gait-2", "column core_kPa is missing"),
        ('"line": "v2"', '"line": "v1"', r"header is damaged \(channel channel 1 on line 'v1'\)"),
        ('"line": "v2"', '"line": "v9"', r"header is damaged \(channel channel 1 on line 'v9'\)"),
    ],
)
def test_a_damaged_table_of_own_lines_is_refused(rig, tmp_path, old, new, message):
    write_csv(channel_table("robot", waves(rig, 2), RHYTHM, rig), tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text()
    assert old in text
    (tmp_path / "a.csv").write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=rf"^{re.escape(str(tmp_path))}/a.csv: [^\n]*{message}[^\n]*$"):
        read_any_table(tmp_path / "a.csv")


def test_forms_and_pictures_of_a_table_have_its_lines(rig, tmp_path):
    names = ("a_valve_whose_name_is_rather_lon", *NAMES[1:])
    long = replace(rig, lines=replace(rig.lines, names=names))
    table = channel_table("robot", waves(long, 6), RHYTHM, long)
    write_plain(table, tmp_path / "a.txt")
    write_c_header(table, tmp_path / "a.h")
    assert np.loadtxt(tmp_path / "a.txt", delimiter=",").shape[1] == 7
    assert f"of {', '.join(names)}." in (tmp_path / "a.h").read_text()
    figure = gait_chart(table)
    (axes,) = figure.axes
    labels = axes.get_yticklabels()
    assert [label.get_text() for label in labels] == list(names)
    figure.draw_without_rendering()
    assert min(label.get_window_extent().x0 for label in labels) > 0  # all of it is in the picture


def test_a_report_names_own_lines_as_they_are(rig):
    report = channel_report(waves(rig, 3), RHYTHM, rig)
    section, document = rig_section(report, False, 1.0)
    assert document["channels"][-2]["names"] == ("v4", "v5") and "v4, v5" in str(section)
    assert not report.exceeded
