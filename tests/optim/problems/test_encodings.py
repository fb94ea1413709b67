"""Genomes of gaits and of walkers' bodies: what they can say, and what searches make of them."""

import importlib
import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optim.cli import main
from optim.problem import Evaluation
from optim.problems.inflatable.encodings import ENCODINGS as GAIT_ENCODINGS
from optim.problems.inflatable.gait_pattern import ACTUATORS
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.walker import WalkerProblem
from optim.runs import open_run
from optim.space import Space, Variable
from robots.inflatable import INCHING, ROLLING
from robots.inflatable.schedule import GaitSchedule
from robots.lattice_robot.walker import WalkerActuation, load_walker, save_walker
from robots.lattice_robot.walker_encoding import ENCODINGS as BODY_ENCODINGS
from robots.world import Terrain

QUICK = WalkerActuation(settling=0.02, cycles=1)
# Weights into four of the six hidden nodes, into the output (its bias last), and the nodes' functions. Found by
# fitting networks to the published gaits.
ROLLING_GENOME = (
    [-1.0, -1.0, -1.6, 0.6, 0.2, -0.2, -2.5, 2.2],
    [-2.2, -1.7, -0.9, 0.5, -2.2, -0.5, -0.2, 2.0],
    [-0.5, -2.4, -1.7, 1.8, 2.1, -0.1, -1.8, -1.0],
    [-2.8, -2.5, 0.8, -1.7, 1.8, -1.9, -0.4, -1.7],
    [0.0] * 16,
    [-1.9, -2.1, 1.7, 2.2, 0.0, 0.0, -0.2],
    [1, 5, 1, 4, 0, 0],
)
INCHING_GENOME = (
    [1.6, 0.3, -0.6, 0.8, 0.4, 0.4, 0.0, 0.6],
    [-0.7, 0.4, 0.6, 1.0, 1.6, -0.6, -1.9, 1.2],
    [0.0, -1.5, -2.2, -0.4, 2.0, 0.9, -2.1, 0.9],
    [0.0, 1.5, 0.2, 2.4, -2.1, 0.9, -2.0, 0.6],
    [0.0] * 16,
    [-0.6, -0.3, -2.5, -2.2, 0.0, 0.0, 1.7],
    [3, 3, 5, 5, 0, 0],
)


def gaits(encoding, **settings):
    return GaitProblem((Terrain(),), **{"encoding": encoding, "columns": 8, **settings})


def any_values(variables, seed):
    return Space(tuple(variables)).sample(np.random.default_rng(seed), 1)[0]


# gaits

ON_OFF = sorted(name for name in GAIT_ENCODINGS if not name.startswith("graded"))


@settings(max_examples=60)
@given(st.sampled_from(ON_OFF), st.integers(1, 12), st.integers(0, 10**6))
def test_every_genome_is_a_schedule(name, columns, seed):
    encoding = GAIT_ENCODINGS[name](columns, 3)
    schedule = encoding.schedule(any_values(encoding.variables(), seed))
    assert isinstance(schedule, GaitSchedule)
    assert schedule.bits.shape == (10, columns) and schedule.repeats == 3


@pytest.mark.parametrize(("gait", "genome"), [(ROLLING, ROLLING_GENOME), (INCHING, INCHING_GENOME)])
def test_patterns_can_say_the_published_gaits(gait, genome):
    problem = gaits("pattern")
    point = np.concatenate([[gait.orientation, gait.pressure], *genome])
    assert problem.space.size == 2 + 6 * 8 + 7 + 6 and problem.design(point) == gait


@pytest.mark.long
@settings(max_examples=60)
@given(st.integers(1, 12), st.integers(0, 10**6))
def test_a_wave_runs_around_the_robot(columns, seed):
    encoding = GAIT_ENCODINGS["graded-wave"](columns, 1)
    names, point = [v.name for v in encoding.variables()], any_values(encoding.variables(), seed)
    gait, shift = encoding.schedule(point), int(point[names.index("shift")])
    levels = np.clip([point[names.index(f"level_{column + 1}")] for column in range(columns)], 0, 1)
    assert np.array_equal(gait.inflation[0], levels) and np.all(gait.settle_steps == gait.settle_steps[0])
    for before, after in pairwise(gait.inflation):
        assert np.array_equal(after, np.roll(before, -shift))
    assert gait.grip.ravel().tolist() == [p for name, p in zip(names, point, strict=True) if name.startswith("foot")]


