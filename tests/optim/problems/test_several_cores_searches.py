"""Searches, commands and reports of the inflatable robot with several cores."""

import functools
import json
import tomllib

import numpy as np
import pytest
from graded import TINY_TWO
from run_products import log

from optim.problems.inflatable.body_genes import EMPTY_CORE
from optim.problems.inflatable.problem import GaitProblem
from robots import inflatable
from robots.inflatable import NAMED_GEOMETRIES
from robots.inflatable.design import load_design
from robots.inflatable.kind import GEOMETRIES
from robots.world import Terrain

FULL = 12e3


def test_a_search_frees_a_pressure_for_each_core():
    problem = GaitProblem((Terrain(),), geometry="two-core", encoding="graded", columns=2)
    assert problem.space.names[:3] == ("orientation", "pressure_1", "pressure_2")
    assert problem.space.low[1:3].tolist() == [EMPTY_CORE] * 2
    point = problem.space.from_dict(problem.space.to_dict(problem.space.low) | {"pressure_2": 3e3})
    assert problem.design(point).pressure == (0.0, 3e3)
    again = GaitProblem.from_description(json.loads(json.dumps(problem.describe())))
    assert again.describe() == problem.describe()
    fixed = GaitProblem((Terrain(),), pressure=[FULL, 0.0], geometry="two-core", columns=1)
    assert fixed.pressure == (FULL, 0.0) and "pressure_1" not in fixed.space.names
    assert GaitProblem.from_description(json.loads(json.dumps(fixed.describe()))).pressure == (FULL, 0.0)


@pytest.fixture
def tiny(monkeypatch):
    """The two-core robot of commands, small, quick and driven so."""
    monkeypatch.setitem(NAMED_GEOMETRIES, "two-core", TINY_TWO)
    drive = functools.partial(
        inflatable.InflatableActuation, inflation_rate=0.05, pressure_ramp=100.0, hold_steps=50, settle_steps=30
    )
    monkeypatch.setattr("robots.calibration.properties.InflatableActuation", drive)


@pytest.mark.slow
@pytest.mark.kernels
def test_the_slopes_of_a_problem_are_by_each_core(tiny):
    """Those of an empty core are cut where its gene is."""
    problem = GaitProblem(
        (Terrain(),),
        geometry="two-core",
        encoding="graded",
        columns=1,
        steps=60,
        ramp_steps=60,
        precision="f64",
        threads=1,
    )
    space = problem.space.relaxed()
    values = space.to_dict((space.low + space.high) / 2)
    point = space.from_dict(values | {"pressure_1": 6e3, "pressure_2": -1e3, "settle_1": 0.0})
    found = problem.evaluate_relaxed([point], 0.0, True)
    assert found.status.tolist() == ["ok"] and np.isfinite(found.gradients).all()
    assert found.gradients[0, 1] != 0 and found.gradients[0, 2] == 0


@pytest.mark.kernels
def test_a_small_search_with_the_simulator_goes_on_where_it_stopped(morpholab, tiny, tmp_path):
    line = "codesign --terrain flat --geometry two-core --columns 1 --repeats 1 --climbers 2 --seed 3 --quiet"
    drawn = "robots.inflatable.view.picture.save_motion_picture"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawn, lambda design, terrain, path, **_: path.write_text("drawn"))
        code, out, error = morpholab(f"{line} --generations 2 --out a --json")
        assert code == 0, error
        assert json.loads(out)["files"] == ["best.json", "robot_flat.png"]  # no table for a rig
        assert morpholab(f"{line} --generations 1 --out b")[0] == 0
        assert morpholab("codesign --resume --generations 2 --out b --quiet")[0] == 0
    assert (tmp_path / "a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
    best = load_design(tmp_path / "a/best.json")
    point = log(tmp_path / "a")[-1]["best_point"]
    assert best.pressure == (point["pressure_1"], point["pressure_2"])
    code, _, error = morpholab("export a --csv gait.csv")
    assert code == 2 and "give all cores one" in error and error.count("\n") == 1
    code, _, error = morpholab("report a --no-player --out page.html --quiet")
    page = (tmp_path / "page.html").read_text()
    assert code == 0 and "Core pressure 2" in page and "give all cores one" in page


@pytest.mark.usefixtures("simulator")
def test_options_take_a_pressure_for_each_core(morpholab, tmp_path):
    line = "codesign --terrain flat --geometry two-core --climbers 2 --generations 1 --columns 2 --quiet"
    assert morpholab(f"{line} --start-pressure 9000,1000 --out a")[0] == 0
    config = tomllib.loads((tmp_path / "a/config.toml").read_text())
    assert config["method"]["start"] == {"pressure_1": 9e3, "pressure_2": 1e3}
    assert morpholab(f"{line} --start-pressure 5000 --out b")[0] == 0
    config = tomllib.loads((tmp_path / "b/config.toml").read_text())
    assert config["method"]["start"] == {"pressure_1": 5e3, "pressure_2": 5e3}
    assert morpholab(f"{line} --free control --gait rolling --pressure 12000,0 --out c")[0] == 0
    assert tomllib.loads((tmp_path / "c/config.toml").read_text())["problem"]["pressure"] == [FULL, 0.0]
    assert morpholab("codesign --resume --out c --generations 2 --quiet")[0] == 0
    code, out, _ = morpholab("simulate --gait rolling --geometry two-core --pressure 0,12000 --json")
    assert code == 0 and json.loads(out)["pressure"] == [0.0, FULL]
    assert morpholab("simulate --gait rolling --geometry two-core --pressure 0,12000 --out d")[0] == 0
    assert not (tmp_path / "d/gait.csv").exists() and load_design(tmp_path / "d/design.json").pressure == (0.0, FULL)
    for wrong in ("--pressure 1,x", "--pressure 1,,2", "--pressure=-1,2"):
        code, _, error = morpholab(f"simulate --gait rolling --geometry two-core {wrong}")
        assert code == 2 and "is not allowed; give a finite number, at least 0 Pa" in error
    code, _, error = morpholab(f"{line} --pressure 1,2 --out e")
    assert code == 2 and "pressure: 1,2 would fix what is free" in error


def test_commands_know_every_named_geometry():
    assert set(GEOMETRIES) == set(NAMED_GEOMETRIES)
