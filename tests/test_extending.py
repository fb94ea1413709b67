"""The code on the page about extending: it runs, as a package of a user's that is installed."""

import json
import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from plug_in import install

from optim import maximise
from optim.problem import objectives_of
from optim.problems.objectives import OBJECTIVES
from optim.problems.robot import RobotProblem
from optim.search import METHODS, check_objectives
from optim.studies.catalogue import STUDIES
from robots.own_measures import OWN_MEASURES
from robots.robot import KINDS, Parameter, load_design

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text()
CODE = "\n\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
GROUPS = tomllib.loads(PAGE.partition("```toml\n")[2].partition("```")[0])["project"]["entry-points"]
ENTRIES = [(group, name, place.partition(":")[2]) for group in GROUPS for name, place in GROUPS[group].items()]
REGISTRIES = {registry.group: registry for registry in (KINDS, OWN_MEASURES, METHODS, OBJECTIVES, STUDIES)}


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """The package of the page, with one distribution for each entry point."""
    site = tmp_path / "site"
    for group, name, attribute in ENTRIES:
        install(site, "lab_" + name.replace("-", "_"), group, {name: f"my_lab:{attribute}"})
    (site / "my_lab.py").write_text(CODE)
    monkeypatch.syspath_prepend(site)
    import my_lab

    yield my_lab
    for group, name, _ in ENTRIES:
        REGISTRIES[group]._loaded.pop(name, None)
    sys.modules.pop("my_lab", None)


def test_every_kind_of_extension_is_found_by_its_name(lab):
    assert {group for group, _, _ in ENTRIES} == set(REGISTRIES)
    for group, name, attribute in ENTRIES:
        assert name in REGISTRIES[group] and REGISTRIES[group].find(name) is not None
        assert hasattr(lab, attribute)


def test_the_hopper_is_designed_by_the_new_method_and_objective(lab):
    robot = KINDS["hopper"].build(None, {})
    problem = RobotProblem(robot, objective="cautious")
    assert [(o.name, o.unit) for o in objectives_of(problem)] == [("cautious height", "m^0.5")]
    found = maximise(problem, method="coordinate", generations=60, population=8, seed=3, progress=lambda _: None)
    highest = (40.0 / 9.80665 - 1.0) * 0.3
    assert found.score == pytest.approx(np.sqrt(highest), rel=0.02)


def test_a_method_is_used_by_its_class_as_by_its_name(lab):
    problem, options = RobotProblem(lab.Hopper()), {"generations": 3, "population": 4, "progress": False}
    by_class = maximise(problem, lab.CoordinateSearch, **options)
    assert by_class.generations == maximise(problem, "coordinate", **options).generations
    with pytest.raises(ValueError, match=r"^climbers: method CoordinateSearch does not take it; its settings are "):
        maximise(problem, lab.CoordinateSearch, climbers=3)
    with pytest.raises(ValueError, match=r"^method: CoordinateSearch takes one objective, not height, mass"):
        check_objectives(lab.CoordinateSearch, ["height", "mass"])
    with pytest.raises(ValueError, match=r"^method: int is no search method; derive it from optim"):
        maximise(problem, int)


@pytest.mark.parametrize("method", ["hill-climb", "gradient-hill-climb"])
def test_the_hopper_whose_parameters_name_no_step_is_designed_by_climbers(lab, method):
    problem = RobotProblem(KINDS["hopper"].build(None, {}))
    found = maximise(problem, method=method, generations=60, climbers=8, seed=3, progress=lambda _: None)
    assert found.score == pytest.approx((40.0 / 9.80665 - 1.0) * 0.3, rel=0.05)


@pytest.mark.long
def test_runs_of_a_robot_without_a_motion_are_reported_without_a_player(lab, morpholab, tmp_path):
    for seed, name in enumerate("ab"):
        line = f"codesign --robot hopper --climbers 2 --generations 1 --seed {seed} --quiet --out runs/{name}"
        assert morpholab(line)[0] == 0
    for page, runs in (("one", "runs/a"), ("two", "runs/a runs/b")):
        code, _, error = morpholab(f"report {runs} --out {page}.html")
        assert code == 0 and "note: there is no player: one-legged hopper cannot be shown\n" in error
        text = (tmp_path / f"{page}.html").read_text()
        assert "The best design" in text and "morpholab view" not in text and "<iframe" not in text
    code, _, error = morpholab("report runs/a --no-player --out plain.html")
    assert code == 0 and "note" not in error
    code, _, error = morpholab("view runs/a --out view.html")
    assert code == 2 and "robot: one-legged hopper cannot be shown" in error


