"""The comparison of searches for the inflatable robot with a hundred variables, with a stand-in for the simulator."""

import dataclasses
import json

import numpy as np
import pytest
from linear_robot import Linear
from study_checks import check_rewritten, check_runs_needed

from optim.experiments.tables import read_records, select
from optim.studies.beyond.inflatable_gradients import ARMS, FLAT, HILL, STUDY, WORLDS, Comparison, rewrite, study
from robots.inflatable import load_design

SHORT = Comparison(
    seconds=0.05, seeds=2, starts=2, columns=1, worlds=(FLAT, HILL), arms=("random", "memetic", "gradient")
)


@pytest.fixture
def linear(monkeypatch):
    stand_in = Linear()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in.simulate)
    monkeypatch.setattr("robots.inflatable.gradient.differentiate", stand_in.differentiate)
    return stand_in


def test_a_folder_goes_on_with_more_of_the_same_alone(linear, tmp_path):
    folder, short = tmp_path / "a", dataclasses.replace(SHORT, seeds=1, worlds=(FLAT,), arms=("random",))
    study(folder, short)
    study(folder, dataclasses.replace(short, seeds=2))
    assert len(read_records(folder / "runs.csv")) == 2
    for changes, message in (
        ({"columns": 2}, "columns: 1, not 2"),
        ({"geometry": "small"}, 'geometry: "small-closed", not "small"'),
    ):
        with pytest.raises(ValueError, match=message):
            study(folder, dataclasses.replace(short, **changes))
    (folder / "inflatable-gradients.json").write_text('{"format": "morpholab-inflatable-gradients-1"}')  # as before
    study(folder, short)
    assert json.loads((folder / "inflatable-gradients.json").read_text())["columns"] == 1


@pytest.mark.long
def test_runs_are_kept_and_tables_follow_from_what_they_found(linear, tmp_path):
    folder, reports = tmp_path / "whole", []
    study(folder, SHORT, reports.append)
    assert reports == sorted(reports) and reports[-1] == 1.0
    assert all((folder / name).is_file() for name in STUDY.writes)
    rows = read_records(folder / "runs.csv")
    assert len(rows) == 12 == len(SHORT.runs) and all(np.isfinite(row["speed"]) for row in rows)
    run = rows[0]
    replays = [call for call in linear.calls if call.precision == "f64"]
    assert len(replays) == 12 and all(call.perturbation == 1e-6 and len(call.designs) == 2 for call in replays)
    assert load_design(folder / "gaits" / "flat-random-0.json") == replays[0].designs[0]
    assert run["slowest"] <= run["speed"] <= run["fastest"]
    curves = select(read_records(folder / "curves.csv"), world=FLAT, search="random", seed=0)
    assert curves[-1]["best"] == run["score"] and curves[-1]["evaluations"] == run["evaluations"]
    page, summary = (folder / "table.md").read_text(), json.loads((folder / "summary.json").read_text())
    assert page.count("| random |") == 2 and "**gradient**" in page and summary["variables"] == 64
    assert summary["worlds"][FLAT]["best_without"] == "random"
    before = len(linear.calls)
    study(folder, SHORT)
    assert len(linear.calls) == before and (folder / "table.md").read_text() == page
    study(folder, dataclasses.replace(SHORT, seconds=0.1))  # the runs go on, and what they found is played again
    assert len([call for call in linear.calls[before:] if call.precision == "f64"]) == 12
    check_rewritten(rewrite, folder, tmp_path / "told")
    check_runs_needed(study, folder, SHORT)


def test_every_search_has_over_a_hundred_variables_in_every_world():
    settings = STUDY.scales["full"]
    for world, name, _ in settings.runs:
        problem = settings.problem(world, name)
        assert problem.space.size == 104 and problem.terrains == WORLDS[world]
        assert ARMS[name].gradients or not ARMS[name].relaxed
