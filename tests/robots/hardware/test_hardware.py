from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from robots.hardware import (
    CHANNELS,
    KPA_PER_UNIT,
    PRESETS,
    Channel,
    LineMap,
    PneumaticRig,
    RigViolation,
    design_hash,
    export_csv,
    gait_table,
    read_csv,
)
from robots.inflatable import INCHING as PUBLISHED_INCHING
from robots.inflatable import SMALL, InflatableActuation, InflatableDesign, simulate
from robots.inflatable.schedule import ROWS, GaitSchedule

INCHING = PUBLISHED_INCHING.schedule
QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)


@dataclass(frozen=True)
class Design:
    pressure: float = 12e3
    orientation: float = 0.0
    schedule: GaitSchedule = INCHING
    materials: None = None
    bladders: None = None


def with_channel(rig, name, **changes):
    channels = dict(zip(CHANNELS, rig.channels, strict=True))
    channels[name] = replace(channels[name], **changes)
    return replace(rig, channels=tuple(channels.values()))


schedules = st.builds(
    GaitSchedule,
    st.integers(1, 5).flatmap(lambda columns: arrays(bool, (ROWS, columns))),
    st.integers(1, 3),
)
designs = st.builds(Design, st.just(0.0) | st.floats(1.0, 12e3), st.floats(0, 90, allow_subnormal=False), schedules)
seconds = st.floats(0.05, 20.0)


@st.composite
def able_rigs(draw):
    """Rigs that can play anything: lines as far and as fast as their map asks."""
    flat, core = draw(st.floats(-90, 0, allow_subnormal=False)), draw(st.floats(1, 90))
    off = draw(st.lists(st.floats(-90, 10, allow_subnormal=False), min_size=ROWS, max_size=ROWS))
    on = [low + draw(st.floats(1, 60)) for low in off]
    channels = []
    for low, high in zip((flat, *off), (core, *on), strict=True):
        rise, fall = draw(seconds), draw(seconds)
        low, high = min(low, 0.0), max(high, 0.0)
        fastest = (high - low) / min(rise, fall)
        channels.append(Channel(rise, fall, low, high or 1.0, fastest, draw(st.sampled_from([0.0, 0.3]))))
    line_map = LineMap(12e3, core, flat, tuple(on), tuple(off))
    return PneumaticRig("any", 100.0, -100.0, tuple(channels), draw(seconds), line_map)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(designs, able_rigs(), st.sampled_from(["kpa", "psi"]), st.sampled_from([None, 7.0, 20.0]), st.integers(0, 9))
def test_any_schedule_survives_its_csv_and_its_rows_on_any_able_rig(tmp_path_factory, design, rig, units, rate, seed):
    path = tmp_path_factory.mktemp("gait") / "gait.csv"
    written = export_csv(design, path, rig, units, rate=rate, seed=seed)
    read = read_csv(path)
    assert read.design == InflatableDesign(design.pressure, design.orientation, design.schedule)
    assert (read.line_map, read.units, read.rate, read.seed) == (rig.line_map, units, rate, seed)
    assert read.sections == written.sections and read.loops == design.schedule.repeats - 1 and not read.clipped
    np.testing.assert_allclose(read.times, written.times, rtol=1e-11)
    np.testing.assert_allclose(read.pressures, written.pressures, rtol=1e-8)
    played = read.played()
    assert (played.schedule, played.orientation) == (design.schedule, design.orientation)
    assert played.pressure == pytest.approx(design.pressure, abs=6e-4)


