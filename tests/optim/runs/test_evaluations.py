"""Every design that a run has evaluated: what is kept, what a kill leaves, and what is damaged."""

import json

import numpy as np
import pytest

import morpholab as ml
from optim.problem import Evaluation
from optim.runs import open_run, run_search
from optim.runs.evaluations import EVALUATIONS
from optim.search import build_method
from optim.space import Space, Variable


class Hill:
    """A hill of two objectives, with a measure that not all points have, and points that fail."""

    space = Space((Variable("x", -1.0, 1.0), Variable("speed", 0.0, 3.0), Variable("status", 0.0, 1.0)))
    objective_names = ("speed", "height")

    def describe(self):
        return {"hill": 1}

    def evaluate(self, points):
        scores = np.column_stack([points[:, 1], -(points[:, 0] ** 2)])
        scores[points[:, 0] > 0.3] = np.nan
        named = {"side": np.where(points[:, 0] < 0, "left", "right"), "speed": 2 * points[:, 1]}
        return Evaluation(scores, details=named | {"track": np.zeros((len(points), 3))})

    def save(self, point, path):
        path.write_text("{}")


def searched(folder, generations, resume=False, keep=False):
    settings = {"population": 8, "seed": 3}
    config = {"problem": Hill().describe(), "method": {"name": "nsga2", **settings}, "generations": generations}
    with open_run(folder, config, resume=resume) as run:
        run_search(Hill(), build_method("nsga2", Hill.space, settings), run, generations, keep_evaluations=keep)


def test_all_designs_are_columns(tmp_path):
    searched(tmp_path / "run", 4, keep=True)
    found = ml.evaluations(tmp_path / "run")
    names = (
        "generation",
        "wants",
        "sharpness",
        "partly",
        "x",
        "speed",
        "speed (measured)",
        "height",
        "status",
        "status (variable)",
        "side",
    )
    assert set(found) == set(names) and {len(column) for column in found.values()} == {40}
    assert found["generation"].tolist() == np.repeat(range(5), 8).tolist() and set(found["wants"]) == {"points"}
    ok = found["status"] == "ok"
    assert np.array_equal(ok, found["x"] <= 0.3) and np.isnan(found["height"][~ok]).all() and 0 < ok.sum() < 40
    assert np.array_equal(found["height"][ok], -(found["x"][ok] ** 2))
    assert np.array_equal(found["speed (measured)"][ok], found["speed"][ok])  # the objective, not the detail
    assert np.array_equal(found["side"] == "left", found["x"] < 0)


def test_a_run_that_goes_on_has_the_same_file(tmp_path):
    searched(tmp_path / "whole", 4, keep=True)
    searched(tmp_path / "cut", 2, keep=True)
    path = tmp_path / "cut" / EVALUATIONS
    path.write_text(
        path.read_text() + '{"generation": 3, "wants": "points"}\n{"generation": 4, "wa'
    )  # a kill left this
    searched(tmp_path / "cut", 4, resume=True)
    assert path.read_bytes() == (tmp_path / "whole" / EVALUATIONS).read_bytes()


def test_a_first_line_that_a_kill_cut_off_is_written_again(tmp_path):
    searched(tmp_path / "whole", 1, keep=True)
    (tmp_path / "cut").mkdir()
    searched(tmp_path / "cut", 0)
    (tmp_path / "cut" / EVALUATIONS).write_text('{"format": "morph')
    searched(tmp_path / "cut", 1, resume=True)
    lines = (tmp_path / "cut" / EVALUATIONS).read_text().splitlines()
    whole = (tmp_path / "whole" / EVALUATIONS).read_text().splitlines()
    assert lines == [whole[0], whole[2]]  # what came before it was kept is not there
    assert set(ml.evaluations(tmp_path / "cut")["generation"]) == {1}


def test_a_run_without_the_file_says_how_to_keep_it(tmp_path):
    searched(tmp_path / "run", 1)
    with pytest.raises(ValueError, match=r"evaluations.jsonl: is not there; start the run with --evaluations, which"):
        ml.evaluations(tmp_path / "run")


def test_a_file_of_another_run_is_refused(tmp_path):
    searched(tmp_path / "run", 1, keep=True)
    (tmp_path / "run" / EVALUATIONS).write_text("garbage\n")
    with pytest.raises(
        ValueError, match=r"evaluations.jsonl: line 1: b'garbage.*' is not of this run; remove the file"
    ):
        searched(tmp_path / "run", 2, resume=True)


def test_what_is_empty_or_no_file_is_told(tmp_path):
    searched(tmp_path / "run", 0, keep=True)
    path = tmp_path / "run" / EVALUATIONS
    path.write_text(path.read_text().splitlines()[0] + "\n")
    assert {name: len(column) for name, column in ml.evaluations(tmp_path / "run").items()}["height"] == 0
    path.write_text("")
    with pytest.raises(ValueError, match=r"evaluations.jsonl: is empty; its first line names the variables"):
        ml.evaluations(tmp_path / "run")
    path.unlink()
    path.mkdir()
    with pytest.raises(ValueError, match=r"evaluations.jsonl: cannot be read"):
        ml.evaluations(tmp_path / "run")


@pytest.mark.parametrize(
    ("line", "change", "told"),
    [
        (0, {"variables": ["x", "x"]}, r"line 1: variables: \['x', 'x'\] are not allowed; give each name once"),
        (0, {"format": "other"}, r"line 1: format: 'other' is not allowed; it is 'morpholab evaluations 1'"),
        (0, {"variables": ["x"]}, r"line 2: points: 8 rows of 1 numbers are needed"),
        (2, {"points": [[0.0, 1.0, 0.0]]}, r"line 3: objectives: 1 rows of 2 numbers are needed"),
        (2, {"objectives": [["a", 1.0]] * 8}, r"line 3: objectives"),
        (1, {"status": ["ok"]}, r"line 2: status: 1 values are not allowed for 8 designs"),
        (1, {"generation": -1}, r"line 2: generation: -1 is not allowed"),
        (1, {"details": {"side": [{}] * 8}}, r"line 2: details: .* is not allowed"),
    ],
)
def test_damage_is_named_by_line_and_field(tmp_path, line, change, told):
    searched(tmp_path / "run", 2, keep=True)
    path = tmp_path / "run" / EVALUATIONS
    lines = [json.loads(each) for each in path.read_text().splitlines()]
    lines[line] |= change
    path.write_text("".join(json.dumps(each) + "\n" for each in lines))
    with pytest.raises(ValueError, match=told):
        ml.evaluations(tmp_path / "run")


@pytest.mark.kernels
def test_codesign_keeps_them_when_asked(morpholab, tmp_path):
    line = "codesign --robot vehicle --method gradient --climbers 2 --generations 1 --threads 1 --quiet --out"
    assert morpholab(f"{line} kept --evaluations")[0] == morpholab(f"{line} plain")[0] == 0
    assert not (tmp_path / "plain" / EVALUATIONS).exists()
    found = ml.evaluations(tmp_path / "kept")
    assert len(found["status"]) == 4 and "gradients" in set(found["wants"])
