"""The training study: what is counted, resuming, tables, correlations."""

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.measures.statistics import pearson
from optim.problems.braitenberg import VehicleProblem
from optim.search import build_method
from optim.search.published import BLACK_BOX_OPTIM
from optim.studies.chapter3.sweep_table import SweepTable, read_sweep_table, sample_designs
from optim.studies.chapter4 import training
from optim.studies.chapter4.training import (
    TRAINERS,
    Training,
    TrainingTable,
    metric_correlations,
    read_training_table,
    train,
)
from robots.braitenberg import PUBLISHED, Sweep, VehicleBody, sweep
from taichi_sim.base.results_folder import ResultsFolder

BRIEF = Training(repetitions=2, budget=12, seed=3, task=replace(PUBLISHED, radius=1.0, time_step=0.5, steps=1000))
DESIGNS = (80, 162, 2000, 6553)


def outcomes(table):
    return table.evaluations.tolist(), table.solved.tolist()


@pytest.mark.kernels
def test_evaluations_are_counted_until_a_controller_solves_all_environments():
    """The same by hand: a method alone, its body fixed, one evaluation after the other."""
    settings = replace(BRIEF, budget=60)
    table = train(DESIGNS, settings=settings)
    assert table.evaluations.shape == table.solved.shape == (4, 4, 2) and table.methods == TRAINERS
    for m, method in enumerate(TRAINERS):
        for d, design in enumerate(DESIGNS):
            problem = VehicleProblem(body=VehicleBody.published(design), task=settings.task)
            run = {**BLACK_BOX_OPTIM[method], "seed": training._seed(3, design, 1)}
            search, seen = build_method(method, problem.space, run), []
            while len(seen) < 60 and 4 not in seen:
                points = search.ask()
                evaluation = problem.evaluate(points)
                search.tell(points, evaluation)
                seen += evaluation.details["solved"].tolist()
            solved = 4 in seen[:60]
            assert table.solved[m, d, 1] == solved
            assert table.evaluations[m, d, 1] == (seen.index(4) + 1 if solved else 60)
    assert 0 < table.solved.mean() < 1 and len(np.unique(table.evaluations)) > 10


@pytest.mark.kernels
def test_outcomes_depend_on_nothing_but_the_run(monkeypatch, tmp_path):
    """Not on bodies and methods beside it, on the order, chunks, threads, or where a study goes on."""
    whole = train(DESIGNS, settings=BRIEF)
    alone = train([2000], ["nes"], BRIEF)
    assert np.array_equal(alone.evaluations[0, 0], whole.evaluations[2, 2])
    monkeypatch.setattr(training, "BODIES_PER_FILE", 1)
    seen = []
    train(DESIGNS[:2], ["de", "nes"], BRIEF, out=tmp_path)
    table = train(reversed(DESIGNS), settings=BRIEF, out=tmp_path, threads=1, progress=seen.append)
    assert outcomes(table) == outcomes(whole)
    assert min(seen) >= 0.25 and max(seen) == pytest.approx(1) and seen == sorted(seen)
    assert len(list(tmp_path.glob("runs-*.npz"))) == 16
    monkeypatch.setattr(training, "_run", None)  # nothing is left to do
    assert outcomes(train(DESIGNS, settings=BRIEF, out=tmp_path)) == outcomes(whole)
    assert outcomes(train(DESIGNS, settings=replace(BRIEF, seed=3), out=tmp_path)) == outcomes(whole)


@pytest.mark.kernels
def test_another_seed_gives_other_outcomes():
    assert outcomes(train([80], settings=BRIEF)) != outcomes(train([80], settings=replace(BRIEF, seed=4)))


