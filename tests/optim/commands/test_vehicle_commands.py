"""``morpholab sweep`` and ``morpholab train``."""

import json
import re
from pathlib import Path

import pytest

from optim.studies.chapter3.sweep_table import read_sweep_table
from optim.studies.chapter4.training import read_training_table

pytestmark = pytest.mark.kernels

WIDE = Path(__file__).parents[3] / "docs/data/vehicle-sweep-radius-0.2.csv.gz"
BRIEF = "--radius 1 --time-step 0.5 --steps 1000 --quiet"
SWEEP = f"sweep --designs 162,6553 --weights 9 {BRIEF}"
TRAIN = f"train --designs 80,100-103,162,6553 --repetitions 2 --budget-evaluations 60 --seed 3 {BRIEF}"


def test_sweep_writes_its_table_and_goes_on(morpholab, tmp_path, monkeypatch):
    code, out, error = morpholab(f"{SWEEP} --out a")
    assert (code, error) == (0, "")
    assert "2 bodies, 81 controllers each" in out and "best M_L: design " in out and "a: table.csv" in out
    first = (tmp_path / "a/table.csv").read_text()
    assert first.startswith("design,all,any,M_L,M_CI\n80,")
    monkeypatch.setattr("robots.braitenberg.sweeps.rollout", None)  # nothing is left to do, also for mirror images
    one = f"sweep --designs 80 --weights 9 {BRIEF} --out a"
    assert morpholab(one)[1].startswith("1 body, 81 controllers each\n")
    code, out, _ = morpholab(f"{one} --json")
    document = json.loads(out)
    assert code == 0 and (tmp_path / "a/table.csv").read_text() == first
    (body,) = document["bodies"]
    assert body["design"] == 80 and body["M_L"] == body["all"] / 81 and document["best"]["M_CI"] == body


def test_sweep_draws(morpholab, tmp_path):
    code, _, _ = morpholab(f"{SWEEP} --out a --figures")
    assert code == 0
    names = {"distributions.png", "distributions.csv", "correlation.png", "correlation.csv", "examples.png"}
    assert names | {"examples.npz", "examples.csv"} <= {path.name for path in (tmp_path / "a").iterdir()}


def test_train_tells_how_evaluations_go_with_metrics(morpholab, tmp_path):
    morpholab(f"sweep --designs 80,100-103,162,6553 --weights 9 {BRIEF} --out swept")
    code, out, error = morpholab(f"{TRAIN} --out a --sweep swept --figures")
    assert (code, error) == (0, "")
    assert "7 bodies\n  random: " in out and "de, M_CI, bodies: " in out and "M_L and M_CI, bodies: +" in out
    assert (tmp_path / "a/training.png").exists() and (tmp_path / "a/training.csv").exists()
    table = read_training_table(tmp_path / "a/runs.csv")
    assert table.designs.tolist() == [80, 100, 101, 102, 103, 162, 6553] and table.evaluations.shape == (4, 7, 2)
    code, out, _ = morpholab(f"{TRAIN} --out a --sweep swept --json")
    document = json.loads(out)
    assert len(document["correlations"]) == 16
    assert document["correlations"][1]["over"] == "bodies" and document["correlations"][1]["found"]["n"] == 7
    assert document["metrics"]["n"] == 7
    assert document["methods"][0]["mean_evaluations"] == pytest.approx(table.evaluations[0].mean())
    assert len(read_sweep_table(tmp_path / "swept").designs) > 7


def test_train_needs_no_sweep_to_count(morpholab, tmp_path):
    line = f"train --sample 3 --methods nes,random --repetitions 1 --budget-evaluations 8 {BRIEF} --out a --json"
    code, out, _ = morpholab(line)
    document = json.loads(out)
    assert code == 0 and document["bodies"] == 3 and [m["method"] for m in document["methods"]] == ["nes", "random"]
    assert document["correlations"] == [] and document["metrics"] is None


@pytest.mark.parametrize("line", [SWEEP, TRAIN])
def test_an_interrupted_command_says_how_to_go_on(morpholab, monkeypatch, line):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("robots.braitenberg.sweeps.rollout", interrupt)
    monkeypatch.setattr("optim.problems.braitenberg.rollout", interrupt)
    code, out, _ = morpholab(f"{line} --out a")
    assert code == 130 and out == "interrupted; a keeps what is done, the same command goes on from there\n"


