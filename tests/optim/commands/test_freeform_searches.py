"""``morpholab codesign --robot freeform`` by evolution: maps of elites, patches of cells, lives that learn."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from run_products import log

from optim.problems.robot import RobotProblem
from optim.problems.robot_designing import seeded
from robots.freeform.grid import Grid
from robots.freeform.robot import FreeformRobot
from robots.hardware import read_channels
from robots.lattice_robot import save_robot
from robots.lattice_robot.presets import soft_quadruped

SMALL = "codesign --robot freeform --shape 4,3,2 --cycles 1 --frequency 12 --settling 0.02 --threads 1 --quiet"
TISSUES = [{"name": "soft"}, {"name": "bone", "youngs_modulus": 2e5, "density": 2e3, "muscle": False}]


@pytest.fixture(autouse=True)
def palette(tmp_path):
    (tmp_path / "palette.json").write_text(json.dumps(TISSUES))


def method_of(folder):
    return tomllib.loads((Path(folder) / "config.toml").read_text())["method"]


@pytest.mark.slow
@pytest.mark.kernels
def test_mass_and_energy_are_axes_of_a_map(morpholab, tmp_path):
    line = f"{SMALL} --palette palette.json --method map-elites --population 8 --out a --set bins=6"
    settings = """--set 'descriptors=["mass","energy"]' --set 'ranges={"energy":[0,0.002]}'"""
    code, out, error = morpholab(f"{line} {settings} --generations 2 --json")
    assert (code, error) == (0, "")
    assert method_of("a")["ranges"] == {"mass": [0.0, pytest.approx(0.048)], "energy": [0, 0.002]}
    assert json.loads(out)["numbers"]["cells"] > 2
    assert morpholab("codesign --resume --generations 3 --out a --quiet --threads 1")[0] == 0
    assert len(log(tmp_path / "a")) == 4
    assert morpholab("report a --no-player --out a.html")[0] == 0
    assert "elites by mass and energy, coloured by score" in (tmp_path / "a.html").read_text()


@pytest.mark.kernels
def test_a_map_has_axes_that_the_robot_suggests(morpholab):
    line = f"{SMALL} --method map-elites --population 4 --generations 1"
    assert morpholab(f"{line} --palette palette.json --out a")[0] == 0
    assert method_of("a")["descriptors"] == ["mass", "payload"] and len(method_of("a")["ranges"]) == 2
    assert morpholab(f"{line} --channels 3 --full --out b --terrain flat --terrain water")[0] == 0
    assert method_of("b")["descriptors"] == ["channels_flat"]


@pytest.mark.kernels
@pytest.mark.parametrize("method", [pytest.param("lamarckian --set learning=2", marks=pytest.mark.slow), "genetic"])
def test_patches_of_cells_evolve(morpholab, tmp_path, method):
    line = f"{SMALL} --population 4 --set patches=0.5 --method {method}"
    assert morpholab(f"{line} --generations 6 --out whole")[::2] == (0, "")
    assert morpholab(f"{line} --generations 4 --out parts")[0] == 0
    assert morpholab("codesign --resume --generations 6 --quiet --threads 1 --out parts")[0] == 0
    assert (tmp_path / "whole/log.jsonl").read_bytes() == (tmp_path / "parts/log.jsonl").read_bytes()
    assert log(tmp_path / "whole")[-1]["best"] > 0


def test_descriptors_that_are_none_are_told_in_one_short_line(morpholab):
    code, _, error = morpholab(f"""{SMALL} --shape 8,4,4 --method map-elites --set 'descriptors=["enrgy"]' --out a""")
    assert code == 2 and "descriptors: enrgy is no variable (presence_1_1_1, " in error and " and 376 more" in error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--shape 1,1,1", "shape: 1,1,1 is not allowed, as it has 1 cell; give at least 4"),
        ("--shape 3,1,1 --full", "shape: 3,1,1 is not allowed, as it has 3 cells; give at least 4"),
        ("--fields filtered --detail 9", "detail: 9.0 is not allowed; give a positive number, at most 4"),
        ("--fields network --detail 2.5", "detail: 2.5 is not allowed; give a whole number, at least 1"),
    ],
)
def test_grids_without_a_robot_and_other_details_are_refused_before_any_work(morpholab, tmp_path, options, message):
    code, out, error = morpholab(f"{SMALL} {options} --out a")
    assert (code, out, error) == (2, "", f"morpholab codesign: error: {message}\n")
    assert not (tmp_path / "a").exists()


def test_a_run_of_an_earlier_version_with_too_few_cells_is_still_read():
    description = RobotProblem(FreeformRobot(Grid((1, 1, 1)))).describe()
    assert RobotProblem.from_description(description).robot.grid.shape == (1, 1, 1)


@pytest.mark.kernels
def test_a_run_says_why_it_has_no_table_for_a_rig_and_how_to_get_one(morpholab, tmp_path):
    line = f"{SMALL} --method random --climbers 2 --generations 0 --full"
    code, out, error = morpholab(f"{line} --out a")
    why = "24 channels are not allowed; the rig dissertation has 8 lines for them: let regions share a wave, or give a"
    assert (code, error) == (0, "")
    assert f"\na: best.json\nno gait.csv: {why} rig of more; search with --channels 8\n" in out
    told = json.loads(morpholab("codesign --resume --out a --quiet --threads 1 --json")[1])["no_table"]
    assert told.endswith("; search with --channels 8")
    code, played, error = morpholab("simulate --gait a/best.json --out c --precision f32 --quiet")
    assert played.endswith(f"\nno gait.csv: {told.removesuffix('; search with --channels 8')}\n"), (code, played, error)
    (tmp_path / "many.toml").write_text(f"lines = {[f'valve{number}' for number in range(1, 25)]}\n")
    assert morpholab("export a --rig many.toml --csv many.csv --on-violation clip")[0] == 0
    table = read_channels("many.csv")
    assert table.channels[-1] == "valve24" and len(table.waves) == 24 and table.pressures.any(axis=0).all()
    code, out, _ = morpholab(f"{line} --channels 8 --out b")
    assert code == 0 and "\nb: best.json, gait.csv\n" in f"{out}\n" and "no gait.csv" not in out


def test_patches_need_fields_of_cells(morpholab):
    code, _, error = morpholab(f"{SMALL} --fields blobs --method genetic --set patches=0.5 --out a")
    assert code == 2 and "patches: only allowed where variables have places" in error


def test_mixtures_meet_no_props_and_are_refused_before_any_work(morpholab, tmp_path):
    line = f"{SMALL} --terrain flat+box:0.02,0.02,0.02,0.07,0 --method race --climbers 2 --generations 1 --out a"
    code, _, error = morpholab(line)
    assert code == 2 and "is not allowed with a method that goes through mixtures of tissues" in error
    assert not (tmp_path / "a").exists()


@pytest.mark.kernels
def test_a_race_through_true_robots_meets_props(morpholab):
    line = f"{SMALL} --terrain flat+box:0.02,0.02,0.02,0.07,0 --method race --climbers 2 --set moves=2 --set mixed=0"
    assert morpholab(f"{line} --generations 1 --out a")[::2] == (0, "")


@pytest.mark.kernels
def test_a_search_is_judged_by_what_becomes_of_a_prop(morpholab, tmp_path):
    line = "codesign --task push --robot freeform --shape 6,4,3 --cycles 1 --frequency 12 --settling 0.02 --threads 1"
    code, out, error = morpholab(f"{line} --method random --climbers 2 --generations 1 --out a --quiet")
    assert code == 0 and error == ""
    assert "best prop_distance: " in out and "task push: not succeeded, prop_distance is " in out
    assert " in flat+box:" in out and " and should be >= 0.03" in out


@pytest.mark.kernels
def test_a_search_is_judged_by_the_way_to_a_light(morpholab):
    line = f"{SMALL} --terrain flat+light:0.1,0.02 --objective minimise:remaining --method random --climbers 2 --out a"
    code, out, error = morpholab(f"{line} --generations 1")
    assert code == 0 and error == "" and "best minus remaining: " in out


@pytest.mark.kernels
@pytest.mark.parametrize("again", ["codesign --quiet", SMALL])
def test_seeds_that_had_not_begun_are_searched_when_the_others_go_on(morpholab, tmp_path, again):
    """Each has the noise of its seed, so the robot of one run is not quite that of another."""
    line = f"{SMALL} --method genetic --population 4 --generations 1 --seeds 0,1 --out a"
    assert morpholab(line)[0] == 0
    before = log(tmp_path / "a/seed-1"), (tmp_path / "a/seed-1/config.toml").read_bytes()
    shutil.rmtree(tmp_path / "a/seed-1")
    code, _, error = morpholab(f"{again} --resume --seeds 0,1 --generations 1 --out a")
    assert code == 0, error
    assert (log(tmp_path / "a/seed-1"), (tmp_path / "a/seed-1/config.toml").read_bytes()) == before


@pytest.mark.kernels
def test_a_robot_with_a_seed_of_its_own_keeps_it(morpholab, tmp_path):
    robot = replace(soft_quadruped(1), perturbation=1e-5, seed=7)
    save_robot(robot, tmp_path / "walker.json")
    line = "codesign --quiet --threads 1 --method random --climbers 2 --generations 0 --seeds 0,1 --out a"
    assert morpholab(f"{line} --robot walker.json")[0] == 0
    before = log(tmp_path / "a/seed-1")
    shutil.rmtree(tmp_path / "a/seed-1")
    assert morpholab(f"{line} --resume")[0] == 0
    assert log(tmp_path / "a/seed-1") == before


@pytest.mark.parametrize(("own", "then"), [(0, 3), (7, 7)])
def test_only_the_seed_of_the_search_becomes_that_of_the_robot(own, then):
    problem = RobotProblem(FreeformRobot(Grid((2, 2, 2)), seed=own, perturbation=1e-5)).describe()
    assert json.loads(seeded(problem, 0, 3)["robot"])["seed"] == then
