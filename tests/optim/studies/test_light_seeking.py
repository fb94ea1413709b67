"""The study of a walker that finds a light: trained under a fan of lights, judged under others."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from optim.experiments.tables import read_records
from optim.studies.beyond import light_seeking
from optim.studies.beyond.light_seeking import ARMS, NEAR, STUDY, WIDEST, LightSeeking

QUICK = LightSeeking(seconds=0.5, seeds=1, cycles=1, lights=2, held_out=3)


def test_lights_that_judge_are_others_than_those_of_training():
    settings = LightSeeking()
    places = np.array([world.light for world in (*settings.training, *settings.judging)])
    assert len(places) == 8 + 64 == len(np.unique(places, axis=0))
    angles = np.degrees(np.arctan2(*places.T[::-1]))
    assert np.abs(angles).max() <= WIDEST and np.hypot(*places.T).min() >= NEAR
    assert angles[:8] == pytest.approx([-52.5, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 52.5])


@pytest.mark.slow  # as that of tasks, whose runs are judged alike
@pytest.mark.kernels
def test_runs_are_judged_and_the_table_is_enough_to_go_on(tmp_path):
    told = []
    light_seeking.study(tmp_path / "a", QUICK, told.append)
    assert told[-1] == 1.0
    rows = read_records(tmp_path / "a" / "runs.csv")
    assert [(row["robot"], row["search"], row["seed"]) for row in rows] == QUICK.runs
    assert all((tmp_path / "a" / name).exists() for name in STUDY.writes)
    page = (tmp_path / "a" / "table.md").read_text()
    assert all(arm.label in page for arm in ARMS.values()) and "of 3, each seed" in page

    (tmp_path / "b").mkdir()
    for name in ("light-seeking.json", "runs.csv"):
        shutil.copy(tmp_path / "a" / name, tmp_path / "b")
    light_seeking.study(tmp_path / "b", QUICK)
    assert not (tmp_path / "b" / "runs").exists()
    assert (tmp_path / "b" / "table.md").read_bytes() == (tmp_path / "a" / "table.md").read_bytes()
    with pytest.raises(ValueError, match="cycles"):
        light_seeking.study(tmp_path / "b", replace(QUICK, cycles=2))