def test_options_and_terrains_reach_the_robot_and_its_run(lab, morpholab, tmp_path):
    """Whole numbers are found, the run keeps masses and slope, and its motion is as high as the hop."""
    line = "codesign --robot hill-hopper --mass 2 --pad-mass 0.5 --terrain hill:10 --method genetic --generations 60"
    assert morpholab(f"{line} --quiet --out a")[::2] == (0, "")
    code, out, _ = morpholab("simulate --robot a/best.json --slope 10 --json --out s")
    assert code == 0
    highest = (4 * 40.0 / (2.0 * 9.80665 * np.cos(np.radians(10))) - 1) * 0.3
    found = json.loads(out)
    assert found["height"] == pytest.approx(highest, rel=0.1)
    values = json.loads((tmp_path / "a/best.json").read_text())["values"]
    assert (values["springs"], values["pad"]) == (4, 0)
    robot = KINDS["hill-hopper"].build(None, {"mass": 2.0})
    replay = robot.replay([20.0, 0.2, 2, 1], robot.worlds[0])
    assert np.ptp(replay.motion.translation[:, 0, 2]) == pytest.approx(replay.outcome.measures["height"][0], rel=1e-3)
    assert morpholab("view a --out a.html --quiet")[::2] == (0, "") and (tmp_path / "a.html").exists()
    code, _, error = morpholab("simulate --robot hill-hopper --mass 0")
    assert code == 2 and "--mass: 0 is not allowed; give a number from 0.01 to 100 kg" in error


@pytest.mark.kernels
def test_worlds_of_a_kind_of_its_own_are_named_and_kept(lab, morpholab, tmp_path):
    line = "codesign --robot kicker --planet earth --planet moon --method random --climbers 2 --generations 0"
    assert morpholab(f"{line} --quiet --out a")[::2] == (0, "")
    assert tomllib.loads((tmp_path / "a/config.toml").read_text())["problem"]["worlds"] == ["earth", "moon"]
    robot = KINDS["kicker"].build(None, {})
    ways = [float(robot.simulate([6.0], world).measures["way"][0]) for world in robot.worlds]
    assert ways[0] != ways[1]
    assert morpholab("view a --planet moon --out a.html --quiet")[::2] == (0, "")
    code, _, error = morpholab("simulate --robot kicker --planet mars")
    assert code == 2 and "planet: 'mars' is unknown; choose one of earth, moon" in error


