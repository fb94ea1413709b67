"""Gaits that searches have found, kept as files beside what the pages say of them."""

from pathlib import Path

import pytest

from robots.gaits import load_gait, steps_of
from robots.inflatable_actuation import PUBLISHED_STEPS
from robots.judgement import judge_gait
from robots.terrain import Terrain

FOLDER = Path(__file__).parents[1] / "docs" / "gaits"
GAITS = sorted(FOLDER.glob("*.json"))
TERRAINS = {"hill": Terrain(15.0), "flat": Terrain()}
LEAST = {"flat-genetic": 0.3, "hill-genetic": 0.03}  # body lengths/s, of the mean of eight noisy runs


@pytest.mark.parametrize("path", GAITS, ids=lambda path: path.stem)
def test_a_found_gait_is_named_for_its_terrain_and_takes_no_longer_than_a_published_one(path):
    assert path.stem.split("-")[0] in TERRAINS and path.stem in LEAST
    assert steps_of(load_gait(path)) <= PUBLISHED_STEPS


@pytest.mark.slow
@pytest.mark.parametrize("path", GAITS, ids=lambda path: path.stem)
def test_a_found_gait_is_as_fast_as_told_and_physical(path):
    judged = judge_gait(load_gait(path), TERRAINS[path.stem.split("-")[0]])
    assert judged.speed >= LEAST[path.stem] and judged.faults == ()
