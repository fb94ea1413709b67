"""The study of what gradients add to searches of gaits for a real floor."""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.judged_runs import warm_up
from optim.experiments.tables import read_records, write_records
from optim.problems.inflatable.problem import GaitProblem
from optim.studies.beyond.robust_gaits import searches
from optim.studies.beyond.robust_gaits.searches import ARMS, STUDY, RobustSearches, Searches
from taichi_sim.base.files import write_text

QUICK: RobustSearches = STUDY.scales["small"]
SCREEN = [
    {"slope": 0.0, "levels": levels, "full": 1, "shift": shift, "settling": 0.0, "speed": speed}
    for levels, shift, speed in (("00000001", 1, 0.1), ("00100111", 1, 0.4), ("00000011", 7, 0.2))
]


@dataclass
class Judged:
    objectives: np.ndarray


def row(search, seed, searched, **more):
    judged = {"nominal": 0.4, "speed": searched, "worst": 0.1, **more}
    about = {"ground": "slope-9", "search": search, "seed": seed, "seconds": 480.0, "start": "00100111+1"}
    return {**about, "evaluations": 50, "searched": searched, **judged}


@pytest.mark.parametrize("arm", ["genetic", "gradient-levels"])
def test_searches_begin_at_the_best_waves_a_little_inside(tmp_path, arm):
    runs = Searches(tmp_path, replace(QUICK, arms=(arm,), seeds=4), SCREEN)
    assert [runs.start(0.0, seed)["levels"] for seed in range(3)] == ["00100111", "00000011", "00000001"]
    with pytest.raises(ValueError, match="seeds: 4 are not allowed; there are 3 waves"):
        runs.start(0.0, 3)
    entry, problem = runs.contest(0.0, 0).entries[arm], QUICK.problem(0.0, arm)
    design = problem.design(problem.space.from_dict(entry.settings["start"]))
    wave = np.where(np.array([0, 0, 1, 0, 0, 1, 1, 1]), 0.95, 0.05)
    assert np.allclose(design.schedule.inflation, [np.roll(wave, -bladder) for bladder in range(8)])
    assert (problem.risk, problem.weight, problem.encoding) == ("worst", "physical", ARMS[arm].encoding)


def test_what_is_told_are_pairs_of_the_same_starts():
    rows = [row("genetic", 0, 0.1), row("genetic", 1, 0.2), row("memetic", 1, 0.25), row("memetic", 0, 0.2)]
    rows += [row("memetic", 2, 0.9), row("hill-climb", 0, None, speed=None, worst=None, nominal=None)]
    told = searches._of_ground(rows)
    (pair,) = told["pairs"]
    assert (pair["of"], pair["over"], pair["starts"]) == ("memetic", "genetic", 2)
    assert pair["difference"] == pytest.approx(0.075) and pair["low"] < 0.075 < pair["high"]
    assert told["searches"]["hill-climb"]["searched"] is None and told["searches"]["memetic"]["seeds"] == 3


def test_the_table_of_runs_is_enough_to_tell_and_is_checked(morpholab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = Path("data/robust-searches")
    data.mkdir(parents=True)
    write_records(data / "runs.csv", [row("genetic", 0, 0.1), row("memetic", 0, 0.2)])
    write_text(data / "summary.json", json.dumps({"settings": RobustSearches().describe()}))
    code, _, error = morpholab("reproduce robust-searches --from-data data --out told")
    assert code == 0, error
    page = Path("told/table.md").read_text()
    assert "memetic less genetic: +0.100 BL/s in the mean (n = 1 starts)" in page
    assert "| **memetic** | 1 | 50 | 0.200" in page
    for rows, message in (
        ([row("swarm", 0, 0.1)], "swarm"),
        ([{**row("genetic", 0, 0.1), "ground": "ice"}], "ice"),
        ([row("genetic", 0, 0.1)] * 2, "slope-9 genetic 0 is there twice"),
        ([row("genetic", 0, 0.1, worst=None)], "slope-9 genetic 0 lacks some of searched"),
        ([row("genetic", 0, 0.1, worst=float("nan"))], "worst"),
    ):
        write_records(data / "runs.csv", rows)
        code, _, error = morpholab("reproduce robust-searches --from-data data --out again")
        assert code == 2 and "runs.csv" in error and message in error and len(error.strip().splitlines()) == 1


def test_settings_that_no_search_can_have_are_refused():
    with pytest.raises(ValueError, match="arms: 'swarm' is unknown"):
        replace(QUICK, arms=("swarm",))
    with pytest.raises(ValueError, match="floor: 'ice'"):
        replace(QUICK, floor="ice")
    with pytest.raises(ValueError, match=r"slopes: 9\.1234567 is not allowed; give at most six digits"):
        replace(QUICK, slopes=(9.1234567,))


def test_what_problems_refuse_is_refused_before_the_folder_is_made(tmp_path):
    for wrong in (replace(QUICK, warm_up=70_000), replace(QUICK, draws=5000)):
        with pytest.raises(ValueError):
            searches.study(tmp_path / "a", wrong)
        assert not (tmp_path / "a").exists()


def test_a_draw_that_diverges_counts_as_standing_still(tmp_path, monkeypatch):
    runs = Searches(tmp_path, replace(QUICK, arms=("hill-climb",)), SCREEN)
    start = runs.contest(0.0, 0).entries["hill-climb"].settings["start"]
    monkeypatch.setattr(searches, "best_of_search", lambda *args: (start, 3))
    speeds = [{"draw": draw, "speed": speed} for draw, speed in ((-1, 0.5), (0, float("nan")), (1, 0.4))]
    monkeypatch.setattr(searches, "judged", lambda *args: speeds)
    monkeypatch.setattr(GaitProblem, "evaluate", lambda *args: Judged(np.array([[0.3]])))
    found = runs.judged(("slope-0", "hill-climb", 0))
    assert (found["speed"], found["worst"], found["nominal"], found["searched"]) == (0.2, 0.0, 0.5, 0.3)


def test_kernels_are_ready_for_gradients_of_gaits_which_true_ones_lack(monkeypatch):
    asked = []
    problem = QUICK.problem(0.0, "gradient-hill-climb")

    def evaluate(problem, request):
        asked.append((request.wants, request.sharpness))
        return type("Judged", (), {"failed": np.zeros(1, bool)})

    monkeypatch.setattr("optim.experiments.judged_runs.evaluate_request", evaluate)
    warm_up(problem, True)
    warm_up(problem, False)
    assert asked == [("gradients", 0.0), ("points", np.inf)]


@pytest.mark.slow  # two searches, two minutes
@pytest.mark.kernels
def test_runs_are_judged_and_the_table_is_enough_to_go_on(tmp_path):
    told = []
    searches.study(tmp_path / "a", QUICK, told.append)
    assert told[-1] == 1.0
    rows = read_records(tmp_path / "a" / "runs.csv")
    assert [(row["ground"], row["search"], row["seed"]) for row in rows] == QUICK.runs
    assert all(row["searched"] >= 0.24 and row["speed"] > 0.2 for row in rows)
    assert all((tmp_path / "a" / name).exists() for name in STUDY.writes)
    (tmp_path / "b").mkdir()
    for name in ("robust-searches.json", "runs.csv"):
        shutil.copy(tmp_path / "a" / name, tmp_path / "b")
    searches.study(tmp_path / "b", QUICK)
    assert not (tmp_path / "b" / "runs").exists()
    assert (tmp_path / "b" / "table.md").read_bytes() == (tmp_path / "a" / "table.md").read_bytes()
