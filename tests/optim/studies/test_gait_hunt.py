"""The hunt for gaits that climb: what searches may spend, what counts as found, and that the study goes on."""

import dataclasses
import json

import numpy as np
import pytest
from graded import tabled
from hill import Hill
from hypothesis import given
from hypothesis import strategies as st
from study_checks import check_rewritten, check_runs_needed

from optim.experiments.comparison import differences, table_of_differences
from optim.measures.statistics import holm
from optim.problem import Evaluation, Request
from optim.problems.inflatable.outcomes import Outcomes, effort
from optim.problems.inflatable.problem import GaitProblem
from optim.studies.beyond.gait_hunt import climb, searches
from optim.studies.beyond.gait_hunt import study as hunting
from optim.studies.beyond.gait_hunt.finalists import Finalist, Finals, best_of, cached_finalists, last_bests
from optim.studies.beyond.gait_hunt.program import Plan
from optim.studies.beyond.gait_hunt.searches import GRADIENT_COST, cost, least_cost, paid, read_spent, search_within
from robots.inflatable import ACTUATION, INCHING, InflatableDesign, simulation
from robots.inflatable import gradient as inflatable_gradient
from robots.inflatable.design import load_design
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import cycle_starts, gait_steps
from robots.world import Terrain

HILL = (Terrain(15),)
SMALL = {"encoding": "graded", "columns": 2, "steps": 62_240, "warm_up": 15_560, "stages": 3, "hard": True}


@pytest.fixture
def hill(monkeypatch):
    stand_in = Hill()
    monkeypatch.setattr(simulation, "simulate", stand_in)
    monkeypatch.setattr(inflatable_gradient, "differentiate", stand_in.gradient)
    return stand_in


def test_a_search_ends_when_its_budget_is_spent(hill, tmp_path):
    problem = GaitProblem(HILL, **{**SMALL, "hard": False})  # what it costs is clear before
    history = search_within(problem, "genetic", {"population": 4, "seed": 1}, tmp_path / "run", 2e6)
    spent = read_spent(tmp_path / "run")
    assert len(spent) == len(history.generations)
    assert sum(spent) <= 2e6 < sum(spent) + spent[-1] and len(spent) > 2
    assert paid(history, spent, 2e6).generations == history.generations
    assert paid(history, spent, sum(spent[:-1])).generations == history.generations[:-1]
    assert len(paid(history, spent, 1.0).generations) == 1


def test_what_a_generation_costs_is_what_is_simulated():
    """The harder conditions for gaits alone that get ahead."""
    problem = GaitProblem(HILL, **SMALL)
    points, speeds = problem.space.sample(np.random.default_rng(0), 3), np.array([0.1, -0.1, 0.0])
    judged = Evaluation(speeds, details={"speed_hill:15": speeds})
    each = [gaits_initial(d.pressure) + gait_steps(d.schedule) for d in map(problem.design, points)]
    assert cost(problem, Request(points), judged) == 2 * each[0] + each[1] + each[2]
    assert least_cost(problem, Request(points)) == sum(each)
    relaxed = Request(points, "relaxed", 2.0)
    slopes = dataclasses.replace(relaxed, wants="gradients")
    assert cost(problem, slopes, judged) == GRADIENT_COST * cost(problem, relaxed, judged)


def test_gaits_that_get_ahead_are_simulated_again_under_harder_conditions(hill):
    """The stand-in climbs where its first bladders move; the harder conditions take 0.03 from it."""
    problem = GaitProblem(HILL, **SMALL)
    points = problem.space.sample(np.random.default_rng(1), 6)
    points[:3, [problem.space.names.index(f"bladder{b}_{c}") for b in (1, 2) for c in (1, 2)]] = 0.5
    found = problem.evaluate(points)
    usual, hard = found.details["speed_hill:15"], found.details["speed_hill:15_hard"]
    assert np.all(usual[:3] == 0) and np.all(usual[3:] > 0)
    np.testing.assert_array_equal(hard[:3], usual[:3])
    assert np.all(hard[3:] < usual[3:])
    np.testing.assert_allclose(found.objectives[:, 0], (usual + hard) / 2)


