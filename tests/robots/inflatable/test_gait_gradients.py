"""Gradient searches for gaits: the relaxed problem and the command line, most with a stand-in for the simulator."""

import dataclasses
import functools
import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from run_products import log, products

from optim.problem import RelaxableProblem
from optim.problems.inflatable.problem import RAMP_STEPS, GaitProblem
from optim.space import Space
from robots import inflatable
from robots.inflatable import INCHING, ROLLING, load_design
from robots.inflatable.body import InflatableGeometry
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
QUICK = {"inflation_rate": 0.05, "pressure_ramp": 50.0, "hold_steps": 100, "settle_steps": 30}
WEIGHTS = np.linspace(-1.0, 1.0, 10)[:, None]
SHORT = "--climbers 3 --generations 6 --geometry small --columns 3"
BODIES = ("orientation", "pressure")


class Simulator:
    """A smooth function of design and terrain, with its gradient, as part of all that can simulate."""

    def __init__(self):
        self.calls = []
        self.diverges = lambda design: False
        self.interrupt_at = None

    def judge(self, designs, terrain, levels, options):
        self.calls.append(SimpleNamespace(designs=designs, terrain=terrain, **options))
        if len(self.calls) == self.interrupt_at:
            raise KeyboardInterrupt
        failed = np.array([self.diverges(design) for design in designs])
        pressure, orientation = (np.array([getattr(d, name) for d in designs]) for name in ("pressure", "orientation"))
        gait = np.array([(WEIGHTS * level).sum() + level[0, 0] * level[9, -1] for level in levels])
        aim = orientation / 90 - terrain.slope / 20
        distance = np.where(failed, np.nan, gait * (1 + pressure / 12e3) - aim**2)
        geometry, columns = options["geometry"], levels[0].shape[1] * designs[0].schedule.repeats
        time = nominal_steps(columns, options["actuation"]) * geometry.time_step
        status = np.where(failed, "diverged", "ok")
        result = SimpleNamespace(distance=distance, speed=distance / geometry.body_length / time, status=status)
        slope = np.array([WEIGHTS + np.zeros_like(level) for level in levels])
        slope[:, 0, 0] += [level[9, -1] for level in levels]
        slope[:, 9, -1] += [level[0, 0] for level in levels]
        slope = slope * np.where(failed, np.nan, 1 + pressure / 12e3)[:, None, None]
        gradient = {"levels": slope, "core_pressure": None}
        return SimpleNamespace(result=result, pressure=gait / 12e3, orientation=-2 * aim / 90, **gradient)

    def simulate(self, designs, terrain, *, progress=None, **options):
        return self.differentiate(designs, terrain, **options).result

    def differentiate(self, designs, terrain, *, progress=None, **options):
        return self.judge(designs, terrain, [d.schedule.levels for d in designs], options)


@pytest.fixture
def simulator(monkeypatch):
    """The stand-in, for simulations and gradients."""
    stand_in = Simulator()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    monkeypatch.setattr("robots.inflatable.gradient.differentiate", stand_in.differentiate)
    return stand_in


@pytest.fixture
def morpholab(morpholab, monkeypatch):
    """The command line, without pictures."""
    picture = lambda design, terrain, path, **_: path.write_text(f"{terrain.name} {design}")  # noqa: E731
    monkeypatch.setattr("robots.inflatable.view.picture.save_motion_picture", picture)
    return morpholab


def problem(**settings):
    terrains = (Terrain(), Terrain(15.0))
    return GaitProblem(terrains, **{"encoding": "bits", "geometry": "small", "columns": 3, **settings})


# the problem


def test_bits_are_the_matrix_of_the_schedule():
    bits = problem(columns=8)
    assert bits.space.names[:2] == BODIES and bits.space.names[2:4] == ("bladder1_1", "bladder1_2")
    assert bits.space.names[-1] == "foot2_8" and bits.space.size == 82
    for gait in (INCHING, ROLLING):
        point = np.concatenate([[gait.orientation, gait.pressure], gait.schedule.bits.ravel()])
        assert bits.design(point) == gait


def test_a_mutation_flips_about_two_bits():
    space = Space(problem(columns=8).space.variables[2:])
    flipped = space.reflect(space.round(space.step * np.random.default_rng(0).standard_normal((4000, 80))))
    space.validate(flipped)
    assert 1.6 < flipped.sum(axis=1).mean() < 2.1


