"""What of a trial is allowed but likely a mistake: ground that is never met, feet without friction, unsolved steps."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import morpholab as ml
from optim.doubts import doubts_after, doubts_before
from optim.problems.inflatable.problem import GaitProblem
from robots.articulated import load_robot
from robots.freeform import FreeformRobot
from robots.freeform.grid import Grid
from robots.ground import Ground
from robots.lattice_robot import Drive, LatticeRobot
from robots.lattice_robot.presets import soft_quadruped
from robots.lattice_robot.walker_robot import WalkerRobot
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeBody, Material

ROOT = Path(__file__).resolve().parents[2]
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
def test_inflatable_robots_reach_what_begins_ahead(geometry):
    assert not list(doubts_before(GaitProblem((Terrain.parse("ramp:5"),), geometry=geometry)))
    (far,) = doubts_before(GaitProblem((Terrain.parse("ramp:5,1"),), geometry=geometry))
    assert "ramp:5,1 is level up to 1 m" in far


def test_ground_that_begins_where_none_is_made_is_told():
    (far,) = doubts_before(GaitProblem((Terrain.parse("stairs:0.01,0.1,6"),), geometry="small"))
    assert "stairs:0.01,0.1,6 is level as far as ground is made, 4 m ahead; give its START, such as stairs:0" in far


@pytest.mark.kernels
def test_the_lab_warns_of_ground_that_a_robot_has_not_met():
    with pytest.warns(UserWarning, match=r"^terrain: stairs:0.01,0.1 is level up to 0.3 m .*this one went 0.0476 m"):
        ml.simulate(ROOT / "examples/voxel_walker.vxa", where="stairs:0.01,0.1", threads=1)


@pytest.mark.kernels
def test_feet_without_friction_are_told_on_dry_ground():
    body = LatticeBody(np.argwhere(np.ones((2, 1, 1))), (Material(1e5, 1e3),), np.zeros(2, int), 0.01)
    robot = LatticeRobot(body, (Drive("all", (0,), amplitude=0.1),), frequency=10.0, cycles=1, settling=0.02)
    with pytest.warns(UserWarning, match=r"^static_friction: no material of robot has any, so it slides as on"):
        ml.simulate(robot, threads=1)
    for place in (Terrain.water(), Terrain(static_friction=1.0, kinetic_friction=0.8)):
        assert not robot.doubts_in(place)
    held = replace(robot, body=replace(body, fixed=np.ones((2, 6), bool)))
    assert not held.doubts_in(Terrain())
    driven = replace(robot, drives=(*robot.drives, Drive("feet", (0,), "friction", amplitude=0.1, mean=0.5)))
    assert not driven.doubts_in(Terrain())
    assert Ground("stairs:0.01,0.1").level_until(4.5, 5.0) == math.inf


def snake(links):
    """MJCF file of a chain of capsules of 1 kg."""
    link = '<geom type="capsule" size="0.03" fromto="0 0 0 0.1 0 0" mass="1"/>'
    body = '<body pos="0.14 0 0"><joint name="j{0}" axis="0 0 1" range="-1.2 1.2"/>' + link
    drive = '<position joint="j{0}" ctrlrange="-1 1" kp="2" forcerange="-1 1"/>'
    bodies, drives = ("".join(text.format(n) for n in range(1, links)) for text in (body, drive))
    return (
        '<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="5 5 0.1"/>'
        '<body pos="0 0 0.05"><freejoint/>'
        f"{link}{bodies}{'</body>' * links}</worldbody><actuator>{drives}</actuator></mujoco>"
    )


@pytest.mark.kernels
@pytest.mark.filterwarnings("ignore:model. ignored")
def test_steps_left_unsolved_are_told(tmp_path):
    (tmp_path / "snake.xml").write_text(snake(20))
    robot = load_robot(str(tmp_path / "snake.xml"), duration=0.25, speed=10.0)
    points = np.random.default_rng(0).uniform(*np.transpose([[p.low, p.high] for p in robot.parameters]), (2, 58))
    single, double = (robot.simulate(points, Terrain(), compute=Compute(precision=name)) for name in ("f32", "f64"))
    (told,) = doubts_after(robot, Terrain(), single)
    assert "did not settle in some step of 2 of 2 robots; compare with double precision" in told
    assert not list(doubts_after(robot, Terrain(), double))