def test_gaits_climb_a_ladder_as_far_as_they_are_fast_enough(hill):
    """Steeper ground is for those that were; the others are not simulated there, and easy ground counts no more."""
    terrains = (Terrain(5.0), Terrain(10.0), Terrain(15.0))
    given = {**SMALL, "hard": False}
    points = GaitProblem(terrains, **given).space.sample(np.random.default_rng(1), 6)
    usual = GaitProblem(terrains, **given).evaluate(points)
    each = np.stack([usual.details[f"speed_hill:{slope}"] for slope in (5, 10, 15)], axis=1)
    ahead = float(np.median(each[:, 0]))
    problem = GaitProblem(terrains, **given, ladder=True, ahead=ahead)
    found = problem.evaluate(points)
    reached = np.stack([np.full(6, True), each[:, 0] > ahead, (each[:, :2] > ahead).all(axis=1)], axis=1)
    assert 0 < reached[:, 1].sum() < 6
    counted = np.where(reached, each, 0.0)
    np.testing.assert_array_equal(found.details["speed_hill:10"], counted[:, 1])
    counted[:, :2] = np.minimum(counted[:, :2], ahead)
    np.testing.assert_allclose(found.objectives[:, 0], counted.mean(axis=1))
    simulations = problem.robot_steps(points, found) / [
        gaits_initial(d.pressure) + gait_steps(d.schedule) for d in map(problem.design, points)
    ]
    assert simulations.tolist() == reached.sum(axis=1).tolist()
    with pytest.raises(ValueError, match=r"^ahead: 0\.01 is not allowed without a ladder$"):
        GaitProblem(terrains, **given, ahead=0.01)


@pytest.mark.parametrize("hard", [False, True])
def test_what_is_fast_enough_has_no_slope(hard):
    """But on the last terrain, under both conditions."""
    ladder = GaitProblem((Terrain(), Terrain(5.0)), **{**SMALL, "hard": hard}, ladder=True).conditions
    speeds, count = [0.01, 0.05], 4 if hard else 2
    found = Outcomes(ladder, np.array([speeds] * count), np.full((count, 2), "ok"), np.ones((count, 2, 3)))
    each = found.capped(0.02)
    assert len(ladder) == len(each.speeds) == count
    for condition, cut, slopes in zip(ladder, each.speeds, each.slopes, strict=True):
        if condition.name.startswith("speed_flat"):
            assert cut.tolist() == [0.01, 0.02] and slopes.tolist() == [[1] * 3, [0] * 3]
        else:
            assert cut.tolist() == speeds and (slopes == 1).all()


def test_a_graded_pattern_tells_alike_what_lies_alike():
    """Networks that know only the side of a bladder and the time treat the four of a side alike; times are genes."""
    problem = GaitProblem(HILL, **{**SMALL, "encoding": "graded-pattern"})
    names, point = problem.space.names, problem.space.sample(np.random.default_rng(2), 1)[0]
    for place, name in enumerate(names):
        if name.startswith("weight_hidden") and name.endswith(("_x", "_y")):
            point[place] = 0.0
    gait = problem.design(point).schedule
    assert np.all(gait.inflation[:4] == gait.inflation[0]) and np.all(gait.inflation[4:] == gait.inflation[4])
    assert np.all((gait.grip == 0) | (gait.grip == 1)) and gait.has_own_times
    point[names.index("settle_1")], point[names.index("settle_2")] = 1234.4, -5.0
    assert problem.design(point).schedule.settle_steps.tolist() == [1234, 0]
    assert gait_steps(problem.design(point).schedule) <= 62_240
    assert GaitProblem.from_description(problem.describe()).describe() == problem.describe()


def test_a_gait_is_played_until_some_of_it_counts(hill):
    """The second cycle begins before the warm-up ends, and two take more steps than they may; the third counts."""
    problem = GaitProblem(HILL, **{**SMALL, "steps": 31_120, "stages": 1, "hard": False})
    names, point = problem.space.names, problem.space.low.copy()
    point[[names.index("bladder1_2"), names.index("settle_1"), names.index("settle_2")]] = 1.5, 4001, 2000
    gait = problem.design(point)
    assert gait_steps(gait.schedule) > 31_120 and gait.schedule.repeats == 3
    starts = cycle_starts(gait.schedule)
    assert starts[1] < 15_560 <= starts[2]
    assert np.isfinite(problem.evaluate(point[None]).objectives).all()


