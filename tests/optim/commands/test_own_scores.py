"""What functions of a user's own return: numbers that are not usual, other things, and what commands say of them."""

import json

import pytest

OWN = """
import numpy as np
from optim import Evaluation, Problem, Space, Variable


class Own(Problem):
    space = Space((Variable("x", 0.0, 1.0, step=0.1), Variable("y", 0.0, 1.0, step=0.1)))
    objective_names, objective_units = ("far",), ("m",)

    def evaluate(self, points):
        x, y = np.asarray(points).T
        return {returned}


problem = Own()
"""
SHORT = "--climbers 6 --generations 3 --quiet"


@pytest.fixture
def searched(tmp_path, morpholab):
    """A function that searches with what an evaluation returns; its exit code, output and error."""

    def search(returned, options=SHORT):
        (tmp_path / "own.py").write_text(OWN.replace("{returned}", returned))
        return morpholab(f"codesign --problem own.py --out a {options}")

    return search


def best_details(folder):
    return json.loads((folder / "log.jsonl").read_text().splitlines()[-1])["best_details"]


@pytest.mark.parametrize(
    ("detail", "told", "workers"),
    [
        ("x * np.nan", None, ""),
        ("np.full(len(x), -np.inf)", None, ""),
        ("np.column_stack([x * 0, x * np.inf])", [0.0, None], "--workers 1"),
        ("['a'] * len(x)", "a", ""),
        ("np.array(['a'] * len(x), object)", "a", "--workers 1"),
        ("x.astype(np.longdouble) * 0", 0.0, "--workers 1"),
        ("np.full(len(x), 2**62)", 2**62, ""),
        ("[True] * len(x)", True, ""),
    ],
)
def test_details_are_logged_as_json_has_them(tmp_path, morpholab, searched, detail, told, workers):
    with_detail = f"Evaluation(x, details={{'d': {detail}}})"
    code, _, error = searched(with_detail, f"{SHORT} {workers}")
    assert code == 0 and "bug" not in error
    assert best_details(tmp_path / "a") == {"d": told}
    assert morpholab("status a")[0] == morpholab("compare a")[0] == 0
    assert morpholab("report a --out a.html --quiet")[::2] == (0, "")


@pytest.mark.parametrize(
    ("details", "told"),
    [
        ("{'d': x * 1j}", "details: d is of type complex128, which is not allowed; give numbers or text"),
        ("{'d': [10**400] * len(x)}", "details: d is of type object, which is not allowed; give numbers or text"),
        ("{'d': [None] * len(x)}", "details: d is of type object, which is not allowed; give numbers or text"),
        ("{'d': [list(range(n)) for n in range(len(x))]}", "details: d has rows of different lengths; give equal ones"),
        ("{'d': 3.0}", "details: d is a single value; give one for each point"),
        ("{3: x}", "details: the name 3 is not allowed; give text"),
    ],
)
def test_other_details_are_refused_in_a_line(searched, details, told):
    code, _, error = searched(f"Evaluation(x, details={details})")
    assert (code, error) == (1, f"morpholab codesign: failed: own.py, line 12: ValueError: {told}\n")


@pytest.mark.parametrize("workers", ["", "--workers 1"])
@pytest.mark.parametrize(
    ("returned", "told"),
    [
        ("None", "evaluate: it gave NoneType, which is not allowed; give an optim.Evaluation"),
        ("x", "evaluate: it gave ndarray, which is not allowed; give an optim.Evaluation"),
        ("Evaluation(x[1:])", "evaluate: it gave objectives of shape (5, 1) for 6 points; give (6, 1)"),
        ("Evaluation(points)", "evaluate: it gave objectives of shape (6, 2) for 6 points; give (6, 1)"),
    ],
)
def test_what_is_no_evaluation_of_the_points_is_refused_in_a_line(searched, returned, told, workers):
    code, _, error = searched(returned, f"{SHORT} {workers}")
    assert (code, error) == (2, f"morpholab codesign: error: {told}\n")


@pytest.mark.parametrize("returned", ["Evaluation(2 * (x - 0.5) * 1.7e308)", "Evaluation(x * -1.7e308)"])
def test_vast_scores_are_reported_in_few_digits(tmp_path, morpholab, searched, returned):
    code, out, error = searched(returned)
    assert code == 0 and error == "" and "e+30" in out and len(out) < 100
    assert len(morpholab("status a")[1]) < 200
    code, _, error = morpholab("report a --out a.html --quiet")
    page = (tmp_path / "a.html").read_text()
    assert (code, error) == (0, "") and "what is beyond 1e+300 is not drawn" in page and "000,000" not in page


def test_a_map_of_vast_elites_is_reported(tmp_path, morpholab, searched):
    assert searched("Evaluation(2 * (x - 0.5) * 1.7e308)", "--method map-elites --generations 2 --quiet")[0] == 0
    assert morpholab("report a --out a.html --quiet")[::2] == (0, "")
    assert "what is beyond 1e+300 is not drawn" in (tmp_path / "a.html").read_text()


def test_a_front_of_vast_objectives_is_reported(tmp_path, morpholab):
    own = OWN.replace('("far",), ("m",)', '("far", "near"), ("m", "m")')
    (tmp_path / "own.py").write_text(own.replace("{returned}", "Evaluation(np.column_stack([x, 0.5 - x]) * 1.7e307)"))
    options = "--method nsga2 --population 8 --generations 2 --quiet"
    assert morpholab(f"codesign --problem own.py {options} --out a")[0] == 0
    assert morpholab("report a --out a.html --quiet")[::2] == (0, "")
