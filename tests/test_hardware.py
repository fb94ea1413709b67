import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.hardware import CHANNELS, Channel, PneumaticRig, design_hash, export_csv, gait_table, read_csv
from robots.schedule import ROWS, GaitSchedule

INCHING = GaitSchedule.from_text("/".join(["10101010"] * 4 + ["00000000"] * 4 + ["01010101", "10101010"]))


@dataclass(frozen=True)
class Design:
    pressure: float = 12e3
    orientation: float = 0.0
    schedule: GaitSchedule = INCHING


designs = st.builds(
    Design,
    st.just(0.0) | st.floats(1.0, 12e3),
    st.floats(0, 90),
    st.builds(
        GaitSchedule,
        st.integers(1, 6).flatmap(lambda columns: arrays(bool, (ROWS, columns))),
        st.integers(1, 3),
    ),
)


@pytest.fixture
def table():
    return gait_table(Design())


@given(design=designs, units=st.sampled_from(["kpa", "psi"]))
def test_the_schedule_survives_its_csv(tmp_path_factory, design, units):
    path = tmp_path_factory.mktemp("gait") / "gait.csv"
    written = export_csv(design, path, units=units)
    read = read_csv(path)
    assert read.schedule() == design.schedule
    assert read.metadata == written.metadata
    assert (read.channels, read.units) == (CHANNELS, units)
    np.testing.assert_allclose(read.times, written.times, rtol=1e-8)
    np.testing.assert_allclose(read.pressures, written.pressures, rtol=1e-8)


def test_the_file_reads_as_documented(tmp_path):
    export_csv(Design(), tmp_path / "gait.csv")
    lines = (tmp_path / "gait.csv").read_text().splitlines()
    assert lines[:2] == ["# schema=morpholab-gait-1", "# units=kpa"]
    assert f"# design={design_hash(Design())}" in lines
    names = next(line for line in lines if not line.startswith("#"))
    assert names.startswith("time_s,core_kPa,bladder1_kPa,") and names.endswith(",foot1_kPa,foot2_kPa")
    assert [path.name for path in tmp_path.iterdir()] == ["gait.csv"]


def test_states_last_until_their_slowest_changing_channel_is_done(table):
    ends = np.array([float(end) for end in table.metadata["state_ends_s"].split(",")])
    # The core's 11.5 s; then bladders (2 s) change together with feet (1 s) in every one of the 16 columns.
    np.testing.assert_allclose(ends, 11.5 + 2.0 * np.arange(17))


def test_a_state_without_change_is_short():
    still = GaitSchedule(np.repeat([[False], [True]], [8, 2], axis=0), repeats=2)
    table = gait_table(Design(schedule=still))
    np.testing.assert_allclose(table.times[-3:], [11.5, 11.6, 11.7])


def test_channels_move_at_their_own_rates(table):
    second = table.times <= 12.5  # one second into the first column: feet done, bladders half way
    assert table.times[second][-1] == 12.5
    now = dict(zip(table.channels, table.pressures[second][-1], strict=True))
    assert (now["core"], now["bladder1"], now["bladder5"]) == (12.0, 10.0, 0.0)
    assert (now["foot1"], now["foot2"]) == (-80.0, 50.0)


def test_a_flat_body_is_drawn_flat_by_vacuum():
    assert gait_table(Design(pressure=0.0)).pressures[-1, 0] == -80.0


def test_psi_is_a_unit_of_the_same_pressure(table):
    in_psi = gait_table(Design(), units="psi")
    np.testing.assert_allclose(in_psi.pressures * 6.894757, table.pressures, rtol=1e-6)
    with pytest.raises(ValueError, match=r"^units: 'bar' is unknown; give one of kpa, psi$"):
        gait_table(Design(), units="bar")


def test_overdriving_is_refused_and_nothing_is_written(tmp_path):
    path = tmp_path / "gait.csv"
    path.write_text("old")
    with pytest.raises(ValueError, match=r"^core: 60 kPa at 11.5 s is not allowed; .* -80 to 50 kPa$"):
        export_csv(Design(pressure=60e3), path)
    rig = PneumaticRig()
    first, *others = rig.bladders
    strong = replace(rig, bladders=(replace(first, on_kpa=25.0), *others))
    with pytest.raises(ValueError, match=r"^bladder1: 25 kPa at 13.5 s is not allowed; .* 0 to 20 kPa$"):
        export_csv(Design(), path, strong)
    hasty = replace(rig, bladders=(*others, replace(first, fall_s=1.0)))
    with pytest.raises(ValueError, match=r"^bladder8: 20 kPa/s at 13.5 s is not allowed; .* 15 kPa/s$"):
        export_csv(Design(schedule=GaitSchedule(np.tile([True, False], (ROWS, 1)))), path, hasty)
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["gait.csv"]


def test_a_pressure_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match=r"^pressure: nan is not allowed; .* at least 0 Pa$"):
        gait_table(Design(pressure=float("nan")))