def test_a_ladder_has_several_rungs():
    with pytest.raises(ValueError, match=r"^ladder: one terrain is not allowed; give several, the easiest first$"):
        GaitProblem(HILL, **SMALL, ladder=True)


def test_a_graded_search_may_ask_for_less_than_no_pressure():
    """A quarter of the range is the flat robot; it has no slope there."""
    problem = GaitProblem(HILL, **SMALL)
    place = problem.space.names.index("pressure")
    point = problem.space.low.copy()
    assert point[place] == -4000 and problem.design(point).pressure == 0.0
    point[place] = 300.0
    assert problem.design(point).pressure == 300.0
    assert GaitProblem(HILL).space.low[place] == 0.0


def gaits_initial(pressure):
    return int(np.floor(pressure / 0.5)) + 1 + 2000


def test_a_larger_budget_goes_on_to_the_same_run(hill, tmp_path):
    problem, settings = GaitProblem(HILL, **SMALL), {"population": 4, "seed": 1}
    whole = search_within(problem, "genetic", settings, tmp_path / "whole", 4e6)
    search_within(problem, "genetic", settings, tmp_path / "parts", 1e6)
    parts = search_within(problem, "genetic", settings, tmp_path / "parts", 4e6)
    assert [g.to_json() for g in parts.generations] == [g.to_json() for g in whole.generations]
    assert read_spent(tmp_path / "parts") == read_spent(tmp_path / "whole")


def test_a_generation_that_was_cut_off_is_not_paid_twice(hill, tmp_path):
    problem, settings = GaitProblem(HILL, **SMALL), {"population": 4, "seed": 1}
    search_within(problem, "genetic", settings, tmp_path / "run", 1e6)
    spent = read_spent(tmp_path / "run")
    (tmp_path / "run" / searches.SPENT).write_text(json.dumps([*spent, 123.0]))
    search_within(problem, "genetic", settings, tmp_path / "run", 1e6 + sum(spent))
    assert 123.0 not in read_spent(tmp_path / "run")


@pytest.mark.long
@pytest.mark.parametrize("text", [None, "", "{}", "[1]", '["a"]', "[-1, 2, 3]"])
def test_a_run_that_does_not_know_what_it_has_spent_is_refused(hill, tmp_path, text):
    """It would go on for its whole budget again."""
    problem, settings = GaitProblem(HILL, **SMALL), {"population": 4, "seed": 1}
    path = tmp_path / "run" / searches.SPENT
    search_within(problem, "genetic", settings, tmp_path / "run", 4e6)
    path.unlink() if text is None else path.write_text(text)
    calls = hill.calls
    with pytest.raises(ValueError, match=r"^.*spent.json: (is damaged; it must be|tells the cost of . of \d)"):
        search_within(problem, "genetic", settings, tmp_path / "run", 4e6)
    assert hill.calls == calls


@pytest.mark.parametrize("budget", [0.0, -1.0, float("nan")])
def test_a_budget_of_nothing_is_refused(budget, tmp_path):
    with pytest.raises(ValueError, match=r"^budget: .* robot-steps are not allowed; give more than 0$"):
        search_within(GaitProblem(HILL, **SMALL), "genetic", {"population": 4}, tmp_path / "run", budget)


def test_finalists_are_the_last_improvements_in_full(hill, tmp_path):
    problem = GaitProblem(HILL, **SMALL)
    history = search_within(problem, "genetic", {"population": 4, "seed": 1}, tmp_path / "run", 4e6)
    scores = [g.best for g in history.generations]
    improved = [g for g, score in enumerate(scores) if g == 0 or score > scores[g - 1]]
    found = last_bests(history, problem, 3)
    assert [generation for _, generation in found] == improved[-3:]
    assert all(150_000 < gait_steps(design.schedule) <= 186_719 for design, _ in found)


