"""M1 to M4 against small cases by hand, and what becomes of them on their way into tables."""

import re

import numpy as np
import pytest

from optim.experiments.tables import select
from optim.measures.catastrophic_interference import (
    MeanOfRuns,
    RunMeasures,
    SeveralRuns,
    angles,
    avoids_interference,
    changes_of,
    last_kept,
    lengths,
    measure_run,
    measure_run_as_computed,
)
from optim.studies.chapter2.champions import Champions, time_near, typical
from optim.studies.chapter2.curves import curve, mutations
from optim.studies.chapter2.likeness import asymmetry, divergence, turned, warping, write_likeness
from optim.studies.chapter2.settings import Treatment, treatments
from optim.studies.chapter2.tables import cells_of, compare_cells, rows_of, summarise, write_tables
from robots.quadruped import ENVIRONMENTS, TWO_ENVIRONMENTS

# Two climbers: the first comes to (5, 5) by way of (6, 8); the second to (1, 6).
CLIMBER = [0, 1, 0, 1, 0]
DISTANCE = [[9, 9], [9, 9], [6, 8], [1, 6], [5, 5]]


def test_changes_are_positive_where_a_robot_comes_nearer():
    assert changes_of([[9, 9], [6, 10], [6, 8]]).tolist() == [[3, -1], [0, 2]]
    assert changes_of([[np.nan, 9], [6, 8], [5, 8]]).tolist() == [[1, 0]]
    assert changes_of([[9, 9]]).shape == (0, 2)


def test_angles_are_from_the_diagonal_in_any_number_of_environments():
    assert angles([[1, 1], [1, 0], [1, -1], [-2, -2]]) == pytest.approx([0, 45, 90, 180])
    assert angles([[1, 1, 1, 1], [3, 0, 0, 0], [1, 1, -1, -1]]) == pytest.approx([0, 60, 90])
    assert angles([[1, 0, 0]]) == pytest.approx([np.degrees(np.arccos(1 / np.sqrt(3)))])
    assert np.isnan(angles([[0, 0]])).all() and angles(np.empty((0, 2))).shape == (0,)


def test_lengths_and_the_first_quadrant():
    assert lengths([[3, 4], [1, 0]]).tolist() == [5, 1]
    assert avoids_interference([[3, 4], [1, 0], [5, -1], [0.1, 0.1]]).tolist() == [True, False, False, True]
    assert avoids_interference([[1, 1, 1, 1], [1, 1, 1, -1]]).tolist() == [True, False]


def test_the_champion_has_the_smallest_worst_distance_and_its_line_counts():
    found = measure_run(CLIMBER, DISTANCE)
    assert (found.champion, found.worst, found.changes) == (0, 5, 2)
    first, second = np.degrees(np.arccos(4 / np.sqrt(20))), np.degrees(np.arccos(4 / np.sqrt(20)))
    assert found.angle == pytest.approx((first + second) / 2)  # changes (3, 1) and (1, 3)
    assert found.length == pytest.approx(np.sqrt(10)) and found.share == 1


def test_only_what_climbers_have_in_the_end_makes_champions():
    """As defined; as computed, the line is that of the best worst distance of all times."""
    climber, distance = [0, 1, 0, 1, 0], [[9, 9], [9, 9], [4, 4], [6, 8], [1, 8.5]]
    assert last_kept(climber).tolist() == [4, 3]
    found = measure_run(climber, distance)
    assert (found.champion, found.worst, found.changes) == (1, 8, 1)
    assert found.angle == pytest.approx(np.degrees(np.arccos(4 / np.sqrt(20))))
    computed = measure_run_as_computed(climber, distance)
    assert (computed.champion, computed.worst) == (0, 8.5)  # the smallest sum
    assert (computed.changes, computed.angle, computed.length) == (1, 0, pytest.approx(5 * np.sqrt(2)))


def test_as_computed_steps_count_that_change_the_worst_distance():
    climber, distance = [0, 0, 0, 0], [[9, 9], [7, 9], [8, 4], [6, 4]]
    assert measure_run(climber, distance).changes == 3
    found = measure_run_as_computed(climber, distance)
    assert found.changes == 2
    assert found.length == pytest.approx((np.hypot(-1, 5) + 2) / 2) and found.share == 0
    apparent = measure_run_as_computed(climber, distance, [[9, 9], [8, 8], [7, 7], [6.5, 6.5]])
    assert (apparent.worst, apparent.changes, apparent.angle) == (6, 3, pytest.approx(0, abs=1e-5))


