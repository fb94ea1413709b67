"""A problem of the user's own on the command line: runs, resumption, workers, and reading without its file."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from optim.problem import DESIGN
from optim.problems import kind_of_description
from optim.problems.user_file import RecordedProblem

ROOT = Path(__file__).resolve().parents[3]
ROCKET = """
import numpy as np

bounds = {"fuel": (0, 1), "fins": (0, 8, "integer"), "valve": (0, 1, "binary")}
name, unit = "height", "km"


def evaluate(points):
    fuel, fins, valve = np.asarray(points).T
    height = 100 * fuel * (0.5 + valve / 2) - (fins - 3) ** 2
    return np.where(fuel > 0.9, np.nan, height)  # it bursts
"""
CLASS = """
import json
import time
import numpy as np
from beside import BEST
from optim import Evaluation, Problem, Space, Variable


class Valley(Problem):
    space = Space((Variable("x", -2.0, 2.0, step=0.2), Variable("y", -1.0, 3.0, step=0.2)))
    objective_names, objective_units = ("far", "light"), ("m", "kg")

    def evaluate(self, points):
        time.sleep(0.02)
        x, y = np.asarray(points).T
        return Evaluation(np.column_stack([x - y**2, BEST - x**2 - y]), details={"steep": x * y})

    def save(self, point, path):
        path.write_text(json.dumps({"valley": list(point)}))


problem = Valley()
"""
BAR = """
from morpholab import OwnMeasure, RobotProblem
from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array

