"""The gradient report on problems whose slopes are known, and on the robot through the command line."""

import json

import numpy as np
import pytest

from optim.cli import main
from optim.measures.gradient_trust import check_gradient, cosine
from optim.plots import save_gradient_check
from optim.problem import Evaluation
from optim.space import Space, Variable


class Staircase:
    """A slope on the large scale, steps of a known height on the small one, and a plane between two steps."""

    def __init__(self, height: float) -> None:
        self.height, self.space = height, Space(tuple(Variable(f"x{i}", -2.0, 2.0) for i in range(4)))
        self.slopes = np.array([1.0, -2.0, 0.5, 3.0])

    def evaluate_relaxed(self, points, sharpness, gradients):
        assert sharpness == 0.0
        rise = np.asarray(points) @ self.slopes
        stairs = self.height * np.floor(rise / 0.01 + 0.5)
        return Evaluation(rise + stairs, gradients=np.tile(self.slopes, (len(points), 1)) if gradients else None)


def test_a_smooth_problem_is_exact_at_every_step():
    report = check_gradient({"plane": (Staircase(0.0), np.full(4, 0.1))}, samples=40)
    (horizon,) = report.horizons
    assert horizon.errors.max() < 1e-6
    assert horizon.exact_cosines == pytest.approx(1)
    assert horizon.smoothed == pytest.approx(horizon.exact, abs=6 * horizon.smoothed_error.max())
    assert "exact within 1% at 1e-07, 1e-06, 1e-05, 0.0001, 0.001, 0.01, 0.05, 0.1; its" in report.verdict(horizon)


def test_stairs_are_exact_between_two_steps_only():
    """Beyond, the true slope is that of the stairs: the smoothed gradient sees it, the exact one cannot."""
    report = check_gradient({"stairs": (Staircase(0.04), np.zeros(4))}, samples=400, directions=4)
    (horizon,) = report.horizons
    good = horizon.errors <= 0.01
    assert good[:4].all() and not good[-3:].any()
    assert np.linalg.norm(horizon.smoothed) == pytest.approx(5 * np.linalg.norm(horizon.exact), rel=0.15)
    assert horizon.smoothed_cosines[-2:].min() > 0.9


def test_a_point_near_a_bound_is_refused():
    with pytest.raises(ValueError, match=r"^point: nearer to a bound of plane than the largest step, 0.1 ranges"):
        check_gradient({"plane": (Staircase(0.0), np.full(4, 1.99))})


def test_a_failed_evaluation_is_refused():
    class Failing(Staircase):
        def evaluate_relaxed(self, points, sharpness, gradients):
            return Evaluation(np.full(len(points), np.nan), ["diverged"] * len(points))

    with pytest.raises(ValueError, match=r"^plane: the evaluation of the point ended as 'diverged'; it has no"):
        check_gradient({"plane": (Failing(0.0), np.zeros(4))})


def test_cosine_of_nothing_is_no_number():
    assert np.isnan(cosine(np.zeros(2), np.ones(2)))


@pytest.mark.long
def test_the_plot_shows_every_horizon(tmp_path):
    report = check_gradient({n: (Staircase(h), np.zeros(4)) for n, h in (("a", 0.0), ("b", 0.04))}, samples=10)
    save_gradient_check(report, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    assert "a " in report.text() and "b " in report.text()


@pytest.mark.kernels
def test_the_command_checks_the_robot(tmp_path, capsys, monkeypatch):
    """One short column of a tiny robot: exact at the smallest steps."""
    from robots import inflatable
    from robots.inflatable import InflatableActuation, InflatableGeometry

    tiny = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
    quick = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=100, settle_steps=100)
    monkeypatch.setitem(inflatable.NAMED_GEOMETRIES, "small", tiny)
    monkeypatch.setattr("optim.problems.inflatable.problem.RAMP_STEPS", 100)
    monkeypatch.setattr("optim.problems.inflatable.problem.GaitProblem.actuation", quick)
    asked = ["--geometry", "small", "--horizons", "1,2", "--samples", "4", "--directions", "2", "--quiet"]
    out = tmp_path / "check"
    assert main(["gradient-check", *asked, "--json", "--out", str(out)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [h["name"] for h in document["horizons"]] == ["1 column", "2 columns"]
    assert document["horizons"][0]["errors"][0] < 1e-3
    assert json.loads((out / "gradient.json").read_text()) == document
    assert (out / "gradient.png").exists()


@pytest.mark.parametrize("text", ["0", "9", "12", "two"])
def test_horizons_that_the_gait_lacks_are_refused(text, capsys):
    assert main(["gradient-check", "--horizons", text]) == 2
    assert "horizons: " in capsys.readouterr().err


@pytest.mark.slow
def test_the_smoothed_gradient_of_a_whole_evaluation():
    """16 columns of the small robot, between inching and indecision: it agrees with differences of its own step."""
    from optim.commands.gradient_check import inside
    from optim.problems.designer import designer_of
    from robots.robot import KINDS

    found = designer_of(KINDS["inflatable"]).horizons("inching", {"geometry": "small"}, [16])
    problems = {name: (problem, inside(problem, point)) for name, (problem, point) in found.items()}
    report = check_gradient(problems, steps=(0.05, 0.1), directions=6, samples=48)
    assert report.horizons[0].smoothed_cosines.max() >= 0.9
