"""The enumeration of layouts of bladders, with a stand-in for the simulator."""

import dataclasses
import json

import numpy as np
import pytest
from linear_robot import Linear
from study_checks import check_rewritten, check_runs_needed

from optim import cli
from optim.experiments.tables import read_records, select
from optim.studies.beyond.bladder_layouts import BODIES, EVOLVED, STUDY, Enumeration, rewrite, study
from robots.inflatable import load_design
from robots.inflatable.layout import WAYS_TO_LIE, laid, told_layout

SHORT = Enumeration(evaluations=8, evolved=2, seeds=2, starts=3, columns=2, bodies=("none", "1", "1,2"))


@pytest.fixture
def linear(monkeypatch):
    stand_in = Linear()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    return stand_in


def test_every_body_is_searched_by_as_many_evaluations_in_the_ways_that_it_lies(linear, tmp_path):
    folder, reports = tmp_path / "whole", []
    study(folder, SHORT, reports.append)
    assert reports == sorted(reports) and reports[-1] == 1.0
    assert all((folder / name).is_file() for name in STUDY.writes)
    rows = read_records(folder / "runs.csv")
    assert len(rows) == 8 and [row["evaluations"] for row in rows] == [8, 8, 8, 16] * 2
    for seed, way in enumerate(list(WAYS_TO_LIE)[:2]):
        for body in SHORT.bodies:
            path = folder / f"gaits/{body.replace(',', '')}-{seed}.json"
            assert load_design(path).bladders == laid(BODIES[body], way)
    assert select(rows, seed=1)[1]["found"] == 4 and select(rows, seed=1)[2]["found"] == (3, 4)
    evolved = select(rows, body=EVOLVED)
    assert len({told_layout(SHORT.problem(EVOLVED, 0).design(p).bladders) for p in sampled(SHORT)}) > 5
    replays = [call for call in linear.calls if call.precision == "f64"]
    assert len(replays) == 8 and all(call.perturbation == 1e-6 and len(call.designs) == 3 for call in replays)
    summary, page = json.loads((folder / "summary.json").read_text()), (folder / "table.md").read_text()
    assert summary["by_number"].keys() == {"0", "1", "2"} and summary["by_number"]["2"]["fastest"] == "1,2"
    assert summary["evolution"] == 16 and summary[EVOLVED]["each"] == [row["speed"] for row in evolved]
    assert summary["bodies"]["1"]["mean"] == pytest.approx((rows[1]["speed"] + rows[5]["speed"]) / 2)
    assert page.count("| 1,2 |") == 2 and "16 evaluations a run" in page
    before = len(linear.calls)
    study(folder, SHORT)
    assert len(linear.calls) == before and (folder / "table.md").read_text() == page
    longer = dataclasses.replace(SHORT, evaluations=16, evolved=0)
    study(folder, longer)  # the runs go on, and what they found is played again
    rows = read_records(folder / "runs.csv")
    assert [row["evaluations"] for row in rows] == [16] * 6 and "Evolution" not in (folder / "table.md").read_text()
    check_rewritten(rewrite, folder, tmp_path / "told")
    check_runs_needed(study, folder, SHORT)


def sampled(settings):
    """First points of evolution."""
    return settings.problem(EVOLVED, 0).space.sample(np.random.default_rng(0), 16)


def test_a_study_of_one_seed_has_no_intervals_of_bodies(linear, tmp_path):
    study(tmp_path / "one", dataclasses.replace(SHORT, seeds=1, evolved=0, bodies=("1", "1,2", "1,3")))
    summary = json.loads((tmp_path / "one/summary.json").read_text())
    assert summary["bodies"]["1"]["low"] is None and summary["by_number"]["1"]["low"] is None
    assert summary["by_number"]["2"]["bodies"] == 2
    with pytest.raises(ValueError, match=r"holds bladder-layouts of other settings \(columns: "):
        study(tmp_path / "one", dataclasses.replace(SHORT, seeds=1, columns=SHORT.columns + 1))
    assert summary["by_number"]["2"]["low"] < summary["by_number"]["2"]["mean"] < summary["by_number"]["2"]["high"]


def test_all_bodies_are_asked_by_default_and_no_others(tmp_path):
    assert len(STUDY.scales["medium"].bodies) == 76 and len(STUDY.scales["full"].runs) == 4 * 77
    with pytest.raises(ValueError, match=r"^bodies: '3' is unknown; choose one of none, 1, 2, "):
        study(tmp_path / "other", dataclasses.replace(SHORT, bodies=("3",)))


@pytest.mark.kernels
@pytest.mark.slow
def test_the_small_budget_runs(tmp_path):
    assert cli.main(["reproduce", "bladder-layouts", "--budget", "small", "--out", str(tmp_path / "a"), "--quiet"]) == 0
    rows = read_records(tmp_path / "a/runs.csv")
    assert {row["body"] for row in rows} >= {"none", EVOLVED}
    assert abs(select(rows, body="none")[0]["speed"]) < 0.05
