"""Runs on ground of a file: what is resumed, compared and reported when the file is another one, or gone."""

import dataclasses
import html
import json
import re
import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from articulated_files import CRAWLER

from optim.pipeline.run import settings_of as pipeline_settings
from optim.pipeline.task import read_task
from optim.problems import problem_of_run
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.robot import RobotProblem
from optim.runs import open_run, run_search
from optim.runs.config import read_config, settings_of, write_config
from optim.runs.history import read_history
from optim.runs.workers import folder_files
from optim.search import build_method, default_settings
from robots.freeform import FreeformRobot
from robots.freeform.grid import Grid
from robots.freeform.robot import FreeformActuation
from robots.world import Terrain
from taichi_sim.base.files import copy_in

HILLS, QUICK = "hills.npy:0.01", FreeformActuation(cycles=1, frequency=12.0, settling=0.02)
ROBOT = "--robot freeform --shape 3,2,2 --full --cycles 1 --frequency 12 --settling 0.02 --threads 1 --quiet"
SEARCH = f"codesign {ROBOT} --method random --climbers 2 --generations 1 --terrain {HILLS}"
MORE = "codesign --resume --generations 2 --threads 1 --quiet"
KEPT = copy_in(Path("a"), "hills.npy")
GONE = "terrain: 'hills.npy' is no file, and {} keeps no copy of it"


