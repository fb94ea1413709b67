"""What sensors' places do: distributions, controllers that succeed, paths, persistence, pictures."""

import csv
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.figures import figure, legend_above, logarithmic
from optim.studies.chapter3 import sensor_placement as study
from optim.studies.chapter3.sweep_study import STUDY, save_figures
from optim.studies.chapter3.sweep_table import SweepTable, read_sweep_table
from optim.studies.chapter4.training import TrainingTable, save_training
from robots.braitenberg import PUBLISHED, Sweep, VehicleBody, simulate, sweep

TABLE = SweepTable(np.array([80, 162, 5841, 6553]), np.array([9, 9, 0, 2]), np.array([12, 12, 8, 8]), Sweep(weights=9))
BEST, BASELINE = VehicleBody.published(162), VehicleBody.published(6553)


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_distributions_count_every_body():
    counts, edges = study.distribution([0.0, 0.0, 0.01, 0.05, 0.1], bins=10)
    assert counts.tolist() == [2, 1, 0, 0, 0, 1, 0, 0, 0, 1] and edges[[0, -1]].tolist() == [0.0, 0.1]
    assert study.distribution([0.1], most=0.5)[1][-1] == 0.5
    assert study.distribution(np.zeros(3))[0][0] == 3


def test_metrics_are_correlated_over_bodies():
    found = study.correlation_of_metrics(TABLE)
    assert found.n == 4
    assert found.r == pytest.approx(np.corrcoef([9, 9, 0, 2], [0.75, 0.75, 0, 0.25])[0, 1])


def test_notable_bodies_are_named_once_and_the_first_of_equals_wins():
    assert study.notable_designs(TABLE) == {6553: "baseline", 80: "best M_L, best M_CI"}
    other = SweepTable(np.array([1, 2]), np.array([5, 4]), np.array([50, 8]), Sweep(weights=9))
    assert study.notable_designs(other) == {1: "best M_L", 2: "best M_CI"}


def test_the_central_controller_has_most_of_its_kind_around_it():
    overlap = np.full((11, 11), 3, np.uint8)
    overlap[1:6, 4:9] = 4
    overlap[9, 9] = 4
    assert study.central_controller(overlap) == pytest.approx([-0.4, 0.2])
    assert study.central_controller(np.full((11, 11), 3, np.uint8)) is None
    assert study.central_controller(np.full((11, 11), 4, np.uint8)) == pytest.approx([0.0, 0.0])
    weights = study.solving_controllers(overlap)
    assert weights.shape == (26, 2) and weights[0] == pytest.approx([-0.8, -0.2]) and weights[-1] == pytest.approx(0.8)


@pytest.mark.kernels
def test_controllers_of_the_best_body_stay_and_those_of_the_baseline_leave():
    """Weights with which chapter 3 shows them: there (0.6, 0.98) passes through the light, and leaves."""
    wide = replace(PUBLISHED, radius=0.2)
    stays = study.persistent(BEST, [[-0.8, 0.6], [-1.0, 1.0]], wide)
    assert stays.shape == (2, 4) and stays.all()
    assert not study.persistent(BASELINE, [[0.6, 0.98]], wide).any()
    assert simulate([BASELINE], [[[[0.6, 0], [0, 0.98]]]], wide).reached.all()
    assert study.persistent(BASELINE, [[0.6, 0.98]], wide, near=100.0).all()
    assert not study.persistent(BEST, [[0.0, 0.0]], wide, near=100.0).any()  # never there


