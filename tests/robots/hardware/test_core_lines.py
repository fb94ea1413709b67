"""Rigs with a line for each of several cores: their tables, files, and what bodies feel of them."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from graded import QUICK, TINY_TWO

from robots.hardware import PneumaticRig, export_csv, gait_table, read_csv, read_design
from robots.hardware.gait_chart import gait_chart
from robots.hardware.gait_commands import rig_report
from robots.hardware.rig_play import play_table
from robots.hardware.stream import CommaLines, stream_of
from robots.inflatable.body import NAMED_GEOMETRIES, PUBLISHED
from robots.inflatable.design import ROLLING, InflatableDesign, save_design
from robots.inflatable.schedule import GaitSchedule

FULL = 12e3
LATTICE = Path(__file__).parents[3] / "examples/starfish.py"
RIG = 'name = "two"\ncores = 2\n[channels.core]\nslew_kpa_per_s = 25.0\n[channels.core2]\nmaximum_kpa = 45.0\n'
HEADER = "time_s,section,state,core1_kPa,core2_kPa,bladder1_kPa"
LEVELS = np.eye(10, 3)
GRADED = GaitSchedule(LEVELS, 2, np.array([[2e3, 4e3, 6e3], [9e3, 5e3, 1e3]]))
DESIGNS = [
    dataclasses.replace(ROLLING, pressure=(FULL * 0.7, 0.0)),
    dataclasses.replace(ROLLING, pressure=9e3),
    dataclasses.replace(ROLLING, pressure=(9e3, 9e3)),
    InflatableDesign((2e3, 5e3), 30.0, GRADED),
    InflatableDesign(3e3, 0.0, dataclasses.replace(GRADED, core_pressure=[1e3, 2e3, 3e3])),
    InflatableDesign(3e3, 0.0, GRADED),
]


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "two.toml").write_text(RIG)
    return PneumaticRig.load(tmp_path / "two.toml")


def test_a_file_gives_a_rig_with_a_line_for_each_core(rig, tmp_path):
    assert rig.cores == 2 and rig.channel_names[:3] == ("core1", "core2", "bladder1")
    first, second = rig.channels[:2]
    assert (first.slew_kpa_per_s, first.maximum_kpa, second.slew_kpa_per_s, second.maximum_kpa) == (25, 50, 25, 45)
    rig.save(tmp_path / "again.toml")
    assert PneumaticRig.load(tmp_path / "again.toml") == rig


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cores = 0", "cores: 0 is not allowed"),
        ("cores = 8", "cores: 8 is not allowed"),
        ("[channels.core1]", "channels: 'core1' is unknown"),
        ("cores = 2\n[channels.core3]", "channels: 'core3' is unknown; give bladder, foot, core, core1, core2"),
    ],
)
def test_rigs_with_other_lines_are_refused(tmp_path, text, told):
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(ValueError, match=told):
        PneumaticRig.load(tmp_path / "rig.toml")


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize("units", ["kpa", "psi"])
def test_a_table_has_a_column_for_each_core_and_gives_its_design_back(rig, tmp_path, design, units):
    written = export_csv(design, tmp_path / "gait.csv", rig, units)
    found = read_csv(tmp_path / "gait.csv")
    assert found.design == design and found.channels == rig.channel_names
    assert np.allclose(found.pressures, written.pressures, rtol=1e-8)
    assert read_design(tmp_path / "gait.csv", from_rows=True) == design
    lines = (tmp_path / "gait.csv").read_text().splitlines()
    assert units == "psi" or next(line for line in lines if line[0] != "#").startswith(HEADER)


def test_each_core_has_the_line_pressure_of_its_own(rig):
    table = gait_table(DESIGNS[0], rig)
    shaped = table.pressures[table.states == 0][-1]
    assert np.allclose(shaped[:2], [35.0, -80.0])
    one = gait_table(dataclasses.replace(ROLLING, pressure=9e3), rig)
    assert np.array_equal(one.pressures[:, 0], one.pressures[:, 1])


def test_a_rig_with_another_number_of_lines_refuses_cores_that_differ(rig):
    for design, told in ((DESIGNS[0], "pressure: 8.4 and 0 kPa are"), (DESIGNS[5], "core_pressure: 2 rows are")):
        with pytest.raises(ValueError, match=f"^{told} not allowed; a rig has one line for the core, so give all"):
            gait_table(design)
    with pytest.raises(ValueError, match="the rig has 2 lines for cores, so give all cores one"):
        rig_report(dataclasses.replace(ROLLING, pressure=(1e3, 2e3, 3e3)), rig)
    assert rig_report(DESIGNS[0], rig).uses[0].names == ("core1",)
    same = dataclasses.replace(ROLLING, pressure=(1e3,) * 3)
    assert gait_table(same, rig).design.pressure == 1e3


def test_limits_hold_for_each_line(rig):
    with pytest.raises(ValueError, match=r"^core2: 50 kPa at .* the rig's limit is 45 kPa"):
        gait_table(dataclasses.replace(ROLLING, pressure=(FULL, FULL)), rig)
    table = gait_table(dataclasses.replace(ROLLING, pressure=(FULL, FULL)), rig, on_violation="clip")
    assert table.pressures[:, :2].max(axis=0).tolist() == [50.0, 45.0]


def test_a_stream_and_a_chart_have_all_lines(rig):
    table = gait_table(DESIGNS[0], rig)
    assert CommaLines().header(stream_of(table, rig)).split(",")[6:9] == ["core1", "core2", "bladder1"]
    labels = [label.get_text() for label in gait_chart(table).axes[0].get_yticklabels()]
    assert labels[:3] == ["core 1", "core 2", "bladder 1"] and len(labels) == 12
    with pytest.raises(ValueError, match="rig: dissertation has 11 lines, the table has 12"):
        stream_of(table, PneumaticRig())


def test_damaged_columns_of_cores_are_told(rig, tmp_path):
    export_csv(DESIGNS[0], tmp_path / "gait.csv", rig)
    text = (tmp_path / "gait.csv").read_text()
    (tmp_path / "gait.csv").write_text(text.replace("core1_kPa", "core_kPa"))
    with pytest.raises(ValueError, match="columns must be time_s,section,state,core_kPa,bladder1_kPa"):
        read_csv(tmp_path / "gait.csv")


def test_a_body_with_another_number_of_cores_refuses_the_table(rig):
    with pytest.raises(ValueError, match="table: 2 lines for cores are not allowed; the body has 1, see --geometry"):
        play_table(gait_table(DESIGNS[0], rig), rig, geometry=PUBLISHED)


@pytest.mark.kernels
def test_a_rig_fills_each_core_by_its_own_line(rig):
    """Two lines that are told the same are one line, bit for bit; others drive the body elsewhere."""
    levels = np.zeros((10, 1))
    levels[:2] = 1.0
    # A tenth of the time of every line, so that the body plays it quickly.
    swift = [dataclasses.replace(c, rise_s=0.1, fall_s=0.1, slew_kpa_per_s=1e6) for c in rig.channels]
    two = dataclasses.replace(rig, channels=tuple(swift))
    one = dataclasses.replace(rig, channels=tuple(swift[1:]))

    def moved(pressure, lines):
        table = gait_table(InflatableDesign(pressure, 0.0, GaitSchedule(levels, 1)), lines)
        found = play_table(table, lines, geometry=TINY_TWO, actuation=QUICK)
        assert found.status[0] == "ok"
        return found.displacement[0]

    alike = moved(4e3, one)
    assert np.array_equal(moved(4e3, two), alike) and np.array_equal(moved((4e3, 4e3), two), alike)
    first, second = moved((4e3, 0.0), two), moved((0.0, 4e3), two)
    assert not np.array_equal(first, alike) and not np.array_equal(first, second)


@pytest.mark.kernels
def test_a_command_plays_a_table_of_several_cores_through_a_rig(tmp_path, monkeypatch, morpholab):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(NAMED_GEOMETRIES, "two-core", TINY_TWO)
    swift = "rise_s = 0.1\nfall_s = 0.1\nslew_kpa_per_s = 1e6\n"
    channels = "".join(f"[channels.{name}]\n{swift}" for name in ("core", "bladder", "foot"))
    (tmp_path / "two.toml").write_text(f'name = "swift"\ncores = 2\n{channels}')
    save_design(InflatableDesign((2e3, 0.0), 0.0, GaitSchedule(np.eye(10, 1), 1)), tmp_path / "gait.json")
    assert morpholab("export gait.json --rig two.toml --csv gait.csv")[0] == 0
    code, out, error = morpholab("simulate --table gait.csv --rig two.toml --geometry two-core --json")
    assert code == 0, error
    found = json.loads(out)
    assert found["pressure"] == [2e3, 0.0] and found["rig"] == "swift" and np.isfinite(found["speed_without_lag"])
    code, _, error = morpholab("simulate --table gait.csv --rig two.toml --geometry small")
    assert code == 2 and "give one, for the one core" in error and error.count("\n") == 1


def test_commands_export_a_gait_of_several_cores(rig, tmp_path, monkeypatch, morpholab):
    monkeypatch.chdir(tmp_path)
    save_design(DESIGNS[0], tmp_path / "gait.json")
    line = "export gait.json --rig two.toml --csv gait.csv --plain plain.csv --c-header gait.h --json"
    code, out, error = morpholab(line)
    assert code == 0, error
    assert json.loads(out)["source"] == "gait.json"
    assert len((tmp_path / "plain.csv").read_text().splitlines()[0].split(",")) == 13
    header = (tmp_path / "gait.h").read_text()
    assert "GAIT_CHANNELS 12" in header and "core1, core2, bladder1" in header
    code, _, error = morpholab("export gait.json --csv other.csv")
    assert code == 2 and "name a rig with a line for each" in error and error.count("\n") == 1
    assert morpholab("play gait.csv --rig two.toml --dry-run")[0] == 0
    code, _, error = morpholab(f"export {LATTICE} --rig two.toml --csv other.csv")
    assert code == 2 and "rig: 2 lines for cores are not allowed for channels; give a rig with one" in error


def test_a_table_without_a_line_for_a_core_has_no_names():
    """It was named as if it had none, and of fewer lines as if all were there."""
    for lines in (10, 3):
        table = dataclasses.replace(gait_table(ROLLING), pressures=np.zeros((5, lines)))
        with pytest.raises(ValueError, match=rf"^channels: {lines} are not allowed; give 11$"):
            _ = table.channels