def finalist(speed, hard):
    return Finalist(np.full(2, speed), np.full(2, hard), INCHING, 0)


def test_the_fastest_that_stays_wins_and_one_that_diverged_never():
    slides, walks, slow, lost = finalist(0.2, -0.1), finalist(0.03, -0.005), finalist(0.01, 0.01), finalist(np.nan, 0)
    assert best_of([slides, walks, slow, lost]) is walks
    assert best_of([slides, lost]) is slides
    assert best_of([lost]) is None


def quick(monkeypatch):
    """The study's searches with few points each."""
    few = {
        "hill-climb": {"climbers": 2},
        "genetic": {"population": 4},
        "gradient": {"climbers": 2},
        "memetic": {"population": 5, "every": 2, "refine": 2},
        "ladder": {"population": 4, "starts": 6},
    }
    found = {name: dataclasses.replace(s, settings=few[name]) for name, s in searches.SEARCHES.items()}
    monkeypatch.setattr(hunting, "SEARCHES", found)
    return hunting.Hunt(4, (0, 1), finalists=2, runs=2)


@pytest.mark.long
def test_a_study_tells_of_every_search_and_goes_on(hill, tmp_path, monkeypatch):
    settings, seen = quick(monkeypatch), []
    hunting.study(tmp_path / "hunt", settings, seen.append)
    summary = json.loads((tmp_path / "hunt" / "summary.json").read_text())
    assert set(summary["searches"]) == set(searches.SEARCHES)
    assert len(summary["runs"]) == 2 * len(searches.SEARCHES)
    for row in summary["runs"]:
        spent = read_spent(tmp_path / "hunt" / "runs" / f"{row['search']}-{row['seed']}")
        assert row["robot_steps"] in (spent[0], sum(spent[:-1]), sum(spent))
        # No search ends early: what it asks for next, perhaps gradients, would cost more than is left.
        gradients = GRADIENT_COST if row["search"] in ("gradient", "memetic") else 1.0
        assert sum(spent) + gradients * max(spent) > settings.budget
        assert row["robot_steps"] <= settings.budget or row["robot_steps"] == spent[0]
    assert seen == sorted(seen) and seen[-1] == pytest.approx(1.0)
    assert (tmp_path / "hunt" / "hunt.png").stat().st_size > 1000
    rows = (tmp_path / "hunt" / "table.md").read_text().splitlines()
    assert len(rows) == 2 + len(searches.SEARCHES) + 1 + 2 + 10
    pairs = {(row["first"], row["second"]): row for row in summary["differences"]}
    assert len(pairs) == 10
    # Both begin with the same gaits; with other numbers of them they do not.
    assert {names for names, row in pairs.items() if row["same_start"]} == set()
    for (first, second), row in pairs.items():
        means = [summary["searches"][name]["speed"] for name in (first, second)]
        assert row["difference"] == pytest.approx(means[1] - means[0]) and row["p"] <= row["p_adjusted"] <= 1
    for row in summary["runs"]:
        design = load_design(tmp_path / "hunt" / "gaits" / f"{row['search']}-{row['seed']}.json")
        assert design.pressure == row["pressure"] and gait_steps(design.schedule) <= 186_719
    before = {name: (tmp_path / "hunt" / name).read_bytes() for name in ("summary.json", "table.md")}
    calls = hill.calls
    hunting.study(tmp_path / "hunt", settings)
    assert hill.calls == calls  # all is kept
    assert before == {name: (tmp_path / "hunt" / name).read_bytes() for name in before}
    check_rewritten(hunting.rewrite, tmp_path / "hunt", tmp_path / "told")
    assert hill.calls == calls  # made from the tables alone
    check_runs_needed(hunting.study, tmp_path / "hunt", settings)
    assert before == {name: (tmp_path / "hunt" / name).read_bytes() for name in before}


