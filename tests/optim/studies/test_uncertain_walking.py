"""The study of walking on a floor that is not known exactly: few draws at a time beside all of them."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from optim.experiments.tables import read_records
from optim.studies.beyond import uncertain_walking
from optim.studies.beyond.uncertain_walking import ARMS, STUDY, UncertainWalking, speeds
from robots.uncertainty import HELD_OUT, Uncertainty
from robots.world import Terrain

QUICK = UncertainWalking(seconds=0.5, seeds=1, robots=("quadruped",), draws=2, held_out=3)


def test_draws_that_judge_are_others_than_those_of_searches():
    settings = UncertainWalking()
    unknown, actuators = Uncertainty.parse(settings.uncertain), settings.problem("quadruped").robot.actuators
    searched = unknown.draw(settings.draws, actuators=actuators)
    judging = unknown.draw(settings.held_out, HELD_OUT, actuators=actuators)
    slopes = [one.slope for one in (*searched, *judging)]
    assert len(set(slopes)) == 16 + 64


@pytest.mark.kernels
def test_speeds_are_those_of_the_robot_under_each_draw():
    problem = QUICK.problem("quadruped", "f64")
    point = problem.space.sample(np.random.default_rng(2), 1)[0]
    robot = problem.robot_of(point)
    found = speeds(robot, QUICK)
    (first, *_) = Uncertainty.parse(QUICK.uncertain).draw(3, HELD_OUT, actuators=robot.actuators)
    alone = robot.perturbed(first).simulate((), robot.drawn_terrain(Terrain(), first)).measures["speed"][0]
    assert found.shape == (3,) and found[0] == pytest.approx(alone, rel=1e-9)


@pytest.mark.slow  # as that of tasks, whose runs are judged alike
@pytest.mark.kernels
def test_runs_are_judged_and_the_table_is_enough_to_go_on(tmp_path):
    told = []
    uncertain_walking.study(tmp_path / "a", QUICK, told.append)
    assert told[-1] == 1.0
    rows = read_records(tmp_path / "a" / "runs.csv")
    assert [(row["robot"], row["search"], row["seed"]) for row in rows] == QUICK.runs
    assert all((tmp_path / "a" / name).exists() for name in STUDY.writes)
    page = (tmp_path / "a" / "table.md").read_text()
    assert all(arm.label in page for arm in ARMS.values()) and "quadruped, 40 variables" in page

    (tmp_path / "b").mkdir()
    for name in ("uncertain-walking.json", "runs.csv"):
        shutil.copy(tmp_path / "a" / name, tmp_path / "b")
    uncertain_walking.study(tmp_path / "b", QUICK)
    assert not (tmp_path / "b" / "runs").exists()
    assert (tmp_path / "b" / "table.md").read_bytes() == (tmp_path / "a" / "table.md").read_bytes()
    with pytest.raises(ValueError, match="draws"):
        uncertain_walking.study(tmp_path / "b", replace(QUICK, draws=3))
