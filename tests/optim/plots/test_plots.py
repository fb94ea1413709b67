"""Drawings on axes: that they show the numbers they are given."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

from optim.plots import (
    add_bar,
    draw_best,
    draw_curves,
    draw_elites,
    draw_front,
    draw_overlap,
    draw_paths,
    draw_run,
    draw_share_solved,
    save_curves,
)
from optim.runs import Generation
from optim.runs.comparison import Curve
from optim.search.method import Grid


@pytest.fixture
def axes():
    return Figure().add_subplot()


def generation(number, best, mean, scores=None, **details):
    return Generation(number, 3 * number + 3, 0, best, mean, mean, scores, {}, details or None, {})


RUN = [
    generation(0, None, None, [None, None], flat=np.nan),
    generation(1, 0.25, 0.125, [0.25, 0.0], flat=0.5, hill=0.0),
    generation(2, 0.75, 0.5, [0.25, 0.75], flat=0.5, hill=1.0),
]


def values(line):
    return [None if np.isnan(value) else value for value in np.asarray(line.get_ydata(), float)]


def test_a_run_has_a_line_for_the_best_the_mean_and_every_climber(axes):
    draw_run(axes, RUN)
    *climbers, mean, best = axes.lines
    assert values(best) == [None, 0.25, 0.75] and values(mean) == [None, 0.125, 0.5]
    assert [values(line) for line in climbers] == [[None, 0.25, 0.25], [None, 0.0, 0.75]]
    assert all(list(line.get_xdata()) == [0, 1, 2] for line in axes.lines)
    assert (best.get_label(), mean.get_label()) == ("best", "mean of the climbers")


def test_a_population_has_no_climbers_and_a_single_generation_is_seen(axes):
    draw_run(axes, [generation(0, 0.5, 0.25)])
    mean, best = axes.lines
    assert mean.get_label() == "mean of what the search keeps" and values(best) == [0.5]
    assert best.get_marker() == mean.get_marker() == "o"


def test_details_of_the_best_design_are_missing_where_it_is(axes):
    draw_best(axes, RUN, {"flat": "on flat ground", "hill": "uphill"})
    assert [values(line) for line in axes.lines] == [[None, 0.5, 0.5], [None, 0.0, 1.0]]
    assert [line.get_label() for line in axes.lines] == ["on flat ground", "uphill"]


def test_a_group_has_its_mean_between_the_ends_of_its_band(axes):
    curve = Curve("climb", ("a", "b"), "runs", np.array([1.0, 2.0]), np.array([[0.0, 1.0], [0.5, 2.0]]))
    draw_curves(axes, [curve], "seconds")
    *units, mean = axes.lines
    assert values(mean) == [0.25, 1.5] and [values(line) for line in units] == [[0.0, 1.0], [0.5, 2.0]]
    (band,) = axes.collections
    ends = band.get_datalim(axes.transData).get_points()[:, 1]
    half = stats.t.isf(0.025, 1) * 0.5  # of 0.5 and 2, by Student's t; axes show all units, and as much around them
    assert ends == pytest.approx([1.5 - half, 1.5 + half]) and axes.get_ylim() == (-2.0, 4.0)
    assert axes.get_xlabel() == "time [s]"


def test_the_share_of_trials_rises_where_one_is_solved(axes):
    draw_share_solved(axes, [30, 10], 4, 100, color="black", label="nes")
    (line,) = axes.lines
    assert list(line.get_xdata()) == [0, 10, 30, 100] and values(line) == [0, 0.25, 0.5, 0.5]


FRONT = np.array([[1.0, 3.0], [2.0, 2.0], [0.5, 0.5], [3.0, 1.0], [np.nan, np.nan]])


def test_a_front_of_two_is_a_staircase_below_which_all_is_dominated(axes):
    assert draw_front(axes, FRONT, ("flat", "hill"), best=1) is None
    stairs, *_, best = axes.lines
    assert np.array_equal(stairs.get_xydata(), [[1, 3], [2, 2], [3, 1]]) and stairs.get_drawstyle() == "steps-pre"
    assert np.array_equal(best.get_xydata(), [[2, 2]])
    assert np.array_equal(axes.collections[0].get_offsets().compressed(), [0.5, 0.5])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("flat", "hill")


def test_a_third_objective_is_a_colour(axes):
    three = np.column_stack([FRONT, [0.0, 5.0, 0.0, 9.0, np.nan]])
    shown = draw_front(axes, three, ("a", "b", "c"))
    assert shown.get_array().tolist() == [0, 5, 9] and shown.get_offsets().tolist() == FRONT[[0, 1, 3]].tolist()
    add_bar(axes.figure, axes, shown, "c")
    assert axes.figure.axes[1].get_ylabel() == "c"


@pytest.mark.parametrize(
    ("objectives", "names", "message"),
    [
        (np.ones((3, 4)), "abcd", r"^objectives: shape \(3, 4\) with 4 names is not allowed; give 2 or 3 of each$"),
        (np.ones((3, 2)), "a", r"^objectives: shape \(3, 2\) with 1 names is not allowed"),
        (np.full((3, 2), np.nan), "ab", "^objectives: no design has succeeded; give at least one that did$"),
    ],
)
def test_what_is_no_front_is_one_line(axes, objectives, names, message):
    with pytest.raises(ValueError, match=message):
        draw_front(axes, objectives, tuple(names))


def test_elites_lie_at_their_descriptors(axes):
    """Of more than two, a cell shows its best elite."""
    grid = Grid({"orientation": (0.0, 90.0), "pressure": (0.0, 4.0)}, 3, np.array([1, 6]))
    shown = draw_elites(axes, grid, [0.5, 0.25])
    expected = np.full((3, 3), np.nan)  # rows are pressures
    expected[1, 0], expected[0, 2] = 0.5, 0.25
    assert np.array_equal(shown.get_array().filled(np.nan), expected, equal_nan=True)
    assert axes.get_xlabel() == "orientation" and axes.get_xlim() == (0.0, 90.0) and axes.get_ylim() == (0.0, 4.0)
    grid = Grid({"a": (0.0, 1.0), "b": (0.0, 1.0), "c": (0.0, 1.0)}, 2, np.array([0, 1, 7]))
    shown = draw_elites(axes, grid, [0.5, 0.75, 0.25]).get_array()
    assert shown[0, 0] == 0.75 and shown[1, 1] == 0.25


def test_success_matrices_have_w1_to_the_right_and_w2_upwards(axes):
    overlap = np.zeros((3, 3), np.uint8)
    overlap[2, 0] = 4  # w1 = 1, w2 = -1
    image = draw_overlap(axes, overlap, np.array([1.0, -1.0]))
    assert image.get_array()[0, 2] == 4 and image.get_array().sum() == 4 and image.origin == "lower"
    assert image.get_extent() == [-1.5, 1.5, -1.5, 1.5] and np.array_equal(axes.lines[0].get_xydata(), [[1, -1]])


def test_paths_begin_at_dots_and_may_end_early(axes):
    paths = np.array([[[1.0, 0.0], [0.5, 0.0]], [[0.0, -2.0], [np.nan, np.nan]]])
    draw_paths(axes, paths, [[0.0, 0.0]])
    starts = [line.get_xydata()[0].tolist() for line in axes.lines if line.get_marker() == "o"]
    assert starts == [[1, 0], [0, -2]] and axes.get_xlim() == pytest.approx((-2.2, 2.2))
    assert [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "*"] == [[[0, 0]]]


def test_a_label_that_is_no_utf_8_is_drawn_as_escapes(tmp_path):
    """As one of ``compare --names`` may be."""
    curve = Curve("a\udcff", ("a",), "climbers", np.arange(3.0), np.ones((2, 3)))
    save_curves([curve], "evaluations", tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 1000
