"""What problems say of their objectives, and what a class of one's own need not say."""

import json

import numpy as np
import pytest

from optim import maximise
from optim.problem import Evaluation, Objective, Problem, objectives_of, score_of
from optim.space import Space, Variable
from robots.robot import Measure


class Plain(Problem):
    """As little as a problem may be."""

    space = Space((Variable("x", 0.0, 1.0), Variable("n", 0, 3, "integer")))

    def evaluate(self, points):
        return Evaluation(np.asarray(points).sum(axis=1))


def test_a_problem_needs_only_a_space_and_a_judgement(tmp_path):
    problem = Plain()
    assert objectives_of(problem) == (Objective("objective"),)
    assert problem.describe() == {"kind": "Plain"}
    problem.save([0.5, 2], tmp_path / "best.json")
    assert json.loads((tmp_path / "best.json").read_text()) == {"x": 0.5, "n": 2}


def test_problems_of_version_1_had_no_units():
    class Old:
        objective_names = ("far", "light")

    assert objectives_of(Old()) == (Objective("far"), Objective("light"))


def test_units_and_names_must_match():
    class Wrong(Plain):
        objective_names = ("far", "light")
        objective_units = ("m",)

    with pytest.raises(ValueError, match="shorter"):
        objectives_of(Wrong())


def test_labels_values_and_the_score():
    speed, energy = Objective("speed_flat", "m/s"), Objective("energy")
    assert speed.label == "speed flat [m/s]" and energy.label == "energy"
    assert speed.value(0.123456) == "0.1235 m/s" and energy.value(2.0) == "2.0000" and speed.value(None) == "none"
    assert speed.value(-1e-13) == "0.0000 m/s" and Measure("speed", "m/s").value(-1e-13) == "speed 0.0000 m/s"
    assert speed.value(-1e-9) == "-1e-09 m/s" and Measure("speed", "m/s").value(1e-9) == "speed 1e-09 m/s"
    assert score_of([speed]) is speed
    assert score_of([speed, Objective("up", "m/s")]) == Objective("mean objective", "m/s")
    assert score_of([speed, energy]) == Objective("mean objective")


def test_complex_scores_and_slopes_are_refused():
    with pytest.raises(ValueError, match=r"^objectives: \(1\+2j\) is not allowed; give real numbers$"):
        Evaluation(np.array([1 + 2j, 3]))
    with pytest.raises(ValueError, match=r"^objectives: 2j is not allowed; give real numbers$"):
        Evaluation([1.0, 2j])
    with pytest.raises(ValueError, match=r"^objectives: 2j is not allowed; give real numbers$"):
        Evaluation(np.array([[1.0, 2j]], object))
    with pytest.raises(ValueError, match=r"^gradients: \(3\+0j\) is not allowed; give real numbers$"):
        Evaluation([1.0], gradients=np.array([[3 + 0j]]))
    with pytest.raises(ValueError, match=r"^function: 2j is not allowed; give real numbers$"):
        maximise(lambda points: points[:, 0] * 0 + 2j, bounds={"x": (2, 3)}, generations=1)