@settings(max_examples=40, deadline=None)
@given(designs, st.sampled_from(CHANNELS), st.sampled_from(["pressure", "rate"]), st.floats(0.2, 0.9))
def test_any_violation_is_named_with_channel_time_and_limit(design, name, kind, share):
    """A limit is made too tight for one channel: at its first too large step the gait is refused."""
    rig, place = PneumaticRig(), CHANNELS.index(name)
    table = gait_table(design, rig)
    peak = table.pressures[:, place].max()
    assume(peak > 0.1)
    fastest = np.max(np.diff(table.pressures[:, place]) / np.maximum(np.diff(table.times), 1e-12))
    assume(fastest > 0.1)
    low = rig.channels[place].minimum_kpa
    if kind == "pressure":
        limit, unit = share * peak, "kPa"
        tight = with_channel(rig, name, maximum_kpa=limit)
        over = np.flatnonzero(table.pressures[:, place] > limit)[0]
        begin, end = table.times[over - 1 : over + 1]
    else:
        limit, unit = share * fastest, "kPa/s"
        tight = with_channel(rig, name, slew_kpa_per_s=limit)
        begin, end = 0.0, table.times[-1]
    with pytest.raises(
        RigViolation, match=rf"{name}: .* at .* s is not allowed; the rig's limit is .* {unit}"
    ) as caught:
        gait_table(design, tight)
    first = next(v for v in caught.value.violations if v.unit == unit)
    assert {v.channel for v in caught.value.violations} == {name} and "\n" not in str(caught.value)
    assert first.limit == pytest.approx(limit) and first.value > limit and begin <= first.time_s <= end
    clipped = gait_table(design, tight, on_violation="clip")
    assert len(clipped.clipped) == len(caught.value.violations)
    pressures, times = clipped.pressures[:, place], clipped.times
    assert low <= pressures.min() and pressures.max() <= tight.channels[place].maximum_kpa
    moves = np.diff(times) > 0
    rates = np.abs(np.diff(pressures)[moves] / np.diff(times)[moves])
    assert rates.max() <= tight.channels[place].slew_kpa_per_s * (1 + 1e-5)
    assert clipped.played().schedule == design.schedule


@pytest.mark.kernels
def test_rows_alone_reach_the_designed_speed(tmp_path):
    """Also a core pressure of many digits, in psi, sampled."""
    designs = []
    for pressure in (12e3, 7654.321987):
        design = InflatableDesign(pressure, 0.0, GaitSchedule(INCHING.bits[:, :2], 1))
        export_csv(design, tmp_path / "gait.csv", units="psi", rate=10.0)
        played = read_csv(tmp_path / "gait.csv").played()
        designs += [design, InflatableDesign(played.pressure, played.orientation, played.schedule)]
    speed = simulate(designs, geometry=SMALL, actuation=QUICK).speed
    assert np.all(np.abs(speed) > 1e-3)
    np.testing.assert_allclose(speed[1::2], speed[::2], rtol=0.05)
    assert speed[0] == speed[1]


def test_the_file_reads_as_documented(tmp_path):
    export_csv(Design(), tmp_path / "gait.csv", seed=3)
    lines = (tmp_path / "gait.csv").read_text().splitlines()
    assert lines[0] == "# schema=morpholab-gait-2" and lines[1].startswith("# checksum=") and lines[2] == "# units=kpa"
    for line in (f"# robot_hash={design_hash(Design())}", "# seed=3", "# loops=1", "# rig=dissertation"):
        assert line in lines
    names = next(line for line in lines if not line.startswith("#"))
    assert names.startswith("time_s,section,state,core_kPa,bladder1_kPa,") and names.endswith(",foot1_kPa,foot2_kPa")
    assert [path.name for path in tmp_path.iterdir()] == ["gait.csv"]


def test_the_map_is_that_of_the_dissertation():
    lines = LineMap().lines(12e3, np.column_stack([np.ones(ROWS), np.zeros(ROWS)]))
    assert lines[0].tolist() == [50.0] + [20.0] * 8 + [50.0] * 2
    assert lines[1].tolist() == [50.0] + [0.0] * 8 + [-80.0] * 2
    assert LineMap().lines(6e3, np.zeros((ROWS, 1)))[0, 0] == 25.0
    assert LineMap().lines(0.0, np.zeros((ROWS, 1)))[0, 0] == -80.0
    assert PRESETS["dissertation"] == PneumaticRig()
    assert gait_table(Design(), PRESETS["dissertation-gentle"]).pressures.max(axis=0)[0] == 35.0