def test_searches_that_begin_with_the_same_gaits_are_compared_run_by_run():
    a, b = np.array([0.01, 0.02, 0.06]), np.array([0.02, 0.03, 0.08])
    starts = {"one": [1.0, 2.0, 3.0], "two": [1.0, 2.0, 3.0], "three": [4.0, 5.0, 6.0]}
    rows = differences({"one": a, "two": b, "three": b}, starts)
    assert [row["same_start"] for row in rows] == [True, False, False]
    assert rows[0]["p"] < 0.06 < 0.5 < rows[1]["p"]
    assert [row["p_adjusted"] for row in rows] == holm([row["p"] for row in rows])
    lines = table_of_differences(rows, {name: name for name in starts}).splitlines()
    assert lines[2].startswith("| one | two | 0.0133 (pairs) | -0.0010 to 0.0277 | 0.057 |")


def test_runs_that_found_nothing_count_neither_as_speeds_nor_as_runs():
    nan = np.nan
    rows = differences({"one": np.array([nan, 0.1, 0.2]), "two": np.array([0.3, nan, nan])}, {"one": [1], "two": [2]})
    assert rows == []
    (row,) = differences(
        {"one": np.array([nan, 0.1, 0.2, 0.3]), "two": np.array([0.3, nan, 0.4, 0.5])},
        {"one": [1, 2, 3, 4], "two": [1, 2, 3, 4]},
    )
    assert row["same_start"] and row["difference"] == pytest.approx(0.2)


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_the_table_tells_of_how_many_runs_speeds_are(hill, tmp_path, monkeypatch):
    """One run's finalists all diverge."""
    settings = dataclasses.replace(quick(monkeypatch), searches=("genetic",))
    hunting.study(tmp_path / "hunt", settings)
    found = iter((None, Finalist(np.full(2, 0.1), np.full(2, 0.1), INCHING, 0)))
    monkeypatch.setattr(hunting, "best_of", lambda known: next(found))
    hunting.study(tmp_path / "hunt", settings)
    row = json.loads((tmp_path / "hunt" / "summary.json").read_text())["searches"]["genetic"]
    assert (row["runs"], row["judged"]) == (2, 1)
    assert "| 1 of 2 |" in (tmp_path / "hunt" / "table.md").read_text()


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_finalists_of_a_longer_run_are_judged_anew(hill, tmp_path, monkeypatch):
    settings = quick(monkeypatch)
    hunting.study(tmp_path / "hunt", dataclasses.replace(settings, searches=("genetic",)))
    kept = tmp_path / "hunt" / "runs" / "genetic.json"
    before, calls = kept.read_text(), hill.calls
    more = dataclasses.replace(settings, searches=("genetic",), evaluations=8)
    hunting.study(tmp_path / "hunt", more)
    assert hill.calls > calls and kept.read_text() != before
    spent = np.cumsum(read_spent(tmp_path / "hunt" / "runs" / "genetic-0"))
    (row, _) = json.loads((tmp_path / "hunt" / "summary.json").read_text())["runs"]
    assert row["robot_steps"] == spent[spent <= more.budget][-1] > spent[0]


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_finalists_of_other_seeds_are_judged_anew(hill, tmp_path, monkeypatch):
    """Of runs with as many generations, too: what was judged are their designs."""
    settings = dataclasses.replace(quick(monkeypatch), searches=("genetic",))
    hunting.study(tmp_path / "hunt", settings)
    kept = tmp_path / "hunt" / "runs" / "genetic.json"
    before = json.loads(kept.read_text())["of"]
    hunting.study(tmp_path / "hunt", dataclasses.replace(settings, seeds=(2, 3)))
    assert json.loads(kept.read_text())["of"] != before
    # What the table no longer tells of is gone.
    assert sorted(path.name for path in (tmp_path / "hunt" / "gaits").iterdir()) == ["genetic-2.json", "genetic-3.json"]