@pytest.mark.long
@settings(max_examples=40)
@given(st.integers(1, 12), st.integers(0, 10**6))
def test_a_wave_can_be_the_start_of_a_search(columns, seed):
    encoding = GAIT_ENCODINGS["graded-wave"](columns, 1)
    gait = encoding.schedule(any_values(encoding.variables(), seed))
    assert encoding.schedule(encoding.genome(gait)) == gait


def test_what_is_no_wave_cannot():
    encoding = GAIT_ENCODINGS["graded"](4, 1)
    with pytest.raises(ValueError, match="inflation: it is no wave"):
        GAIT_ENCODINGS["graded-wave"].genome(encoding.schedule(any_values(encoding.variables(), 1)))


def test_rolling_is_a_wave():
    encoding = GAIT_ENCODINGS["graded-wave"](8, 1)
    values = [float(v.name in ("level_8", "shift")) for v in encoding.variables()]
    assert np.array_equal(encoding.schedule(np.array(values)).levels, ROLLING.schedule.bits)


def test_a_pattern_is_of_the_whole_robot():
    """A wave that runs across the robot: one weight of place and one of time."""
    encoding = GAIT_ENCODINGS["pattern"](4, 1)
    variables = encoding.variables()
    values = dict.fromkeys((v.name for v in variables), 0.0)
    values |= {"weight_hidden1_x": 1.0, "weight_hidden1_time": 1.0, "weight_on_hidden1": 1.0}
    schedule = encoding.schedule(np.array([values[v.name] for v in variables]))
    times = np.array([-0.75, -0.25, 0.25, 0.75])
    assert np.array_equal(schedule.bits, ACTUATORS[:, :1] + times > 0)
    assert np.array_equal(schedule.bits[:4], schedule.bits[7:3:-1])  # above as below


def test_a_mutation_changes_few_functions_and_every_weight():
    space = Space(tuple(GAIT_ENCODINGS["pattern"](4, 1).variables()))
    start = space.sample(np.random.default_rng(0), 1)
    deviates = np.random.default_rng(1).standard_normal((4000, space.size))
    changed = space.reflect(space.round(start + space.step * deviates)) != start
    whole = np.array([v.is_integer for v in space.variables])
    assert changed[:, ~whole].all() and 0.03 < changed[:, whole].mean() < 0.06


@pytest.mark.parametrize("schedule", [None, ROLLING.schedule])
@pytest.mark.parametrize("pressure", [None, 3e3])
@pytest.mark.parametrize("encoding", GAIT_ENCODINGS)
def test_gaits_and_shapes_are_free_or_fixed_in_every_encoding(encoding, pressure, schedule):
    problem = gaits(encoding, schedule=schedule, pressure=pressure)
    again = GaitProblem.from_description(json.loads(json.dumps(problem.describe())))
    assert again.describe() == problem.describe() and again.space == problem.space
    assert ("encoding" in problem.describe()) == (encoding != "codes" and schedule is None)
    design = problem.design(problem.space.sample(np.random.default_rng(0), 1)[0])
    assert schedule is None or design.schedule == schedule
    assert pressure is None or design.pressure == pressure


def test_an_unknown_encoding_of_gaits_is_refused():
    with pytest.raises(ValueError, match="encoding: 'dna' is unknown; choose one of codes, bits, pattern"):
        gaits("dna")


# bodies


@settings(max_examples=60)
@given(st.sampled_from(sorted(BODY_ENCODINGS)), st.tuples(*[st.integers(1, 5)] * 3), st.integers(0, 10**6))
def test_every_genome_is_a_body(name, shape, seed):
    encoding = BODY_ENCODINGS[name](shape)
    assert encoding.design(any_values(encoding.variables(), seed)).materials.shape == shape


def test_direct_genes_are_the_voxels():
    problem = WalkerProblem(shape=(2, 3, 2))
    values = dict.fromkeys(problem.space.names, 0) | {"voxel_2_1_2": 3, "voxel_1_3_1": 1}
    materials = problem.design(problem.space.from_dict(values)).materials
    assert materials[1, 0, 1] == 3 and materials[0, 2, 0] == 1 and materials.sum() == 4