def test_states_last_until_their_slowest_changing_channel_is_done():
    table = gait_table(Design())
    # The core's 11.5 s; then bladders (2 s) change together with feet (1 s); the core vents in 4.7 s.
    ends = [state.end_s for state in table.timing]
    np.testing.assert_allclose(ends, [*(11.5 + 2.0 * np.arange(17)), 11.5 + 32.0 + 4.7])
    assert [state.slowest for state in table.timing] == ["core", *["bladder1"] * 16, "core"]
    slow = gait_table(Design(), with_channel(PneumaticRig(), "foot2", valve_delay_s=1.5))
    assert slow.timing[2].slowest == "foot2" and slow.timing[2].end_s - slow.timing[2].start_s == pytest.approx(2.5)


def test_a_state_without_change_is_short():
    still = GaitSchedule(np.repeat([[False], [True]], [8, 2], axis=0), repeats=2)
    np.testing.assert_allclose([s.end_s for s in gait_table(Design(schedule=still)).timing], [11.5, 11.6, 11.7, 16.4])


def test_channels_move_at_their_own_rates():
    table = gait_table(Design())
    now = dict(zip(table.channels, table.pressures[table.times == 12.5][0], strict=True))
    assert (now["core"], now["bladder1"], now["bladder5"]) == (50.0, 10.0, 0.0)  # one second into the first column
    assert (now["foot1"], now["foot2"]) == (-80.0, 50.0)


@pytest.mark.parametrize("rate", [None, 10.0])
def test_the_main_begins_as_it_ends_and_can_be_looped(rate):
    table = gait_table(Design(schedule=GaitSchedule(INCHING.bits[:, :4], repeats=4)), rate=rate)
    sections = np.array(table.sections)
    main = table.pressures[sections == "main"]
    np.testing.assert_array_equal(main[0], main[-1])
    assert table.loops == 3 and table.seconds == pytest.approx(11.5 + 8.0 + 3 * 8.0 + 4.7)
    assert not table.pressures[0].any() and not table.pressures[-1].any()
    np.testing.assert_allclose(table.pressures[sections == "prefix"][-1], main[0])


def test_rows_come_at_the_rate_asked_for():
    rig = with_channel(PneumaticRig(), "bladder1", rise_s=2.03)  # states last whole samples
    table = gait_table(Design(), rig, rate=20.0)
    steps = np.diff(table.times)
    np.testing.assert_allclose(steps[steps > 0], 0.05)
    assert np.count_nonzero(steps == 0) == 2  # between sections
    assert table.timing[1].end_s == pytest.approx(11.5 + 2.05)