@pytest.mark.kernels
def test_a_damaged_file_is_as_good_as_missing(tmp_path):
    whole = train(DESIGNS[:1], ["random"], BRIEF, out=tmp_path)
    (file,) = tmp_path.glob("runs-*.npz")
    file.write_bytes(file.read_bytes()[:-50])
    with pytest.warns(UserWarning, match="is damaged, and as good as missing"):
        again = train(DESIGNS[:1], ["random"], BRIEF, out=tmp_path)
    assert outcomes(again) == outcomes(whole)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"designs": np.array([6562])}, "designs: 6562 is not allowed; give whole numbers from 1 to 6561"),
        ({"evaluations": np.array([[501, 1]])}, "evaluations: 501 is not allowed; give whole numbers from 1 to 500"),
        ({"evaluations": np.array([[0, 1]])}, "evaluations: 0 is not allowed"),
        ({"solved": np.array([[True]])}, "solved: 1 runs of a body are not allowed; give 2"),
    ],
)
def test_outcomes_that_no_run_has_are_as_good_as_missing(tmp_path, monkeypatch, changed, why):
    class Recomputed(Exception):
        """Ends the study before any work."""

    def run(*_):
        raise Recomputed

    monkeypatch.setattr(training, "_run", run)
    settings = training.Training(repetitions=2, budget=500)
    folder = ResultsFolder(tmp_path, "training", settings.describe())
    arrays = {"designs": np.array([80]), "evaluations": np.array([[500, 3]]), "solved": np.array([[False, True]])}
    folder.add("runs-random", b"", **arrays)
    assert outcomes(train([80], ["random"], settings, out=tmp_path)) == ([[[500, 3]]], [[[False, True]]])
    folder.add("runs-random", b"", **arrays | changed)
    warned = pytest.warns(UserWarning, match=rf"runs-random-.*npz: is damaged, and as good as missing \({why}")
    with warned, pytest.raises(Recomputed):
        train([80], ["random"], settings, out=tmp_path)


KILLED = """
from pathlib import Path
from dataclasses import replace
import optim.studies.chapter4.training as module
from robots.braitenberg import PUBLISHED
module.BODIES_PER_FILE = 2
task = replace(PUBLISHED, radius=1.0, time_step=0.1, steps=2000)
module.train(range(100, 160), ["random"], module.Training(2, 300, 3, task), out=Path({!r}))
"""


@pytest.mark.kernels
def test_a_killed_study_goes_on_and_repeats_no_file(tmp_path):
    out = tmp_path / "study"
    process = subprocess.Popen([sys.executable, "-c", KILLED.format(str(out))], cwd=Path(__file__).parents[3])
    while process.poll() is None and len(list(out.glob("runs-*.npz"))) < 2:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = {path: path.stat().st_mtime_ns for path in out.glob("runs-*.npz")}
    settings = Training(2, 300, 3, replace(PUBLISHED, radius=1.0, time_step=0.1, steps=2000))
    assert 2 <= len(before) < 30
    found = train(range(100, 106), ["random"], settings, out=out)
    assert all(path.stat().st_mtime_ns == changed for path, changed in before.items())
    assert outcomes(found) == outcomes(train(range(100, 106), ["random"], settings))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: train([], settings=BRIEF), "designs: none given"),
        (lambda: train([0], settings=BRIEF), "design: 0 is not allowed; give a whole number from 1 to 6561"),
        (lambda: train([1], [], BRIEF), "methods: none given"),
        (lambda: train([1], ["cma"], BRIEF), "methods: 'cma' is unknown; choose some of random, generating-set, nes"),
        (lambda: Training(repetitions=0), "repetitions: 0 is not allowed"),
        (lambda: Training(budget=0), "budget: 0 is not allowed"),
        (lambda: Training(precision="f16"), "precision: 'f16' is unknown"),
        (lambda: sample_designs(6562), "sample: 6562 is not allowed; give at most 6561"),
    ],
)
def test_bad_input_is_one_line(call, message):
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        call()
    assert "\n" not in str(error.value)


