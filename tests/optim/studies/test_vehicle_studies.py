"""The studies of chapter 4's co-optimisation, on a task that takes milliseconds."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.tables import read_table, write_records
from optim.measures import homeostasis
from optim.problems.braitenberg import VehicleProblem
from optim.studies.beyond import search_comparison
from optim.studies.catalogue import STUDIES as CATALOGUE
from optim.studies.chapter4 import co_optimisation, homeostasis_objective, homeostasis_of_bodies, reality_gap
from optim.studies.chapter4.co_optimisation import CoOptimisation, compare_first_and_last, first_and_last
from optim.studies.chapter4.homeostasis_objective import HomeostasisObjective, HomeostasisProblem
from optim.studies.chapter4.homeostasis_of_bodies import BodyHomeostasis
from optim.studies.chapter4.perturbations import PERTURBATIONS
from optim.studies.chapter4.reality_gap import RealityGap, survival
from optim.studies.chapter4.sensor_homeostasis import decimation, sensor_distances
from robots.braitenberg import PUBLISHED, STARTS, Sweep, VehicleTask
from taichi_sim.signals import warping_distances
from taichi_sim.vehicle import VehicleBatch, trace

NEAR = VehicleTask(
    STARTS * [0.25, 0.25, 1.0], radius=0.3, time_step=0.1, steps=300
)  # every thirteenth point solves all
SHORT = Sweep(weights=9, radius=0.5, time_step=0.2, steps=2500)
TINY = CoOptimisation(runs=3, budget=58, task=NEAR, threads=2)


def solving(count):
    """Points that solve all environments, and some that do not."""
    problem = VehicleProblem(task=NEAR, objectives="environments")
    points = problem.space.sample(np.random.default_rng(0), 40 * count)
    good = problem.evaluate(points).details["solved"] == 4
    return problem, points[good][:count], points[~good][:count]


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


STUDIES = {
    "co-optimisation": (co_optimisation.study, TINY, replace(TINY, budget=59)),
    "search-comparison": (search_comparison.study, TINY, replace(TINY, seed=2)),
    "homeostasis-of-bodies": (
        homeostasis_of_bodies.study,
        BodyHomeostasis(bodies=4, controllers=2, sweep=SHORT, samples=50),
        BodyHomeostasis(bodies=5, controllers=2, sweep=SHORT, samples=50),
    ),
    "reality-gap": (
        reality_gap.study,
        RealityGap(controllers=3, draws=2, sweep=SHORT, manifold=9, manifold_draws=2),
        RealityGap(controllers=3, draws=3, sweep=SHORT, manifold=9),
    ),
    "homeostasis-objective": (
        homeostasis_objective.study,
        HomeostasisObjective(replace(TINY, runs=2), samples=50, weights=5, draws=1),
        HomeostasisObjective(replace(TINY, runs=2), samples=60, weights=5, draws=1),
    ),
}


@pytest.mark.kernels
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_writes_what_the_catalogue_says_goes_on_from_its_folder_and_refuses_others(name, tmp_path):
    study, settings, other = STUDIES[name]
    folder, fractions = tmp_path / "a", []
    study(folder, settings, fractions.append)
    first = files(folder)
    assert set(CATALOGUE[name].writes) <= set(first)
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    (tmp_path / "told").mkdir()
    CATALOGUE[name].rewrite(Data(folder), tmp_path / "told")
    told = files(tmp_path / "told")
    assert {"summary.json", f"{name}.png"} <= set(told) and told.items() <= first.items()
    parts = sorted(folder.glob("*-????????????????.npz"))
    parts[0].unlink()
    stamps = {path: path.stat().st_mtime_ns for path in parts[1:]}
    study(folder, settings)
    assert files(folder) == first  # bit for bit, the part that was missing too
    assert stamps == {path: path.stat().st_mtime_ns for path in parts[1:]}
    with pytest.raises(ValueError, match=r"of other settings .*; name another folder"):
        study(folder, other)


def test_budgets_that_there_are_not_are_refused(tmp_path):
    for item in CATALOGUE.values():
        with pytest.raises(ValueError, match=r"budget: 'huge' is unknown; choose one of small, (medium, )?full"):
            item.reproduce(tmp_path / "a", "huge")
    assert not (tmp_path / "a").exists()
    with pytest.raises(ValueError, match="runs: 1 is not allowed; give a whole number, at least 2"):
        CoOptimisation(runs=1)


@pytest.mark.kernels
def test_the_curve_of_co_optimisation_is_that_of_its_raw_data(tmp_path):
    co_optimisation.study(tmp_path / "a", TINY)
    _, curve = read_table(tmp_path / "a" / "environments-solved.csv")
    _, raw = read_table(tmp_path / "a" / "evaluations-until-all-solved.csv")
    for arm in co_optimisation.ARMS:
        rows = np.array([row[1:] for row in curve if row[0] == arm], float)
        trials = np.array([row[1:] for row in raw if row[0] == arm], float)
        assert rows.shape == (TINY.budget, 4) and trials[:, 0].tolist() == list(TINY.seeds)
        assert rows[-1, 1] == pytest.approx(trials[:, 3].mean())
        assert (rows[:, 2] <= rows[:, 1]).all() and (rows[:, 1] <= rows[:, 3]).all()
        assert ((trials[:, 1] <= trials[:, 2]) | (trials[:, 2] < 0)).all()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert {row["alternative"] for row in summary["tests_of_evaluations_until_all_solved"]} == {"less"}


@pytest.mark.kernels
def test_distances_of_many_controllers_are_those_of_each_and_follow_the_definition(monkeypatch):
    problem, points, _ = solving(4)
    sites, controllers = problem.split(points)
    raw, normalised = sensor_distances(sites, controllers[:, 0], NEAR, 6)
    seen = trace(VehicleBatch(sites, controllers), NEAR, every=6).readings[:, 0]
    assert np.array_equal(raw, homeostasis(seen, warping_distances))
    monkeypatch.setattr("optim.studies.chapter4.sensor_homeostasis.SAMPLES_AT_ONCE", 1)
    assert np.array_equal(sensor_distances(sites, controllers[:, 0], NEAR, 6), [raw, normalised])
    assert (raw != normalised).all() and decimation(PUBLISHED) == 10 and decimation(NEAR, 1000) == 1


def test_first_and_last_solutions_are_compared_within_trials():
    values = np.array([[np.nan, 3.0, 2.0], [5.0, 5.0, 5.0], [1.0, 2.0, 4.0]])
    solved = np.array([[False, False, True], [True, True, True], [False, True, True]])
    rows = first_and_last(np.where(solved, values, np.nan), range(3))
    assert rows[2] == {"seed": 2, "first": 2.0, "last": 4.0}
    found, every = compare_first_and_last(rows), compare_first_and_last(first_and_last(values, range(3)))
    assert (found["fell"], found["rose"], found["trials"]) == (0, 1, 3)
    assert (every["fell"], every["rose"]) == (1, 1)
    assert (found["median_first"], every["median_last"]) == (2.0, 4.0)
    nothing = compare_first_and_last(first_and_last(np.full((2, 3), np.nan), range(2)))
    assert nothing["median_first"] is None and nothing["p_wilcoxon_two_sided"] == 1.0


@pytest.mark.kernels
def test_homeostasis_counts_only_once_everything_is_solved():
    vehicle, good, bad = solving(5)
    problem = HomeostasisProblem(vehicle, samples=100)
    points = np.concatenate([bad, good])
    judged, plain = problem.evaluate(points), vehicle.evaluate(points)
    assert np.array_equal(judged.objectives[:, :4], plain.objectives)
    similarity = judged.objectives[:, 4]
    assert (similarity[:5] == -1.0).all() and (similarity[5:] > -1.0).all() and (similarity <= 0.0).all()
    sites, controllers = vehicle.split(good)
    distances, _ = sensor_distances(sites, controllers[:, 0], NEAR, 3)
    assert np.array_equal(similarity[5:], -distances / (1 + distances))
    with pytest.raises(ValueError, match="gradients: not allowed"):
        problem.evaluate_relaxed(points, 0.0, True)


@pytest.mark.kernels
def test_perturbations_without_strength_change_nothing_and_others_do_what_their_names_say():
    problem, points, bad = solving(6)
    sites, controllers = problem.split(points)
    controllers = controllers[:, 0]
    rng = np.random.default_rng(0)
    by_name = {p.name.split(" [")[0]: p for p in PERTURBATIONS}

    def changed(name):
        return by_name[name].change(sites, controllers, NEAR, rng, by_name[name].strength)

    s, c, task = changed("sensitivity of sensors")
    ratio = c / np.where(controllers == 0, np.nan, controllers)
    assert np.array_equal(s, sites) and task is NEAR and (np.abs(ratio[~np.isnan(ratio)] - 1) > 0).all()
    assert changed("radius of the light")[2].radius == 0.15
    longer = changed("time step")[2]
    assert longer.time_step * longer.steps == pytest.approx(NEAR.time_step * NEAR.steps)
    moved = changed("heading at the start")[2].starts
    assert np.array_equal(moved[:, :2], NEAR.starts[:, :2]) and (moved[:, 2] != 0).all()
    assert np.array_equal(changed("gain of both motors")[1], 1.2 * controllers)
    same = replace(by_name["gain of both motors"], change=lambda s, c, t, r, f: (s, c, t))
    assert (survival(sites, controllers, NEAR, same, 3, 1) == 1.0).all()
    other_sites, other = problem.split(bad)
    assert (survival(other_sites, other[:, 0], NEAR, same, 3, 1) == 0.0).all()
    shaken = by_name["places of sensors"]
    one, two = (survival(sites, controllers, NEAR, shaken, 4, 1) for _ in range(2))
    assert np.array_equal(one, two) and set(one * 4) <= {0, 1, 2, 3, 4}


def test_controllers_that_a_perturbation_lacks_are_told(tmp_path):
    rows = [
        dict(zip(reality_gap.COLUMNS, (162, one.name, one.strength, 0.5, 0.5, 1.0), strict=True))
        for one in PERTURBATIONS
    ]
    write_records(tmp_path / reality_gap.TABLE, rows[:-1])
    message = (
        f"{tmp_path / reality_gap.TABLE}: design 162 has [0, 1] controllers in the perturbations of the study; give as "
        "many in each, at least 1"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        reality_gap.rewrite(Data(tmp_path), tmp_path / "told")


def test_bodies_none_of_which_succeeds_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(homeostasis_of_bodies, "chosen_bodies", lambda *given: {})
    with pytest.raises(ValueError, match=r"^sweep: no body succeeds from everywhere; give it more steps, or a larger"):
        homeostasis_of_bodies.study(tmp_path, BodyHomeostasis(bodies=4, controllers=2, sweep=SHORT, samples=50))


@pytest.mark.kernels
def test_a_body_whose_controllers_all_fail_is_told_with_the_settings_of_its_sweep(tmp_path):
    hard = RealityGap(sweep=replace(SHORT, weights=3, radius=1e-5, steps=10))
    message = (
        "sweep: no controller of design 6553 solves all environments with sweep.weights=3, sweep.radius=1e-05, "
        "sweep.steps=10; give it more steps or weights, or a larger radius"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        reality_gap.study(tmp_path, hard)