@pytest.mark.parametrize("free", [{}, {"pressure": 4e3}, {"schedule": ROLLING.schedule}, {"orientation": 90.0}])
@pytest.mark.parametrize("sharpness", [0.0, 4.0])
def test_gradients_are_those_of_the_mean_speed(simulator, free, sharpness):
    relaxed = problem(**free)
    assert isinstance(relaxed, RelaxableProblem)
    space = relaxed.space.relaxed()
    points = space.sample(np.random.default_rng(2), 2)
    exact = relaxed.evaluate_relaxed(points, sharpness, gradients=True)
    assert np.array_equal(relaxed.evaluate_relaxed(points, sharpness, gradients=False).objectives, exact.objectives)
    for number, reach in enumerate(1e-6 * space.span):
        step = np.where(np.arange(space.size) == number, reach, 0.0)
        up, down = (relaxed.evaluate_relaxed(points + s, sharpness, gradients=False) for s in (step, -step))
        slope = (up.objectives - down.objectives)[:, 0] / (2 * reach)
        assert exact.gradients[:, number] == pytest.approx(slope, rel=1e-5, abs=1e-12), space.names[number]


def test_points_without_values_between_are_judged_as_true_ones(simulator):
    relaxed = problem()
    points = relaxed.space.sample(np.random.default_rng(1), 5)
    true, between = relaxed.evaluate(points), relaxed.evaluate_relaxed(points, 8.0, gradients=True)
    assert between.objectives == pytest.approx(true.objectives)
    assert between.details.keys() == true.details.keys() == {"speed_flat", "speed_hill:15"}
    first, *_, last = simulator.calls
    assert last.actuation == dataclasses.replace(first.actuation, ramp_steps=RAMP_STEPS)
    others = {"designs": 0, "terrain": 0, "actuation": 0}
    assert {**vars(first), **others} == {**vars(last), **others}


def test_the_ramp_of_the_pressure_is_as_published_unless_pressure_is_free(simulator):
    for settings, steps in (({}, RAMP_STEPS), ({"pressure": 5e3}, None), ({"pressure": 5e3, "ramp_steps": 9}, 9)):
        relaxed = problem(**settings)
        relaxed.evaluate_relaxed(relaxed.space.low, 1.0, gradients=True)
        relaxed.evaluate_relaxed(relaxed.space.low, 1.0, gradients=False)
        assert [call.actuation.ramp_steps for call in simulator.calls[-4:]] == [steps] * 4


def test_failures_have_no_gradient(simulator):
    relaxed = problem()
    points = relaxed.space.relaxed().sample(np.random.default_rng(0), 6)
    simulator.diverges = lambda design: design.pressure > 6000
    evaluation = relaxed.evaluate_relaxed(points, 1.0, gradients=True)
    failed = points[:, 1] > 6000
    assert np.array_equal(evaluation.failed, failed) and 0 < failed.sum() < 6
    assert np.array_equal(np.isnan(evaluation.gradients).all(axis=1), failed)
    assert np.isfinite(evaluation.gradients[~failed]).all() and set(evaluation.status[failed]) == {"diverged"}


@pytest.mark.parametrize("encoding", ["codes", "pattern"])
def test_by_codes_and_patterns_the_gradient_is_zero(simulator, encoding):
    coded = problem(encoding=encoding)
    points = coded.space.sample(np.random.default_rng(3), 2)
    exact = coded.evaluate_relaxed(points, 1.0, gradients=True)
    assert exact.gradients.shape == points.shape
    assert (exact.gradients[:, :2] != 0).all() and not exact.gradients[:, 2:].any()
    between = problem()
    schedules = [coded.design(point).schedule.bits.ravel() for point in points]
    same = between.evaluate_relaxed(np.column_stack([points[:, :2], schedules]), 1.0, gradients=True)
    assert np.array_equal(same.objectives, exact.objectives)
    assert np.array_equal(same.gradients[:, :2], exact.gradients[:, :2])
    with pytest.raises(ValueError, match=r"bladder1_1: 1\.5 is not allowed; give a number from 0 to 1"):
        between.evaluate_relaxed(between.space.low + 1.5, 1.0, gradients=True)


def test_each_terrain_may_be_an_objective(simulator):
    points = problem().space.sample(np.random.default_rng(1), 5)
    mean, each = (problem(objectives=name).evaluate(points) for name in ("mean", "terrains"))
    assert problem(objectives="terrains").objective_names == ("speed_flat", "speed_hill:15")
    assert np.array_equal(each.objectives, np.stack([each.details[n] for n in ("speed_flat", "speed_hill:15")], axis=1))
    assert np.array_equal(mean.objectives[:, 0], each.objectives.mean(axis=1))
    with pytest.raises(ValueError, match="objectives: 'all' is unknown; choose one of mean, terrains"):
        problem(objectives="all")


