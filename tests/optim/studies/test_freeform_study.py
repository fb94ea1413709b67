"""The study of freeform robots: runs, their judgement, and tables that are enough to go on."""

import shutil

import pytest

from optim.experiments.tables import read_records
from optim.studies.beyond import freeform
from optim.studies.beyond.freeform import PROBLEMS, STUDY, Comparison

QUICK = Comparison(share=0.03, times=(0.5, 1.0), seeds=1, problems=("ground-48",), arms=("race", "hill-climb"))


def test_problems_have_as_many_variables_as_their_names_say():
    for name, problem in PROBLEMS.items():
        if name != "tuning":
            assert name.endswith(f"-{len(problem.robot.parameters)}"), name


def test_settings_that_are_not_allowed_are_one_line():
    with pytest.raises(ValueError, match="share: 0 is not allowed"):
        Comparison(share=0)


@pytest.mark.kernels
def test_runs_are_judged_and_tables_are_enough_to_go_on(tmp_path):
    told = []
    freeform.study(tmp_path / "a", QUICK, told.append)
    assert told[-1] == 1.0
    rows, trials = (read_records(tmp_path / "a" / f"{name}.csv") for name in ("runs", "trials"))
    assert [(row["search"], row["seconds"]) for row in rows] == [
        (arm, seconds) for arm in QUICK.arms for seconds in QUICK.marks("ground-48")
    ]
    found = [row for row in rows if row["score"] is not None]
    assert found and all(row["speed"] == pytest.approx(row["score"], abs=0.05) for row in found)
    starts = [row for row in trials if row["trial"] == "start"]
    assert len(starts) == 8 * len(found)
    page = (tmp_path / "a" / "table.md").read_text()
    assert "hill climbing" in page and "48 variables" in page
    assert all((tmp_path / "a" / name).exists() for name in STUDY.writes)

    (tmp_path / "b").mkdir()
    for name in ("freeform.json", "runs.csv", "curves.csv", "trials.csv"):
        shutil.copy(tmp_path / "a" / name, tmp_path / "b")
    freeform.study(tmp_path / "b", QUICK)
    assert not (tmp_path / "b" / "runs").exists()
    for name in ("table.md", "runs.csv", "summary.json"):
        assert (tmp_path / "b" / name).read_bytes() == (tmp_path / "a" / name).read_bytes()