robot = LatticeRobot(
    body_from_array([[[1]], [[1]]], Material(1e5, 1e3), 0.01),
    (Drive("m", (0,), amplitude=Free(0.0, 0.2)),),
    cycles=1,
    settling=0.05,
    own_measures=(OwnMeasure("high", "m", law=lambda motion: motion.ended[:, 0, 2] * 1.0),),
)
problem = RobotProblem(robot, (Terrain(slope=5.0),), objective="high")
"""
SHORT = "--climbers 5 --seed 3 --quiet"


@pytest.fixture
def rocket(tmp_path):
    """A file with a function and bounds, in the working directory."""
    (tmp_path / "rocket.py").write_text(ROCKET)
    return tmp_path


@pytest.fixture
def valley(tmp_path):
    """A file with a class of two objectives, and a module beside it."""
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab/valley.py").write_text(CLASS)
    (tmp_path / "lab/beside.py").write_text("BEST = 1.0\n")
    return tmp_path


def log(folder):
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def test_a_problem_of_a_file_is_searched(rocket, morpholab):
    code, out, error = morpholab(f"codesign --problem rocket.py --out a --generations 30 {SHORT}")
    assert code == 0 and error == "" and out.startswith("best height: 8") and " km after 155 evaluations\n" in out
    lines = log(rocket / "a")
    assert lines[-1]["best"] > 85 and sum(line["failed"] for line in lines) > 0
    assert json.loads((rocket / "a/best.json").read_text()) == lines[-1]["best_point"]
    config = (rocket / "a/config.toml").read_text()
    assert str(rocket) not in config and "evaluate" not in config and 'file = "rocket.py"' in config
    code, _, error = morpholab("codesign --problem rocket.py --out b --generations 1 --climbers 5")
    assert code == 0 and " km, 5 evaluations" in error and "BL/s" not in error


def test_it_goes_on_to_the_same_bits_with_any_workers(rocket, morpholab):
    assert morpholab(f"codesign --problem rocket.py --out whole --generations 6 {SHORT}")[0] == 0
    assert morpholab(f"codesign --problem rocket.py --out parts --generations 2 {SHORT}")[0] == 0
    code, _, error = morpholab("codesign --resume --problem rocket.py --out parts --generations 6 --workers 2 --quiet")
    assert (code, error) == (0, "")
    for name in ("log.jsonl", "best.json", "config.toml"):
        assert (rocket / "whole" / name).read_bytes() == (rocket / "parts" / name).read_bytes()


def test_resuming_needs_the_very_file(rocket, morpholab):
    assert morpholab(f"codesign --problem rocket.py --out a --generations 1 {SHORT}")[0] == 0
    before = (rocket / "a/log.jsonl").read_bytes()
    code, _, error = morpholab("codesign --resume --out a --generations 3")
    assert code == 2 and error == (
        "morpholab codesign: error: problem: the run in a needs its file again; give --problem rocket.py\n"
    )
    (rocket / "rocket.py").write_text(ROCKET + "\n")
    code, _, error = morpholab("codesign --resume --problem rocket.py --out a --generations 3")
    assert code == 2 and "problem: rocket.py is not the file of the run in a (SHA-256 " in error
    (rocket / "elsewhere.py").write_text(ROCKET)
    code, _, error = morpholab("codesign --resume --problem elsewhere.py --out a --generations 3 --quiet")
    assert code == 2 and "problem.file: 'elsewhere.py' is not what the run in a has, 'rocket.py'" in error
    assert (rocket / "a/log.jsonl").read_bytes() == before


def test_status_compare_and_report_need_no_file(rocket, morpholab):
    for method, seed in (("random", 1), ("random", 2), ("hill-climb", 1), ("hill-climb", 2)):
        options = f"--method {method} --seed {seed} --generations 5 --climbers 5 --quiet"
        assert morpholab(f"codesign --problem rocket.py --out runs/{method}{seed} {options}")[0] == 0
    (rocket / "rocket.py").unlink()
    code, out, _ = morpholab("status runs")
    assert code == 0 and out.count("finished") == 4
    (rocket / "mine.svg").write_text("a picture of mine")
    refused = "morpholab compare: error: out: mine.svg exists; name a new file\n"
    assert morpholab("compare runs --out mine.svg") == (2, "", refused)
    assert (rocket / "mine.svg").read_text() == "a picture of mine"
    code, out, error = morpholab("compare runs --out curves.svg")
    assert code == 0 and error == "" and "hill-climb (2 runs)" in out
    code, _, error = morpholab("report runs --out runs.html --quiet")
    page = (rocket / "runs.html").read_text()
    assert (code, error) == (0, "") and "Best scores at 30 evaluations [km]" in page
    code, _, error = morpholab("report runs/random1 --out one.html --quiet")
    page = (rocket / "one.html").read_text()
    assert (code, error) == (0, "") and "The best height found is" in page and "rocket.py, SHA-256" in page
    code, _, error = morpholab("view runs/random1 --out v.html")
    told = "is a run of rocket.py, which is no robot; `morpholab report runs/random1` shows it, and"
    assert code == 2 and f"{told} runs/random1/best.json has its best point" in error
    (rocket / "rocket.py").write_text(ROCKET.replace("100", "101"))
    assert morpholab(f"codesign --problem rocket.py --out other --generations 1 {SHORT}")[0] == 0
    code, _, error = morpholab("compare runs/random1 other")
    assert code == 2 and "are judged differently (sha256" in error


@pytest.mark.kernels
def test_designs_of_a_file_about_a_robot_are_seen_without_it(tmp_path, morpholab):
    (tmp_path / "bar.py").write_text(BAR)
    search = "codesign --problem bar.py --out bar --method random --climbers 2 --quiet --threads 1"
    assert morpholab(f"{search} --generations 0")[0] == 0
    config = (tmp_path / "bar/config.toml").read_text()
    assert morpholab(f"{search} --generations 1 --resume")[0] == 0
    assert (tmp_path / "bar/config.toml").read_text().splitlines()[2:-1] == config.splitlines()[2:-1]
    (tmp_path / "bar.py").unlink()
    code, out, error = morpholab("view bar --frames 10 --out bar.html --quiet --threads 1")
    assert code == 0 and out.startswith("bar on hill:5: "), error
    code, _, error = morpholab("export bar --voxels bar.vxa")
    assert code == 0 and (tmp_path / "bar.vxa").exists(), error


@pytest.mark.long
def test_a_killed_run_of_a_class_with_two_objectives_goes_on(valley, morpholab):
    search = "codesign --problem lab/valley.py --method borg --population 8 --seed 1 --quiet --generations 12"
    assert morpholab(f"{search} --out whole")[0] == 0
    command = [sys.executable, "-m", "optim", *search.split(), "--out", "killed", "--workers", "1"]
    process = subprocess.Popen(command, cwd=valley, env=os.environ | {"PYTHONPATH": str(ROOT)})
    done = valley / "killed/checkpoint.previous.npz"
    while not done.exists():
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert morpholab(f"{search} --resume --out killed")[0] == 0
    for name in ("log.jsonl", "best.json", "front.json"):
        assert (valley / "whole" / name).read_bytes() == (valley / "killed" / name).read_bytes()
    assert list(json.loads((valley / "whole/best.json").read_text())) == ["valley"]
    code, _, error = morpholab("report whole --out one.html --quiet")
    page = (valley / "one.html").read_text()
    assert (code, error) == (0, "") and "far [m]" in page and "light [kg]" in page and "The Pareto front" in page


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        (None, "", "problem: own.py cannot be read (No such file or directory)"),
        ("1 +", "", "problem: own.py: SyntaxError: "),
        ("raise SystemExit('no')", "", "problem: own.py: SystemExit: no"),
        ("import nowhere_to_be_found", "", "problem: own.py: ModuleNotFoundError: "),
        ("bounds = {}", "", "problem: own.py: it sets neither problem nor bounds and a function evaluate"),
        ("problem = 3", "", "problem: own.py: problem: space and evaluate missing; derive it from optim.Problem"),
        ("bounds = {'x': (1, 0)}\ndef evaluate(p): ...", "", "problem: own.py: x: bounds 1.0 to 0.0 are not allowed"),
        (ROCKET, "--terrain flat", "terrain: the file of --problem says what is designed"),
        (ROCKET, "--encoding bits", "encoding: the file of --problem says what is designed"),
        (ROCKET, "--method cmaes", "argument --method: 'cmaes' is unknown; did you mean cma?"),
        (
            CLASS.replace("from beside import BEST", "BEST = 1"),
            "",
            "method: hill-climb takes one objective, not far, li",
        ),
    ],
)
def test_wrong_files_are_one_line_and_leave_no_folder(tmp_path, morpholab, source, options, message):
    if source is not None:
        (tmp_path / "own.py").write_text(source)
    code, _, error = morpholab(f"codesign --problem own.py --out a {options}")
    assert code == 2 and message in error and error.count("\n") == 1 and not (tmp_path / "a").exists()


UNCOMMON = """
import multiprocessing, sys
class Leaving(SystemExit): pass
class Panic(BaseException): pass
bounds = {"x": (0, 1)}
BESIDE
def evaluate(points):
    LINE