def test_a_pattern_body_has_the_materials_that_say_most_where_it_is_present():
    """Present near the middle; active in front, in antiphase behind."""
    problem = WalkerProblem(shape=(4, 4, 4), encoding="pattern")
    values = dict.fromkeys(problem.space.names, 0.0)
    values |= {"weight_hidden1_radius": 1.0, "weight_presence_hidden1": -1.0, "weight_presence_bias": 1.2}
    values |= {"weight_hidden2_x": 1.0, "weight_active_hidden2": 1.0, "weight_antiphase_hidden2": -1.0}
    materials = problem.design(problem.space.from_dict(values)).materials
    assert (materials[2:] > 0).sum() == (materials[:2] > 0).sum() == 28 and not materials[::3, ::3, ::3].any()
    assert set(np.unique(materials[2:])) == {0, 2} and set(np.unique(materials[:2])) == {0, 3}


@pytest.mark.kernels
@pytest.mark.parametrize("encoding", BODY_ENCODINGS)
def test_walkers_are_judged_saved_and_described(encoding, tmp_path):
    problem = WalkerProblem((3, 3, 2), encoding, actuation=QUICK, threads=1)
    points = problem.space.sample(np.random.default_rng(4), 6)
    evaluation = problem.evaluate(points)
    again = WalkerProblem.from_description(json.loads(json.dumps(problem.describe())))
    assert again.describe() == problem.describe() and again.space == problem.space
    assert np.array_equal(again.evaluate(points[::-1]).objectives[::-1], evaluation.objectives, equal_nan=True)
    works = ~evaluation.failed
    assert works.sum() >= 2 and len(np.unique(evaluation.objectives[works])) == works.sum()
    distance = evaluation.details["distance"][works]
    assert evaluation.objectives[works, 0] == pytest.approx(distance / 0.06 * 4) and (distance != 0).all()
    problem.save(points[0], tmp_path / "walker.json")
    assert np.array_equal(load_walker(tmp_path / "walker.json").materials, problem.design(points[0]).materials)


