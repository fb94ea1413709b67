"""A kind of robot and an objective of installed packages, by the command lines of processes of their own."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from plug_in import install

ROOT = Path(__file__).resolve().parents[3]
HOPPER = ROOT / "tests/support/hopper.py"
OBJECTIVE = '''
from optim.problem import Objective
from optim.problems.objectives import RobotObjective


class Economy(RobotObjective):
    """Height for the work of the joint."""

    def objective(self, measure):
        return Objective("economy", "m/J")

    def score(self, outcome, measure):
        return outcome.measures["height"] / (0.1 + outcome.measures["energy"])
'''
pytestmark = pytest.mark.long

SEARCH = "codesign --robot hopper --climbers 4 --quiet"


# A process that imports once and takes one command line after the other.
COMMANDS = """
import contextlib, io, json, sys
from optim.cli import main
for line in sys.stdin:
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            code = main(line.split())
        except SystemExit as stop:
            code = stop.code
    print(json.dumps([code, out.getvalue(), error.getvalue()]), flush=True)
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Runs a command line in a folder, with two packages installed: (exit code, stdout, stderr)."""
    folder = tmp_path_factory.mktemp("lab")
    install(folder / "site", "hopper-kit", "morpholab.robots", {"hopper": "hopper_kit:HopperKind"})
    install(folder / "site", "economy-kit", "morpholab.objectives", {"economy": "economy_kit:Economy"}, OBJECTIVE)
    shutil.copy(HOPPER, folder / "site/hopper_kit.py")
    processes = {}

    def run(line, installed=True, fresh=False):
        path = os.pathsep.join([str(ROOT), *([str(folder / "site")] if installed else [])])
        options = {"cwd": folder, "env": {**os.environ, "PYTHONPATH": path}, "text": True}
        if fresh:
            command = [sys.executable, "-m", "optim.cli", *line.split()]
            done = subprocess.run(command, **options, capture_output=True, check=False)
            return done.returncode, done.stdout, done.stderr
        if installed not in processes:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            processes[installed] = subprocess.Popen([sys.executable, "-c", COMMANDS], **options, **pipes)
        process = processes[installed]
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
        return tuple(json.loads(process.stdout.readline()))

    run.folder = folder
    yield run
    for process in processes.values():
        process.communicate(timeout=60)


@pytest.fixture(scope="module")
def searched(lab):
    """The folder of a run of hoppers."""
    code, out, error = lab(f"{SEARCH} --mass 0.5 --generations 3 --out runs/a --json")
    assert (code, error) == (0, "")
    return json.loads(out)


def test_a_hopper_takes_sixty_lines():
    lines = [line for line in HOPPER.read_text().splitlines() if line.strip()]
    assert len(lines) <= 60


def test_a_hopper_is_designed_and_the_run_goes_on_to_the_same_bits(lab, searched):
    assert set(searched["best_point"]) == {"stiffness", "stroke"} and searched["best"] > 0
    assert lab(f"{SEARCH} --mass 0.5 --generations 1 --out runs/b")[0] == 0
    code, out, _ = lab("codesign --resume --generations 3 --quiet --out runs/b", fresh=True)
    assert code == 0 and out.startswith("best height: ") and " m (energy " in out
    logs = [(lab.folder / f"runs/{name}/log.jsonl").read_bytes() for name in "ab"]
    assert logs[0] == logs[1]
    assert "hopper_kit" not in (lab.folder / "runs/a/config.toml").read_text()


def test_a_hopper_is_seen_simulated_and_reported(lab, searched):
    code, out, error = lab("view runs/a runs/a/best.json hopper --frames 20 --out page.html --quiet")
    assert (code, error) == (0, "") and out.count("1 part") == 3
    code, out, error = lab("simulate --gait runs/a/best.json --out seen")
    assert (code, error) == (0, "") and f"height {searched['best']:.4f} m" in out
    assert {path.name for path in (lab.folder / "seen").iterdir()} == {"design.json", "result.json", "robot.png"}
    code, out, error = lab("report runs/a --frames 20 --out report.html --json --quiet")
    assert (code, error) == (0, "")
    (world,) = json.loads(out)["design"]["worlds"]
    assert world["height"] == world["replayed"] == searched["best"]
    page = (lab.folder / "report.html").read_text()
    assert "one-joint hopper" in page and "highest jump (m)" in page


def test_runs_of_hoppers_are_compared(lab, searched):
    assert lab(f"{SEARCH} --mass 0.5 --method random --generations 3 --out runs/random")[0] == 0
    code, out, _ = lab("compare runs/a runs/random")
    assert code == 0 and "height [m]" in out
    assert lab(f"{SEARCH} --objective worst --mass 0.5 --generations 0 --out other")[0] == 0
    code, _, error = lab("compare runs/a other")
    assert code == 2 and "are judged differently (objective " in error


def test_gradients_of_a_hopper_are_checked(lab):
    code, out, error = lab("gradient-check --robot hopper --directions 2 --samples 4 --quiet --json")
    assert (code, error) == (0, "") and [each["name"] for each in json.loads(out)["horizons"]] == ["1 s", "2 s"]


def test_an_objective_of_a_package_is_named_wherever_its_values_are(lab):
    code, out, error = lab(f"{SEARCH.replace(' --quiet', '')} --objective economy --generations 1 --out runs/economy")
    assert code == 0 and out.startswith("best economy: ") and " m/J (" in out and " m/J, " in error
    code, out, _ = lab("report runs/economy --no-player --quiet --out economy.html")
    assert code == 0 and "economy [m/J]" in (lab.folder / "economy.html").read_text()
    code, _, error = lab(f"{SEARCH} --objective economics --out x")
    assert code == 2 and "objective: 'economics' is unknown; did you mean economy?" in error


def test_without_the_package_runs_are_refused_in_one_line(lab, searched):
    for line in (
        "report runs/a --out b.html --quiet",
        "view runs/a --out b.html --quiet",
        "codesign --resume --out runs/a",
    ):
        code, out, error = lab(line, installed=False)
        assert code == 2 and out == "" and error.count("\n") == 1 and "hopper" in error


def test_help_names_options_of_a_kind_and_runs_no_package(lab):
    code, out, _ = lab("codesign --robot hopper --help", fresh=True)
    assert code == 0 and "--mass" in out and "--encoding" not in out
    (lab.folder / "site/economy_kit.py").rename(lab.folder / "site/broken.py")
    code, out, _ = lab("codesign --help", fresh=True)
    (lab.folder / "site/broken.py").rename(lab.folder / "site/economy_kit.py")
    assert code == 0 and "--encoding" in out and "--mass" not in out


def test_options_of_other_kinds_are_refused(lab):
    code, _, error = lab(f"{SEARCH} --encoding bits --out x")
    assert code == 2 and "encoding: it is an option of other kinds (inflatable robot" in error
    code, _, error = lab("codesign --robot hoper --out x")
    assert code == 2 and "robot: 'hoper' is unknown; did you mean hopper?" in error
