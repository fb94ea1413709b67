"""Run folders of version 1.0, see ``tests/data/v1_runs/make.py``: read, and continued to what 1.0 found next."""

import json
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

from optim.problems import problem_of_description
from optim.runs import open_run, read_config, run_search
from optim.runs.config import write_config
from optim.runs.environment import versions
from optim.runs.history import read_history, read_progress, read_result
from optim.search import METHODS, build_method
from optim.space import Space, Variable
from robots.hardware import read_csv, read_design
from robots.lattice_robot import load_robot
from robots.lattice_robot.walker import load_walker

DATA = Path(__file__).resolve().parents[2] / "data/v1_runs"
NEXT = json.loads((DATA / "next.json").read_text())
RUNS = ("gait", "walker", "vehicle", "robot")
LOADERS = {"gait": read_design, "walker": load_walker, "robot": load_robot}
# These go on, to the same bits where the CPU is the one on which version 1.0 ran; other CPUs round differently.
RESUMED = ("gait", "vehicle", "robot")
TOLERANCE = 1e-6

runs = pytest.mark.parametrize("name", RUNS)


@pytest.fixture
def folder(tmp_path, name):
    """A copy of the run's folder."""
    return Path(shutil.copytree(DATA / name, tmp_path / name))


def same_machine():
    flags = runpy.run_path(str(DATA / "make.py"))["flags"]()
    here, there = versions(), NEXT["versions"]
    return flags == NEXT["cpu_flags"] and all(here[name] == there[name] for name in ("numpy", "taichi"))


def numbers(value):
    """All numbers in a line of a log, in order."""
    if isinstance(value, dict):
        return [number for each in value.values() for number in numbers(each)]
    if isinstance(value, list):
        return [number for each in value for number in numbers(each)]
    return [] if value is None else [value]


@runs
def test_they_are_read(name, folder, morpholab):
    code, out, _ = morpholab(f"status {folder} --json")
    (document,) = json.loads(out)
    line = json.loads((DATA / name / "log.jsonl").read_text().splitlines()[-1])
    assert code == 0 and document["state"] == "finished" and document["generation"] == 2
    assert document["best"] == line["best"] and document["evaluations"] == line["evaluations"]
    code, _, error = morpholab(f"report {folder} --no-player --quiet --out page.html")
    assert (code, error) == (0, "")


@pytest.mark.kernels
@pytest.mark.parametrize("name", [name for name in RUNS if name != "walker"])  # which is refused, see below
def test_the_command_goes_on_with_them(name, folder, morpholab):
    code, _, notes = morpholab(f"codesign --resume --generations 3 --quiet --out {folder}")
    assert code == 0 and notes.count("\n") == 1 and "began elsewhere (morpholab 1.0.0" in notes
    assert len((folder / "log.jsonl").read_text().splitlines()) == 4


@pytest.mark.parametrize("name", ["walker", "robot"])
def test_they_have_one_terrain(name, folder, morpholab):
    code, _, error = morpholab(f"codesign --resume --out {folder} --terrain flat --terrain hill:5")
    assert code == 2 and f"terrain: the run in {folder} has one; leave out hill:5" in error


@runs
def test_their_designs_are_loaded(name, folder):
    if name in LOADERS:
        assert LOADERS[name](folder / "best.json") is not None
    problem, history = problem_of_description(read_config(folder)["problem"]), read_history(folder)
    best = problem.space.from_dict(history.generations[-1].best_point)
    problem.save(best, folder / "again.json")
    again, before = json.loads((folder / "again.json").read_text()), json.loads((folder / "best.json").read_text())
    again.pop("highest_size", None)  # which makes time steps in water those of the search, and version 1.0 did not know
    assert again == before and list(again) == list(before)
    kept = read_result(history, problem)
    assert np.array_equal(kept.point, best) and kept.score == history.generations[-1].best
    assert repr(read_progress(folder)) == repr(history.progress)  # which may have nan


def test_the_table_for_the_hardware_is_read():
    table = read_csv(DATA / "gait/gait.csv")
    assert table.schedule() == read_design(DATA / "gait/best.json").schedule