def test_a_folder_that_is_missing_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"gait.csv: cannot be written \(No such file or directory\)$"):
        export_csv(Design(), tmp_path / "missing" / "gait.csv")


def test_the_hash_tells_designs_apart():
    assert design_hash(Design()) == design_hash(Design(12000, 0))
    assert len({design_hash(d) for d in (Design(), Design(1e4), Design(orientation=1.0))}) == 3


@pytest.mark.parametrize("suffix", ["json", "toml"])
def test_a_rig_survives_its_file(tmp_path, suffix):
    rig = replace(PneumaticRig(), shortest_state_s=0.25)
    rig.save(tmp_path / f"rig.{suffix}")
    assert PneumaticRig.load(tmp_path / f"rig.{suffix}") == rig


def test_a_rig_file_may_hold_only_what_differs(tmp_path):
    (tmp_path / "rig.toml").write_text("shortest_state_s = 0.5\n")
    assert PneumaticRig.load(tmp_path / "rig.toml") == PneumaticRig(shortest_state_s=0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "Expecting property name"),
        ("[]", "rig: give a table with core, bladders, feet, shortest_state_s"),
        ('{"cores": 1}', "rig: 'cores' is unknown; give core, bladders"),
        ('{"core": {}}', "core: on_kpa is missing"),
        ('{"bladders": []}', "bladders: 0 channels are not allowed; give 8"),
        ('{"feet": 2}', "feet: give a list of channels"),
        ('{"shortest_state_s": 0}', "shortest_state_s: 0 is not allowed; it must be positive"),
    ],
)
def test_a_bad_rig_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "rig.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^{path}: {message}.*$"):
        PneumaticRig.load(path)


def test_a_rig_file_of_another_kind_or_none_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"rig.json: cannot be read \(No such file or directory\)$"):
        PneumaticRig.load(tmp_path / "rig.json")
    (tmp_path / "rig.yaml").write_text("")
    with pytest.raises(ValueError, match=r"rig.yaml: a rig is a .json or a .toml file$"):
        PneumaticRig.load(tmp_path / "rig.yaml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rise_s": 0.0}, "rise_s: 0 is not allowed; it must be positive"),
        ({"slew_kpa_per_s": float("nan")}, "slew_kpa_per_s: nan is not allowed; give a finite number"),
        ({"off_kpa": 50.0}, "off_kpa: 50 is not allowed; it must be below on_kpa"),
        ({"minimum_kpa": 60.0}, "minimum_kpa: 60 is not allowed; it must be below maximum_kpa"),
    ],
)
def test_a_bad_channel_is_refused(change, message):
    good = {"on_kpa": 50.0, "off_kpa": 0.0, "rise_s": 1.0, "fall_s": 1.0}
    limits = {"minimum_kpa": 0.0, "maximum_kpa": 50.0, "slew_kpa_per_s": 60.0}
    with pytest.raises(ValueError, match=f"^{message}$"):
        Channel(**{**good, **limits, **change})


def damage(line: int, text: str):
    def apply(lines: list[str]) -> list[str]:
        return [*lines[:line], text, *lines[line:][1:]]

    return apply


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (damage(0, "# schema=other"), "schema 'other' is unknown; .* '# schema=morpholab-gait-1'"),
        (damage(1, "# units=bar"), "units 'bar' are unknown"),
        (damage(10, "time_s,core_kPa"), "line 11 must be 'time_s,core_kPa,bladder1_kPa"),
        (damage(12, "1,2,3"), "line 13 must be 12 numbers, the first one increasing"),
        (damage(12, ",".join(["0"] * 12)), "line 13 must be 12 numbers, the first one increasing"),
        (damage(12, ",".join(["nan"] * 12)), "line 13 must be 12 numbers"),
        (damage(12, "what,is,this"), "line 13 must be 12 numbers"),
        (lambda lines: lines[:11], "holds no rows"),
        (lambda lines: [], "schema None is unknown"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "gait.csv"
    export_csv(Design(), path)
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(ValueError, match=rf"^{path}: {message}.*$"):
        read_csv(path)


def test_a_table_that_plays_no_schedule_is_refused(table):
    def schedule_with(**header: str) -> GaitSchedule:
        return replace(table, metadata={**table.metadata, **header}).schedule()

    with pytest.raises(ValueError, match=r"^gait table: its header does not fit"):
        schedule_with(repeats="3")
    with pytest.raises(ValueError, match=r"^gait table: its header is damaged"):
        schedule_with(columns="eight")
    with pytest.raises(ValueError, match=r"^gait table: columns is missing in its header$"):
        replace(table, metadata=json.loads('{"state_ends_s": "1", "thresholds": "1"}')).schedule()
    pressures = table.pressures.copy()
    pressures[-1, 1] = 20.0
    with pytest.raises(ValueError, match=r"^gait table: its pressures differ from one repeat to the next$"):
        replace(table, pressures=pressures).schedule()