def test_psi_is_a_unit_of_the_same_pressure():
    in_psi = gait_table(Design(), units="psi")
    np.testing.assert_allclose(in_psi.pressures * 6.894757, gait_table(Design()).pressures, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"units": "bar"}, r"units: 'bar' is unknown; choose one of kpa, psi"),
        ({"on_violation": "shrug"}, r"on_violation: 'shrug' is unknown; choose one of refuse, clip"),
        ({"rate": 0.0}, r"rate: 0.0 is not allowed; give a number from 0.1 to 1000 Hz"),
        ({"rate": 1e6}, r"rate: 1000000.0 is not allowed; give a number from 0.1 to 1000 Hz"),
        ({"seed": -1}, r"seed: -1 is not allowed; give a whole number, at least 0"),
        ({"design": Design(float("nan"))}, r"pressure: nan is not allowed; .* from 0 to 15000 Pa"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(change, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        gait_table(**{"design": Design(), **change})


def test_overdriving_is_refused_and_nothing_is_written(tmp_path):
    path = tmp_path / "gait.csv"
    path.write_text("old")
    with pytest.raises(
        ValueError, match=r"^core: 60 kPa at 9.58333 s is not allowed; the rig's limit is 50 kPa; --on-"
    ):
        export_csv(Design(pressure=14.4e3), path)
    hasty = with_channel(PneumaticRig(), "bladder8", fall_s=1.0)
    on_off = GaitSchedule(np.tile([True, False], (ROWS, 1)))
    with pytest.raises(
        RigViolation,
        match=r"^bladder8: 20 kPa/s at 13.5 s .* 15 kPa/s \(1 more; a dry run names all\); --on-violation clip",
    ):
        export_csv(Design(schedule=on_off), path, hasty)
    assert path.read_text() == "old" and [file.name for file in tmp_path.iterdir()] == ["gait.csv"]
    table = export_csv(Design(14.4e3, schedule=on_off), path, hasty, on_violation="clip")
    read = read_csv(path)
    assert read.clipped == table.clipped and len(read.clipped) == 3
    assert read.design.pressure == 14.4e3 and read.played().pressure == 12e3
    # 20 kPa at 15 kPa/s: the other bladders' 2 s still decide.
    np.testing.assert_allclose(np.diff([s.end_s for s in table.timing])[:2], 2.0)


def test_limits_that_leave_one_pressure_for_both_states_cannot_be_clipped():
    rig = with_channel(PneumaticRig(), "bladder2", minimum_kpa=-1.0, maximum_kpa=0.0)
    with pytest.raises(ValueError, match=r"^bladder2: clipping leaves 0 kPa for both on and off; widen its limits$"):
        gait_table(Design(), rig, on_violation="clip")


def test_a_folder_that_is_missing_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"gait.csv: cannot be written \(No such file or directory\)$"):
        export_csv(Design(), tmp_path / "missing" / "gait.csv")


def test_the_hash_tells_designs_apart():
    assert design_hash(Design()) == design_hash(Design(12000, 0))
    assert len({design_hash(d) for d in (Design(), Design(1e4), Design(orientation=1.0))}) == 3


def damage(mark: str, text: str, offset: int = 0):
    """Replace the line that begins with a mark, or one after it."""

    def apply(lines: list[str]) -> list[str]:
        place = next(i for i, line in enumerate(lines) if line.startswith(mark)) + offset
        return [*lines[:place], *([text] if text else []), *lines[place + 1 :]]

    return apply


def row(time="1", section="prefix", state="0", pressures="0," * 10 + "0"):
    return ",".join([time, section, state, pressures])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (damage("# schema", "# schema=other"), "schema 'other' is unknown; .* '# schema=morpholab-gait-2'"),
        (lambda lines: [], "schema None is unknown"),
        (damage("# units", "# units=bar"), "units 'bar' are unknown; give one of kpa, psi"),
        (damage("# units", "# units=psi"), "line 14: column core_psi is missing; give time_s,section,state,core_psi"),
        (damage("time_s", "time_s,section,state,core_kPa"), "line 14: column bladder1_kPa is missing"),
        (damage("# schedule", ""), "schedule is missing in the header"),
        (damage("# repeats", "# repeats=two"), "header is damaged"),
        (damage("# pressure", "# pressure_pa=1"), r"header is damaged \(robot_hash and loops do not fit"),
        (damage("time_s", "1,2,3", 2), "line 16: give 14 values, finite numbers but for the section"),
        (damage("time_s", row(pressures="0," * 10 + "much"), 2), "line 16: give 14 values, finite numbers"),
        (damage("time_s", row("nan"), 2), "line 16: give 14 values, finite numbers"),
        (damage("time_s", row("0"), 2), "line 16: time 0 s after 0 s is not allowed; it must be later"),
        (damage("time_s", row(section="main"), 2), "line 16: section 'main' does not fit state 0"),
        (damage("time_s", row(state="2"), 2), "line 16: state 2 does not follow state 0"),
        (lambda lines: lines[:20], "rows end early; give states 0 to 17"),
        (damage("time_s", row(), 2), "checksum does not fit; the file was changed or damaged"),
        (damage("# seed", "# seed=4"), "checksum does not fit"),
        (damage("# checksum", ""), "checksum does not fit"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "gait.csv"
    export_csv(Design(), path)
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    with pytest.raises(ValueError, match=rf"^{path}: {message}[^\n]*$"):
        read_csv(path)


def test_rows_that_play_no_gait_are_refused():
    table = gait_table(Design())
    pressures = table.pressures.copy()
    pressures[table.states == 12, 1:9] = 20.0
    with pytest.raises(ValueError, match=r"^gait table: the columns of its prefix differ from those of its main$"):
        replace(table, pressures=pressures).played()
    pressures[table.states == 12, 0] = 25.0
    with pytest.raises(ValueError, match=r"^core: 6000 to 12000 Pa are not allowed; a gait has one core pressure$"):
        replace(table, pressures=pressures).played()


def test_units_of_tables_are_known():
    assert KPA_PER_UNIT["psi"] == pytest.approx(6.894757293168361)
