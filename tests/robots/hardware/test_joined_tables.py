"""Tables that begin where another gait has left the lines, and what tables ask of a rig one after the other."""

import dataclasses

import numpy as np
import pytest
from graded import graded_designs
from hypothesis import given, settings

from robots.hardware import PneumaticRig, Start, export_csv, gait_table, read_csv
from robots.hardware.joined import Part, joined_faults
from robots.inflatable import INCHING, ROLLING
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.transition import change_of_shape

RIG = PneumaticRig()
FLATTENS = change_of_shape(ROLLING.pressure, 0.0, 90.0)


def joined(before, *after, rig=RIG):
    """Faults of a gait's main and then of the prefixes of tables."""
    return joined_faults([Part(gait_table(before, rig), "main"), *(Part(table, "prefix") for table in after)], rig)


def test_a_table_takes_the_time_from_where_the_gait_before_ends():
    """A whole stroke of bladder 1 and then the time to settle; from empty bladders it was that of the feet alone."""
    table = gait_table(FLATTENS, RIG, start=Start.after(ROLLING))
    end = gait_table(ROLLING, RIG).pressures[np.array(gait_table(ROLLING, RIG).sections) == "main"][-1]
    assert table.pressures[table.states == 0][-1].tolist() == end.tolist() and end[1] == 20.0
    shaping, emptying = table.timing[:2]
    assert "bladder1" in shaping.changes and emptying.slowest == "bladder1"
    assert emptying.end_s - emptying.start_s == pytest.approx(2.0 + 0.424, abs=1e-3)


def test_a_start_survives_the_file_and_is_no_part_of_the_gait(tmp_path):
    table = export_csv(FLATTENS, tmp_path / "t.csv", RIG, start=Start.after(ROLLING))
    read = read_csv(tmp_path / "t.csv")
    assert read.start == table.start == Start(ROLLING.pressure, (1.0, *[0.0] * 9))
    assert read.design == FLATTENS and read.played().schedule.levels.tolist() == FLATTENS.schedule.levels.tolist()
    other = gait_table(INCHING, RIG, start=Start.after(ROLLING))  # from another core pressure
    assert other.played() == INCHING


def test_own_starts_are_the_default():
    own = gait_table(ROLLING, RIG)
    told = gait_table(ROLLING, RIG, start=Start.of(ROLLING))
    assert told.pressures.tolist() == own.pressures.tolist() and told.times.tolist() == own.times.tolist()
    assert own.start is None


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ('{"pressure": 1.0}', "start: give a JSON object with pressure and levels"),
        ('{"pressure": 1.0, "levels": 3}', "start: give a JSON object"),
        ('{"pressure": "x", "levels": []}', "pressure: 'x' is not allowed"),
        ('{"pressure": 1.0, "levels": [0.5]}', "levels: 1 are not allowed; give 10"),
        ('{"pressure": 1.0, "levels": [2, 0, 0, 0, 0, 0, 0, 0, 0, 0]}', "levels: 2 is not allowed"),
    ],
)
def test_a_damaged_start_is_one_line(tmp_path, start, message):
    path = tmp_path / "t.csv"
    export_csv(FLATTENS, path, RIG, start=Start.after(ROLLING))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(f"# start={start}" if line.startswith("# start=") else line for line in lines))
    with pytest.raises(ValueError, match="header is damaged") as error:
        read_csv(path)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_table_of_its_own_asks_too_much_after_another_gait():
    """State 1 of a change of shape lasts 1.24 s, in which bladder 1 is to fall by 20 kPa."""
    assert joined(ROLLING, gait_table(FLATTENS, RIG)) == [
        "bladder1: 20 to 0 kPa at 16.2 kPa/s; the rig's limit is 15 kPa/s"
    ]
    fast = dataclasses.replace(
        RIG, channels=tuple(dataclasses.replace(each, slew_kpa_per_s=200.0) for each in RIG.channels)
    )
    own = gait_table(ROLLING, fast)
    assert joined(ROLLING, own, rig=fast)[0] == "bladder1: 20 to 0 kPa in 1 s; the rig takes 2 s"
    assert joined(ROLLING, gait_table(ROLLING, fast, start=Start.after(ROLLING)), rig=fast) == []


def test_pressures_beyond_the_lines_are_faults():
    low = dataclasses.replace(RIG.channels[0], maximum_kpa=40.0)
    rig = dataclasses.replace(RIG, channels=(low, *RIG.channels[1:]))
    table = gait_table(ROLLING, RIG)
    found = joined_faults([Part(table, "main"), Part(table, "main")], rig)
    assert found == ["core: 50 to 50 kPa; the rig's limits are -80 and 40 kPa"]


def test_a_rig_of_other_lines_is_refused():
    two = dataclasses.replace(RIG, channels=(RIG.channels[0], *RIG.channels), name="two")
    with pytest.raises(ValueError, match=r"^rig: two has 12 lines, the table has 11$"):
        joined_faults([Part(gait_table(ROLLING, RIG), "main")], two)


DELAYED = dataclasses.replace(
    RIG,
    name="delayed",
    channels=tuple(dataclasses.replace(each, valve_delay_s=0.05, slew_kpa_per_s=300.0) for each in RIG.channels),
)


def test_a_line_that_is_nearly_there_as_another_arrives_is_not_too_fast():
    """Rows are told where lines arrive: another one may be within what counts as arrived then."""
    levels = np.zeros((10, 2))
    levels[:2] = [[0.5, 0.99999], [0.5, 0.0]]
    first = dataclasses.replace(ROLLING, schedule=GaitSchedule(np.zeros((10, 1))))
    second = dataclasses.replace(ROLLING, schedule=GaitSchedule(levels))
    assert joined(first, gait_table(second, DELAYED, start=Start.after(first)), rig=DELAYED) == []


@settings(max_examples=40)
@given(graded_designs, graded_designs)
def test_tables_that_begin_where_the_one_before_ends_never_ask_too_much(first, second):
    """Whatever the two gaits, with a change of shape in between and without."""
    change = change_of_shape(np.atleast_1d(first.pressure)[0], np.atleast_1d(second.pressure)[0], 0.0)
    steps = [change, second]
    tables = [
        gait_table(each, DELAYED, start=Start.after(before))
        for before, each in zip([first, change], steps, strict=True)
    ]
    assert joined(first, *tables, rig=DELAYED) == []
    assert joined(first, gait_table(second, DELAYED, start=Start.after(first)), rig=DELAYED) == []
