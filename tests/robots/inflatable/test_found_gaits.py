"""Gaits that searches have found, kept as files beside what the pages say of them."""

from pathlib import Path

import numpy as np
import pytest

from robots.inflatable import INCHING, ROLLING
from robots.inflatable.actuation import PUBLISHED_STEPS
from robots.inflatable.design import load_design
from robots.inflatable.robustness import GaitJudgement, judge_gait
from robots.inflatable.timing import gait_steps
from robots.world import Terrain

FOLDER = Path(__file__).parents[3] / "docs" / "gaits"
# By file, the slopes that a gait is for [degrees], and the least mean speed of eight noisy runs there [body lengths/s].
LEAST = {
    "both-genetic": {0.0: 0.11, 15.0: 0.035},
    "flat-genetic": {0.0: 0.3},
    "hill-cma": {15.0: 0.06},
    "hill-cma-gradient": {15.0: 0.035},
    "hill-genetic": {15.0: 0.03},
    "hill-program": {15.0: 0.09},
}
SLOPES = {"flat": {0.0}, "hill": {15.0}, "both": {0.0, 15.0}}


def test_every_found_gait_has_its_speeds_here():
    assert {path.stem for path in FOLDER.glob("*.json")} == set(LEAST)


@pytest.mark.parametrize("name", LEAST)
def test_a_found_gait_is_named_for_its_terrains_and_takes_no_longer_than_a_published_one(name):
    assert SLOPES[name.split("-")[0]] == set(LEAST[name])
    assert gait_steps(load_design(FOLDER / f"{name}.json").schedule) <= PUBLISHED_STEPS


def worth_its_file(name, slope, judged):
    return judged.speed >= LEAST[name][slope] and judged.physical


@pytest.mark.parametrize(("speed", "hard"), [(0.0895, 0.0), (0.0905, -0.02), (np.nan, 0.0), (0.0905, 0.0)])
def test_a_gait_that_is_too_slow_or_slides_is_not_worth_its_file(speed, hard):
    judged = GaitJudgement(np.full(8, speed), np.full(8, hard), np.full((8, 2), 0.1), np.ones(8), 181_000)
    assert worth_its_file("hill-program", 15.0, judged) == (speed > 0.09 and hard == 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("design", "slope"), [(ROLLING, 0.0), (INCHING, 0.0), (INCHING, 15.0)])
def test_gaits_by_hand_walk_where_they_belong(design, slope):
    judged = judge_gait(design, Terrain(slope))
    assert judged.physical, judged.to_document()


@pytest.mark.slow
@pytest.mark.parametrize(("file", "slope"), [("gaits/hill-program", 0.0), ("data/gait-hunt/gaits/genetic-2", 15.0)])
def test_gaits_that_live_on_what_the_model_gives_do_not_walk(file, slope):
    """Both get ahead as the model is, the one on level ground as fast as any published one."""
    judged = judge_gait(load_design(FOLDER.parent / f"{file}.json"), Terrain(slope))
    assert judged.speed > 0.01 and not judged.physical, judged.to_document()
    assert "bladders that keep their weight" in judged.faults[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "slope"), [(name, slope) for name, speeds in LEAST.items() for slope in speeds])
def test_a_found_gait_is_as_fast_as_told_and_physical(name, slope):
    judged = judge_gait(load_design(FOLDER / f"{name}.json"), Terrain(slope))
    assert worth_its_file(name, slope, judged), judged.to_document()