@pytest.mark.parametrize(
    ("name", "section", "changed", "why"),
    [
        ("walker", "problem", {}, "soft walkers"),
        ("gait", "problem", {"precision": "f32"}, "gaits in f32"),
        ("robot", "method", {"name": "cma-gradient"}, "gradients"),
    ],
)
def test_those_that_would_go_on_to_other_bits_are_refused(name, section, changed, why, folder):
    config = read_config(folder)
    config[section] |= changed
    write_config(folder, config)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    said = f"^resume: the run is of version 1.0, and {why} are rounded otherwise since"
    with pytest.raises(ValueError, match=said), open_run(folder, config, resume=True, environment={}):
        pass
    assert before == {path.name: path.read_bytes() for path in folder.iterdir() if path.name in before}


@pytest.mark.kernels
@pytest.mark.parametrize("name", RESUMED)
def test_they_go_on_to_what_version_1_found_next(name, folder):
    config = read_config(folder) | {"generations": 3}
    problem = problem_of_description(config["problem"])
    settings = dict(config["method"])
    before = (folder / "log.jsonl").read_bytes()
    with open_run(folder, config, resume=True, environment={}) as opened:
        run_search(problem, build_method(settings.pop("name"), problem.space, settings), opened, 3)
    after = (folder / "log.jsonl").read_bytes()
    assert after.startswith(before) and after.count(b"\n") == 4
    found, wanted = json.loads(after.splitlines()[-1]), NEXT["lines"][name]
    assert found.keys() == wanted.keys()
    if same_machine() and name != "robot":  # which rounds its way on level ground otherwise since
        assert found == wanted
    assert numbers(found) == pytest.approx(numbers(wanted), rel=TOLERANCE, abs=1e-12)


with np.load(DATA / "methods.npz", allow_pickle=False) as _arrays:
    V1_METHODS = sorted({key.partition("/")[0] for key in _arrays})


def test_every_method_of_version_1_is_still_there():
    assert len(V1_METHODS) == 13 and set(V1_METHODS) <= set(METHODS)


@pytest.mark.parametrize("name", V1_METHODS)
def test_states_of_methods_go_on(name):
    """The next points and the best score are those of version 1.0, but for what linear algebra may round otherwise."""
    with np.load(DATA / "methods.npz", allow_pickle=False) as arrays:
        state = {key.removeprefix(f"{name}/state/"): arrays[key] for key in arrays if key.startswith(f"{name}/state/")}
        asked, score = arrays[f"{name}/asked"], float(arrays[f"{name}/score"])
    plain = Variable("x", -2.0, 6.0, step=0.5), Variable("a", -180.0, 180.0, "angle", step=20.0)
    whole = () if name == "gradient" else (Variable("n", -3, 4, "integer", step=1.0),)
    space = Space((*plain, *whole, Variable("b", 0, 1, "binary", step=0.3)))
    size = "climbers" if name in ("generating-set", "gradient", "hill-climb", "random") else "population"
    method = build_method(name, space, {size: 6, "seed": 5})
    assert set(method.state()) == set(state)
    method.restore(state)
    assert method.result().score == score
    assert method.ask() == pytest.approx(asked, rel=1e-12, abs=1e-12)


@pytest.mark.kernels
def test_settings_that_came_later_do_not_part_groups(tmp_path):
    """A run of version 1.0 and one of now that differ in their seed only are one group."""
    from optim.runs.comparison import curves

    config = read_config(DATA / "vehicle")
    problem = problem_of_description(config["problem"])
    settings = dict(config["method"]) | {"seed": 5, "window": 200}
    name = settings.pop("name")
    with open_run(tmp_path / "now", {**config, "method": {"name": name, **settings}}) as opened:
        run_search(problem, build_method(name, problem.space, settings), opened, 2)
    (curve,) = curves([read_history(DATA / "vehicle"), read_history(tmp_path / "now")], "evaluations")
    assert len(curve.folders) == 2