BAD_LINES = [
    ("sweep --designs 162", "the following arguments are required: --out"),
    ("sweep --out new", "the following arguments are required: --designs"),
    ("sweep --designs 0 --out new", "argument --designs: 0 is not allowed; give numbers from 1 to 6561"),
    ("sweep --designs 6000-7000 --out new", "argument --designs: 6000-7000 is not allowed; give numbers from 1"),
    ("sweep --designs 9-3 --out new", "argument --designs: 9-3 is not allowed"),
    ("sweep --designs '' --out new", "argument --designs: '' is not allowed; give numbers such as 162,6553 or"),
    ("sweep --designs best --out new", "argument --designs: 'best' is not allowed; give numbers such as"),
    ("sweep --designs 1 --out new --weights 1", "argument --weights: 1 is not allowed; give a whole number, at least"),
    ("sweep --designs 1 --out new --weights 9999", "weights: 9999 is not allowed; give at most 2001"),
    ("sweep --designs 1 --out new --radius 0", "radius: 0.0 is not allowed; give a positive finite number"),
    ("sweep --designs 1 --out new --radius -1", "radius: -1.0 is not allowed; give a positive finite number"),
    ("sweep --designs 1 --out new --radius 5", "starts: "),
    ("sweep --designs 1 --out new --steps 0", "argument --steps: 0 is not allowed"),
    ("sweep --designs 1 --out new --time-step nan", "argument --time-step: nan is not allowed"),
    ("sweep --designs 1 --out new --precision f16", "argument --precision: invalid choice: 'f16'"),
    ("sweep --designs 1 --out file.txt", "out: file.txt holds something else; name a new folder"),
    ("train --designs 1 --sample 5 --out new", "argument --sample: not allowed with argument --designs"),
    ("train --sample 7000 --out new", "sample: 7000 is not allowed; give at most 6561"),
    ("train --sample 0 --out new", "argument --sample: 0 is not allowed"),
    ("train --designs 1 --methods '' --out new", "methods: '' is unknown; choose some of random, generating-set"),
    ("train --designs 1 --methods cma --out new", "methods: 'cma' is unknown"),
    ("train --designs 1 --repetitions 0 --out new", "argument --repetitions: 0 is not allowed"),
    ("train --designs 1 --budget-evaluations 0 --out new", "argument --budget-evaluations: 0 is not allowed"),
    ("train --designs 1 --radius 0 --out new", "radius: 0.0 is not allowed"),
    ("train --designs 1 --out new --figures", "figures: they need metrics; give --sweep"),
    ("train --designs 1 --out new --sweep nothing", "nothing: cannot be read (No such file or directory)"),
    ("train --designs 1 --out new --sweep file.txt", "file.txt: is not the table of a sweep"),
    ("train --designs 1 --out new --sweep .", ".: holds no sweep"),
    (f"train --designs 1 --out new --sweep {WIDE}", f"sweep: {WIDE} does not tell its radius, and design 162 has 1759"),
]


@pytest.mark.parametrize(("line", "message"), BAD_LINES)
def test_bad_input_is_one_line_before_any_work(morpholab, monkeypatch, tmp_path, line, message):
    monkeypatch.setattr("robots.braitenberg.sweeps.rollout", None)
    monkeypatch.setattr("optim.problems.braitenberg.rollout", None)
    (tmp_path / "file.txt").write_text("notes")
    code, out, error = morpholab(line)
    assert (code, out) == (2, "")
    assert error.startswith("morpholab") and f"error: {message}" in error and error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_a_damaged_part_is_noted_in_one_line_and_made_again(morpholab, tmp_path):
    _, first, error = morpholab(f"{SWEEP} --out swept")
    assert error == ""
    (part,) = tmp_path.glob("swept/*.npz")
    part.write_bytes(part.read_bytes()[:-40])
    code, out, error = morpholab(f"{SWEEP} --out swept")
    note = f"morpholab sweep: note: {part.relative_to(tmp_path)}: is damaged, and as good as missing"
    assert (code, out, error) == (0, first, f"{note} (File is not a zip file)\n")
    assert morpholab(f"{SWEEP} --out swept") == (0, first, "")


def test_folders_and_sweeps_of_other_settings_are_refused(morpholab):
    morpholab(f"{SWEEP} --out swept")
    code, _, error = morpholab(f"sweep --designs 162 --weights 11 {BRIEF} --out swept")
    assert code == 2 and "swept holds a sweep of other settings (weights: 9, not 11); name another folder\n" in error
    morpholab(f"train --designs 162 --methods nes --repetitions 1 --budget-evaluations 6 {BRIEF} --out a")
    code, _, error = morpholab(f"train --designs 162 --methods nes --repetitions 2 {BRIEF} --out a")
    assert code == 2 and "out: a holds a training of other settings (" in error
    code, _, error = morpholab("train --designs 162 --out new --sweep swept")
    assert code == 2 and error.endswith("sweep: swept has radius 1, not 0.075\n")
    code, _, error = morpholab(f"train --designs 162,200 --out new --sweep swept {BRIEF}")
    assert code == 2 and error.endswith("sweep: 1 of 2 bodies are missing, design 200 first\n")


def test_a_body_of_ones_own_is_measured_and_searched(morpholab, tmp_path):
    """As the page of vehicles says."""
    page = (Path(__file__).parents[3] / "docs/vehicle.md").read_text()
    code = re.search(r"```python\n([^`]*\nrobot = VehicleRobot.*?)```", page, re.DOTALL)
    (tmp_path / "mine.py").write_text(code[1])
    quick = "--robot mine.py --threads 1 --quiet --json"
    code, out, error = morpholab(f"simulate {quick}")
    assert (code, error) == (0, "") and "closest" in out
    code, out, error = morpholab(f"measure {quick} --success 'closest <= 0.075' --grid 3 --out m")
    assert (code, error) == (0, "") and json.loads(out)["learnability"]["of"] == 9
    code, out, error = morpholab(f"codesign {quick} --climbers 2 --generations 1 --out c")
    assert (code, error) == (0, "") and (tmp_path / "c/best.json").is_file()
