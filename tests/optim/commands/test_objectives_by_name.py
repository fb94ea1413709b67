"""``morpholab codesign --objective``: measures by name, through runs, resumes, fronts and reports."""

import json

import numpy as np
import pytest
from run_products import log

from optim.runs.config import read_config

FREEFORM = "codesign --robot freeform --shape 4,2,2 --full --cycles 1 --settling 0.02 --quiet"
SUM = "--objective speed --objective minimise:0.1*energy"


@pytest.mark.slow
@pytest.mark.kernels
def test_a_weighted_sum_is_climbed_by_gradients_and_goes_on_to_the_same_bits(morpholab, tmp_path):
    search = f"{FREEFORM} --method race --climbers 2 --set moves=4 {SUM}"
    code, out, error = morpholab(f"{search} --generations 3 --out a")
    assert (code, error) == (0, "") and out.startswith("best speed minus 0.1*energy: ")
    assert morpholab(f"{search} --generations 1 --out b")[0] == 0
    again = "codesign --resume --quiet --generations 3 --out b"
    assert morpholab(f"{again} --objective speed --objective minimise:0.10*energy")[0] == 0
    assert (tmp_path / "a/log.jsonl").read_bytes() == (tmp_path / "b/log.jsonl").read_bytes()
    first, *_, last = log(tmp_path / "a")
    assert last["best"] > first["best"]
    details = last["best_details"]
    assert last["best"] == pytest.approx(details["speed"] - 0.1 * details["energy"], rel=1e-12)
    for other in ("--objective speed", "--objective mean"):
        code, _, error = morpholab(f"{again} {other}")
        assert code == 2 and error.count("\n") == 1 and "is not what the run in b has, ['mean', 'speed'," in error
    assert "best speed minus 0.1*energy " in morpholab("status a")[1]
    assert morpholab("report a --no-player --quiet --out a.html")[0] == 0
    page = (tmp_path / "a.html").read_text()
    assert "speed along its heading (BL/s) minus 0.1 × work of the muscles in the last cycle (J)" in page
    assert "energy [J]" in page


@pytest.mark.kernels
def test_a_front_has_a_column_for_each_objective(morpholab, tmp_path):
    search = f"{FREEFORM} --method nsga2 --population 8 --generations 1 --objective speed --objective minimise:energy"
    assert morpholab(f"{search} --out a")[0] == 0
    assert read_config(tmp_path / "a")["objectives"] == [
        {"name": "speed", "unit": "BL/s"},
        {"name": "minus energy", "unit": "J"},
    ]
    front = json.loads((tmp_path / "a/front.json").read_text())
    assert front["objectives"] == ["speed", "minus energy"]
    values = np.array([design["objectives"] for design in front["designs"]])
    assert (values[:, 1] < 0).all()
    order = values[np.argsort(values[:, 0])]
    assert (np.diff(order[:, 1]) <= 0).all()  # who is faster takes more work
    assert morpholab("report a --no-player --quiet --out a.html")[0] == 0
    assert "minus energy [J]" in (tmp_path / "a.html").read_text()


@pytest.mark.kernels
def test_limits_cost_score_and_what_the_best_breaks_is_told(morpholab, tmp_path):
    search = f"{FREEFORM} --method genetic --population 4 --generations 1 --objective speed"
    code, out, error = morpholab(f'{search} --objective "energy <= 1e-4" --objective "mass>=0" --out a')
    assert (code, error) == (0, "") and out.startswith("best speed where energy <= 0.0001 and mass >= 0: -")
    last = log(tmp_path / "a")[-1]
    speed, energy = (last["best_details"][name] for name in ("speed", "energy"))
    assert last["best"] == pytest.approx(speed - 10 * (energy / 1e-4 - 1), rel=1e-12)
    assert f"\nbreaks energy <= 0.0001: {energy:.6g}\n" in out and "breaks mass" not in out
    assert (
        morpholab(
            "codesign --resume --generations 2 --out a --quiet --objective speed --objective 'energy<=1e-4' "
            "--objective 'mass >= 0'"
        )[0]
        == 0
    )
    code, _, error = morpholab("codesign --resume --generations 2 --out a --quiet --objective speed")
    assert code == 2 and "is not what the run in a has, ['mean', 'speed', 'energy <= 0.0001', 'mass >= 0']" in error
    assert "speed where energy <= 0.0001 and mass >= 0" in morpholab("status a")[1]
    assert morpholab("report a --no-player --quiet --out a.html")[0] == 0
    assert "where energy &lt;= 0.0001 and mass &gt;= 0" in (tmp_path / "a.html").read_text()


@pytest.mark.kernels
def test_vehicles_are_judged_by_named_measures(morpholab, tmp_path):
    search = "codesign --robot vehicle --climbers 2 --generations 0 --quiet"
    code, out, _ = morpholab(f"{search} --objective worst --objective minimise:closest --out a")
    assert code == 0 and out.startswith("best minus worst closest: -")
    code, _, error = morpholab("codesign --resume --out a --quiet --objective total --objective minimise:closest")
    assert code == 2 and "problem.objective: ['mean', 'minimise:closest'] is not what the run in a has" in error
    code, _, error = morpholab("codesign --resume --out a --generations 1")
    assert code == 0 and "generation 1/1: best minus worst closest -" in error
    code, out, _ = morpholab(f"{search} --objective total --out b")
    assert code == 0 and out.startswith("best total: -")
    code, _, error = morpholab("codesign --resume --out b --quiet --objective minimise:closest")
    assert code == 2 and "problem.objectives: 'minimise:closest' is not what the run in b has, 'total'" in error


@pytest.mark.parametrize(
    "line, why",
    [
        (f"{FREEFORM} --objective sped", "objective: 'sped' is unknown; did you mean speed? all measures: speed, "),
        (f"{FREEFORM} --objective 0*speed", "objective: '0*speed' is not allowed; give NAME, WEIGHT*NAME, "),
        (f"{FREEFORM} --objective=-1*speed", "what shall be low is minimise:NAME"),
        (f"{FREEFORM} --objective speed --objective minimise:2*speed", "objective: speed is given twice"),
        (f"{FREEFORM} --objective each {SUM}", "objective: each needs a method for several objectives"),
        (f"{FREEFORM} --objective each --slope 0 --slope 10", "method: hill-climb takes one objective, not speed_flat"),
        (f"{FREEFORM} --measure mass --objective speed", "measure: 'mass' is not used"),
        ("codesign --robot vehicle --objective total --objective environments", "are not allowed together"),
        ("codesign --terrain flat --objective minimise:energy", "gaits have mean, terrains and speed; --effort says"),
        ("codesign --terrain flat --objective mean --objective terrains", "give mean or terrains once"),
    ],
)
def test_bad_objectives_are_refused_in_one_line_before_any_work(morpholab, tmp_path, line, why):
    code, out, error = morpholab(f"{line} --out a")
    assert (code, out) == (2, "") and error.count("\n") == 1 and why in error
    assert not (tmp_path / "a").exists()


def test_the_speed_of_gaits_may_be_named(morpholab):
    code, _, error = morpholab("codesign --terrain flat --objective speed --objective terrains --out a")
    assert code == 2 and "'terrains' needs a method for several objectives" in error