def test_descriptions_are_as_they_were_and_tell_what_is_new():
    old = problem(encoding="codes").describe()
    assert "encoding" not in old and "ramp_steps" not in old
    assert GaitProblem.from_description(old).encoding == "codes"
    for settings in (
        {},
        {"ramp_steps": 500},
        {"objectives": "terrains"},
        {"ramp_steps": 500, "encoding": "codes"},
        {"encoding": "pattern"},
    ):
        described = json.loads(json.dumps(problem(**settings).describe()))
        again = GaitProblem.from_description(described)
        assert again.describe() == described and again.space == problem(**settings).space
        assert again.ramp_steps == settings.get("ramp_steps")
    assert "encoding" not in problem(schedule=ROLLING.schedule).describe()  # of a schedule that is not free
    for change, message in (
        ({"encoding": "text"}, "encoding: 'text' is unknown"),
        ({"ramp_steps": 0}, "ramp_steps: 0"),
    ):
        with pytest.raises(ValueError, match=message):
            GaitProblem.from_description({**problem().describe(), **change})


# the command line


def test_codesign_by_gradients(morpholab, simulator, tmp_path):
    code, out, error = morpholab(f"codesign --method gradient --terrain flat --seed 2 --out a --json {SHORT}")
    assert code == 0, error
    lines, document = log(tmp_path / "a"), json.loads(out)
    assert [line["evaluations"] for line in lines] == [3 * (i + 1) for i in range(7)]
    assert [call.actuation.ramp_steps is not None for call in simulator.calls] == [False, True] * 3 + [False]
    assert lines[-1]["best"] > lines[0]["best"]
    best = load_design(tmp_path / "a/best.json")
    bits = [document["best_point"][f"{row}_{i + 1}"] for row in GaitSchedule.row_names for i in range(3)]
    assert best.schedule == GaitSchedule(np.reshape(bits, (10, 3)))
    assert simulator.simulate([best], Terrain(), **robot()).speed[0] == document["best"]
    config = tomllib.loads((tmp_path / "a/config.toml").read_text())
    assert (
        config["problem"]["encoding"] == "bits"
        and config["method"]
        | {
            "name": "gradient",
            "climbers": 3,
            "seed": 2,
            "rule": "adam",
            "gradient": "exact",
            "verify": True,
            "learning_rate": 0.05,
            "samples": 8,
        }
        == config["method"]
    )


def robot():
    return {"geometry": inflatable.NAMED_GEOMETRIES["small"], "actuation": inflatable.ACTUATION}


def test_every_option_of_the_search_arrives(morpholab, simulator, tmp_path):
    options = "--gradient smoothed --samples 2 --smoothing 0.1 --learning-rate 0.2 --rule adam --start-pressure 6000"
    code, _, error = morpholab(f"codesign --method gradient --terrain flat --out a {options} {SHORT}")
    assert code == 0, error
    method = tomllib.loads((tmp_path / "a/config.toml").read_text())["method"]
    given = {"gradient": "smoothed", "samples": 2, "smoothing": 0.1, "learning_rate": 0.2, "start": {"pressure": 6e3}}
    assert method | given == method
    assert [len(call.designs) for call in simulator.calls] == [3, 12] * 3 + [3]


@pytest.mark.parametrize("method", ["memetic", "cma-gradient"])
def test_codes_alone_have_no_gradient(morpholab, simulator, method):
    line = "--terrain flat --free control --encoding codes --gait rolling --quiet --out a"
    code, _, error = morpholab(f"codesign --method {method} {line}")
    assert code == 2 and "an integer has no gradient" in error and error.count("\n") == 1


def test_the_help_of_samples_tells_every_default(morpholab, simulator, tmp_path):
    code, out, _ = morpholab("codesign --help")
    assert code == 0 and "around the mean of cma-gradient (default: 0)" in " ".join(out.split())
    line = "--terrain flat --geometry small --columns 1 --method cma-gradient --samples 0 --set every=9 --quiet"
    assert morpholab(f"codesign {line} --generations 1 --out a")[0] == 0


@pytest.mark.long
@pytest.mark.parametrize("options", ["", "--rule l-bfgs", "--gradient smoothed --samples 2", "--free orientation"])
def test_interrupted_gradient_searches_continue_exactly(morpholab, simulator, tmp_path, options):
    line = f"codesign --terrain flat --seed 7 --method gradient {SHORT} {options}"
    if "--free" in options:
        line = line.replace(" --columns 3", "")
    assert morpholab(f"{line} --out whole")[0] == 0
    for cut in (1, 4, 5):
        simulator.calls, simulator.interrupt_at = [], cut
        assert morpholab(f"{line} --out cut{cut}")[0] == 130
        assert not (log := tmp_path / f"cut{cut}/log.jsonl").exists() or len(log.read_text().splitlines()) == cut - 1
        simulator.interrupt_at = None
        code, _, error = morpholab(f"codesign --resume --out cut{cut}")
        assert code == 0, error
        assert products(tmp_path / f"cut{cut}") == products(tmp_path / "whole")


