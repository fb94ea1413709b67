"""Looking at runs, and comparing them, through the command line."""

import errno
import json
import os
import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest
from run_products import Kite, log, searched
from scipy.stats import mannwhitneyu

from optim.commands.compare import _difference
from optim.measures.statistics import superiority
from optim.runs.comparison import Curve
from optim.runs.differences import differences_at
from optim.runs.folder_lock import locked

pytestmark = pytest.mark.usefixtures("simulator")

SIZE = "--terrain flat --geometry small --columns 4 --quiet"


def design(morpholab, out, method="hill-climb", seed=0, generations=4, more="--climbers 5"):
    line = f"codesign {SIZE} --method {method} --seed {seed} --generations {generations} {more} --out {out}"
    assert morpholab(line)[0] == 0


def test_status_tells_how_far_runs_are(morpholab, simulator, tmp_path):
    design(morpholab, "runs/done")
    simulator.calls, simulator.interrupt_at = [], 3
    assert morpholab(f"codesign {SIZE} --climbers 5 --generations 4 --out runs/cut")[0] == 130
    simulator.calls, simulator.interrupt_at = [], 1
    code, out, _ = morpholab(f"codesign {SIZE} --out runs/none --json")
    assert code == 130 and json.loads(out) == {"folder": "runs/none", "interrupted": True}
    code, out, error = morpholab("status runs --json")
    cut, done, none = json.loads(out)
    assert code == 0 and error == ""
    last = log(tmp_path / "runs/done")[-1]
    assert done["state"] == "finished" and done["seconds_left"] == 0 and done["best"] == last["best"]
    assert (done["generation"], done["generations"], done["evaluations"]) == (4, 4, 25)
    assert cut["state"] == "stopped" and cut["generation"] == 1
    assert cut["seconds_left"] == pytest.approx(3 * cut["seconds_per_generation"])
    assert none["generation"] is None and none["evaluations"] == 0
    with locked(tmp_path / "runs/cut"):
        code, out, _ = morpholab("status runs/cut runs/none")
    assert out.startswith("runs/cut: running, hill-climb, generation 1/4, best ")
    assert out.endswith("runs/none: stopped, hill-climb, no complete generation yet of 200\n")


def test_runs_that_have_just_begun_are_left_out_of_comparisons(morpholab, simulator, tmp_path):
    design(morpholab, "runs/done")
    simulator.calls, simulator.interrupt_at = [], 1
    assert morpholab(f"codesign {SIZE} --climbers 5 --out runs/none")[0] == 130
    for command in ("compare runs --json", "report runs --out page.html --no-player --quiet --json"):
        code, out, error = morpholab(command)
        (reason,) = json.loads(out)["left_out"]
        assert code == 1 and "runs/none has no complete generation yet" in reason and reason in error
    assert "runs/none has no complete generation yet" in (tmp_path / "page.html").read_text()
    code, _, error = morpholab("compare runs --names A,B")
    assert code == 2 and "names: 'A,B' is not allowed" in error and "left out: run: runs/none" in error


def test_a_run_is_ended_politely_by_sigterm(morpholab, simulator, tmp_path):
    evaluate, handler = simulator.diverges, signal.getsignal(signal.SIGTERM)

    def ended(design, terrain):
        if len(simulator.calls) == 3:
            signal.raise_signal(signal.SIGTERM)
        return evaluate(design, terrain)

    simulator.diverges = ended
    code, out, _ = morpholab(f"codesign {SIZE} --climbers 5 --generations 4 --out a --json")
    assert code == 143 and json.loads(out)["interrupted"] and json.loads(out)["generation"] == 1
    simulator.diverges = evaluate
    assert morpholab("codesign --resume --quiet --out a")[0] == 0
    assert signal.getsignal(signal.SIGTERM) is handler


def test_runs_that_differ_in_their_seed_are_one_group(morpholab, tmp_path):
    for seed in range(3):
        design(morpholab, f"runs/climb{seed}", "hill-climb", seed)
        design(morpholab, f"runs/random{seed}", "random", seed, generations=3)
    code, out, _ = morpholab("compare runs --out curves.png --json")
    document = json.loads(out)
    assert code == 0 and document["at"] == 20 and document["by"] == "evaluations"
    climb, random = document["groups"]
    assert (climb["label"], climb["unit"], climb["count"], random["label"]) == ("hill-climb", "runs", 3, "random")
    best = {
        name: [log(tmp_path / f"runs/{name}{seed}")[3]["best"] for seed in range(3)] for name in ("climb", "random")
    }
    assert climb["mean"] == pytest.approx(np.mean(best["climb"])) and climb["low"] <= climb["mean"] <= climb["high"]
    (difference,) = document["differences"]
    gains = np.subtract(best["random"], best["climb"])  # both begin alike with each seed
    assert difference["effect"]["superiority"] == np.mean(gains > 0) != superiority(best["climb"], best["random"])
    assert difference["effect"]["difference"] == pytest.approx(np.mean(gains))
    assert (difference["effect"]["pairs"], difference["shared_starts"]) == (3, 3)
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = morpholab("compare runs --by generations")
    assert out.startswith(
        "best speed [BL/s] after 3 generations: mean, its 95 % interval, best\n  hill-climb (3 runs): "
    )
    assert "random minus hill-climb: " in out and ", 3 pairs, higher in " in out and "(paired t, Holm)" in out
    assert "\n  luck (3 runs): " in morpholab("compare runs --names 'climbing, luck'")[1]
    code, _, error = morpholab("compare runs --names one")
    assert code == 2 and "names: 'one' is not allowed; give 2, one for each of hill-climb; random" in error


