"""Gaits with levels between 0 and 1 and times of their own: what they do, their files, and their search."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from graded import GRIPPING, LOW, QUICK, TINY, graded_designs, retabled, settling, tabled, unskipped
from hypothesis import given, settings
from hypothesis import strategies as st

from optim.problems.inflatable.graded_encoding import LEAST_MOTION, GradedGait, GradedWaveGait
from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable import INCHING, NAMED_GEOMETRIES, ROLLING, InflatableDesign, simulation
from robots.inflatable.actuation import PUBLISHED_STEPS
from robots.inflatable.design import load_design, save_design
from robots.inflatable.gradient import differentiate
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import (
    MOST_COLUMNS,
    counted_steps,
    full_stroke_steps,
    gait_steps,
    gait_timeline,
    most_repeats,
    nominal_steps,
    play,
)
from robots.world import Terrain

HILL = Terrain(5.0)
ROBOT = {"geometry": TINY, "actuation": QUICK}


def random_levels(seed: int, columns: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (10, columns))


def graded(gait: GaitSchedule, pressure: float = 2e3) -> InflatableDesign:
    return InflatableDesign(pressure, 40.0, gait)


# what they do


@pytest.mark.kernels
def test_the_published_times_given_change_no_bit_of_on_and_off():
    binary = InflatableDesign(0.0, 90.0, INCHING.schedule.cut(2, 1))
    on_off = unskipped(binary)
    published = play(binary.schedule, QUICK)[0]
    motion, settle = [column.motion_steps for column in published], np.full(2, QUICK.settle_steps)
    timed = InflatableDesign(0.0, 90.0, settling(binary.schedule.levels, settle, 1, motion))
    runs = [simulation.simulate(design, HILL, perturbation=1e-6, **ROBOT) for design in (binary, on_off, timed)]
    assert runs[0].status[0] == "ok" and abs(runs[0].distance[0]) > 1e-5
    for field in ("distance", "speed_simulated", "steps"):
        assert getattr(runs[0], field)[0] == getattr(runs[1], field)[0] == getattr(runs[2], field)[0]
    assert runs[0].speed[0] == runs[1].speed[0]


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_published_times_given_are_the_published_program(seed):
    """Of any levels: durations are data, whether a gait says them or not."""
    levels = random_levels(seed, 3)
    plain = tabled(levels[:8], levels[8:], 1)
    motion = [column.motion_steps for column in play(plain, QUICK)[0]]
    timed = settling(levels, np.full(3, QUICK.settle_steps), 1, motion)
    programs = [build_program([graded(gait)], HILL, QUICK) for gait in (plain, timed)]
    assert np.array_equal(programs[0].lengths, programs[1].lengths)
    assert np.array_equal(programs[0].events, programs[1].events)


def test_columns_last_as_long_as_their_slowest_bladder_moves_and_then_settle():
    levels = np.zeros((10, 2))
    levels[0, 0], levels[1, 0] = 0.5, 0.25
    columns, steps = play(settling(levels, [7, 0], 2), QUICK)
    stroke = full_stroke_steps(QUICK)
    motion = [column.motion_steps for column in columns]
    assert motion[0] == pytest.approx(stroke / 2, abs=2) and len(set(motion[1:])) == 1
    starts = [column.start for column in columns]
    assert np.diff(starts).tolist() == [motion[0] + 7, motion[1], motion[2] + 7]
    assert steps == sum(motion) + 14 == gait_steps(settling(levels, [7, 0], 2), QUICK)
    held = play(settling(levels, [0, 0], 1, [stroke, 3]), QUICK)[0]
    assert held[0].motion_steps == stroke and held[1].motion_steps == motion[1]


@pytest.mark.kernels
def test_a_column_without_change_that_does_not_settle_is_one_step():
    still = settling(np.full((10, 3), 0.5), [0, 0, 0])
    assert [column.motion_steps for column in play(still, QUICK)[0]][1:] == [1, 1]
    assert simulation.simulate(graded(still), HILL, **ROBOT).status[0] == "ok"


def test_a_timeline_tells_what_is_played():
    gait = InflatableDesign(3e3, 0.0, GaitSchedule(np.eye(10)[:, :3]))
    both = [gait_timeline(design, QUICK) for design in (gait, unskipped(gait))]
    for one, other in zip(*(dataclasses.astuple(each) for each in both), strict=True):
        assert np.array_equal(one, other)
    assert both[0].levels.shape == (10, 6) and both[0].edges[-1] == both[0].steps == gait_steps(gait.schedule, QUICK)
    core = dataclasses.replace(unskipped(gait).schedule, core_pressure=[1e3, 2e3, 3e3])
    changing = gait_timeline(InflatableDesign(0.0, 0.0, core), QUICK)
    assert changing.pressures.tolist() == [0, 1e3, 2e3, 3e3, 1e3, 2e3, 3e3]
    assert (changing.settles + QUICK.settle_steps == changing.edges[1:]).all()


@pytest.mark.kernels
def test_speeds_are_counted_by_the_time_of_a_published_gait_or_by_more():
    brief, long = settling(random_levels(1), [0, 0]), settling(random_levels(1), [10, 10])
    found = simulation.simulate([graded(brief), graded(long)], HILL, **ROBOT)
    nominal = nominal_steps(16, QUICK)
    metres = found.distance / TINY.body_length / TINY.time_step
    assert found.speed == pytest.approx(metres / nominal, rel=1e-12)
    assert found.speed_simulated == pytest.approx(metres / found.steps, rel=1e-12)
    assert counted_steps(brief) == PUBLISHED_STEPS
    assert counted_steps(settling(random_levels(1), [150_000, 90_000])) > 240_000
    assert counted_steps(INCHING.schedule) == counted_steps(unskipped(ROLLING).schedule) == PUBLISHED_STEPS
    slow = dataclasses.replace(INCHING.schedule, pace=np.full((8, INCHING.schedule.columns), 0.1))
    assert counted_steps(slow) == gait_steps(slow) > 5 * PUBLISHED_STEPS
    slow = settling(random_levels(1), [0, 2 * nominal])
    found = simulation.simulate(graded(slow), HILL, **ROBOT)
    assert found.speed[0] == found.speed_simulated[0]


@pytest.mark.kernels
def test_on_and_off_and_levels_between_can_be_mixed_and_order_is_kept():
    designs = [InflatableDesign(1e3, 0.0, INCHING.schedule.cut(2, 1)), graded(settling(random_levels(4), [5, 0]))]
    mixed = simulation.simulate(designs, HILL, **ROBOT)
    alone = [simulation.simulate(unskipped(design), HILL, **ROBOT) for design in designs]
    assert mixed.distance.tolist() == [run.distance[0] for run in alone]


@pytest.mark.kernels
def test_gradients_agree_with_differences_while_durations_hold():
    """By levels and by grip, on the way up a hill; times of motion are long enough for every difference."""
    stroke = full_stroke_steps(LOW)
    options = {"geometry": GRIPPING, "actuation": dataclasses.replace(LOW, ramp_steps=500), "threads": 1}
    designs = [graded(settling(random_levels(seed), [20, 0], 1, [stroke, stroke])) for seed in (1, 2, 3)]
    found = differentiate(designs, HILL, **options)
    assert (found.result.steps == 2 * stroke + 20).all()
    generator, steps = np.random.default_rng(5), np.array([1e-7, -1e-7, 5e-8, -5e-8])
    for part, rows, scale in (("inflation", 8, 1.0), ("grip", 2, 10.0)):
        direction = scale * generator.normal(size=(3, rows, 2))
        moved = [
            graded(retabled(design.schedule, **{part: getattr(design.schedule, part) + h * change}))
            for h in steps
            for design, change in zip(designs, direction, strict=True)
        ]
        distance = simulation.simulate(moved, HILL, **options).distance.reshape(4, 3)
        far, near = (distance[::2] - distance[1::2]) / (steps[::2] - steps[1::2])[:, None]
        along = (getattr(found, part) * direction).reshape(3, -1).sum(axis=1)
        smooth = np.abs(far - near) < 1e-4 * np.abs(far)  # not where contact begins or ends in between
        assert smooth.any() and (along != 0).all(), part
        assert along[smooth] == pytest.approx(far[smooth], rel=1e-3), part


# what is not allowed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"settle_steps": [1]}, r"settle_steps: shape \(1,\) is not allowed; give \(2,\)"),
        ({"settle_steps": [1, -1]}, "settle_steps: -1.0 of column 2 is not allowed; give numbers from 0 to 1e\\+06"),
        (
            {"motion_steps": [1, 2e6]},
            "motion_steps: 2000000.0 of column 2 is not allowed; give numbers from 0 to 1e\\+06",
        ),
        ({"motion_steps": [0.5, 1]}, "motion_steps: 0.5 is not allowed; give a whole number"),
        ({"motion_steps": [np.nan, 1]}, "motion_steps: nan is not allowed; give finite numbers"),
        ({"motion_steps": "soon"}, r"motion_steps: 'soon' is not allowed; give numbers of shape \(2,\)"),
        (
            {"inflation": np.full((8, 2), 1.5)},
            "inflation: 1.5 of bladder1, column 1 is not allowed; give numbers from 0 to 1",
        ),
        ({"repeats": 0}, "repeats: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_bad_gaits_are_refused_in_one_line(change, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        repeats = change.pop("repeats", 2)
        dataclasses.replace(retabled(settling(random_levels(0), [0, 0]), **change), repeats=repeats)


def test_on_and_off_cannot_say_times():
    gait = settling(random_levels(0), [0, 0])
    with pytest.raises(ValueError, match=r"^steps: times of its own are not allowed; on and off have"):
        gait.project()
    assert gait.decided() == GaitSchedule(gait.levels >= 0.5, 1) and gait.decided().skip_idle


# files


@given(graded_designs)
@settings(max_examples=50)
def test_a_design_survives_its_file_and_its_text(tmp_path_factory, design):
    path = tmp_path_factory.mktemp("gait") / "gait.json"
    save_design(design, path)
    assert load_design(path) == design
    assert json.loads(path.read_text())["format"] == "morpholab-graded-design-1"
    gait = GaitSchedule.from_text(design.schedule.to_text(), design.schedule.repeats)
    assert gait == design.schedule and hash(gait) == hash(design.schedule)
    assert gait.cut(1, 1).columns == 1 and gait.cut(None, None) == gait


def test_on_and_off_have_the_files_that_they_always_had(tmp_path):
    save_design(ROLLING, tmp_path / "gait.json")
    assert load_design(tmp_path / "gait.json") == ROLLING
    rows = ",\n    ".join(f'"{"0" * (7 - i)}1{"0" * i}"' for i in range(8))
    head = '{\n  "format": "morpholab-inflatable-design-1",\n  "pressure": 12000.0,\n  "orientation": 0.0,'
    feet = '"00000000",\n    "00000000"'
    text = f'{head}\n  "schedule": [\n    {rows},\n    {feet}\n  ],\n  "repeats": 2\n}}\n'
    assert (tmp_path / "gait.json").read_text() == text
    assert GaitSchedule.from_text(ROLLING.schedule.to_text()) == ROLLING.schedule


def test_equal_gaits_are_those_of_equal_numbers():
    gait = settling(random_levels(0), [0, 0])
    others = [gait.cut(1, 1), gait.cut(2, 2), settling(random_levels(0), [0, 1]), INCHING.schedule]
    assert gait == settling(random_levels(0), [-0.0, 0]) and all(gait != other for other in others)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inflation": None}, r"inflation: shape \(\) is not allowed; give \(8, T\)"),
        ({"grip": [[0, 1]]}, r"grip: shape \(1, 2\) is not allowed; give \(2, 2\)"),
        ({"settle_steps": [1, 2, 3]}, r"settle_steps: shape \(3,\) is not allowed"),
        ({"settle": [1, 2]}, "settle: is unknown; a gait's tables are inflation, grip, core_pressure, motion_steps, s"),
        (
            {"inflation": [[True, 0.5]] * 8},
            r"inflation: \[\[True, 0.5\], .* is not allowed; give numbers of shape \(8, T\)",
        ),
        ({"grip": [[True, False]] * 2}, r"grip: \[\[True, False\], .* is not allowed; give numbers of shape \(2, 2\)"),
        ({"settle_steps": [1, True]}, r"settle_steps: \[1, True\] is not allowed"),
        ({"repeats": 1.5}, "repeats: 1.5 is not allowed"),
        ({"repeats": True}, "repeats: True is not allowed"),
        ({"pressure": -1}, "pressure: -1 is not allowed"),
        ({"format": "morpholab-graded-design-2"}, "it is of the format 'morpholab-graded-design-2'; gaits of"),
        ({"format": "morpholab-walker-design-1"}, "it is of the format 'morpholab-walker-design-1'; gaits of"),
        ({"format": 3}, "it is not of the format 'morpholab-inflatable-design-1'"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, change, message):
    path = tmp_path / "gait.json"
    save_design(graded(settling(random_levels(0), [0, 0])), path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ValueError, match=rf"^{path}: {message}[^\n]*$"):
        load_design(path)


@pytest.mark.parametrize("name", ["inflation", "grip", "repeats", "pressure", "orientation"])
def test_what_is_missing_in_a_file_is_named(tmp_path, name):
    path = tmp_path / "gait.json"
    save_design(graded(settling(random_levels(0), [0, 0])), path)
    record = json.loads(path.read_text())
    del record[name]
    path.write_text(json.dumps(record))
    with pytest.raises(ValueError, match=rf"^{path}: '{name}' is missing$"):
        load_design(path)
    path.write_text(path.read_text()[:-3])
    with pytest.raises(ValueError, match=rf"^{path}: [^\n]*$"):
        load_design(path)


@pytest.mark.parametrize("name", ["format", "inflation", "repeats", "pressure"])
def test_a_name_that_is_given_twice_in_a_file_is_refused(tmp_path, name):
    """JSON would take the last value, and the file that someone edited would be another gait than it looks."""
    path = tmp_path / "gait.json"
    save_design(graded(settling(random_levels(0), [0, 0])), path)
    value = json.loads(path.read_text())[name]
    path.write_text(path.read_text().rstrip("\n}") + f', "{name}": {json.dumps(value)}}}')
    with pytest.raises(ValueError, match=rf"^{path}: '{name}' is given twice, which is not allowed; give it once$"):
        load_design(path)


def test_a_name_that_is_given_twice_in_a_text_is_refused():
    with pytest.raises(ValueError, match=r"^schedule: 'grip' is given twice, which is not allowed; give it once$"):
        GaitSchedule.from_text('{"inflation": [], "grip": [], "grip": []}')


def test_truth_values_of_a_caller_are_on_and_off():
    """As a matrix of bits always was; beside numbers they are a slip."""
    bits = np.random.default_rng(0).random((10, 3)) < 0.5
    assert GaitSchedule(bits) == GaitSchedule(bits.tolist()) == GaitSchedule(bits.astype(float))
    with pytest.raises(ValueError, match=r"^schedule: .* is not allowed; give numbers of shape"):
        GaitSchedule([[True, 0.5, 0.0]] * 10)


def test_a_damaged_text_is_refused_in_one_line():
    for text in ("{", "{}", '{"inflation": 3, "grip": 1}', '{"grip": []}'):
        with pytest.raises(ValueError, match=r"^(schedule|inflation): [^\n]*$"):
            GaitSchedule.from_text(text)


# search


@given(st.integers(1, 5), st.integers(0, 10**6), st.integers(1, 250_000))
@settings(max_examples=15)
def test_every_genome_is_a_gait_that_takes_its_steps_or_one_cycle(columns, seed, steps):
    encoding = GradedGait(columns, 2, steps)
    variables = encoding.variables()
    assert len(variables) == 11 * columns and variables[0].name == "bladder1_1"
    assert variables[8 * columns].name == "foot1_1" and variables[-1].name == f"settle_{columns}"
    generator = np.random.default_rng(seed)
    values = np.array([generator.uniform(v.low, v.high) for v in variables])
    values[8 * columns : 10 * columns] = values[8 * columns : 10 * columns] > 0.5
    gait = encoding.schedule(values)
    taken = gait_steps(gait)
    assert gait.repeats == 1 or taken <= steps
    full = (gait.repeats + 1) * columns > MOST_COLUMNS
    assert taken > steps or full or gait_steps(gait.cut(None, gait.repeats + 2)) > steps
    assert np.array_equal(gait.inflation, np.clip(values[: 8 * columns], 0, 1).reshape(8, -1))
    assert np.isin(gait.grip, (0, 1)).all() and (gait.motion_steps == LEAST_MOTION).all()
    assert (gait.settle_steps >= 0).all() and (gait.settle_steps <= 4001).all()
    again = GradedGait(columns, 2, steps).schedule(GradedGait.genome(gait.cut(None, 1)))
    assert again == gait


def test_genes_say_no_times_of_motion_and_no_pressures():
    gait = settling(random_levels(0), [0, 0], 1, [10, 0])
    assert GradedGait.genome(gait).shape == (22,)  # bladders take longer anyway
    message = r"^motion_steps: graded genes move as fast as bladders do; give at most 100, and settle_steps$"
    for other in ([0, 20_000], None):
        with pytest.raises(ValueError, match=message):
            GradedGait.genome(dataclasses.replace(gait, motion_steps=other))
    with pytest.raises(ValueError, match=r"^core_pressure: one per column is not allowed; graded genes keep that of"):
        GradedGait.genome(dataclasses.replace(gait, core_pressure=[0, 0]))


def test_a_gait_in_which_nothing_moves_is_not_played_without_end():
    still = GradedGait(1, 1, 10**6).schedule(np.zeros(11))
    assert still.repeats == MOST_COLUMNS and gait_steps(still) == MOST_COLUMNS * LEAST_MOTION < 10**6


def test_a_gait_is_played_as_often_as_its_steps_allow():
    levels = INCHING.schedule.levels[:, :2]
    gait = settling(levels, [0, 0])
    assert most_repeats(gait, PUBLISHED_STEPS) == 12 and most_repeats(gait, 1) == 1
    assert gait_steps(gait.cut(None, 12)) <= PUBLISHED_STEPS < gait_steps(gait.cut(None, 13))


def problem(**more) -> GaitProblem:
    return GaitProblem((Terrain(), HILL), **{"encoding": "graded", "columns": 2, "geometry": "small", **more})


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"steps": 30_000, "pressure": 0.0},
        {"schedule": settling(random_levels(3), [4, 0], 5), "encoding": "codes"},
        {"schedule": tabled(random_levels(3)[:8], random_levels(3)[8:]), "orientation": 90.0},
    ],
)
def test_a_problem_can_be_built_from_its_description(more):
    described = problem(**more).describe()
    again = GaitProblem.from_description(json.loads(json.dumps(described)))
    assert again.describe() == described and again.schedule == more.get("schedule")
    assert ("steps" in described) == ("steps" in more)
    point = again.space.sample(np.random.default_rng(0), 1)[0]
    assert isinstance(again.design(point), InflatableDesign)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"encoding": "bits", "steps": 100}, "steps: 100 is not allowed with encoding 'bits'; they are of a free gra"),
        ({"schedule": ROLLING.schedule, "steps": 100}, "steps: 100 is not allowed with a fixed gait; they are of a f"),
        ({"encoding": "bits", "most_full": 4}, "most_full: 4.0 is not allowed with encoding 'bits'; they are of a f"),
        ({"most_full": 9}, "most_full: 9 is not allowed"),
        ({"steps": 0}, "steps: 0 is not allowed; give a whole number, at least 1"),
        ({"columns": 0}, "columns: 0 is not allowed"),
    ],
)
def test_problems_refuse_what_is_not_allowed_in_one_line(more, message):
    with pytest.raises(ValueError, match=f"^{message}[^\n]*$"):
        problem(**more)


class Counted:
    """Stands in for ``simulate``: every robot goes 1 m."""

    def __init__(self, geometry):
        self.geometry = geometry

    def __call__(self, designs, terrain, **_):
        steps = np.array([gait_steps(d.schedule) for d in designs])
        nominal = np.array([counted_steps(d.schedule) for d in designs])
        metre = np.ones(len(designs)) / self.geometry.body_length / self.geometry.time_step
        return SimpleNamespace(
            speed=metre / nominal,
            steps=steps,
            status=np.full(len(steps), "ok"),
            stages=np.ones((len(steps), 1)),
            time_step=self.geometry.time_step,
        )


@pytest.mark.parametrize("steps", [None, 20_000, 400_000])
def test_speeds_scale_with_the_steps_that_gaits_may_take(monkeypatch, steps):
    geometry = NAMED_GEOMETRIES["small"]
    monkeypatch.setattr("robots.inflatable.simulation.simulate", Counted(geometry))
    for columns, settle in ((2, 0.0), (18, 4001.0)):  # of 18 columns one cycle takes longer than a published gait
        hills = problem(steps=steps, columns=columns, pressure=0.0, orientation=90.0)
        levels = np.tile([0.0, 1.0], columns // 2)  # moves a full stroke in every column
        genes = np.concatenate([np.tile(levels, 10), np.full(columns, settle)])
        found = hills.evaluate(genes[None]).objectives[0, 0]
        design = hills.design(genes)
        taken = max(gait_steps(design.schedule), steps or PUBLISHED_STEPS)
        assert hills.counted_steps(design) == taken and (columns == 2 or gait_steps(design.schedule) > PUBLISHED_STEPS)
        assert found == pytest.approx(1 / geometry.body_length / geometry.time_step / taken, rel=1e-12)


@given(st.integers(0, 10**6), st.sampled_from([1.0, 2.5, 4.0]))
@settings(max_examples=15)
def test_no_genome_has_more_full_bladders_than_allowed(seed, most_full):
    """Graded levels and waves alike; columns within it keep their levels to the bit, and a wave stays one."""
    generator = np.random.default_rng(seed)
    for kind in (GradedGait, GradedWaveGait):
        free, within = (kind(8, 2, 10_000, most_full=most) for most in (None, most_full))
        values = np.array([generator.uniform(v.low, v.high) for v in free.variables()])
        if kind is GradedWaveGait:
            values[8] = seed % 8
        else:
            values[:64:8] -= 1.0  # of the first column, to have one within it
        before, after = (each.schedule(values).inflation for each in (free, within))
        sums = before.sum(axis=0)
        assert after.sum(axis=0) == pytest.approx(np.minimum(sums, most_full), rel=1e-12)
        kept = sums < most_full
        np.testing.assert_array_equal(after[:, kept], before[:, kept])
        assert (sums > most_full).any() or kind is GradedWaveGait
        once = dataclasses.replace(within.schedule(values), repeats=1)
        np.testing.assert_allclose(within.schedule(kind.genome(once)).inflation, after, rtol=1e-12)


def test_slopes_by_levels_are_those_of_what_is_allowed_to_be_full():
    """By differences, in a column of more full bladders than allowed and one of fewer; without a limit as ever."""
    table = np.vstack([np.full((8, 2), (0.6, 0.2)) + 0.02 * np.arange(16).reshape(8, 2), np.zeros((3, 2))])
    values, by_levels = table.ravel(), np.vstack([np.random.default_rng(0).normal(size=(8, 2)), np.zeros((2, 2))])
    for most_full in (3.0, None):
        encoding = GradedGait(2, 1, 10, most_full=most_full)
        found = encoding.slopes(values, 0.0, by_levels)[:16]
        h = 1e-6 * np.eye(22)[:16]
        sides = [[encoding.schedule(values + s * step).inflation for s in (1, -1)] for step in h]
        wanted = [((up - down) * by_levels[:8]).sum() / 2e-6 for up, down in sides]
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-8)
    assert found.tolist() == by_levels[:8].ravel().tolist()


def test_problems_limit_how_many_bladders_are_full():
    """The setting reaches the gaits, and is described only where it is set."""
    limited = problem(most_full=3)
    assert limited.describe()["most_full"] == 3.0 and "most_full" not in problem().describe()
    points = limited.space.sample(np.random.default_rng(0), 20)
    gaits = [[each.design(point).schedule for point in points] for each in (limited, problem())]
    fullest, free = (max(gait.inflation.sum(axis=0).max() for gait in some) for some in gaits)
    assert fullest == pytest.approx(3.0) and free > 3.5
    relaxed = [limited.relaxed_design(point, 2.0).schedule.inflation for point in points]
    assert all(np.array_equal(levels, gait.inflation) for levels, gait in zip(relaxed, gaits[0], strict=True))
    assert dict(limited.facts())["Gait"].endswith("encoded as graded, at most 3 bladders full at a time")


def test_slopes_stop_at_empty_and_full_and_sharpen_grip():
    encoding, values = GradedGait(1, 1, 10), np.array([*[-0.2, 0.0, 0.3, 0.5, 0.7, 1.0, 1.2, 0.1], 0.3, 0.6, 9.0])
    for sharpness in (0.0, 3.0):
        found = encoding.slopes(values, sharpness, np.ones((10, 1)))
        assert found[:8].tolist() == [0, 0, 1, 1, 1, 0, 0, 1] and found[-1] == 0
        h = np.where(np.arange(11) // 8 == 1, 1e-6, 0.0)  # grip of each foot depends on its own gene
        rise = encoding.relaxed(values + h, sharpness).grip - encoding.relaxed(values - h, sharpness).grip
        assert found[8:10] == pytest.approx(rise[:, 0] / 2e-6, rel=1e-6)
