"""Notes on ground whose uneven part a robot hardly reaches."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from optim.commands.far_ground import note_far_ground
from optim.problems.inflatable.problem import GaitProblem
from robots.freeform import FreeformRobot
from robots.freeform.grid import Grid
from robots.ground import Ground
from robots.lattice_robot.presets import soft_quadruped
from robots.lattice_robot.walker_robot import WalkerRobot
from robots.world import Terrain

ROOT = Path(__file__).resolve().parents[3]
ROBOT = "--robot freeform --shape 4,3,2 --full --cycles 1 --frequency 12 --settling 0.02 --threads 1"
SEARCH = f"codesign {ROBOT} --method random --climbers 2 --generations 0"
WALKER = f"simulate --robot {ROOT}/examples/voxel_walker.vxa --terrain"


@pytest.mark.kernels
def test_a_search_tells_of_ground_that_its_robots_do_not_reach(morpholab):
    line = f"{SEARCH} --terrain flat --terrain stairs:0.004,0.06 --terrain rough:0.004"
    code, _, error = morpholab(f"{line} --out a")
    assert code == 0 and error.count("note: ") == 1
    assert (
        "note: terrain: stairs:0.004,0.06 is level up to 0.3 m ahead of the robot's origin, 6.6 body lengths beyond "
        "its front; one that goes less far meets nothing else; give its START, such as stairs:0.004,0.06,0.04\n"
    ) in error
    assert morpholab(f"{line} --out b --quiet")[::2] == (0, "")
    assert "note: " not in morpholab("codesign --resume --out a --threads 1")[2]
    assert "note: " not in morpholab(f"{SEARCH} --terrain stairs:0.004,0.06,0.04 --out c")[2]


@pytest.mark.kernels
def test_a_simulation_tells_of_ground_that_its_robot_has_not_met(morpholab):
    code, _, error = morpholab(f"{WALKER} stairs:0.01,0.1")
    assert code == 0 and "is level up to 0.3 m" in error and "this one went 0.0476 m, so it meets nothing" in error
    assert "give its START, such as stairs:0.01,0.1,0.13" in error
    assert "note: " not in morpholab(f"{WALKER} stairs:0.01,0.1,0.13")[2]
    assert morpholab(f"{WALKER} stairs:0.01,0.1 --quiet")[2] == ""


def test_robots_know_where_they_begin_and_end():
    """From the origin, along the heading."""
    freeform = FreeformRobot(Grid((4, 3, 2), 0.01))
    assert freeform.footprint == pytest.approx((-0.005, 0.035))
    quadruped = soft_quadruped(1)
    begin, end = quadruped.footprint
    assert end - begin == pytest.approx(quadruped.length) and begin == -quadruped.body.voxel_size / 2
    back, front = replace(quadruped, heading=180.0).footprint
    assert (back, front) == pytest.approx((-end, -begin))
    assert WalkerRobot((4, 4, 3)).footprint == pytest.approx((-0.01, 0.07))


@pytest.mark.parametrize("geometry", ["published", "small"])
def test_inflatable_robots_reach_what_begins_ahead(capsys, geometry):
    note_far_ground(GaitProblem((Terrain.parse("ramp:5"),), geometry=geometry))
    assert capsys.readouterr().err == ""
    note_far_ground(GaitProblem((Terrain.parse("ramp:5,1"),), geometry=geometry))
    assert "ramp:5,1 is level up to 1 m" in capsys.readouterr().err


def test_ground_that_begins_where_none_is_made_is_told(capsys):
    note_far_ground(GaitProblem((Terrain.parse("stairs:0.01,0.1,6"),), geometry="small"))
    told = "terrain: stairs:0.01,0.1,6 is level as far as ground is made, 4 m ahead; give its START, such as stairs:0"
    assert told in capsys.readouterr().err
    assert Ground("stairs:0.01,0.1").level_until(4.5, 5.0) == math.inf