def test_single_runs_of_climbers_are_compared_by_climber(morpholab, tmp_path):
    design(morpholab, "a")
    design(morpholab, "b", more='--climbers 4 --set start={"pressure":3000}'.replace('"', '\\"'))
    document = json.loads(morpholab("compare a b --json")[1])
    assert [(group["unit"], group["count"]) for group in document["groups"]] == [("climbers", 5), ("climbers", 4)]
    assert [group["label"] for group in document["groups"]] == [
        "hill-climb, climbers 5",
        "hill-climb, climbers 4, pressure 3000",
    ]
    scores = [log(tmp_path / "a")[i]["scores"] for i in range(5)]
    assert document["at"] == 5 and document["groups"][0]["mean"] == pytest.approx(np.mean(scores[4]))
    _, out, error = morpholab("compare a b")
    assert out.startswith("best speed [BL/s] after 5 evaluations of each climber: mean, its ") and "A12 " in out
    assert error == ""  # with another pressure they begin elsewhere


def test_starts_of_one_seed_are_told(morpholab):
    """In full they make pairs; in part they make a test of independent samples find too little."""
    design(morpholab, "a")
    design(morpholab, "b", "generating-set")
    design(morpholab, "c", more="--climbers 8")
    design(morpholab, "d", more="--climbers 8", seed=1)
    _, out, error = morpholab("compare a b")
    assert ", 5 pairs, higher in " in out and "Cohen's d of pairs" in out and error == ""
    _, out, error = morpholab("compare a c --names few,many")
    assert "many minus few: " in out and "A12 " in out and error.count("\n") == 1
    assert "few and many share 5 of 8 starts, so the test of the difference finds less than it could: search " in error
    _, _, error = morpholab("compare a b c --by generations")
    assert "share 5 of 8 starts, and so does 1 more pair of groups, so the test of the difference" in error
    assert morpholab("compare a d")[2] == morpholab("compare c d")[2] == ""


@pytest.mark.long
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("compare nothing", "run: nothing does not exist"),
        ("status .", "run: . holds no run"),
        ("compare a --out a.txt", "out: a.txt is not allowed; its name must end in .png"),
        ("compare a --out no/where.png", "out: no/where.png cannot be written"),
        ("compare a deeper/c/kite", 'run: a/b and deeper/c/kite are judged differently (kind "gait" and "kite")'),
        ("compare a deeper/c/effort", "run: a/b and deeper/c/effort are judged differently (effort null and 0.1)"),
        ("compare deeper/c/d deeper/c/short", "deeper/c/short are judged differently (steps null and 9000)"),
    ],
)
def test_what_cannot_be_compared_is_one_line(morpholab, tmp_path, line, message):
    design(morpholab, "a/b", generations=0)
    design(morpholab, "deeper/c/d", generations=0)
    design(morpholab, "deeper/c/effort", generations=0, more="--climbers 5 --effort 0.1")
    design(morpholab, "deeper/c/short", generations=0, more="--climbers 5 --encoding graded --steps 9000")
    searched(Kite(), tmp_path / "deeper/c/kite")
    code, _, error = morpholab(line)
    assert code == 2 and message in error and error.count("\n") == 1


def test_searches_that_never_come_to_the_same_place_are_not_compared(morpholab):
    design(morpholab, "few", generations=0)
    design(morpholab, "many", "genetic", generations=1, more="--population 10")
    code, _, error = morpholab("compare few many")
    assert code == 2 and error == (
        "morpholab compare: error: by: few ended at 5 evaluations, before many had a first score, at 10; compare by "
        "generations, or continue what is short\n"
    )
    assert morpholab("compare few many --by generations")[0] == 0


def test_before_its_first_place_a_curve_has_no_value():
    curve = Curve("a", ("a",), "runs", np.array([9.0, 18.0]), np.array([[1.0, 2.0]]))
    assert curve.at(8.0).size == 0 and curve.at(9.0).tolist() == [1.0]


def test_runs_whose_times_do_not_overlap_are_one_line(morpholab, monkeypatch):
    for seed in (0, 1):
        design(morpholab, f"runs/{seed}", seed=seed, generations=0)
    times = {"runs/0": 1.0, "runs/1": 3.0}
    monkeypatch.setattr("optim.runs.history._read_timing", lambda folder, _: ((times[str(folder)],), None))
    code, _, error = morpholab("compare runs --by seconds")
    assert code == 2 and "by: runs/0 ended at 1 seconds, before runs/1 had a first score, at 3; " in error
    assert error.count("\n") == 1