@pytest.mark.kernels
def test_folders_of_other_settings_are_refused(tmp_path):
    train([1], ["random"], BRIEF, out=tmp_path / "a")
    for other in (replace(BRIEF, seed=4), replace(BRIEF, task=PUBLISHED), replace(BRIEF, budget=13)):
        with pytest.raises(ValueError, match=r"a holds a training of other settings .*; name another folder"):
            train([1], ["random"], other, out=tmp_path / "a")
    (tmp_path / "b").mkdir()
    (tmp_path / "b/notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="b holds something else"):
        train([1], ["random"], BRIEF, out=tmp_path / "b")
    assert json.loads((tmp_path / "a/training.json").read_text())["methods"]["nes"]["population"] == 6


def test_samples_are_nested_and_differ_by_seed():
    small, large = sample_designs(50), sample_designs(500)
    assert len(set(small)) == 50 and set(small) < set(large) and small == sorted(small)
    assert small == sample_designs(50, seed=1) != sample_designs(50, seed=2)
    assert sample_designs(6561) == list(range(1, 6562))


# tables and correlations


@pytest.mark.kernels
@pytest.mark.parametrize("name", ["runs.csv", "runs.csv.gz"])
def test_tables_of_training_are_read_as_written(tmp_path, name):
    table = train(DESIGNS[:3], ["nes", "random"], BRIEF)
    table.write(tmp_path / name)
    first = (tmp_path / name).read_bytes()
    read = read_training_table(tmp_path / name)
    assert outcomes(read) == outcomes(table)
    assert read.methods == table.methods and np.array_equal(read.designs, table.designs)
    read.write(tmp_path / name)
    assert (tmp_path / name).read_bytes() == first


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "design,method,repetition,evaluations,solved\n1,nes,2,30,1\n"])
def test_other_files_are_no_tables_of_training(tmp_path, text):
    (tmp_path / "runs.csv").write_text(text)
    with pytest.raises(ValueError, match=r"runs\.csv: is"):
        read_training_table(tmp_path / "runs.csv")


def test_correlations_are_those_of_runs_and_of_means():
    settings = Sweep(weights=10)
    swept = SweepTable(np.arange(1, 6), np.array([0, 5, 10, 20, 40]), np.array([0, 50, 20, 80, 50]), settings)
    assert swept.learnability.tolist() == [0, 0.05, 0.1, 0.2, 0.4]
    assert swept.resistance.tolist() == [0, 0.1, 0.5, 0.25, 0.8]
    evaluations = np.array([[[500, 500], [300, 100], [90, 110], [10, 70], [5, 7]]])
    table = TrainingTable(("nes",), swept.designs, evaluations, evaluations < 500)
    found = {(c.metric, c.over): c.found for c in metric_correlations(table, swept)}
    means = [500, 200, 100, 40, 6]
    assert found["M_L", "bodies"] == pearson([0, 0.05, 0.1, 0.2, 0.4], means, "two-sided")
    assert found["M_CI", "bodies"] == pearson([0, 0.1, 0.5, 0.25, 0.8], means, "two-sided")
    assert found["M_L", "runs"].n == 10 and -1 < found["M_L", "runs"].r < -0.5
    with pytest.raises(ValueError, match="sweep: 1 of 5 bodies are missing, design 5 first"):
        metric_correlations(table, swept.rows([1, 2, 3, 4]))