@pytest.fixture(autouse=True)
def hills(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return written(tmp_path, 0.0)


def written(folder, height):
    np.save(folder / "hills.npy", np.full((40, 40), height))
    return folder / "hills.npy"


def without_checksum(folder):
    """The run as earlier versions began it, before its first generation."""
    known = read_config(folder)
    assert list(known.pop("ground_files")) == ["hills.npy"]
    for path in (each for each in folder.iterdir() if each.name != "environment.json"):
        path.unlink()
    write_config(folder, known)


@pytest.mark.kernels
def test_a_run_goes_on_with_the_very_file_alone(morpholab, tmp_path):
    """With its copy; with the file itself, if the run has no copy yet; in no other file."""
    assert morpholab(f"{SEARCH} --out a")[::2] == (0, "")
    assert len(tomllib.loads((tmp_path / "a/config.toml").read_text())["ground_files"]["hills.npy"]) == 64
    before, content = (tmp_path / "a/log.jsonl").read_bytes(), KEPT.read_bytes()
    assert content == (tmp_path / "hills.npy").read_bytes()
    np.save(KEPT, np.full((40, 40), 0.002))
    code, _, error = morpholab(f"{MORE} --out a")
    assert code == 2 and error.startswith(
        f"morpholab codesign: error: terrain: {KEPT} is not the file of the run in a (SHA-256 "
    )
    assert error.count("\n") == 1 and "give it as it was, or start a new run" in error
    KEPT.unlink()
    written(tmp_path, 0.001)
    code, _, error = morpholab(f"{MORE} --out a")
    assert code == 2 and error.startswith(
        "morpholab codesign: error: terrain: hills.npy is not the file of the run in a (SHA-256 "
    )
    (tmp_path / "hills.npy").unlink()
    code, _, error = morpholab(f"{MORE} --out a")
    assert code == 2 and error == f"morpholab codesign: error: {GONE.format('a')}\n"
    assert (tmp_path / "a/log.jsonl").read_bytes() == before
    (tmp_path / "hills.npy").write_bytes(content)
    assert morpholab(f"{MORE} --out a")[::2] == (0, "") and KEPT.read_bytes() == content


@pytest.mark.kernels
def test_a_run_that_was_moved_needs_no_other_file(morpholab, tmp_path, monkeypatch):
    """It goes on to the bits of one that stayed; another file of the same name does not matter, unless it is named.

    The command that its report gives for the best design runs, too.
    """
    for name in "ab":
        assert morpholab(f"{SEARCH} --out {name}")[::2] == (0, "")
    assert morpholab(f"{MORE} --out b")[::2] == (0, "")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "a").rename(tmp_path / "elsewhere/a")
    (tmp_path / "hills.npy").unlink()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert morpholab(f"{MORE} --out a")[::2] == (0, "")
    assert Path("a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
    written(Path(), 0.001)
    assert morpholab("view a --frames 3 --precision f64 --strip a.png --quiet")[::2] == (0, "")
    assert morpholab("report a --out a.html --frames 3 --quiet")[::2] == (0, "")
    code, _, error = morpholab(f"{MORE} --terrain {HILLS} --out a")
    assert code == 2 and "terrain: hills.npy is not the file of the run in a (" in error
    Path("hills.npy").unlink()
    (line,) = re.findall("morpholab (simulate .*?)<", Path("a.html").read_text())
    code, out, error = morpholab(f"{html.unescape(line)} --threads 1 --json --quiet")
    assert (code, error) == (0, "") and json.loads(out)["speed"] == read_history(Path("a")).generations[-1].best


@pytest.mark.kernels
def test_a_run_is_seen_on_its_own_ground_or_on_another_that_is_named(morpholab, tmp_path):
    assert morpholab(f"{SEARCH} --out a")[::2] == (0, "")
    np.save(KEPT, np.full((40, 40), 0.001))
    code, _, error = morpholab("view a --frames 3 --strip a.png")
    assert code == 2 and error.startswith(f"morpholab view: error: terrain: {KEPT} is not the file of the run in a (")
    assert morpholab("view a --terrain flat --frames 3 --precision f64 --strip flat.png --quiet")[::2] == (0, "")
    assert (tmp_path / "flat.png").exists() and not (tmp_path / "a.png").exists()


@pytest.mark.kernels
def test_a_generation_on_another_ground_is_not_kept(tmp_path):
    """The file changes while the search goes on."""
    problem = RobotProblem(FreeformRobot(Grid((3, 2, 2)), full=True, actuation=QUICK), (Terrain(ground=HILLS),))
    settings, done = default_settings("random") | {"climbers": 2}, []
    method, config = build_method("random", problem.space, settings), settings_of(problem, "random", settings, 3)

    def overwritten(last):
        done.append(last.generation)
        written(tmp_path, 0.001)

    refused = pytest.raises(ValueError, match=r"^terrain: hills\.npy is not the file of the run in .*a \(SHA-256 ")
    with open_run(tmp_path / "a", config) as folder, refused:
        run_search(problem, method, folder, 3, overwritten)
    assert done == [0] and len((tmp_path / "a/log.jsonl").read_text().splitlines()) == 1


@pytest.mark.kernels
def test_a_run_of_a_robot_of_a_file_needs_its_copy_alone(morpholab, tmp_path):
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    robot = f"--robot crawler.xml --duration 0.1 --body-sizes front=0.5:2 --terrain {HILLS}"
    assert morpholab(f"codesign {robot} --method random --climbers 2 --generations 0 --quiet --out a")[0] == 0
    (tmp_path / "hills.npy").unlink()
    held = "codesign --robot a --hold '*_size' --method random --climbers 2 --generations 0 --quiet --out b"
    for line in (MORE + " --out a", "simulate --robot a", held, "simulate --robot b"):
        code, _, error = morpholab(line)
        assert code == 0, (line, error)
    assert copy_in(Path("b"), "hills.npy").is_file()
    (tmp_path / KEPT).unlink()
    code, _, error = morpholab(f"{MORE} --out a")
    assert code == 2 and GONE.format("a") in error


@pytest.mark.kernels
def test_seeds_of_one_study_share_one_ground(morpholab, tmp_path):
    options = f"--robot soft-quadruped --method random --climbers 2 --threads 1 --quiet --terrain {HILLS}"
    assert morpholab(f"codesign {options} --generations 0 --seed 1 --out a/seed-1")[0] == 0
    written(tmp_path, 0.001)
    code, _, error = morpholab(f"{MORE} --seeds 2 --terrain {HILLS} --out a")
    assert code != 0 and "terrain: hills.npy is not the file of the run in a" in error
    assert not (tmp_path / "a/seed-2/config.toml").exists()
    assert morpholab(f"{MORE} --seeds 2 --out a")[::2] == (0, "")
    copies = [copy_in(tmp_path / "a" / seed, "hills.npy").read_bytes() for seed in ("seed-1", "seed-2")]
    assert copies[0] == copies[1] != (tmp_path / "hills.npy").read_bytes()


@pytest.mark.usefixtures("simulator")
def test_gaits_of_the_inflatable_robot_go_on_with_the_copy(morpholab, tmp_path):
    """Alone, and as one of several seeds of which another has not begun."""
    options = f"--free shape --gait rolling --climbers 2 --geometry small --terrain {HILLS} --quiet"
    assert morpholab(f"codesign {options} --generations 1 --seed 1 --out a/seed-1")[::2] == (0, "")
    before = read_config(tmp_path / "a/seed-1")
    assert before["problem"]["terrains"] == [{"slope": 0.0, "ground": HILLS}]
    (tmp_path / "hills.npy").unlink()
    assert morpholab("codesign --resume --generations 2 --out a/seed-1 --quiet")[::2] == (0, "")
    assert read_config(tmp_path / "a/seed-1") == before | {"generations": 2}
    assert morpholab("codesign --resume --generations 2 --seeds 2 --out a --quiet")[::2] == (0, "")
    assert copy_in(tmp_path / "a/seed-2", "hills.npy").is_file()


@pytest.mark.usefixtures("simulator")
@pytest.mark.parametrize("terrain", ["flat+light:0.5,0.1", "hill:5+rough:0.01"])
def test_gaits_on_other_terrains_go_on(morpholab, terrain):
    options = f"--free shape --gait rolling --climbers 2 --geometry small --terrain {terrain} --quiet"
    assert morpholab(f"codesign {options} --generations 1 --out a")[::2] == (0, "")
    assert morpholab("codesign --resume --generations 2 --out a --quiet")[::2] == (0, "")


@pytest.mark.kernels
def test_runs_of_earlier_versions_go_on(morpholab, tmp_path):
    assert morpholab(f"{SEARCH} --out a")[0] == 0
    without_checksum(tmp_path / "a")
    assert morpholab(f"{MORE} --out a")[::2] == (0, "")
    written(tmp_path, 0.001)
    assert morpholab("codesign --resume --generations 3 --threads 1 --quiet --out a")[::2] == (0, "")
    assert "ground_files" not in (tmp_path / "a/config.toml").read_text()


@pytest.mark.kernels
def test_runs_are_told_of_without_their_ground(morpholab, tmp_path):
    for seed in (1, 2):
        assert morpholab(f"{SEARCH} --seed {seed} --out runs/{seed}")[0] == 0
    written(tmp_path, 0.001)
    copies = [copy_in(tmp_path / "runs" / seed, "hills.npy") for seed in "12"]
    copies[0].write_bytes((tmp_path / "hills.npy").read_bytes())
    code, _, error = morpholab("report runs/1 --out changed.html --frames 4")
    told = f"runs/1/{copies[0].name} is not the file of the run in runs/1"
    assert code == 0 and told in error and "the player is left out" in error
    assert morpholab(f"{SEARCH} --out other")[0] == 0
    code, _, error = morpholab("compare runs/1 other")
    assert code == 2 and "are judged differently (ground_files" in error
    for file in (tmp_path / "hills.npy", *copies):
        file.unlink()
    code, out, _ = morpholab("status runs")
    assert code == 0 and out.count("finished") == 2
    assert morpholab("compare runs")[::2] == (0, "")
    assert morpholab("report runs --no-player --out all.html --quiet")[::2] == (0, "")
    code, out, error = morpholab("report runs/1 --out one.html --json --quiet")
    assert (code, error) == (0, "")
    assert json.loads(out)["notes"] == [f"{GONE.format('runs/1')}; the player is left out"]
    code, _, error = morpholab("view runs/1 --out v.html")
    assert (code, error) == (2, f"morpholab view: error: {GONE.format('runs/1')}\n")


@pytest.mark.kernels
def test_measures_go_on_with_the_very_file_alone(morpholab, tmp_path):
    line = f"measure --robot soft-quadruped --environments {HILLS} --success 'speed >= 9' --controllers 1 --threads 1"
    for _ in range(2):
        assert morpholab(f"{line} --quiet --out m")[::2] == (0, "")
    written(tmp_path, 0.001)
    code, _, error = morpholab(f"{line} --quiet --out m")
    assert code == 2 and "out: m holds measures of other settings (ground_files" in error and error.count("\n") == 1
    assert morpholab(f"{line.replace(HILLS, 'flat')} --quiet --out flat")[::2] == (0, "")
    assert "ground_files" not in (tmp_path / "flat/measures.json").read_text()


def test_a_pipeline_goes_on_with_the_very_file_alone(tmp_path):
    (tmp_path / "task.toml").write_text(f"terrains = ['{HILLS}']\ngaits = ['rolling']\n")
    task = read_task(tmp_path / "task.toml")
    before = pipeline_settings(task)
    assert pipeline_settings(task) == before and list(before["ground_files"]) == ["hills.npy"]
    written(tmp_path, 0.001)
    assert pipeline_settings(task) != before
    assert "ground_files" not in pipeline_settings(dataclasses.replace(task, terrains=(Terrain(),)))


@pytest.mark.parametrize("of", [partial(RobotProblem, FreeformRobot(full=True)), GaitProblem])
def test_workers_elsewhere_need_the_very_file(morpholab, tmp_path, of):
    problem = of((Terrain(ground=HILLS),))
    offers = [folder_files.Offer.here(problem.describe(), 1.0, problem.ground_files)]
    (tmp_path / "w").mkdir()
    folder_files.make_folders(tmp_path / "w")
    offers[0].write(tmp_path / "w")
    assert folder_files.Offer.read(tmp_path / "w") == offers[0]
    problem.keep_ground_files(tmp_path / "w")
    written(tmp_path, 0.001)
    told = {"problem": offers[0].problem, "ground_files": offers[0].ground_files}
    kept = problem_of_run(tmp_path / "w", told)
    assert kept.ground_files == offers[0].ground_files and kept.describe() == problem.describe()
    folder_files.Offer.here(kept.describe(), 1.0, kept.ground_files).write(tmp_path / "w")
    copy_in(tmp_path / "w", "hills.npy").unlink()
    code, _, error = morpholab("work w --quiet")
    assert code == 2 and "terrain: hills.npy is not the file of the run in w (SHA-256 " in error
    offers.append(folder_files.Offer.here(problem.describe(), 1.0, problem.ground_files))
    assert offers[0].digest != offers[1].digest  # so that no answer on the other ground is taken for one on this