"""


@pytest.mark.parametrize("workers", ["", "--workers 2"])
@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("sys.exit(0)", "SystemExit: 0"),
        ("sys.exit('no')", "SystemExit: no"),
        ("raise Leaving(3)", "Leaving: 3"),
        ("raise Panic('a\\nb')", "Panic: a b"),
        ("raise GeneratorExit", "GeneratorExit"),
    ],
)
def test_what_is_no_failure_of_a_users_function_fails_its_search_in_a_line(tmp_path, morpholab, line, told, workers):
    (tmp_path / "own.py").write_text(UNCOMMON.replace("BESIDE", "").replace("LINE", line))
    code, out, error = morpholab(f"codesign --problem own.py --generations 1 --quiet --out a {workers}")
    assert (code, out) == (1, "") and error == f"morpholab codesign: failed: own.py, line 8: {told}\n"


@pytest.mark.parametrize("workers", ["", "--workers 2"])
@pytest.mark.parametrize("beside", ["", "if multiprocessing.parent_process(): raise KeyboardInterrupt"])
def test_an_interrupt_by_users_code_ends_the_search_as_ctrl_c_does(tmp_path, morpholab, beside, workers):
    """Also where a worker alone raises it, when it loads the file."""
    (tmp_path / "own.py").write_text(UNCOMMON.replace("BESIDE", beside).replace("LINE", "raise KeyboardInterrupt"))
    code, out, error = morpholab(f"codesign --problem own.py --generations 1 --quiet --out a {workers}")
    assert (code, error) == (130, "") and out.startswith("interrupted before the first generation was complete")


def test_a_run_of_a_robot_takes_no_file(rocket, morpholab, simulator):
    assert morpholab("codesign --terrain flat --geometry small --climbers 2 --generations 0 --quiet --out a")[0] == 0
    code, _, error = morpholab("codesign --resume --problem rocket.py --out a")
    assert code == 2 and "problem: the run in a is of no file; leave --problem out" in error


FAULTY = "bounds = {'x': (0, 1)}\n\nclass Bad(Exception): ...\n\ndef evaluate(point):\n    raise "


@pytest.mark.parametrize("workers", ["", "--workers 2"])
@pytest.mark.parametrize("raised", ["ZeroDivisionError: division by zero", "Bad: no"])
def test_what_a_function_raises_while_it_judges_is_told_as_the_files_own(tmp_path, morpholab, raised, workers):
    kind, _, text = raised.partition(": ")
    (tmp_path / "function.py").write_text(f"{FAULTY}{kind}({text!r})\n")
    code, _, error = morpholab(f"codesign --problem function.py --out a --climbers 2 --quiet {workers}")
    assert code == 1 and error.splitlines()[-1].endswith(f"failed: function.py, line 6: {raised}")
    assert "bug" not in error


def test_what_morpholab_refuses_of_a_function_is_not_told_as_one_of_its_lines(tmp_path, morpholab):
    (tmp_path / "function.py").write_text("bounds = {'x': (0, 1)}\n\ndef evaluate(points):\n    return points[:, 0]\n")
    code, _, error = morpholab("codesign --problem function.py --method gradient --out a --quiet")
    assert code == 2 and "error: gradient: the method needs one" in error


def test_scores_whose_sum_no_float_holds_are_searched(tmp_path, morpholab):
    source = "bounds = {'x': (0, 1)}\n\ndef evaluate(points):\n    return 1e308 + 7e307 * points[:, 0]\n"
    (tmp_path / "large.py").write_text(source)
    code, _, error = morpholab("codesign --problem large.py --out a --climbers 6 --generations 2 --quiet")
    assert (code, error) == (0, "")
    for line in log(tmp_path / "a"):
        assert min(line["scores"]) < line["mean"] < line["best"] and 1e308 < line["median"] < line["best"]
    assert morpholab("codesign --problem large.py --out a --resume --generations 3 --quiet")[::2] == (0, "")
    assert morpholab("status a")[::2] == (0, "")
    code, _, error = morpholab("compare a --out a.png")
    assert code == 2 and error.count("\n") == 1 and not (tmp_path / "a.png").exists()
    assert (
        "compare: error: run: a score of 1." in error
        and "e+308, in a, is not allowed here; give at most 1e+100" in error
    )


@pytest.mark.parametrize("workers", ["", "--workers 1"])
def test_complex_scores_are_refused(tmp_path, morpholab, workers):
    (tmp_path / "own.py").write_text(
        "bounds = {'x': (2, 3)}\n\ndef evaluate(points):\n    return points[:, 0] * 0 + 2j\n"
    )
    code, _, error = morpholab(f"codesign --problem own.py --out a --climbers 2 --quiet {workers}")
    assert (code, error) == (2, "morpholab codesign: error: function: 2j is not allowed; give real numbers\n")


@pytest.mark.parametrize(
    ("name", "code", "told"),
    [
        ("config.toml", 2, "error: out: a/config.toml cannot be written (Operation not permitted)"),
        ("best.json", 1, "failed: a/best.json: cannot be written (Operation not permitted); its "),
        ("checkpoint.npz", 1, "failed: a/checkpoint.npz: cannot be written (Operation not permitted); its 0 "),
        (
            "checkpoint.previous.npz",
            1,
            "failed: a/checkpoint.previous.npz: cannot be written (Operation not permitted)",
        ),
    ],
)
def test_a_file_of_a_run_that_cannot_be_replaced_is_named(rocket, morpholab, monkeypatch, name, code, told):
    replace = os.replace

    def immutable(path, target):
        if Path(target).name == name:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path), None, str(target))
        replace(path, target)

    monkeypatch.setattr(os, "replace", immutable)
    found, _, error = morpholab(f"codesign --problem rocket.py --out a --generations 3 {SHORT}")
    assert found == code and error.startswith(f"morpholab codesign: {told}") and error.count("\n") == 1


@pytest.mark.parametrize("harm", ["[]", "3", "{", '{"kind": []}', 7])
def test_a_damaged_design_is_told_in_a_line(harm):
    description = {"kind": "file", "file": "bar.py", "sha256": "0", DESIGN: harm}
    if harm == '{"kind": []}':
        assert kind_of_description(description) is None
        return
    for read in (kind_of_description, RecordedProblem):
        with pytest.raises(ValueError, match=r"^problem: its design is damaged, no JSON object$"):
            read(description)