def test_finalists_under_other_conditions_are_judged_anew(hill, tmp_path):
    problem = GaitProblem(HILL, **SMALL)
    history = search_within(problem, "genetic", {"population": 4, "seed": 1}, tmp_path / "run", 1e6)
    calls = []
    for terrain, precision in ((15, "f32"), (15, "f32"), (10, "f32"), (10, "f64")):
        finals = Finals(slope=terrain, finalists=1, runs=2)
        cached_finalists(tmp_path / "f.json", [history], problem, finals, None, precision=precision)
        calls.append(hill.calls)
    assert calls[0] == calls[1] < calls[2] < calls[3]


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
@pytest.mark.parametrize("text", ["", "{", "[]", '{"of": 3}', '{"of": {}, "speeds": 1}'])
def test_damaged_finalists_are_judged_again(hill, tmp_path, monkeypatch, text):
    settings = dataclasses.replace(quick(monkeypatch), searches=("genetic",), seeds=(0,))
    hunting.study(tmp_path / "hunt", settings)
    path = tmp_path / "hunt" / "runs" / "genetic.json"
    whole = path.read_bytes()
    path.write_text(text)
    hunting.study(tmp_path / "hunt", settings)
    assert path.read_bytes() == whole


def test_other_folders_are_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"^out: .* holds something else; name a new folder$"):
        hunting.study(tmp_path, hunting.STUDY.scales["small"])


def test_a_hunt_and_a_climb_refuse_each_others_folders(hill, tmp_path, monkeypatch):
    """Both have runs, tables and gaits: a file tells which study they are of, from the start."""
    hunting.study(tmp_path / "hunt", dataclasses.replace(quick(monkeypatch), searches=("genetic",), seeds=(0,)))
    with pytest.raises(ValueError, match=r"^out: .* holds something else; name a new folder$"):
        climb.study(tmp_path / "hunt", climb.STUDY.scales["small"])
    (tmp_path / "climb").mkdir()
    (tmp_path / "climb" / "gait-climb.json").write_text("{}")
    with pytest.raises(ValueError, match=r"^out: .* holds something else; name a new folder$"):
        hunting.study(tmp_path / "climb", hunting.STUDY.scales["small"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hunting.Hunt(0, (0,)), "evaluations: 0 is not allowed; give a number above 0"),
        (lambda: hunting.Hunt(float("nan"), (0,)), "evaluations: nan is not allowed; give a number above 0"),
        (lambda: hunting.Hunt(1, ()), r"seeds: \(\) are not allowed; give at least one, and none twice"),
        (lambda: hunting.Hunt(1, (1, 1)), r"seeds: \(1, 1\) are not allowed; give at least one, and none twice"),
        (lambda: hunting.Hunt(1, (-1,)), "seeds: -1 is not allowed; give a whole number, at least 0"),
        (lambda: hunting.Hunt(1, (0,), ("genetics",)), "searches: 'genetics' is unknown.*; did you mean genetic?"),
        (lambda: hunting.Hunt(1, (0,), ()), "searches: none given; give at least one, and none twice"),
        (lambda: hunting.Hunt(1, (0,), finalists=0), "finalists: 0 is not allowed; give a whole number, at least 1"),
        (lambda: climb.Climb((0,), slope=60.0), "slope: 60.0 is not allowed; give a number from 0.1 to 45 deg"),
        (lambda: climb.Climb((0,), geometry="large"), "geometry: 'large' is unknown; choose one of published"),
        (lambda: climb.Climb((0,), runs=0), "runs: 0 is not allowed; give a whole number, at least 1"),
        (lambda: Plan(rounds=()), "rounds: none given; give the generations of at least one"),
        (lambda: Plan(kinds=0), "kinds: 0 is not allowed; give a whole number, at least 1"),
        (lambda: Plan(leads=(1.5,)), "leads: 1.5 is not allowed; give a number from 0 to 1"),
    ],
)
def test_settings_that_no_study_can_do_are_refused(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)


def test_diverged_finalists_are_kept_as_such(hill, tmp_path, monkeypatch):
    problem = GaitProblem(HILL, **SMALL)
    history = search_within(problem, "genetic", {"population": 4, "seed": 1}, tmp_path / "run", 1e6)
    count = len(last_bests(history, problem, 2))
    stand_in = "optim.studies.beyond.gait_hunt.finalists.play_with_noise"
    speeds = np.array([[np.nan, 0.1]]), np.array([[0.0, 0.1]])
    monkeypatch.setattr(stand_in, lambda designs, *_, **__: tuple(np.repeat(each, len(designs), 0) for each in speeds))
    for _ in range(2):  # computed, then read
        finals = Finals(finalists=2, runs=2)
        found = cached_finalists(tmp_path / "f.json", [history, history], problem, finals, None)
        assert [len(each) for each in found] == [count, count]
        np.testing.assert_array_equal(found[1][0].speeds, [np.nan, 0.1])
    assert best_of(found[0]) is None


