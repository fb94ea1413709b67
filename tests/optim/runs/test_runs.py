"""Runs on disk: logs, checkpoints, and resuming after any interruption."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from optim.problem import Evaluation, Objective
from optim.runs import open_run, run_search
from optim.runs.config import check_same, read_config, score_in, settings_of
from optim.runs.products import save_failed
from optim.search import build_method
from optim.space import Space, Variable
from taichi_sim.base.files import pack, unpack, write_text

GENERATIONS = 4
CONFIG = {"problem": {"size": 2}, "method": {"name": "hill-climb", "climbers": 3, "seed": 5}}
PRODUCTS = ("log.jsonl", "best.json", "config.toml")


class Sphere:
    """A quick problem, some of whose points fail."""

    space = Space((Variable("x", -5.0, 5.0, step=0.5), Variable("n", 0, 8, "integer", step=0.9)))
    objective_names = ("score",)

    def __init__(self, seconds=0.0):
        self.seconds = seconds
        self.calls = 0

    def describe(self):
        return {"size": 2}

    def evaluate(self, points):
        self.calls += 1
        time.sleep(self.seconds)
        distance = np.abs(points[:, 0] - 1) + np.abs(points[:, 1] - 3)
        return Evaluation(np.where(points[:, 0] < -3, np.nan, -distance), details={"distance": distance})

    def save(self, point, path):
        path.write_text(json.dumps(self.space.to_dict(point)))


class Hill(Sphere):
    """A quick problem with a relaxation."""

    space = Space((Variable("x", -5.0, 5.0, step=0.5), Variable("on", 0, 1, "binary", step=0.3)))

    def __init__(self):
        super().__init__()
        self.asked = []

    def evaluate(self, points):
        self.asked.append("points")
        return super().evaluate(self.space.validate(points))

    def evaluate_relaxed(self, points, sharpness, gradients):
        self.asked.append((sharpness, gradients))
        judgement = super().evaluate(self.space.relaxed().validate(points))
        slopes = -np.sign(points - [1.0, 3.0]) if gradients else None
        return Evaluation(judgement.objectives, judgement.status, judgement.details, slopes)


def run(path, generations=GENERATIONS, resume=False, problem=None, method=CONFIG["method"], **options):
    problem = problem or Sphere()
    config = {**CONFIG, "method": method, "generations": generations}
    with open_run(path, config, resume=resume, **options) as folder:
        settings = {key: value for key, value in method.items() if key != "name"}
        return run_search(problem, build_method(method["name"], problem.space, settings), folder, generations)


def products(path):
    return {name: (path / name).read_bytes() for name in PRODUCTS}


def log(path):
    return [json.loads(line) for line in (path / "log.jsonl").read_text().splitlines()]


@pytest.fixture
def whole(tmp_path):
    """A run that nothing interrupted."""
    run(tmp_path / "whole")
    return tmp_path / "whole"


def test_the_log_tells_every_generation(whole):
    lines = log(whole)
    assert [line["generation"] for line in lines] == list(range(GENERATIONS + 1))
    assert [line["evaluations"] for line in lines] == [3 * (i + 1) for i in range(GENERATIONS + 1)]
    assert set(lines[-1]) == {
        "generation",
        "evaluations",
        "failed",
        "best",
        "mean",
        "median",
        "scores",
        "best_point",
        "best_details",
        "numbers",
    }
    last = lines[-1]
    assert last["best"] == -last["best_details"]["distance"] == max(last["scores"]) >= last["mean"]
    assert json.loads((whole / "best.json").read_text()) == last["best_point"]
    assert [line["best"] for line in lines] == sorted(line["best"] for line in lines)


def test_the_folder_holds_what_was_run(tmp_path):
    run(tmp_path / "a", environment={"seed": 5})
    settings = {"format": 1, **CONFIG, "generations": GENERATIONS}
    assert tomllib.loads((tmp_path / "a/config.toml").read_text()) == settings
    assert json.loads((tmp_path / "a/environment.json").read_text()) == {"seed": 5}
    timing = [json.loads(line) for line in (tmp_path / "a/timing.jsonl").read_text().splitlines()]
    assert [line["generation"] for line in timing] == list(range(GENERATIONS + 1))


def test_failures_are_counted_and_never_averaged(tmp_path):
    problem = Sphere()
    problem.evaluate = lambda points: Evaluation([np.nan, -2.0, -4.0])
    run(tmp_path / "some", generations=0, problem=problem)
    assert log(tmp_path / "some")[0] | {"best_point": 0} == {
        "generation": 0,
        "evaluations": 3,
        "failed": 1,
        "best": -2.0,
        "mean": -3.0,
        "median": -3.0,
        "scores": [None, -2.0, -4.0],
        "best_point": 0,
        "best_details": {},
        "numbers": {},
    }
    problem.evaluate = lambda points: Evaluation([np.nan] * 3)
    last = run(tmp_path / "all", generations=1, problem=problem)
    assert (last.failed, last.best, last.mean, last.best_point, last.best_details) == (
        3,
        None,
        None,
        None,
        None,
    )
    assert not (tmp_path / "all/best.json").exists()


def test_a_finished_run_is_left_as_it_is(whole):
    before = {path.name: path.read_bytes() for path in whole.iterdir()}
    problem = Sphere()
    last = run(whole, resume=True, problem=problem)
    assert problem.calls == 0 and json.loads(last.to_json()) == log(whole)[-1]
    assert {path.name: path.read_bytes() for path in whole.iterdir()} == before


def test_more_generations_continue_a_run(tmp_path, whole):
    run(tmp_path / "short", generations=1)
    run(tmp_path / "short", resume=True)
    assert products(tmp_path / "short") == products(whole)


GRADIENT = {"name": "gradient", "climbers": 3, "seed": 5, "stage": 2}


@pytest.mark.parametrize("settings", [{}, {"rule": "l-bfgs"}, {"gradient": "smoothed", "samples": 2}])
def test_gradient_searches_get_what_they_want_and_resume_exactly(tmp_path, settings):
    problem, method = Hill(), {**GRADIENT, **settings}
    run(tmp_path / "whole", generations=8, problem=problem, method=method)
    exact = "gradient" not in settings
    relaxed = [(sharpness, exact) for sharpness in (1.0, 1.0, 2.0, 2.0)]
    assert problem.asked == [asked for pair in zip(["points"] * 4, relaxed, strict=True) for asked in pair] + ["points"]
    lines = log(tmp_path / "whole")
    assert lines[-1]["best"] == -lines[-1]["best_details"]["distance"] and lines[-1]["best_point"]["on"] in (0, 1)
    moves = 3 if exact else 12
    assert np.diff([line["evaluations"] for line in lines]).tolist() == [moves, 3] * 4
    for stop in (0, 3, 4):
        run(tmp_path / f"cut{stop}", generations=stop, problem=Hill(), method=method)
        run(tmp_path / f"cut{stop}", generations=8, resume=True, problem=Hill(), method=method)
        assert products(tmp_path / f"cut{stop}") == products(tmp_path / "whole")


def test_without_a_relaxation_there_are_no_gradients(tmp_path):
    problem = Sphere()
    problem.space = Hill.space
    with pytest.raises(ValueError, match=r"^method: it wants gradients, but Sphere has no relaxation; choose another"):
        run(tmp_path / "a", problem=problem, method=GRADIENT)


class Killed(BaseException):
    """Stands for a kill: nothing in the project may catch it."""


@pytest.mark.long
def test_a_kill_at_any_write_loses_nothing(tmp_path, whole, monkeypatch):
    """Every call that touches the disk fails in turn, once before it has done its work and once after."""
    countdown = 0

    def interrupted(function):
        def call(*arguments, **options):
            nonlocal countdown
            countdown -= 1
            if countdown == 0:
                raise Killed
            result = function(*arguments, **options)
            countdown -= 1
            if countdown == 0:
                raise Killed
            return result

        return call

    for owner, name in (
        (os, "link"),
        (os, "replace"),
        (os, "fsync"),
        (os, "truncate"),
        (Path, "write_bytes"),
        (Path, "write_text"),
    ):
        monkeypatch.setattr(owner, name, interrupted(getattr(owner, name)))
    kills = 0
    while countdown <= 0:
        kills += 1
        path = tmp_path / f"killed{kills}"
        countdown = kills
        try:
            run(path)
        except Killed:
            countdown = kills  # kill the first attempt to resume as well
            try:
                run(path, resume=True)
            except Killed:
                countdown = -1
                run(path, resume=True)
            assert products(path) == products(whole), f"killed at write {kills}"
            countdown = 0
    assert kills > 50


def child(folder):
    """What the killed process of the next test does."""
    run(Path(folder), generations=40, resume=True, problem=Sphere(seconds=0.01))


@pytest.mark.long
def test_kill_9_at_random_moments(tmp_path):
    child(tmp_path / "whole")
    moments = random.Random(1)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    kills = 0
    while True:
        process = subprocess.Popen([sys.executable, __file__, tmp_path / "killed"], env=environment)
        try:
            assert process.wait(moments.uniform(0.1, 0.5 + 0.1 * kills)) == 0
            break
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
    assert kills > 0
    assert products(tmp_path / "killed") == products(tmp_path / "whole")


def spoil(path, how):
    content = path.read_bytes()
    if how == "missing":
        path.unlink()
    else:
        path.write_bytes(
            {
                "torn": content[: len(content) // 2],
                "empty": b"",
                "flipped": content[:700] + bytes([content[700] ^ 1]) + content[701:],
            }[how]
        )


@pytest.mark.parametrize("how", ["torn", "empty", "flipped", "missing"])
def test_a_spoilt_checkpoint_gives_way_to_the_one_before(tmp_path, whole, how):
    path, notes = tmp_path / "spoilt", []
    run(path, generations=2)
    spoil(path / "checkpoint.npz", how)
    run(path, resume=True, note=notes.append)
    assert products(path) == products(whole)
    assert len(notes) == 1 and "\n" not in notes[0] and "checkpoint.npz is unusable" in notes[0]
    for name in ("checkpoint.npz", "checkpoint.previous.npz"):
        unpack((path / name).read_bytes())


def test_two_spoilt_checkpoints_end_in_one_line(whole):
    spoil(whole / "checkpoint.npz", "flipped")
    spoil(whole / "checkpoint.previous.npz", "torn")
    before = {path.name: path.read_bytes() for path in whole.iterdir()}
    with pytest.raises(
        ValueError, match=r"checkpoint.npz .* and checkpoint.previous.npz .* are unusable; cannot resume"
    ):
        run(whole, resume=True)
    assert {path.name: path.read_bytes() for path in whole.iterdir()} == before


def test_a_log_that_lost_its_end_is_continued_from_what_is_left(tmp_path, whole):
    path, notes = tmp_path / "spoilt", []
    run(path, generations=2)
    log_file = path / "log.jsonl"
    log_file.write_bytes(log_file.read_bytes()[:-5])
    run(path, resume=True, note=notes.append)
    assert products(path) == products(whole)
    assert len(notes) == 1 and "checkpoint.npz is unusable (log.jsonl has 2 lines of 3)" in notes[0]


def test_lost_checkpoints_or_lines_are_noticed(whole):
    lines = (whole / "log.jsonl").read_bytes()
    cut, changed = lines[: lines.index(b"\n") + 9], lines.replace(b"1", b"2")
    for content, reason in ((cut, r"has 1 lines of \d"), (changed, "is not as it was")):
        (whole / "log.jsonl").write_bytes(content)
        with pytest.raises(ValueError, match=rf"npz \(log.jsonl {reason}.*npz \(log.jsonl .*; cannot resume"):
            run(whole, resume=True)
    (whole / "log.jsonl").write_bytes(lines)
    for name in ("checkpoint.npz", "checkpoint.previous.npz"):
        spoil(whole / name, "missing")
    with pytest.raises(ValueError, match=r"log.jsonl has 5 lines, but no checkpoint is left; cannot resume"):
        run(whole, resume=True)


def test_a_packed_state_is_a_plain_npz(tmp_path):
    arrays = {"points": np.arange(6.0).reshape(2, 3), "generation": np.array(4)}
    (tmp_path / "a.npz").write_bytes(pack(arrays))
    with np.load(tmp_path / "a.npz") as loaded:
        assert all(np.array_equal(loaded[name], arrays[name]) for name in arrays)
    with pytest.raises(ValueError, match="allow_pickle"):
        pack({"objects": np.array([None])})


def test_a_run_that_ended_before_its_first_generation_may_begin_again_otherwise(tmp_path):
    with open_run(tmp_path / "a", {**CONFIG, "generations": 9}):
        pass
    with open_run(tmp_path / "a", {**CONFIG, "generations": 2}):
        pass
    assert read_config(tmp_path / "a") == {**CONFIG, "generations": 2}


def test_designs_that_killed_are_never_overwritten(tmp_path):
    points = Sphere.space.sample(np.random.default_rng(0), 3)
    with open_run(tmp_path / "a", {**CONFIG, "generations": 2}) as folder:
        first, second = (save_failed(folder, Sphere.space, points[[i]], "killed its worker") for i in (0, 1))
        first.unlink()
        kept = second.read_bytes()
        assert save_failed(folder, Sphere.space, points[[2]], "killed its worker").name == "failed-3.json"
    assert second.read_bytes() == kept


def test_what_a_kill_left_of_any_file_is_cleared_away(tmp_path, whole, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", lambda *_, **__: None)  # a killed process removes nothing
        patch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(Killed()))
        for name in ("gait.csv", ".aside-best.json"):
            with pytest.raises(Killed):
                write_text(whole / name, "half")
    assert len([path for path in whole.iterdir() if path.name.startswith(".")]) == 3
    run(whole, resume=True)
    assert [path.name for path in whole.iterdir() if path.name.startswith(".")] == [".lock"]


def test_nothing_is_overwritten(tmp_path, whole):
    before = {path.name: path.read_bytes() for path in whole.iterdir()}
    with pytest.raises(ValueError, match="whole holds a run already; continue it with --resume or name another"):
        run(whole)
    assert {path.name: path.read_bytes() for path in whole.iterdir()} == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other/thesis.txt").touch()
    for resume in (False, True):
        with pytest.raises(ValueError, match="other holds other files and no run; name a new folder"):
            run(tmp_path / "other", resume=resume)
        with pytest.raises(ValueError, match=r"thesis.txt is a file; name a new folder"):
            run(tmp_path / "other/thesis.txt", resume=resume)
        with pytest.raises(ValueError, match="cannot be written"):
            run(tmp_path / "other/thesis.txt/below", resume=resume)
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["thesis.txt"]


def test_a_setting_that_the_method_did_not_have_then_may_be_given_as_its_default(tmp_path):
    run(tmp_path / "a")
    run(tmp_path / "a", resume=True, method={**CONFIG["method"], "bounds": "reflect"})
    assert read_config(tmp_path / "a")["method"] == CONFIG["method"]
    with pytest.raises(ValueError, match=r"^method.bounds: 'clip' is not what the run in .* has, None; leave it out$"):
        run(tmp_path / "a", resume=True, method={**CONFIG["method"], "bounds": "clip"})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"problem": {"size": 3}}, "problem.size: 3 is not what the run in .* has, 2; leave it out"),
        ({"method": {"seed": 6}}, "method.seed: 6 is not what the run in .* has, 5; leave it out"),
        (
            {"method": {"start": {"x": 1.0}}},
            "method.start: .* is not what the run in .* has, None; leave it out",
        ),
        ({"generations": 3}, "generations: 3 is below the 4 of the run in .*; it may only be raised"),
    ],
)
def test_other_settings_are_named(whole, change, message):
    before = products(whole)
    with pytest.raises(ValueError, match=message), open_run(whole, change, resume=True):
        pass
    assert products(whole) == before


def test_a_table_among_the_settings_is_given_whole_or_not_at_all(tmp_path):
    method = {**CONFIG["method"], "start": {"x": 1.0, "n": 2}}
    run(tmp_path / "a", method=method)
    message = r"^method.start: {'x': 1.0} is not what the run in .* has, {'x': 1.0, 'n': 2}; leave it out$"
    with pytest.raises(ValueError, match=message):
        run(tmp_path / "a", resume=True, method={**method, "start": {"x": 1.0}})
    run(tmp_path / "a", resume=True, method=method)


def test_settings_may_be_left_out_when_a_run_continues(whole):
    with open_run(whole, {}, resume=True) as folder:
        assert folder.config == {**CONFIG, "generations": GENERATIONS}


@pytest.mark.parametrize("content", ["generations = ", "generations = 4", 'problem = 1\nmethod = 2\ngenerations = "x"'])
def test_unreadable_settings_are_one_line(whole, content):
    (whole / "config.toml").write_text(content)
    with pytest.raises(ValueError, match=r"config\.toml") as error:
        run(whole, resume=True)
    assert "\n" not in str(error.value)


def test_two_processes_do_not_share_a_folder(whole):
    with (
        open_run(whole, {}, resume=True),
        pytest.raises(ValueError, match="whole is in use by another process"),
    ):
        run(whole, resume=True)
    run(whole, resume=True)


if __name__ == "__main__":
    child(sys.argv[1])


def test_objectives_are_told_and_change_no_checkpoint(tmp_path):
    """Names and units stand in the settings of new runs; a folder without them, as of version 1.0, goes on the same."""
    problem = Sphere()
    settings = {"climbers": 3, "seed": 5}
    config = settings_of(problem, "hill-climb", settings, 2)
    assert config["objectives"] == [{"name": "score", "unit": ""}]
    for name, content in {"new": config, "old": {k: v for k, v in config.items() if k != "objectives"}}.items():
        with open_run(tmp_path / name, content) as folder:
            run_search(problem, build_method("hill-climb", problem.space, settings), folder, 2)
    checkpoints = [unpack((tmp_path / name / "checkpoint.npz").read_bytes()) for name in ("new", "old")]
    records = [json.loads(arrays.pop("run/record").tobytes()) for arrays in checkpoints]
    assert all(records[0][name] == records[1][name] for name in ("lines", "log", "settings"))
    assert all(np.array_equal(checkpoints[0][name], checkpoints[1][name]) for name in checkpoints[0])
    with open_run(tmp_path / "old", config | {"generations": 3}, resume=True) as folder:
        run_search(problem, build_method("hill-climb", problem.space, settings), folder, 3)
    assert "objectives" not in read_config(tmp_path / "old") and len(log(tmp_path / "old")) == 4
    assert score_in(read_config(tmp_path / "new")) == Objective("score")


def test_scores_of_version_1_have_units():
    assert score_in({"problem": {}}).label == "speed [BL/s]"
    assert score_in({"problem": {"kind": "vehicle"}}).label == "score [m]"
    assert score_in({"problem": {"kind": "hopper"}}).label == "score"


def test_a_run_of_an_earlier_version_does_not_tell_where_its_robots_mesh_lay(tmp_path):
    """So the same mesh goes on; one that lies elsewhere is another robot of a run that does tell."""

    def settings(**robot):
        return {"problem": {"robot": json.dumps({"cycles": 2, **robot})}}

    check_same(settings(), settings(origin=[0.1, 0.0, 0.2]), tmp_path)
    check_same(settings(origin=[0.1, 0.0, 0.2]), settings(origin=[0.1, 0.0, 0.2]), tmp_path)
    for known, asked in (
        (settings(origin=[0.0, 0.0, 0.2]), settings(origin=[0.1, 0.0, 0.2])),
        (settings(), settings(cycles=3, origin=[0.1, 0.0, 0.2])),
        (settings(), {"problem": {"robot": "inching"}}),
    ):
        with pytest.raises(ValueError, match=r"^problem.robot: "):
            check_same(known, asked, tmp_path)


def test_a_link_to_a_folder_that_is_not_there_is_told(tmp_path):
    for name, target in (("link", "no/where"), ("loop", "loop")):
        (tmp_path / name).symlink_to(target)
        with (
            pytest.raises(ValueError, match=rf"^out: .*{name} is a link to {target}, which is not there; make that"),
            open_run(tmp_path / name, CONFIG),
        ):
            pass