def test_failures_are_no_champions_and_no_changes():
    found = measure_run([0, 1, 0], [[np.nan, np.nan], [9, 9], [8, 8]])
    assert (found.champion, found.worst, found.changes) == (0, 8, 0)
    assert np.isnan([found.angle, found.length, found.share]).all()
    assert measure_run([0, 1], [[np.nan, np.nan], [9, 9]]).champion == 1
    assert measure_run_as_computed([0, 1], [[np.nan, np.nan], [9, 9]]).champion == 1


def test_means_of_runs_leave_out_what_a_run_does_not_have():
    """Of the worst distances 1, 2 and 6, Student's t at 2 degrees of freedom, 4.302653, times their standard error."""
    bare = RunMeasures(0, 6.0, np.nan, np.nan, np.nan, 0)
    found = SeveralRuns.of([RunMeasures(0, 1.0, 30.0, 4.0, 0.5, 3), RunMeasures(1, 2.0, 50.0, 4.0, 1.0, 2), bare])
    half = 4.302653 * np.sqrt(7 / 3)
    assert (found.worst.low, found.worst.high) == pytest.approx((3 - half, 3 + half))
    assert (found.worst.value, found.worst.counted, found.angle.value, found.angle.counted) == (3, 3, 40, 2)
    assert found.length == MeanOfRuns(4.0, 4.0, 4.0, 2) and found.changes == 5 and found.runs[2] is bare
    assert SeveralRuns.of([bare]).angle == MeanOfRuns(None, None, None, 0)
    assert SeveralRuns.of([bare]).worst == MeanOfRuns(6.0, None, None, 1)


@pytest.mark.parametrize(
    ("climber", "distance", "message"),
    [
        ([0, 1], [[9, 9]], "distance: shape (1, 2) is not allowed for 2 evaluations"),
        ([], np.empty((0, 2)), "distance: shape (0, 2) is not allowed for 0 evaluations"),
        ([0], [9], "distance: shape (1,) is not allowed"),
    ],
)
@pytest.mark.parametrize("of", [measure_run, measure_run_as_computed])
def test_bad_input_is_one_line(of, climber, distance, message):
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        of(climber, distance)
    assert "\n" not in str(error.value)


# from runs to tables


def state_of(climber, distance, born=None):
    """What climbers kept, as the study has it."""
    distance = np.array(distance, np.float32)
    born = np.arange(len(climber)) if born is None else born
    return {
        "generation": np.array(max(born) + 1),
        "born": np.array(born, np.int32),
        "climber": np.array(climber, np.int32),
        "distance": distance,
        "light": 1.0 / distance**2,
    }


def runs_of(worst):
    """Runs by treatment, each of one climber that comes from (9, 9) to its worst distance in both environments."""
    return {t: [state_of([0, 0], [[9, 9], [value, value]]) for value in values] for t, values in worst.items()}


def test_tests_are_between_all_cells_of_a_row_and_of_a_column():
    every = [(t.row, t.robot) for t in treatments()]
    values = {place: np.arange(6) + 100.0 * (place[1] == "whegged") for place in every}
    found = compare_cells(values)
    assert len(found) == 18
    marked = {(t["first"][0], t["first"][1], t["second"][1]) for t in found if t["significant"]}
    assert marked == {(row, robot, "whegged") for row in ("sum", "product", "min") for robot in ("legged", "wheeled")}
    apart = next(t for t in found if t["significant"])
    assert apart["p"] == pytest.approx(2 / 924) and apart["p_bonferroni"] == pytest.approx(18 * 2 / 924)
    assert apart["difference"] == 100 and apart["A12"] == 1
    assert compare_cells({t: np.ones(1) for t in every}) == []


