"""Searches on the command line over workers here, of a folder and on a cluster, array jobs of Slurm, several seeds."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from worker_checks import wait_for

from optim.commands.codesign_plan import named_kinds
from optim.commands.codesign_seeds import seeds_of
from optim.problems.user_file import load_problem
from optim.runs.config import write_config
from optim.runs.history import runs_below
from optim.runs.workers.folder_files import Offer, make_folders
from optim.runs.workers.slurm import job_script

ROOT = Path(__file__).resolve().parents[3]
ROCKET = """
import numpy as np

bounds = {"fuel": (0, 1), "fins": (0, 8, "integer")}
name, unit = "height", "km"


def evaluate(points):
    fuel, fins = np.asarray(points).T
    return np.where(fuel > 0.9, np.nan, 100 * fuel - (fins - 3) ** 2)
"""
SMALL = "codesign --terrain flat --geometry small --columns 1 --repeats 1 --climbers 2 --generations 0 --out a"
SHORT = "--problem rocket.py --climbers 5 --generations 3 --quiet"
# Runs the tasks of an array job at once, as Slurm does when there is room.
SBATCH = """#!/bin/bash
echo "$@" >> "$0.called"
last=$(sed -n 's/^#SBATCH --array=0-//p' "$1")
output=$(sed -n 's/^#SBATCH --output=//p' "$1")
for task in $(seq 0 "$last"); do
  file=${output//%A/7}
  SLURM_CPUS_PER_TASK=1 bash "$1" > "${file//%a/$task}" 2>&1 &
done
echo "Submitted batch job 7"
"""


@pytest.fixture
def rocket(tmp_path):
    """A file with a function and bounds, in the working directory."""
    (tmp_path / "rocket.py").write_text(ROCKET)
    return tmp_path


@pytest.fixture
def sbatch(tmp_path, monkeypatch):
    """A command sbatch that runs what it is given on this machine."""
    path = tmp_path / "bin" / "sbatch"
    path.parent.mkdir()
    path.write_text(SBATCH)
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{path.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return path


def log(folder):
    return (folder / "log.jsonl").read_bytes()


@pytest.mark.long
def test_a_job_of_workers_leaves_the_log_of_one_process(rocket, sbatch, morpholab):
    assert morpholab(f"codesign {SHORT} --seeds 3,4 --out alone")[0] == 0
    line = (
        f"codesign {SHORT} --seeds 3,4 --out b --slurm --workers 2 --slurm-option=--partition=x --slurm-option=-t1:00"
    )
    code, _, error = morpholab(line)
    assert code == 0
    assert error == "morpholab codesign: note: slurm: Submitted batch job 7, 2 workers (b.workers/workers.sbatch)\n"
    for seed in (3, 4):
        for name in ("log.jsonl", "best.json", "config.toml"):
            assert (rocket / f"b/seed-{seed}" / name).read_bytes() == (
                rocket / f"alone/seed-{seed}" / name
            ).read_bytes()
    script = (rocket / "b.workers/workers.sbatch").read_text()
    assert "#SBATCH --partition=x\n#SBATCH -t1:00\n" in script and "#SBATCH --array=0-1\n" in script
    assert sbatch.with_name("sbatch.called").read_text() == "b.workers/workers.sbatch\n"
    logs = sorted((rocket / "b.workers/logs").iterdir())
    wait_for(lambda: all("the search has ended" in path.read_text() for path in logs))
    assert len(logs) == 2 and not list((rocket / "b.workers/open").iterdir())


def test_without_sbatch_one_line_says_where_the_script_is(rocket, morpholab, monkeypatch):
    from optim.runs.workers.slurm import submit_workers

    monkeypatch.setenv("PATH", "/nowhere")
    told = submit_workers(rocket / "w", 3)
    assert told == f"slurm: there is no sbatch on this machine; submit {rocket}/w/workers.sbatch where there is one"


def test_what_sbatch_refuses_is_one_line(rocket, sbatch, morpholab):
    sbatch.write_text("#!/bin/bash\necho 'sbatch: error: invalid partition' >&2\necho '  x' >&2\nexit 1\n")
    code, _, error = morpholab(f"codesign {SHORT} --slurm --workers-dir w --out a")
    assert code == 1
    assert error == (
        "morpholab codesign: failed: slurm: sbatch refused w/workers.sbatch (sbatch: error: invalid partition x)\n"
    )
    assert (rocket / "w/stop").exists()


def test_the_first_failure_is_told_though_workers_cannot_be_told_of_the_end(rocket, sbatch, morpholab, monkeypatch):
    def full(folder):
        raise RuntimeError(f"{folder}/stop: cannot be written (No space left on device)")

    monkeypatch.setattr("optim.runs.workers.folder_files.end_workers", full)
    sbatch.write_text("#!/bin/bash\necho 'sbatch: error: invalid partition' >&2\nexit 1\n")
    code, _, error = morpholab(f"codesign {SHORT} --slurm --workers-dir w --out a")
    told, last = error.splitlines()
    assert code == 1 and last.startswith("morpholab codesign: failed: slurm: sbatch refused w/workers.sbatch (")
    noted = (
        "morpholab codesign: note: workers-dir: w/stop: cannot be written (No space left on device); the workers wait "
        "on, end them yourself"
    )
    assert told == noted
    assert morpholab(f"codesign {SHORT} --out b")[0] == 0
    code, out, error = morpholab(f"codesign {SHORT} --out b --resume --workers-dir w")  # it has all of its result
    assert (code, error) == (0, f"{noted}\n") and out.startswith("best ")


def test_a_run_that_is_complete_submits_nothing(rocket, sbatch, morpholab):
    assert morpholab(f"codesign {SHORT} --out a")[0] == 0
    assert morpholab(f"codesign {SHORT} --out a --resume --slurm")[:3:2] == (0, "")
    assert not sbatch.with_name("sbatch.called").exists()


def test_the_script_quotes_its_paths(tmp_path):
    script = job_script(tmp_path / "my workers", 2, problem=tmp_path / "it's.py")
    assert f'#SBATCH --output="{tmp_path}/my workers/logs"/%A_%a.txt\n' in script
    words = subprocess.run(
        ["bash", "-c", script.replace("exec ", "printf '%s\\n' ")], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert words == [
        *(sys.executable, "-m", "morpholab", "work", f"{tmp_path}/my workers"),
        *("--problem", f"{tmp_path}/it's.py", "--threads", "1"),
    ]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--slurm-option=-x", "slurm-option: it belongs to --slurm; give that, too, or leave it out"),
        ("--workers-dir w --slurm-option=-x", "slurm-option: it belongs to --slurm; give that, too, or leave it out"),
        ("--silent-after 5", "silent-after: it belongs to --workers-dir; give that, too, or leave it out"),
        ("--slurm --slurm-option=x", "slurm-option: 'x' is not allowed; give an option of sbatch"),
        ("--workers-dir w --ray auto", "ray: it is not allowed with a folder of workers; give one of them"),
        ("--workers-dir rocket.py", "workers-dir: rocket.py is a file; name a folder"),
        ("--workers-dir a", "workers-dir: a is not allowed with --out a; name one beside it"),
        ("--workers-dir ./a/w", "workers-dir: a/w is not allowed with --out a; name one beside it"),
        ("--seeds 0-2 --seed 1", "seed: 1 is not allowed with --seeds; give one of them"),
        ("--seeds 2-0", "argument --seeds: '2-0' is not allowed; give whole numbers and ranges, such as 0-5 or 0,2,7"),
    ],
)
def test_options_that_do_not_fit_are_one_line(rocket, morpholab, line, message):
    code, _, error = morpholab(f"codesign {SHORT} --out a {line}")
    assert code == 2 and message in error and error.count("\n") == 1 and not (rocket / "a").exists()


def test_work_says_in_one_line_what_does_not_fit(rocket, morpholab):
    def said(more=""):
        code, _, error = morpholab(f"work {more or 'w'}")
        assert code == 2 and error.count("\n") == 1
        return error.removeprefix("morpholab work: error: ").strip()

    assert said("rocket.py") == "folder: rocket.py is a file; give the folder of codesign --workers-dir"
    assert said("no/w") == "folder: no/w cannot be written; there is no folder no"
    make_folders(rocket / "w")
    described = load_problem(rocket / "rocket.py").describe()
    offer = Offer.here({**described, "sha256": "0" * 64}, 1.0)
    offer.write(rocket / "w")
    assert said() == "problem: the search needs its file here, too; give --problem rocket.py"
    assert said("w --problem rocket.py").startswith("problem: rocket.py is not the file of the run in w (SHA-256 ")
    other = {**offer.versions, "numpy": "1.0"}
    Offer(offer.problem, other, offer.processor, 1.0).write(rocket / "w")
    assert re.fullmatch(r"work: this machine has numpy \S+, the search 1\.0; install the same here", said())
    code, out, error = morpholab("work new --idle 0")
    assert (code, out) == (0, "0 parts evaluated; there was no sign of a search for 0 s\n")
    assert error == "morpholab work: note: new is new; waiting for a search that is given it\n"


@pytest.mark.parametrize(
    ("text", "seeds"), [("0-2", (0, 1, 2)), ("0,2,7", (0, 2, 7)), ("5,1-2", (5, 1, 2)), ("3", (3,))]
)
def test_seeds_are_lists_and_ranges(text, seeds):
    assert seeds_of(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1,", "3-1", "-1", "1,0-3", "0-99999", "1.5", "1--2"])
def test_other_seeds_are_refused(text):
    with pytest.raises(ValueError, match=r"^seeds: .* is not allowed; "):
        seeds_of(text)


def test_each_seed_has_the_run_that_it_has_alone(rocket, morpholab):
    assert morpholab(f"codesign {SHORT} --seed 2 --out alone")[0] == 0
    code, out, error = morpholab(f"codesign {SHORT} --seeds 0,2 --out a --json")
    assert (code, error) == (0, "") and [run["seed"] for run in json.loads(out)["runs"]] == [0, 2]
    assert sorted(path.name for path in (rocket / "a").iterdir()) == ["seed-0", "seed-2"]
    assert [run.parent.name for run in runs_below([rocket])].count("a") == 2  # as status and track find them
    assert "source: a/seed-0 is a run of rocket.py, which is no robot; `morph" in morpholab("view a --out a.html")[2]
    assert log(rocket / "a/seed-2") == log(rocket / "alone")
    code, _, error = morpholab(f"codesign {SHORT} --seeds 1-2 --out a")
    assert code == 2 and "out: a/seed-2 holds a run already; continue it with --resume" in error
    assert not (rocket / "a/seed-1").exists()
    code, _, error = morpholab(f"codesign {SHORT} --seeds 1-2 --out alone")
    assert code == 2 and "out: alone holds a single run; name another folder for --seeds" in error


def test_one_seed_where_many_may_be_meant_is_noted(rocket, morpholab):
    search = f"codesign {SHORT} --out a --seeds"
    code, _, error = morpholab(f"{search} 5")
    assert code == 0 and "note: seeds: this is seed 5 alone; for 5 searches give --seeds 0-4\n" in error
    assert "alone" not in morpholab(f"{search} 6")[2] + morpholab(f"{search.replace('out a', 'out b')} 5,6")[2]
    Path("more").mkdir()
    Path("a/seed-5").rename("more/mine")
    code, _, error = morpholab("view more --out a.html")
    assert (
        code == 2
        and "more: holds no run; its config.toml is missing; name one of those in it, such as more/mine" in error
    )


def test_runs_of_seeds_are_not_continued_as_one(rocket, morpholab):
    assert morpholab(f"codesign {SHORT} --seeds 0-1,4 --out a")[0] == 0
    for options in ("", SHORT):
        code, _, error = morpholab(f"codesign --resume --out a {options}")
        assert code == 2 and error.endswith("out: a holds runs of seeds; give --seeds 0-1,4 to go on with them\n")
    assert morpholab("codesign --problem rocket.py --resume --seeds 0-1,4 --quiet --out a")[0] == 0


def test_seeds_that_have_not_begun_take_the_settings_of_the_others(rocket, morpholab):
    assert morpholab(f"codesign {SHORT} --method random --seeds 0,2 --out a")[0] == 0
    assert morpholab(f"codesign {SHORT} --method random --seeds 0-2 --out whole")[0] == 0
    code, out, _ = morpholab("codesign --problem rocket.py --seeds 0-2 --resume --quiet --out a")
    assert code == 0 and out.count("best height: ") == 3
    for seed in range(3):
        assert log(rocket / f"a/seed-{seed}") == log(rocket / f"whole/seed-{seed}")


def test_a_run_of_any_seed_tells_the_kind_of_robot(tmp_path):
    (tmp_path / "seed-3").mkdir()
    write_config(tmp_path / "seed-3", {"problem": {"kind": "vehicle"}, "method": {"name": "random"}, "generations": 1})
    assert [kind.name for kind in named_kinds(["--out", str(tmp_path), "--resume"])] == ["vehicle"]
    assert [kind.name for kind in named_kinds(["--out", str(tmp_path)])] == ["inflatable"]


def test_compare_names_groups(rocket, morpholab):
    for method, size in (("random", 5), ("hill-climb", 5), ("hill-climb", 6)):
        own = f"--generations 0 --climbers {size} --method {method} --seeds 1-2 --out runs/{method}{size}"
        assert morpholab(f"codesign {SHORT} {own}")[0] == 0
    code, out, error = morpholab("compare --label 'drawn=runs/ran*' --label climbed=runs/hill-climb5/seed-? --json")
    groups = json.loads(out)["groups"]
    assert (code, error) == (0, "") and [(group["label"], group["count"]) for group in groups] == [
        ("drawn", 2),
        ("climbed", 2),
    ]
    code, out, _ = morpholab("compare 'runs/*m5' --json")  # as of a shell
    assert code == 0 and [group["count"] for group in json.loads(out)["groups"]] == [2]
    assert "run: runs/z* does not exist" in morpholab("compare 'runs/z*'")[2]
    code, out, _ = morpholab(
        f"compare --label one=runs/hill-climb5 {Path.cwd()}/runs/hill-climb5 runs/random5/seed-1 --json"
    )
    assert [group["label"] for group in json.loads(out)["groups"]] == ["one", "random"]
    twice = f"{Path.cwd()}/runs/random5/seed-1"
    for line, message in {
        "": "runs: none are given; name folders of runs, or groups by --label NAME=PATTERN",
        "--label runs": "label: 'runs' is not allowed; give NAME=PATTERN, as in new=runs/new*",
        "--label a=none*": "label: nothing matches none*, of a",
        f"--label a=runs/r* --label b={twice}": f"label: {twice} would be a and b; give it one",
        "--label 'a=runs/hill*'": "label: runs of 'a' differ in method.climbers; only seeds may differ",
    }.items():
        code, _, error = morpholab(f"compare {line}")
        assert code == 2 and f"morpholab compare: error: {message}" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--ray 127.0.0.1:1", "ray: no cluster answers at 127.0.0.1:1"),
        ("--ray moon", "ray: 'moon' is not an address; give HOST:PORT, ray://HOST:PORT, auto, or local for one here"),
        ("--workers 0", "argument --workers: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_a_place_that_is_not_there_is_one_line(morpholab, options, message):
    code, _, error = morpholab(f"{SMALL} {options}")
    assert code == 2 and message in error and error.count("\n") == 1


def test_more_workers_than_cores_are_noted(morpholab, monkeypatch, tmp_path):
    (tmp_path / "hill.py").write_text(
        "bounds = {'x': (0, 1)}\n\n\ndef evaluate(points):\n    return [-((x - 0.3) ** 2) for (x,) in points]\n"
    )
    line = "codesign --problem hill.py --climbers 4 --generations 2 --quiet"
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0})
    code, _, error = morpholab(f"{line} --workers 2 --out a")
    told = "morpholab codesign: note: 2 workers need 2 threads, of 1 cores; fewer would be as fast\n"
    assert (code, error) == (0, told)
    assert morpholab(f"{line} --out b")[0] == 0
    assert (tmp_path / "a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