@pytest.mark.kernels
def test_tables_of_sweeps_are_those_of_the_folder(tmp_path):
    options = {"weights": 9, "r": 1.0, "dt": 0.5, "steps": 1000}
    bodies = [VehicleBody.published(design) for design in DESIGNS]
    overlaps = sweep(bodies, **options, out=tmp_path / "sweep")
    table = read_sweep_table(tmp_path / "sweep").rows(DESIGNS)
    assert table.solving_all.tolist() == [(o == 4).sum() for o in overlaps] and table.solving_all.any()
    assert table.solving_any.tolist() == [(o > 0).sum() for o in overlaps]
    assert table.settings == Sweep(9, 1.0, 0.5, 1000)
    assert {5840, 5922} < set(read_sweep_table(tmp_path / "sweep").designs.tolist())  # images of 80 and 162
    table.write(tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text().startswith("design,all,any,M_L,M_CI\n80,")


@pytest.mark.kernels
def test_a_table_is_of_the_sweep_beside_it_and_elsewhere_its_metrics_must_be_of_the_published_grid(tmp_path):
    options = {"weights": 9, "r": 1.0, "dt": 0.5, "steps": 1000}
    sweep([VehicleBody.published(design) for design in DESIGNS], **options, out=tmp_path / "sweep")
    table = read_sweep_table(tmp_path / "sweep")
    for folder in (tmp_path / "sweep", tmp_path):
        table.write(folder / "table.csv")
    beside = read_sweep_table(tmp_path / "sweep/table.csv")
    assert beside.settings == table.settings and np.array_equal(beside.learnability, table.learnability)
    with pytest.raises(
        ValueError, match=r"table\.csv: its M_L is not of 121 x 121 controllers; give the sweep's folder"
    ):
        read_sweep_table(tmp_path / "table.csv")
    (tmp_path / "table.csv").write_text("design,all,any,M_L\n162,1517,2338,much\n")
    with pytest.raises(ValueError, match="its M_L is not of 121 x 121"):
        read_sweep_table(tmp_path / "table.csv")
    settings = tmp_path / "sweep/sweep.json"
    settings.write_text(settings.read_text().replace('"steps"', '"stairs"'))
    with pytest.raises(ValueError, match="sweep: holds no sweep"):
        read_sweep_table(tmp_path / "sweep/table.csv")


def test_the_committed_table_of_the_complete_sweep_is_of_the_published_grid():
    table = read_sweep_table(Path(__file__).parents[3] / "docs/data/vehicle-sweep.csv.gz").rows([162, 6553])
    assert table.solving_all == pytest.approx([1517, 26], abs=5) and table.solving_any == pytest.approx(
        [2338, 1830], abs=5
    )


def test_a_table_alone_is_of_the_published_sweep_only_if_its_counts_say_so(tmp_path):
    data = Path(__file__).parents[3] / "docs/data"
    read_sweep_table(data / "vehicle-sweep.csv.gz").check_published(data)
    wide = read_sweep_table(data / "vehicle-sweep-radius-0.2.csv.gz")
    told = r"not tell its radius, and design 6553 has 54 of 3348 there, not 26 of 1830 as in the published sweep; give"
    with pytest.raises(ValueError, match=told):
        wide.rows([1, 6553]).check_published(data)
    with pytest.raises(ValueError, match="not tell its radius, nor has it designs 162 and 6553, whose counts do; give"):
        wide.rows([1]).check_published(data)
    replace(wide, assumed=False).check_published(data)


def test_the_report_takes_no_budget_for_a_median(tmp_path):
    """The median of trials of which half or fewer succeed is beyond the budget."""
    ResultsFolder(tmp_path, "training", replace(BRIEF, budget=60).describe())
    spent = np.array([[[5, 60, 60]], [[5, 9, 60]], [[5, 7, 9]]])
    table = TrainingTable(("random", "nes", "de"), np.array([162]), spent, spent < 60)
    table.write(tmp_path / "runs.csv")
    (section,) = training.report(tmp_path).sections
    assert [row[-1] for row in section.rows] == ["more than 60", 9.0, 7.0]
    assert section.rows[0][3] == pytest.approx(125 / 3) and "fails counts with all that it used up" in section.note


def test_the_compressed_table_of_the_published_sweep_can_be_read(tmp_path):
    import gzip

    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"design,all,any\n162,1517,2338\n6553,26,1830\n"))
    table = read_sweep_table(tmp_path / "a.csv.gz")
    assert table.learnability == pytest.approx([0.1036, 0.0018], abs=5e-5)
    assert table.resistance == pytest.approx([0.6488, 0.0142], abs=5e-5)
    for wrong in (b"design,all,any\n2,1,2\n1,1,2\n", b"design,all,any\n2,3,2\n", b"design,all\n2,1\n"):
        (tmp_path / "b.csv.gz").write_bytes(gzip.compress(wrong))
        with pytest.raises(ValueError, match=r"b\.csv\.gz: is not the table of a sweep"):
            read_sweep_table(tmp_path / "b.csv.gz")
    for content in (b"design", b""):
        (tmp_path / "c.csv.gz").write_bytes(content)
        with pytest.raises(ValueError, match=r"c\.csv\.gz: "):
            read_sweep_table(tmp_path / "c.csv.gz")


def test_the_committed_tables_tell_the_correlations_that_the_docs_have(tmp_path):
    training.rewrite(Data(Path(__file__).parents[3] / "docs/data"), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"summary.json", "training.png", "training.csv"}
    told = json.loads((tmp_path / "summary.json").read_text())["correlations"]
    found = [f"{one['found']['r']:.2f}" for one in told if one["over"] == "bodies"]
    rows = zip(TRAINERS, found[::2], found[1::2], strict=True)
    assert [*rows] == [
        *(("random", "-0.79", "-0.86"), ("generating-set", "-0.69", "-0.75")),
        *(("nes", "-0.68", "-0.76"), ("de", "-0.78", "-0.85")),
    ]