def test_a_kind_without_an_entry_point_is_designed_by_a_file(morpholab, tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    hopper = next(block for block in blocks if "class HopperKind" in block).replace('"hopper"', '"unknown"')
    more = "from optim.problems.robot import RobotProblem\nproblem = RobotProblem(Hopper())\n"
    (tmp_path / "hop.py").write_text(f"{hopper}\n{more}")
    assert morpholab("codesign --problem hop.py --climbers 4 --generations 20 --quiet --out a")[::2] == (0, "")
    assert json.loads((tmp_path / "a/best.json").read_text())["values"].keys() == {"push", "stroke"}
    for shown in ("a", "a/best.json"):
        code, _, error = morpholab(f"view {shown} --out v.html")
        assert code == 2 and error.count("\n") == 1


def test_the_method_that_names_what_changes_goes_on_to_the_same_bits(lab, morpholab, tmp_path):
    (tmp_path / "hill.py").write_text(HILL)
    search = "codesign --problem hill.py --method records --population 4 --quiet"
    assert morpholab(f"{search} --generations 5 --out whole")[::2] == (0, "")
    assert morpholab(f"{search} --generations 2 --out parts")[0] == 0
    assert morpholab("codesign --resume --problem hill.py --generations 5 --quiet --out parts")[0] == 0
    assert (tmp_path / "whole/log.jsonl").read_bytes() == (tmp_path / "parts/log.jsonl").read_bytes()


@pytest.mark.parametrize(("name", "value"), [("push", 41.0), ("stroke", -3), ("push", 2.5), ("push", "many")])
def test_designs_with_values_that_parameters_do_not_take_are_refused(
    lab, morpholab, tmp_path, monkeypatch, name, value
):
    monkeypatch.setattr(lab.Hopper, "parameters", (Parameter("push", 0, 40, "integer"), Parameter("stroke", 0.05, 0.3)))
    robot = KINDS["hopper"].build(None, {})
    robot.save([40, 0.3 + 1e-14], tmp_path / "best.json")
    assert load_design(tmp_path / "best.json").point[0] == 40
    record = json.loads((tmp_path / "best.json").read_text())
    record["values"][name] = value
    (tmp_path / "best.json").write_text(json.dumps(record))
    code, _, error = morpholab("simulate --robot best.json")
    assert code == 2 and error.count("\n") == 1
    assert name in error if isinstance(value, float | int) else "best.json" in error


FAULTY = """
from optim.search.population import PopulationSearch


class Faulty(PopulationSearch):
    def ask(self):
        return self._starts() / (1 - self.generation)

    def _take(self, points, evaluation):
        self.points, self.objectives = points, evaluation.objectives
        if len(points) > 2:
            raise ValueError("too many")

    def state(self):
        return super().state() if len(self.points) < 2 else {}["x"]
"""
HILL = "bounds = {'x': (0, 1)}\ndef evaluate(points):\n    return -points[:, 0] ** 2\n"


@pytest.mark.parametrize(
    ("population", "told"),
    [
        (1, "line 7: FloatingPointError: divide by zero encountered in divide"),
        (2, "line 15: KeyError: 'x'"),
        (3, "line 12: ValueError: too many"),
    ],
)
def test_a_fault_of_a_method_is_told_as_that_of_its_package(morpholab, tmp_path, monkeypatch, population, told):
    install(tmp_path / "site", "faulty-kit", "morpholab.methods", {"faulty": "faulty_kit:Faulty"}, FAULTY)
    monkeypatch.syspath_prepend(tmp_path / "site")
    (tmp_path / "hill.py").write_text(HILL)
    with np.errstate(divide="raise", invalid="raise"):
        line = f"codesign --problem hill.py --method faulty --population {population} --generations 2 --quiet --out a"
        code, _, error = morpholab(line)
    METHODS._loaded.pop("faulty")
    sys.modules.pop("faulty_kit")
    assert (code, error) == (1, f"morpholab codesign: failed: {tmp_path}/site/faulty_kit.py, {told}\n")


def test_a_fault_of_a_robot_is_told_as_that_of_its_package(lab, morpholab, monkeypatch):
    monkeypatch.setattr(lab.Hopper, "mass", None)
    code, _, error = morpholab("codesign --robot hopper --climbers 2 --generations 1 --quiet --out a")
    assert code == 1 and re.search(r"failed: /.*/my_lab\.py, line \d+: TypeError: unsupported operand", error)


def test_the_objective_is_named_among_others_and_has_a_gradient(lab):
    robot, point = KINDS["hopper"].build(None, {}), np.array([[25.0, 0.2]])
    problem = RobotProblem(robot, objective=("2*cautious", "minimise:0.5*height"), summed=True)
    assert problem.objective_names == ("2*cautious height minus 0.5*height",)
    found = problem.evaluate_relaxed(point, np.inf, gradients=True)
    height = robot.simulate(point, robot.worlds[0]).measures["height"]
    assert found.objectives[:, 0] == pytest.approx(2 * np.sqrt(height) - 0.5 * height)
    for n, step in enumerate(1e-6 * np.eye(2)):
        above, below = (problem.evaluate(point + way * step).objectives[0, 0] for way in (1, -1))
        assert found.gradients[0, n] == pytest.approx((above - below) / 2e-6, rel=1e-6)


def test_the_hoppers_gradient_is_that_of_differences(lab):
    robot, point, step = KINDS["hopper"].build(None, {}), np.array([[25.0, 0.2]]), 1e-6
    slopes = robot.differentiate(point, robot.worlds[0]).gradients["height"][0]
    for n, slope in enumerate(slopes):
        moved = point + step * np.eye(2)[n] * np.array([[1.0], [-1.0]])
        above, below = robot.simulate(moved, robot.worlds[0]).measures["height"]
        assert slope == pytest.approx((above - below) / (2 * step), rel=1e-6)


def test_the_study_writes_what_it_says(lab, tmp_path):
    STUDIES["hop-heights"].reproduce(tmp_path / "out", "small")
    assert all((tmp_path / "out" / name).exists() for name in STUDIES["hop-heights"].writes)


def test_the_law_computes_and_the_problem_is_maximised(lab):
    assert lab.spring_force(0.1, 2.0, 5.0) == pytest.approx(0.2 + 5e-3)
    assert lab.hop.score > 0.5
    assert list(lab.best.best.values()) == pytest.approx([0.3, -0.2], abs=1e-3)


def test_the_hopper_which_has_no_motion_is_simulated_without_a_picture(lab, morpholab, tmp_path):
    assert (
        morpholab("codesign --robot hopper --method random --climbers 4 --generations 0 --quiet --out runs/a")[0] == 0
    )
    code, out, error = morpholab("simulate --robot runs/a/best.json --out out")
    assert code == 0, error
    assert out.startswith("runs/a/best.json: ok\n")  # it counts no steps
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["design.json", "result.json"]
