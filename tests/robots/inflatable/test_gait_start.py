"""Searches that begin at a gait: its variables give it back, and what cannot say it is refused."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from graded import tabled

from optim.problems.inflatable.body_genes import EMPTY_CORE
from optim.problems.inflatable.problem import GaitProblem
from robots.inflatable import INCHING, ROLLING
from robots.inflatable.design import InflatableDesign, save_design
from robots.world import Terrain

HILL = (Terrain(15.0),)
LEVELS = np.random.default_rng(0).random((8, 2)).round(3)
TIMES = {"motion_steps": np.full(2, 100), "settle_steps": np.array([0, 700])}
GRADED = InflatableDesign(3000.0, 70.0, tabled(LEVELS, np.eye(2), 5, **TIMES))


def point(problem, design):
    values = problem.start_values(design)
    assert list(values) == list(problem.space.names)
    return problem.space.validate(np.array(list(values.values())))


@pytest.mark.parametrize("design", [INCHING, ROLLING])
def test_bits_give_back_a_binary_gait(design):
    problem = GaitProblem(HILL, encoding="bits", columns=8, repeats=2)
    found = problem.design(point(problem, design))
    assert found == design


def test_graded_genes_give_back_levels_and_times():
    problem = GaitProblem(HILL, encoding="graded", columns=2)
    found = problem.design(point(problem, GRADED))
    assert (found.pressure, found.orientation) == (3000.0, 70.0)
    np.testing.assert_array_equal(found.schedule.levels, GRADED.schedule.levels)
    assert found.schedule.settle_steps.tolist() == [0, 700]


def test_an_empty_core_begins_inside_of_what_says_so():
    problem = GaitProblem(HILL, encoding="graded", columns=2)
    values = problem.start_values(replace(GRADED, pressure=0.0))
    assert values["pressure"] == EMPTY_CORE / 2
    assert problem.design(list(values.values())).pressure == 0.0


def test_what_is_fixed_does_not_start():
    problem = GaitProblem(HILL, encoding="graded", columns=2, pressure=0.0, orientation=90.0)
    assert not {"pressure", "orientation"} & set(problem.start_values(GRADED))


@pytest.mark.parametrize(
    ("encoding", "columns", "design", "message"),
    [
        ("codes", 2, GRADED, "start: encoding 'codes' cannot say a gait; choose bits, graded or graded-wave"),
        ("graded-pattern", 2, GRADED, "start: encoding 'graded-pattern' cannot say a gait"),
        ("graded", 4, GRADED, "start: a gait of 2 columns is not allowed; the search has 4"),
        ("bits", 2, GRADED, "start: bits cannot say levels between 0 and 1, nor times; choose encoding graded"),
    ],
)
def test_gaits_that_an_encoding_cannot_say_are_refused(encoding, columns, design, message):
    with pytest.raises(ValueError, match=message):
        GaitProblem(HILL, encoding=encoding, columns=columns).start_values(design)


@pytest.mark.usefixtures("simulator")
def test_the_command_starts_at_a_file(tmp_path, morpholab):
    save_design(GRADED, tmp_path / "start.json")
    code, _, error = morpholab(
        f"codesign --terrain flat --geometry small --encoding graded --columns 2 --steps 50 --method genetic "
        f"--population 2 --generations 0 --start {tmp_path / 'start.json'} --start-orientation 60 "
        f"--out {tmp_path / 'run'} --quiet --threads 1"
    )
    assert code == 0, error
    start = tomllib.loads((tmp_path / "run" / "config.toml").read_text())["method"]["start"]
    assert start["pressure"] == 3000.0 and start["orientation"] == 60.0 and start["settle_2"] == 700.0
    best = json.loads((tmp_path / "run" / "best.json").read_text())
    assert best["format"].startswith("morpholab-graded")
