"""What a user does with a rigid robot, or one that feels, from the search to the report, by the command line alone."""

import json
import shlex

import pytest
from articulated_files import CART, CRAWLER

from taichi_sim.base.short_text import decimal

pytestmark = [pytest.mark.kernels, pytest.mark.filterwarnings("ignore:model. ignored")]

QUICK = "--threads 1 --quiet"
SEARCH = f"--climbers 2 --generations 0 {QUICK}"
SHORE = "ramp:-10,0.1+water:0.02"
# By name: the robot, what belongs to it alone, the world, and the objective with its unit.
KINDS = {
    "quadruped": ("legged", "--looks 12 --limb-length 0.5", "--environment 2", "light", "1/m²", "0,9"),
    "rover": ("rover", "--looks 12 --body-mass 5", "--environment 2", "approach", "m", "-4,4"),
    "model of MuJoCo": ("crawler.xml", "--duration 0.1 --friction inf", "", "speed", "m/s", "flat"),
    "model of free sizes": (
        "crawler.xml",
        "--duration 0.1 --body-sizes front=0.5:2 --body-sizes trunk=1.2",
        "",
        "speed",
        "m/s",
        "flat",
    ),
    "model in water": ("crawler.xml", "--duration 0.1 --friction inf", f"--terrain {SHORE}", "speed", "m/s", SHORE),
    "pouch": ("pouch", "--cycles 1 --settling 0.02 --frequency 8", "", "speed", "BL/s", "flat"),
    "model of ROS": ("cart.urdf", "--duration 0.1 --controller network --light 1,0,0.5", "", "speed", "m/s", "flat"),
}


@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.slow if k == "pouch" else ()) for k in KINDS])
def test_a_robot_is_designed_compared_seen_and_told(morpholab, tmp_path, kind):
    robot, options, world, objective, unit, place = KINDS[kind]
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    (tmp_path / "cart.urdf").write_text(CART)

    def ask(line):
        code, out, error = morpholab(line)
        assert code == 0, error
        return out

    for name, method in (("a", "hill-climb"), ("b", "random")):
        ask(f"codesign --robot {robot} {options} {world} --method {method} --out {name} {SEARCH}")
    (tmp_path / "crawler.xml").unlink()  # the runs know their robots
    (tmp_path / "cart.urdf").unlink()
    found = json.loads(ask(f"codesign --resume --generations 1 --out a --json {QUICK}"))
    assert found["generation"] == 1 and found["evaluations"] == 4 and found["files"] == ["best.json"]

    told = ask("status a b")
    assert told.count("finished") == 2 and f"best {objective} {decimal(found['best'])} {unit}, 4 evaluations" in told
    assert f"best {objective} [{unit}] after 1 evaluation of each climber" in ask("compare a b --out curves.svg")
    assert f"best {objective} [{unit}] so far" in (tmp_path / "curves.svg").read_text()
    assert json.loads(ask("compare a b --json"))["score"] == {"name": objective, "unit": unit}

    ask(f"view a a/best.json --frames 5 --out page.html {QUICK}")
    ask(f"view a --frames 5 --picture still.png --glb motion.glb {QUICK}")
    assert (tmp_path / "page.html").stat().st_size > 10_000 and (tmp_path / "motion.glb").stat().st_size > 1000
    ask("report a b --frames 5 --out page-of-runs.html --quiet")
    assert f"{objective} [{unit}]" in (tmp_path / "page-of-runs.html").read_text()

    again = json.loads(ask(f"simulate --robot a/best.json {world} --threads 1 --json"))
    assert again[objective] == found["best"] and place in again.values()
    # A pouch's design is a lattice robot, of which nothing is free.
    assert kind == "pouch" or again["values"] == found["best_point"]
    code, _, error = morpholab("export a --csv gait.csv")
    why = "one with reflexes has no table" if kind == "pouch" else "has no gait table; no rig plays it"
    assert code == 2 and why in error


@pytest.mark.parametrize("kind", [pytest.param("rover", marks=pytest.mark.slow), "model of MuJoCo"])
def test_gradients_of_a_robot_are_checked(morpholab, tmp_path, kind):
    robot, options, world, *_ = KINDS[kind]
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    options += " --body-sizes *r*=0.5:2" if kind == "model of MuJoCo" else ""
    asked = f"--robot {robot} {options} {world} --horizons 1 --directions 2 --samples 2"
    code, out, _ = morpholab(f"gradient-check {asked} --out g --json {QUICK}")
    (horizon,) = json.loads(out)["horizons"]
    assert code == 0 and min(horizon["errors"]) < 1e-5 and (tmp_path / "g/gradient.png").exists()


def test_the_command_of_a_run_of_before_goes_on_with_its_slip(morpholab, tmp_path):
    """Runs of earlier versions had 0.01 m/(N s) and did not tell it, as those with it do not."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    asked = "codesign --robot crawler.xml --duration 0.1 --method hill-climb --climbers 2 --quiet --out r"
    assert morpholab(f"{asked} --slip 0.01 --generations 1")[0] == 0
    assert morpholab(f"{asked} --generations 2 --resume")[0] == 0
    code, _, error = morpholab(f"{asked} --slip 0.02 --generations 3 --resume")
    assert code == 2 and "robot: crawler.xml is not the robot of the run in r" in error


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["codesign --out a", "simulate", "gradient-check", "view"])
def test_the_help_shows_what_belongs_to_the_robot(morpholab, tmp_path, command, kind):
    robot, options, *_ = KINDS[kind]
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    (tmp_path / "cart.urdf").write_text(CART)
    code, out, _ = morpholab(f"{command} {'' if command == 'view' else '--robot'} {robot} --help")
    shown = out.partition("options:")[2]
    assert code == 0 and all(f"  {word} " in shown for word in shlex.split(options) if word.startswith("--"))
    assert "--calibration" not in shown
