"""Files and folders that version 1.0 saved, see ``tests/data/v1_files/make.py``, are read, and go on."""

import json
import shutil
from pathlib import Path

import pytest

from robots.hardware import read_csv, write_csv
from robots.inflatable import load_design, save_design

DATA = Path(__file__).parent / "data/v1_files"


@pytest.mark.parametrize("name", ["inching", "graded", "timed"])
def test_gaits_are_read_and_written_alike(tmp_path, name):
    design = load_design(DATA / f"{name}.json")
    save_design(design, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (DATA / f"{name}.json").read_bytes()
    table = read_csv(DATA / f"{name}.csv")
    assert table.design == design
    write_csv(table, tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (DATA / f"{name}.csv").read_bytes()


@pytest.mark.parametrize("name", ["inching", "graded", "timed"])
def test_tables_of_gaits_are_made_alike(morpholab, name):
    code, *_ = morpholab(f"export {DATA / name}.json --csv now.csv --on-violation clip")
    assert code == 0 and Path("now.csv").read_bytes() == (DATA / f"{name}.csv").read_bytes()


def test_a_sampled_table_in_psi_is_a_gait(morpholab):
    assert morpholab(f"export {DATA / 'sampled.csv'} --csv now.csv --on-violation clip")[0] == 0
    assert read_csv("now.csv").design == load_design(DATA / "inching.json")


@pytest.mark.kernels
@pytest.mark.parametrize(("name", "steps"), [("block", 3744), ("walker", 5888), ("vehicle", 10000)])
def test_robots_are_simulated(morpholab, name, steps):
    code, said, error = morpholab(f"simulate --robot {DATA / name}.json --precision f64 --threads 1 --json")
    assert code == 0, error
    found = json.loads(said)
    assert found["status"] == "ok" and found["steps"] == steps


@pytest.mark.kernels
def test_a_calibration_is_played(morpholab):
    """A gait on the calibrated robot travels otherwise than on the published one."""
    gait = "simulate --gait inching --geometry small --columns 1 --repeats 1 --precision f64 --threads 1 --json"
    speeds = [
        json.loads(morpholab(f"{gait} {more}")[1])["speed"]
        for more in ("", f"--calibration {DATA / 'calibration.json'}")
    ]
    assert speeds[0] != speeds[1]


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("folder", "line", "table"),
    [
        ("sweep", "sweep --designs {} --weights 11", "table.csv"),
        ("training", "train --designs {} --methods random,de --repetitions 2 --budget-evaluations 20", "runs.csv"),
    ],
)
def test_studies_of_vehicles_go_on(morpholab, folder, line, table):
    """What 1.0 computed is kept to the byte; further bodies join it."""
    shutil.copytree(DATA / folder, folder)
    designs = "162,6553" if folder == "sweep" else "162"
    before = Path(folder, table).read_text()
    assert morpholab(f"{line.format(designs)} --threads 1 --quiet --out {folder}")[0] == 0
    assert Path(folder, table).read_text() == before
    assert morpholab(f"{line.format(designs + ',81')} --threads 1 --quiet --out {folder}")[0] == 0
    assert set(before.splitlines()) < set(Path(folder, table).read_text().splitlines())