def test_times_that_kernels_were_compiled_in_are_told_of(morpholab, monkeypatch):
    for seed in (0, 1):
        design(morpholab, f"runs/{seed}", seed=seed, generations=3)
    times = {"runs/0": (18.0, 1.0, 1.0, 1.0), "runs/1": (2.0, 1.0, 1.0, 17.0)}
    monkeypatch.setattr("optim.runs.history._read_timing", lambda folder, _: (times[str(folder)], None))
    code, _, error = morpholab("compare runs --by seconds")
    told = "the first generation of runs/0 took 18 s, as it seems to have compiled kernels, and others did not: compare"
    assert code == 0 and told in error and error.count("\n") == 1
    assert morpholab("compare runs")[2] == ""
    times["runs/1"] = (2.0, 1.0, 1.0, 1.0)
    code, _, error = morpholab("compare runs --by seconds")
    told = "before runs/0 had a first score, at 18, as it seems to have compiled kernels first; compare by generations"
    assert code == 2 and told in error and error.count("\n") == 1


def test_a_copy_of_a_run_is_no_second_sample(morpholab, tmp_path):
    design(morpholab, "runs/0")
    shutil.copytree(tmp_path / "runs/0", tmp_path / "runs/copy")
    design(morpholab, "runs/other", seed=1)
    code, _, error = morpholab("compare runs")
    assert code == 2 and "run: runs/copy is the same search as runs/0, seed included; leave one of them" in error
    assert morpholab("compare runs/0 runs/other")[0] == 0


def test_unknown_times_cannot_be_compared(morpholab, tmp_path):
    design(morpholab, "a")
    (tmp_path / "a/timing.jsonl").unlink()
    assert morpholab("status a")[0] == 0
    code, _, error = morpholab("compare a --by seconds")
    assert code == 2 and "by: the times of a are not known" in error


@pytest.fixture
def unlisted(monkeypatch, tmp_path):
    """Lets the disk refuse to list a folder, as one of mode 300."""
    listed = os.listdir

    def refuse(name):
        def call(path="."):
            if os.path.realpath(path) == str(tmp_path / name):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return listed(path)

        monkeypatch.setattr(os, "listdir", call)

    return refuse


def test_a_folder_that_cannot_be_listed_is_told(morpholab, unlisted, tmp_path):
    """It may hold runs, alone or of several seeds."""
    searched(Kite(), tmp_path / "runs/a")
    searched(Kite(), tmp_path / "runs/deep/seed-1")
    assert morpholab("status runs")[1].count("\n") == 2
    unlisted("runs/deep")
    code, out, error = morpholab("status runs")
    told = "runs/deep: damaged: cannot be listed (Permission denied)"
    assert (code, error) == (1, "") and out.startswith("runs/a: finished") and out.splitlines()[1:] == [told]
    assert morpholab("status runs/deep")[:2] == (1, told + "\n")
    code, out, error = morpholab("compare runs")
    assert code == 1 and "runs/deep: cannot be listed (Permission denied); the run is left out" in error
    unlisted("runs")
    assert morpholab("compare runs") == (
        2,
        "",
        "morpholab compare: error: runs: cannot be listed (Permission denied)\n",
    )


def test_runs_without_any_success_rank_below_all_others():
    """A method that succeeds in three of ten runs does not beat one that succeeds always, however high these come."""
    seldom = np.array([[np.nan]] * 7 + [[1.0], [1.1], [1.2]])
    always = np.linspace(0.45, 0.55, 10)[:, None]
    groups = [Curve(name, (name,), "runs", np.array([1.0]), scores) for name, scores in (("a", seldom), ("b", always))]
    (found,) = differences_at(groups, 1.0)
    assert found.effect.difference == pytest.approx(-0.6) and found.effect.superiority == pytest.approx(0.7)
    ranks = np.where(np.isnan(seldom), -1.0, seldom)[:, 0]
    assert found.effect.p == pytest.approx(mannwhitneyu(ranks, always[:, 0], method="asymptotic").pvalue)
    (same,) = differences_at([replace(groups[0], scores=seldom[7:]), groups[1]], 1.0)
    assert same.effect.superiority == 0.0 and same.effect.difference == found.effect.difference


@pytest.mark.parametrize("successes", [0, 1])
def test_groups_with_less_than_two_successes_are_ranked(successes):
    """Means of one, or of none, have no interval, but ten of ten are more than one of ten."""
    often = np.linspace(0.45, 0.55, 10)
    seldom = np.where(np.arange(10) < successes, 0.5001, np.nan)
    groups = [Curve(name, (name,), "runs", np.array([1.0]), v[:, None]) for name, v in (("a", seldom), ("b", often))]
    (found,) = differences_at(groups, 1.0)
    assert found.effect.superiority == pytest.approx(1.0 - 0.05 * successes)
    expected = mannwhitneyu(np.nan_to_num(seldom, nan=-1.0), often, method="asymptotic").pvalue
    assert found.effect.p == found.adjusted_p == pytest.approx(expected) and expected < 1e-3
    assert found.effect.difference is None and found.effect.low is None and found.effect.cohens_d is None
    line = _difference(found, unsuccessful=True)
    assert line.startswith("  b minus a: too few with success for a difference of means, A12 ")