@pytest.mark.kernels
def test_persistence_counts_from_the_arrival(monkeypatch):
    """Late is not too late; a sample beyond the distance afterwards is."""
    weights = [[-0.8, 0.6]]
    arrival = simulate([BEST], [[[[-0.8, 0], [0, 0.6]]]]).arrival[0, 0]
    places = np.full((1, 4, 2001, 2), 3.0)
    for environment, steps in enumerate(arrival):
        places[0, environment, -(-steps // study.EVERY) :] = 0.1
    places[0, 2, -1] = 0.4
    monkeypatch.setattr(study, "paths", lambda *_: places)
    assert study.persistent(BEST, weights, PUBLISHED).tolist() == [[True, True, False, True]]
    monkeypatch.setattr(study, "AT_ONCE", 1)
    assert study.persistent(BEST, weights * 3, PUBLISHED).tolist() == [[True, True, False, True]] * 3


@pytest.mark.kernels
def test_pictures_have_their_numbers_beside_them(tmp_path):
    settings = {"weights": 15, "r": 0.5, "dt": 0.2, "steps": 2000}
    sweep([BEST, BASELINE], **settings, out=tmp_path / "sweep")
    table = read_sweep_table(tmp_path / "sweep")
    names = ["distributions.png", "correlation.png", "bodies.png", "landscape.png", "examples.png"]
    assert save_figures(table, tmp_path / "sweep", tmp_path) == names
    for name in names:
        assert matplotlib.image.imread(tmp_path / name).std() > 0.05
    bins = rows_of(tmp_path / "distributions.csv")
    for metric in table.metrics:
        assert sum(int(row["bodies"]) for row in bins if row["metric"] == metric) == len(table.designs)
    assert len(rows_of(tmp_path / "correlation.csv")) == len(table.designs)
    numbers, rows = np.load(tmp_path / "examples.npz"), rows_of(tmp_path / "examples.csv")
    assert {row["name"]: int(row["design"]) for row in rows} == study.best_bodies(table)
    for row in rows:
        overlap = numbers[f"overlap_{row['design']}"]
        assert int(row["persistent"]) <= int(row["all"]) == (overlap == 4).sum()
        first, second = np.rint((numbers[f"weights_{row['design']}"] + 1) * 7).astype(int)
        assert overlap[first, second] == 4
        assert numbers[f"paths_{row['design']}"].shape[::2] == (4, 2)
        assert numbers[f"persistent_{row['design']}"] == int(row["persistent"])


def test_the_picture_of_training_has_the_mean_of_every_body(tmp_path):
    evaluations = np.array([[[10, 20], [30, 50], [500, 500], [100, 400]]] * 2)
    table = TrainingTable(("random", "nes"), TABLE.designs, evaluations, evaluations < 500)
    for name in ("a.png", "b.png"):
        save_training(table, TABLE, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    rows = rows_of(tmp_path / "a.csv")
    assert [float(row["nes"]) for row in rows] == [15, 40, 500, 250]
    assert [float(row["M_CI"]) for row in rows] == [0.75, 0.75, 0, 0.25]


@pytest.mark.long
def test_complete_sweeps_are_told_from_their_tables(tmp_path):
    data = Path(__file__).parents[3] / "docs/data"
    STUDY.rewrite(Data(data), tmp_path)
    for name, part, r in (
        ("vehicle-sweep.csv.gz", "", 0.958),
        ("vehicle-sweep-radius-0.2.csv.gz", "radius-0.2", 0.971),
    ):
        whole, told = read_sweep_table(data / name), read_sweep_table(tmp_path / part / "table.csv")
        assert len(told.designs) == 6561 and study.correlation_of_metrics(told).r == pytest.approx(r, abs=5e-4)
        for column in ("designs", "solving_all", "solving_any"):
            assert np.array_equal(getattr(told, column), getattr(whole, column))


def test_pictures_that_cannot_be_written_are_one_line(tmp_path):
    for path, message in ((tmp_path / "a.bmp", "is no picture"), (tmp_path / "no/a.png", "cannot be written")):
        with pytest.raises(ValueError, match=message), figure(path, 2, 2):
            pass


def test_a_legend_above_hides_no_panel_and_logarithmic_axes_have_plain_numbers(tmp_path):
    with figure(tmp_path / "a.png", 4, 2, ncols=2) as (drawn, panels):
        lines = [panels[0, 0].plot([1, 2], [0.02, 0.9], label=name)[0] for name in ("one", "another")]
        legend_above(drawn, lines)
        logarithmic(panels[0, 0], "y")
        logarithmic(panels[0, 0], "x", [1.0, 1.5, 2.0])
    box, shown = drawn.legends[0].get_window_extent(), drawn.transFigure
    assert all(axes.get_tightbbox().y1 <= box.y0 for axes in panels.flat) and box.y1 <= shown.transform((1, 1))[1]
    low, high = panels[0, 0].get_ylim()
    marks = {text.get_text() for text in panels[0, 0].get_yticklabels() if low <= text.get_position()[1] <= high}
    assert marks == {"0.02", "0.05", "0.1", "0.2", "0.5", "1"}
    assert [text.get_text() for text in panels[0, 0].get_xticklabels()] == ["1", "1.5", "2"]