def test_tables_hold_means_intervals_published_values_and_marks(tmp_path):
    worst = {t: np.linspace(7, 8, 6) - 5 * (t.robot == "whegged") for t in treatments()}
    found = runs_of(worst)
    write_tables(rows_of(found), 2, tmp_path, {"runs": 6})
    text = (tmp_path / "tables.md").read_text()
    assert "# As defined" in text and "# As computed" in text
    assert re.search(r"\| min \| 7\.50 ± 0\.37 \[7\.\d\d, 7\.\d\d\], published 5\.83 \| .* \| 2\.50 ± ", text)
    assert "min: wheeled ↔ whegged" in text and "legged: sum ↕" not in text
    lines = (tmp_path / "tables.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * 36 and lines[0].startswith("definition,measure,fitness,robot,runs,mean,deviation,low")
    assert re.search(r"defined,M4,min,whegged,6,100.0,0.0,.*,54.332,", "\n".join(lines))
    assert len((tmp_path / "tests.csv").read_text().splitlines()) == 1 + 2 * 4 * 18
    assert len((tmp_path / "runs.csv").read_text().splitlines()) == 1 + 2 * 54


def test_runs_without_beneficial_mutations_count_for_the_worst_distance_only():
    treatment = Treatment("legged", "min")
    found = {treatment: [*runs_of({treatment: [8.0]})[treatment], state_of([0], [[9, 9]])]}
    rows = select(rows_of(found), definition="defined")
    worst, angle = (cells_of(rows, name) for name in ("M1", "M2"))
    assert worst == {("min", "legged"): pytest.approx([8, 9])} and angle["min", "legged"].tolist() == [0]
    (row,) = summarise(angle, "M2", 2)
    assert (row["runs"], row["mean"], row["low"], row["published"]) == (1, 0, None, 57.843)
    assert summarise(worst, "M1", 4)[0]["published"] == 8.02


def test_curves_follow_what_climbers_have_and_mutations_their_own_parents():
    state = state_of([0, 1, 0, 1], [[9, 8], [7, 9], [6, 8], [5, 5]], born=[0, 0, 2, 3])
    found = curve(state, "min")
    assert found[:, 0] == pytest.approx([9, 9, 8, 5]) and found[:, 1] == pytest.approx(1 / found[:, 0] ** 2)
    changes, born = mutations(state)
    assert changes.tolist() == [[3, 0], [2, 4]] and born.tolist() == [2, 3]
    assert mutations(state, [1])[1].tolist() == [3]


# champions


def test_paths_that_are_alike_once_turned_have_no_asymmetry():
    along = np.linspace(0, 9, 50)
    straight = np.stack([np.stack([along * x / 9, along * y / 9], -1) for x, y in ENVIRONMENTS])[None]
    assert asymmetry(straight, ENVIRONMENTS) == pytest.approx([0], abs=1e-12)
    both = np.stack([straight[0, 0], straight[0, 0]])[None]  # goes to the first light wherever the light is
    assert asymmetry(both, TWO_ENVIRONMENTS) == pytest.approx([9])
    assert turned(both, TWO_ENVIRONMENTS)[0, 1, -1] == pytest.approx([-9, 0])


def test_divergence_is_when_paths_are_a_body_length_apart():
    times = np.arange(11.0)
    away = np.stack([times * 0.1, 0 * times], -1)
    assert divergence(np.stack([away, -away])[None], times) == pytest.approx([2])
    assert divergence(np.stack([away, away])[None], times) == pytest.approx([10])


@pytest.mark.kernels
def test_warping_compares_each_two_environments_without_offset_and_scale():
    wave = np.sin(np.linspace(0, 6, 80))
    light = np.stack([[wave, 3 + 2 * wave], [wave, np.linspace(-1, 1, 80)]])
    found = warping(light, threads=1)
    assert found[0] == pytest.approx(0, abs=1e-12) and found[1] > 0.05


def test_time_near_the_light_is_told_in_all_and_at_the_end():
    away = np.array([[[1, 0.4, 1, 0.4, 0.4]], [[0.4, 0.4, 0.4, 0.4, 1]]])
    paths = np.stack([9 - away, 0 * away], axis=-1)
    seen = Champions(np.zeros((2, 5, 8)), 0.1 * np.arange(5), paths, np.ones((2, 1, 5)), np.array([[0.4], [1.0]]))
    near, waiting = time_near(seen, [(9, 0)])
    assert near[:, 0] == pytest.approx([0.3, 0.4]) and waiting[:, 0] == pytest.approx([0.2, 0])
    assert typical(seen) == 0


def test_tables_of_likeness_hold_means_and_tests_between_robots(tmp_path):
    cells = {("min", "legged"): np.arange(8.0), ("min", "whegged"): np.arange(8.0) + 20, ("sum", "legged"): np.ones(1)}
    found = write_likeness({"warping": cells}, tmp_path)
    (test,) = found["warping"]["tests"]["min"]
    assert (test["first"], test["second"], test["A12"]) == ("legged", "whegged", 1) and test["p_bonferroni"] < 0.001
    assert found["warping"]["tests"]["sum"] == [] and found["warping"]["means"][1]["mean"] == 23.5
    assert "| min | 3.500 | 23.500 | legged and whegged: p = 0.0" in (tmp_path / "likeness.md").read_text()
    assert len((tmp_path / "likeness.csv").read_text().splitlines()) == 18
