"""Studies of the two-wheel vehicle of chapter 3, on short runs and coarse grids."""

import json
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from types import SimpleNamespace

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.search_evaluations import SearchEvaluations
from optim.experiments.tables import read_records, read_table, write_records
from optim.studies.catalogue import STUDIES as CATALOGUE
from optim.studies.chapter3 import rover_pre_optimisation, rover_success, rover_sweep
from optim.studies.chapter3.rover_pre_optimisation import PreOptimisation, RoverProblem, front_of
from optim.studies.chapter3.rover_success import RoverGrid, RoverSuccess, successes
from optim.studies.chapter3.rover_sweep import RoverSweep
from robots.braitenberg import Sweep
from robots.rover import BEST, Rover, simulate


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RoverGrid(1), "weights: 1 is not allowed; give a whole number, at least 2"),
        (lambda: RoverGrid(precision="f16"), "precision: 'f16' is unknown; choose one of f32, f64"),
        (lambda: RoverProblem("none"), "controller: 'none' is unknown; choose one of unit, evolved"),
        (lambda: RoverSweep(theory=Sweep(5)), "theory: 5 weights are not allowed beside 31"),
        (lambda: RoverSweep(1), "bodies: 1 is not allowed; give a whole number, at least 2"),
        (lambda: PreOptimisation(budget=0), "budget: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_mistakes_in_studies_are_one_line(make, message):
    with pytest.raises(ValueError) as raised:
        make()
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


@pytest.mark.kernels
def test_a_grid_shares_sweeps_between_mirror_images_and_says_what_single_runs_say(tmp_path):
    settings, design = RoverGrid(5, steps=900), Rover(BEST).vehicle.design
    image = Rover(BEST).mirrored.vehicle.design
    both = successes([image, design], settings, tmp_path / "a", threads=1)
    assert len(list((tmp_path / "a").glob("*.npz"))) == 1
    for found, number in zip(both, (image, design), strict=True):
        single = simulate(Rover.published(number), settings.pairs, steps=900, precision="f32", threads=1).success
        assert np.array_equal(found, single.reshape(5, 5, 4))
    assert both.any() and settings.pairs[1].tolist() == [-1.0, -0.5]


@pytest.mark.parametrize("damaged", [np.zeros((2, 2, 4)), np.zeros((2, 2, 3), bool)])
def test_a_grid_of_another_kind_is_tried_again(tmp_path, monkeypatch, damaged):
    reached = SimpleNamespace(success=np.arange(16).reshape(4, 4) % 3 == 0)
    monkeypatch.setattr(rover_success, "simulate", lambda *_, **__: reached)
    found = successes([1], RoverGrid(2), tmp_path / "a")
    (part,) = (tmp_path / "a").glob("design_1-*.npz")
    np.savez(part, success=damaged)
    with pytest.warns(UserWarning, match=r"design_1-.*: is damaged, and as good as missing \(success: (type|shape)"):
        assert np.array_equal(successes([1], RoverGrid(2), tmp_path / "a"), found)


@pytest.mark.kernels
def test_objectives_of_the_base_body_are_those_of_its_runs():
    problem = RoverProblem("evolved", steps=2500, threads=1)
    values = dict.fromkeys(("w1", "w2"), 1.0)
    base = {"body_mass": 999.973, "wheel_mass": 117.519, "castor_mass": 0.00666004, "wheel_radius": 0.260017}
    drives = {"speed": 2.59115, "command_range": 2.59255, "torque": 1.95026}
    point = problem.space.from_dict({**base, **drives, **values})
    judged = problem.evaluate(point)
    assert judged.details["solved"].tolist() == [4]  # as the published base does, with both weights at 1
    assert judged.objectives[0] == pytest.approx([-4 * Rover().success_distance, -7.13396], abs=1e-5)
    unit = RoverProblem(steps=2500, threads=1)
    assert np.array_equal(unit.evaluate(point[:7]).objectives, judged.objectives)
    with pytest.raises(ValueError, match="gradients: not allowed"):
        problem.evaluate_relaxed(point, 0.0, True)


def test_a_front_falls_so_that_the_last_that_solves_all_has_the_least_effort():
    objectives = np.array([[-4, -9], [-4, -7], [-9, -2], [-5, -6], [-9, -3], [np.nan, np.nan]], float)
    solved = np.array([4, 4, 1, 3, 2, 0], np.int8)
    front = front_of(
        [SearchEvaluations(np.arange(6.0)[None, :, None], objectives[None], solved[None], np.zeros((1, 6), bool))]
    )
    assert [row["point"].item() for row in front] == [1, 3, 2] and [row["effort"] for row in front] == [7, 6, 2]
    assert [row["solved"] for row in front] == [4, 3, 1] and [row["distance"] for row in front] == [4, 5, 9]


DATA = Path(__file__).parents[3] / "docs/data"


def told(data):
    CATALOGUE[data.name].rewrite(Data(data), data)


def test_matrices_and_counts_that_cannot_be_are_told(tmp_path):
    data = copytree(DATA / "rover-success", tmp_path / "rover-success")
    with np.load(data / "rover-success.npz") as file:
        whole = dict(file)
    for name in ("canonical, rigid bodies", "best, theoretical"):
        np.savez(data / "rover-success.npz", **{**whole, name: whole[name] + np.uint8(1)})
        with pytest.raises(ValueError, match=rf"rover-success.npz: {name} is no success matrix; it must have bytes"):
            told(data)
    np.savez(data / "rover-success.npz", **{name: whole[name] for name in list(whole)[:3]})
    with pytest.raises(ValueError, match=r"rover-success.npz: it has no array 'best, theoretical'"):
        told(data)
    (data / "rover-success.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"rover-success.npz: cannot be read \(File is not a zip file\)"):
        told(data)


def test_counts_of_bodies_that_cannot_be_are_told(tmp_path):
    data = copytree(DATA / "rover-sweep", tmp_path / "rover-sweep")
    rows = read_records(data / "rover-sweep.csv.gz")
    write_records(data / "rover-sweep.csv", [*rows[:2], {**rows[2], "rigid_any": 962}])
    with pytest.raises(ValueError, match=r"row 4 has 0 as rigid_all and 962 as rigid_any; they must be 0 to 961"):
        told(data)
    write_records(data / "rover-sweep.csv", rows)
    (data / "summary.json").write_text('{"seed": 1, "weights": 1}')
    with pytest.raises(ValueError, match=r"summary.json: weights: 1 is not allowed; give a whole number, at least 2"):
        told(data)


def test_base_bodies_that_are_not_told_are_named(tmp_path):
    data = copytree(DATA / "rover-pre-optimisation", tmp_path / "rover-pre-optimisation")
    summary = json.loads((data / "summary.json").read_text())
    for base, message in (
        (None, "base of unit: None"),
        ({**summary["unit"]["base"], "controllers": 0}, "controllers: 0"),
    ):
        (data / "summary.json").write_text(json.dumps({**summary, "unit": {"base": base}}))
        with pytest.raises(ValueError, match=rf"summary.json: {message} is not allowed"):
            told(data)


GRID = RoverGrid(5, steps=300, precision="f64")
THEORY = Sweep(5, radius=0.5, time_step=0.2, steps=500)


def small_success(folder, grid=GRID):
    rover_success.study(folder, RoverSuccess(grid, THEORY))


def small_sweep(folder, grid=GRID):
    rover_sweep.study(folder, RoverSweep(3, grid=grid, theory=THEORY))


def small_search(folder, grid=GRID):
    rover_pre_optimisation.study(folder, PreOptimisation(1, 120, weights=3, steps=grid.steps - 100))


STUDIES = {"rover-success": small_success, "rover-sweep": small_sweep, "rover-pre-optimisation": small_search}


@pytest.mark.kernels
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_writes_what_the_catalogue_says_goes_on_from_its_folder_and_refuses_others(name, tmp_path):
    study, folder = STUDIES[name], tmp_path / "a"
    study(folder)
    files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert {path.name for path in files} >= set(CATALOGUE[name].writes)
    parts = sorted(path for path in files if path.match("*-????????????????.npz") and path.parent.name != "theory")
    parts[0].unlink()
    study(folder)
    assert {path: path.read_bytes() for path in files} == files  # bit for bit, the part that was missing too
    with pytest.raises(ValueError, match=r"of other settings .*; name another folder"):
        study(folder, RoverGrid(5, steps=301, precision="f64"))
    (tmp_path / "told").mkdir()
    CATALOGUE[name].rewrite(Data(folder), tmp_path / "told")
    again = {path.name: path.read_bytes() for path in (tmp_path / "told").iterdir()}
    assert again.keys() >= set(CATALOGUE[name].writes)
    assert all((folder / file).read_bytes() == content for file, content in again.items())
    if name == "rover-pre-optimisation":
        header, rows = read_table(folder / "rover-fronts.csv")
        assert header[-2:] == ["w1", "w2"] and all(row[-2:] == ["1.0", "1.0"] for row in rows if row[0] == "unit")
        assert {len(row) for row in rows} == {len(header)} and {row[0] for row in rows} == {"unit", "evolved"}
    if name == "rover-sweep":
        the_table_holds_the_metrics_of_the_grids(folder)


@pytest.mark.kernels
def test_another_theory_is_refused_before_rigid_bodies_are_tried(tmp_path, monkeypatch):
    def swept(*_, **__):
        raise AssertionError("the rigid bodies were tried")

    monkeypatch.setattr(rover_success, "successes", swept)
    for kind, settings in ((rover_success, RoverSuccess(GRID)), (rover_sweep, RoverSweep(3, grid=GRID, theory=THEORY))):
        folder = tmp_path / kind.__name__
        with pytest.raises(AssertionError, match="rigid bodies"):
            kind.study(folder, replace(settings, theory=THEORY))  # whose sweep is in its folder then
        with pytest.raises(ValueError, match="of other settings"):
            kind.study(folder, replace(settings, theory=replace(THEORY, radius=0.6)))


def the_table_holds_the_metrics_of_the_grids(folder):
    header, rows = read_table(folder / "rover-sweep.csv")
    summary = json.loads((folder / "summary.json").read_text())
    assert header[:5] == ["design", "rigid_all", "rigid_any", "rigid_M_L", "rigid_M_CF"] and len(rows) == 3
    for row in rows:
        reached = successes([int(row[0])], GRID, folder / "success")[0]
        every, some = (np.count_nonzero(reached.sum(-1) >= least) for least in (4, 1))
        assert [int(row[1]), int(row[2])] == [every, some] and float(row[3]) == every / 25
    assert summary["M_L, theoretical"]["mean"] == pytest.approx(np.mean([float(row[7]) for row in rows]))