def test_bodies_that_are_no_robots_fail_with_a_reason():
    problem = WalkerProblem((3, 3, 2), actuation=QUICK)
    evaluation = problem.evaluate(np.stack([problem.space.low, problem.space.low + 1]))
    assert evaluation.failed.all() and np.isnan(evaluation.objectives).all()
    assert list(evaluation.status) == ["the body is empty", "the body has no active voxel"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"encoding": "dna"}, "encoding: 'dna' is unknown; choose one of direct, pattern"),
        ({"shape": [4, 0, 3]}, "shape: 0 is not allowed; give a whole number, at least 1"),
        ({"shape": [4, 4]}, r"shape: \(4, 4\) is not allowed; give \(X, Y, Z\)"),
        ({"terrain": {"low_friction": 0.1}}, "low_friction: 0.1 is not allowed; a walker has no sliding feet"),
        ({"actuation": {"cycles": 0}}, "cycles: 0 is not allowed"),
        ({"actuation": {"speed": 1}}, "problem: its description is damaged"),
        ({"colour": "red"}, "problem: its description is damaged"),
    ],
)
def test_descriptions_of_no_walker_are_refused_in_one_line(change, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        WalkerProblem.from_description({**WalkerProblem().describe(), **change})
    assert "\n" not in str(error.value)


def test_walkers_are_not_exported_and_no_gaits(tmp_path, capsys):
    config = {"problem": WalkerProblem().describe(), "method": {"name": "random", "seed": 0}, "generations": 1}
    with open_run(tmp_path / "a", config):
        pass
    assert main(["export", str(tmp_path / "a"), "--csv", str(tmp_path / "a.csv")]) == 2
    assert capsys.readouterr().err.endswith(f": error: source: {tmp_path / 'a'} has no best design yet\n")
    design = WalkerProblem().design(WalkerProblem().space.low + 2)
    save_walker(design, tmp_path / "walker.json")
    assert main(["export", str(tmp_path / "walker.json"), "--csv", str(tmp_path / "a.csv")]) == 2
    assert capsys.readouterr().err.endswith(": error: source: soft walker has no gait table; no rig plays it\n")
    with pytest.raises(ValueError, match=r"^problem: it is a gait, but a walker is needed here$"):
        WalkerProblem.from_description(GaitProblem((Terrain(),)).describe())


# comparisons at equal cost


class Sphere:
    """A quick problem that fails on the left."""

    objective_names = ("height",)
    space = Space((Variable("x", -1.0, 1.0, step=0.1), Variable("y", -1.0, 1.0, step=0.1)))

    def describe(self):
        return {"name": "sphere", "precision": "f64"}

    def evaluate(self, points):
        return Evaluation(np.where(points[:, 0] < -0.5, np.nan, -(points**2).sum(axis=1)))

    def save(self, point, path):
        path.write_text(str(point))


@pytest.fixture
def equal_cost(monkeypatch):
    import optim.experiments.equal_cost

    monkeypatch.setattr(optim.experiments.equal_cost, "SEEDS", (0, 1))
    return optim.experiments.equal_cost


def test_comparisons_continue_where_they_stopped(equal_cost, tmp_path, capsys):
    entries = {
        "many starts": equal_cost.Entry(Sphere, "random", {"climbers": 4}),
        "climbing": equal_cost.Entry(Sphere, "hill-climb", {"climbers": 4}),
    }

    def contest(budget, name):
        return equal_cost.Contest(entries, "evaluations", budget, tmp_path / name)

    for budget in (12, 40):
        contest(budget, "pieces").run([0, 1])
    whole = contest(40, "whole")
    assert not whole.complete
    whole.run([0, 1])
    assert whole.complete and not contest(41, "whole").complete
    for name in entries:
        curves = [
            [(p["evaluations"], p["best"], p["mean"]) for p in contest(40, where).curve(name, 1)]
            for where in ("pieces", "whole")
        ]
        assert curves[0] == curves[1] and [e for e, _, _ in curves[0]] == list(range(4, 41, 4))
        assert whole.at(whole.curve(name, 1), 15, "best") == curves[0][2][1]
        assert np.isnan(whole.at(whole.curve(name, 1), 3, "best"))
    rows = whole.table().splitlines()
    assert len(rows) == 4 and rows[2].startswith("| many starts | 40 |") and rows[3].startswith("| climbing | 40 |")
    assert sum(int(row.split("|")[-2]) for row in rows[2:]) == 2
    whole.save_plot(tmp_path / "curves.png", "height")
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert "climbing-1: 40 evaluations" in capsys.readouterr().out


def test_what_a_kill_left_of_the_booked_cost_is_completed(equal_cost, tmp_path, monkeypatch):
    contest = equal_cost.Contest(
        {"climbing": equal_cost.Entry(Sphere, "hill-climb", {"climbers": 4})}, "evaluations", 20, tmp_path
    )
    contest.run([0])
    clock = tmp_path / "climbing-0" / "cpu.jsonl"
    lines = clock.read_text().splitlines(keepends=True)
    monkeypatch.setattr("optim.runs.history._read_timing", lambda *_: ((1.0, 2.0, 3.0, 4.0, 5.0), None))
    for left in ("".join(lines[:3]), "".join(lines[:3]) + lines[3][:9]):  # before, and within, the line of generation 3
        clock.write_text(left)
        contest.run([0])
        curve = contest.curve("climbing", 0)
        assert [point["evaluations"] for point in curve] == [4, 8, 12, 16, 20]
        assert [point["best"] for point in curve] == [json.loads(line)["best"] for line in lines]
        assert curve[3]["cpu"] == curve[2]["cpu"] + 4.0 and curve[4]["cpu"] == curve[3]["cpu"] + 5.0


def test_the_status_of_a_comparison_knows_how_far_its_runs_shall_go(equal_cost, tmp_path, capsys):
    entries = {"climbing": equal_cost.Entry(Sphere, "hill-climb", {"climbers": 4})}
    equal_cost.Contest(entries, "evaluations", 12, tmp_path).run([0])
    assert main(["status", str(tmp_path)]) == 0
    assert "finished, hill-climb, generation 2/2," in capsys.readouterr().out


def test_curves_are_drawn_into_a_new_folder(equal_cost, tmp_path):
    contest = equal_cost.Contest(
        {"climbing": equal_cost.Entry(Sphere, "hill-climb", {"climbers": 4})}, "evaluations", 4, tmp_path
    )
    contest.run([0, 1])
    contest.save_plot(tmp_path / "curves" / "gaits.png", "height")
    assert (tmp_path / "curves" / "gaits.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["hybrids", "gradient_codesign"])
def test_comparisons_by_cpu_time_share_their_command_line(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "path", [str(Path(__file__).parents[3] / "benchmarks"), *sys.path])
    benchmark, equal_cost = importlib.import_module(name), importlib.import_module("equal_cost")
    monkeypatch.setattr(sys, "argv", [name, "--out", str(tmp_path), "--budget", "0", "--seeds", ""])
    equal_cost.compare_at_equal_cpu_time(benchmark.__doc__, benchmark.ENTRIES)
    assert capsys.readouterr().out == "" and not list(tmp_path.iterdir())