def test_effort_counts_strokes():
    """A full stroke of every bladder in every published column is 1; a bladder that is told the same costs nothing."""
    every = GaitSchedule(np.tile([[1, 0]], (10, 4)))
    assert effort(InflatableDesign(0.0, 90.0, every), 186_719, ACTUATION)[0] == 1.0
    assert effort(INCHING, 186_719, ACTUATION)[0] == 0.5
    still = GaitSchedule(np.ones((10, 8)))
    assert effort(InflatableDesign(0.0, 90.0, still), 186_719, ACTUATION)[0] == 8 / 128  # filled once
    assert effort(INCHING, 2 * 186_719, ACTUATION)[0] == 0.25


@given(st.integers(0, 1000))
def test_slopes_of_effort_agree_with_differences(seed):
    generator = np.random.default_rng(seed)
    levels, h = generator.uniform(0.05, 0.95, (8, 3)), 1e-6

    def used(table):
        gait = tabled(table, np.ones((2, 3)), 2, None, np.zeros(3), np.zeros(3))
        return effort(InflatableDesign(0.0, 90.0, gait), 1000, ACTUATION)

    direction = generator.normal(size=levels.shape)
    change = (used(levels + h * direction)[0] - used(levels - h * direction)[0]) / (2 * h)
    assert (used(levels)[1] * direction).sum() == pytest.approx(change, rel=1e-5, abs=1e-7)


def test_effort_is_subtracted_from_speed_and_its_slope_from_that_of_speed(hill):
    plain, dear = (GaitProblem(HILL, **SMALL, effort=cost) for cost in (0.0, 0.1))
    points = plain.space.sample(np.random.default_rng(2), 4)
    free, paid = (p.evaluate_relaxed(points, 1.0, gradients=True) for p in (plain, dear))
    np.testing.assert_allclose(paid.objectives[:, 0], free.objectives[:, 0] - 0.1 * paid.details["effort"])
    assert not np.allclose(paid.gradients, free.gradients)
    assert GaitProblem.from_description(dear.describe()).describe() == dear.describe()
    np.testing.assert_array_equal(paid.objectives, dear.evaluate(points).objectives)
    with pytest.raises(ValueError, match=r"^effort: 0.1 is not allowed with objectives, terrains; choose mean$"):
        GaitProblem((*HILL, Terrain()), objectives="terrains", effort=0.1)


@pytest.mark.parametrize("more", [("core",), ("pace",), ("core", "pace")])
@pytest.mark.parametrize("steps", [2_000, 62_240])
def test_slopes_of_effort_agree_with_differences_where_core_pressures_and_paces_are_free(hill, more, steps):
    """In every variable, of gaits that take longer than the steps given, and of those that do not."""
    settings = {"encoding": "graded", "columns": 2, "steps": steps, "more": more, "pressure": 2e3, "orientation": 60.0}
    plain, dear = (GaitProblem(HILL, **settings, effort=cost) for cost in (0.0, 0.1))
    span = dear.space.high - dear.space.low
    point = dear.space.low + np.random.default_rng(5).uniform(0.05, 0.95, dear.space.size) * span
    free, paid = (p.evaluate_relaxed(point, 1.0, gradients=True).gradients[0] for p in (plain, dear))
    moved = 1e-7 * span * np.eye(dear.space.size)
    sides = [dear.evaluate_relaxed(point + h, 1.0, gradients=False).details["effort"] for h in (moved, -moved)]
    wanted = (sides[0] - sides[1]) / (2 * np.diag(moved))
    assert (free - paid) / 0.1 == pytest.approx(wanted, rel=1e-6, abs=1e-9) and wanted.any()