def test_bits_are_for_every_method_and_codes_the_default(morpholab, simulator, tmp_path):
    for name, options in (("a", "--encoding bits"), ("b", ""), ("c", "--encoding bits --method random")):
        assert morpholab(f"codesign --terrain flat --out {name} {options} {SHORT}")[0] == 0
        assert ("foot2_3" in log(tmp_path / name)[-1]["best_point"]) == ("bits" in options)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--method gradient --encoding codes", "encoding: 'codes' has no gradient; method gradient needs bits or"),
        ("--method gradient --rule l-bfgs --gradient smoothed", "rule: 'l-bfgs' is not allowed with smoothed"),
        ("--method gradient --learning-rate 0", "learning_rate: 0.0 is not allowed; give a positive number"),
        ("--rule adam", "rule: method hill-climb does not take it; its settings are climbers, seed, start"),
        ("--method random --samples 4", "samples: method random does not take it"),
        ("--method gradient --samples 0", "samples: 0 is not allowed; give a whole number, at least 1"),
        ("--encoding text", "argument --encoding: invalid choice: 'text'"),
    ],
)
def test_bad_input_is_one_line(morpholab, simulator, tmp_path, line, message):
    code, out, error = morpholab(f"codesign --out new --terrain flat {line}")
    assert (code, out) == (2, "") and f"error: {message}" in error and error.count("\n") == 1
    assert simulator.calls == [] and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("start", "options", "name"),
    [
        ("--method gradient", "--method hill-climb", "method.name"),
        ("--method gradient", "--encoding codes", "problem.encoding"),
        ("--method gradient", "--learning-rate 0.1", "method.learning_rate"),
        ("--method gradient", "--rule l-bfgs", "method.rule"),
        ("", "--method gradient", "method.name"),
        ("", "--encoding bits", "problem.encoding"),
    ],
)
def test_a_run_continues_with_its_own_settings_only(morpholab, simulator, tmp_path, start, options, name):
    assert morpholab(f"codesign --terrain flat --out a {start} {SHORT}")[0] == 0
    before = products(tmp_path / "a")
    code, _, error = morpholab(f"codesign --out a --resume --quiet {options}")
    assert code == 2 and f"error: {name}: " in error and error.count("\n") == 1
    assert products(tmp_path / "a") == before
    assert morpholab("codesign --out a --resume --quiet --generations 8")[0] == 0
    assert len(log(tmp_path / "a")) == 9


@pytest.mark.kernels
def test_a_gradient_search_with_the_simulator(morpholab, monkeypatch, tmp_path):
    """Nothing stands in for anything here, but robot and actuation are of the smallest and quickest."""
    monkeypatch.setitem(inflatable.NAMED_GEOMETRIES, "small", TINY)
    monkeypatch.setattr(
        "robots.calibration.properties.InflatableActuation",
        functools.partial(inflatable.InflatableActuation, **QUICK),
    )
    monkeypatch.setattr("optim.problems.inflatable.problem.RAMP_STEPS", 200)
    # A picture is simulated in the other precision, for which kernels are built anew.
    picture = "robots.inflatable.view.picture.save_motion_picture"
    monkeypatch.setattr(picture, lambda design, terrain, path, **_: path.write_text("drawn"))
    line = "--terrain flat --geometry small --columns 2 --repeats 1 --climbers 2 --precision f64 --learning-rate 0.2"
    code, out, error = morpholab(f"codesign --method gradient --out a --json {line} --generations 2")
    assert code == 0, error
    lines, document = log(tmp_path / "a"), json.loads(out)
    assert [line["failed"] for line in lines] == [0] * 3 and np.isfinite(document["best"])
    state = np.load(tmp_path / "a/checkpoint.npz")
    assert (state["slope"][:, 2:] != 0).any() and (state["step"] != 0).any() and np.isfinite(state["value"]).all()
    assert morpholab(f"codesign --method gradient --out b {line} --generations 1")[0] == 0
    assert morpholab("codesign --out b --resume --generations 2")[0] == 0
    assert (tmp_path / "b/log.jsonl").read_bytes() == (tmp_path / "a/log.jsonl").read_bytes()
    smoothed = "--gradient smoothed --samples 2"
    assert morpholab(f"codesign --method gradient --out c {line} {smoothed} --generations 1")[0] == 0
    assert [line["failed"] for line in log(tmp_path / "c")] == [0] * 2
    assert load_design(tmp_path / "c/best.json").schedule.columns == 2
