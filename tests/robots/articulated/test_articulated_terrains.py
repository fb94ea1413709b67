"""Articulated robots of files on terrains: slopes, uneven ground, sand and water."""

from dataclasses import replace

import numpy as np
import pytest
from crawlers import HERE, crawler, some_points

from robots.articulated import differentiate, simulate
from robots.articulated.worlds import GROUND, ground_place, relief_under
from robots.robot import KINDS, Place, Trial
from robots.uncertainty import HELD_OUT, Risk, Uncertainty, judge_uncertain
from robots.view.motion import GroundPlane
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.rigid import RigidEngine

pytestmark = pytest.mark.filterwarnings("ignore:model. ignored")
UNEVEN = Terrain(ground="rough:0.02,0.2")
SHORE = Terrain(ground="ramp:-10,0.1+water:0.02")
SAND, BEACH = Terrain(ground="sand:3e4"), Terrain(ground="ramp:-10,0.1+sand:3e4+water:0.02")
# Each has a kernel of its own to compile; those of a part of what others have are slow.
TERRAINS = [
    *(Terrain(8.0), Terrain(-5.0, ground=UNEVEN.ground), Terrain.water()),
    *(pytest.param(part, marks=pytest.mark.slow) for part in (UNEVEN, SHORE, SAND, BEACH)),
]


@pytest.mark.kernels
def test_it_stands_on_uneven_ground_and_walks_there():
    """As far above it as its file has it above the floor, and never in it."""
    robot = crawler(friction=None)
    tree = robot.model.tree
    relief = relief_under(robot, UNEVEN)
    start = RigidEngine(tree, robot.physics, ground=relief).standing()
    centres, radii = tree.balls()
    gap = (centres - radii[:, None] * [0, 0, 1])[:, 2].min()
    raised = start.position - np.array(tree.ordered[0][0].position)
    assert relief.rise_of_balls(centres + raised, radii) == pytest.approx(-gap)
    points = some_points(robot, 2)
    level, uneven = (simulate(robot, points, terrain=world, **HERE) for world in (GROUND, UNEVEN))
    assert (uneven.status == "ok").all() and np.abs(uneven.distance - level.distance).max() > 1e-4
    flat = simulate(robot, points, terrain=Terrain(ground="rough:0"), **HERE)
    assert np.array_equal(flat.distance, level.distance)


@pytest.mark.kernels
def test_uneven_ground_lies_about_the_start_of_a_robot():
    """It ended 4 m ahead of the file's origin and 1.5 m beside it, so robots that begin elsewhere found it level."""
    near = crawler(friction=None, duration=0.2)
    away = replace(near, text=near.text.replace('name="trunk" pos="0 0 ', 'name="trunk" pos="6 -3 '))
    assert not ground_place(near).any() and ground_place(away).tolist() == [6, -3, 0]
    here, there = (relief_under(robot, UNEVEN) for robot in (near, away))
    assert here.heights == pytest.approx(there.heights)
    assert np.subtract(there.origin, here.origin) == pytest.approx([6, -3])
    points = some_points(near, 1)
    ways = [simulate(robot, points, terrain=UNEVEN, **HERE).distance for robot in (near, away)]
    assert ways[1] == pytest.approx(ways[0], abs=1e-6) and away.footprint == pytest.approx(near.footprint)


@pytest.mark.kernels
@pytest.mark.parametrize("terrain", TERRAINS, ids=lambda t: t.name)
def test_derivatives_on_terrains_agree_with_differences(terrain):
    robot = crawler()
    points = some_points(robot, 1, seed=2)
    found = differentiate(robot, points, terrain=terrain, **HERE).gradient[0]
    direction = np.random.default_rng(3).normal(size=points.shape[1])
    step = 1e-6
    around = points + step * np.array([[1.0], [-1.0]]) * direction
    ahead, behind = simulate(robot, around, terrain=terrain, **HERE).distance
    assert found @ direction == pytest.approx((ahead - behind) / (2 * step), rel=1e-5)


@pytest.mark.kernels
def test_it_swims_in_a_fluid_and_floats_on_water():
    """In a fluid it stays, without drives, where its file has it; heavy or light, it has the fluid's density."""
    robot = crawler(friction=None, duration=1.0)
    still = [[1.0, *([0.0] * 6)]]
    (found,) = simulate(robot, still, terrain=Terrain.water(), **HERE).runs
    assert found.position == pytest.approx(engine_rest(robot), abs=1e-9)
    (deep,) = simulate(robot, still, terrain=Terrain.parse("water:1"), **HERE).runs
    assert deep.position[0, 2] > engine_rest(robot)[0, 2] + 0.1  # 1.6 kg displace 4.3
    (empty,) = simulate(robot, still, terrain=Terrain(fluid_density=0.0), **HERE).runs  # a vacuum, without weight
    assert empty.position == pytest.approx(engine_rest(robot), abs=1e-9)
    points = some_points(robot, 2)
    slow, thick = (Terrain(fluid_density=1000.0, pressure_drag=drag) for drag in (0.0, 5.0))
    there = [simulate(robot, points, terrain=each, **HERE).distance for each in (slow, Terrain.water(), thick)]
    assert len(np.unique(np.concatenate(there))) == 6


def engine_rest(robot) -> np.ndarray:
    """Where the base of a robot is at the start."""
    return np.array([robot.model.tree.ordered[0][0].position])


@pytest.mark.kernels
def test_it_sinks_into_sand_and_walks_there():
    """The softer it is the deeper, and otherwise than on firm ground; on hills and slopes of it, too."""
    robot = crawler(friction=None, duration=1.0)
    still, points = [[1.0, *([0.0] * 6)]], some_points(robot, 2)
    names = ("flat", "sand:1e6", "sand:1e5", "sand:3e4")
    worlds = [KINDS["articulated"].world(name) for name in names]
    heights = [simulate(robot, still, terrain=world, **HERE).runs[0].position[0, 2] for world in worlds]
    assert (np.diff(heights) < -1e-4).all()
    names = ("flat", "sand:1e5", "hill:5+sand:1e5", "rough:0.02,0.2+sand:1e5")
    worlds = [KINDS["articulated"].world(name) for name in names]
    found = [simulate(robot, points, terrain=world, **HERE) for world in worlds]
    assert all((each.status == "ok").all() for each in found)
    assert len(np.unique(np.concatenate([each.distance for each in found]))) == 8


@pytest.mark.kernels
def test_motions_show_what_is_below():
    """The ground of its world, uneven, tilted or below water; nothing solid in a fluid."""
    robot = crawler(duration=0.1)
    shown = {}
    for world in (GROUND, UNEVEN, Terrain(5.0), SHORE, Terrain.water()):
        outcome = robot.run(some_points(robot, 1), Trial(world, Compute(**HERE), 1))
        shown[world.name] = robot.motion(outcome, world, "it").ground
    assert shown["flat"] == GroundPlane() and shown["hill:5"] == GroundPlane(slope=5.0)
    assert shown[UNEVEN.name].relief.heights.max() > 0.01 and shown[UNEVEN.name].relief.water is None
    assert shown[SHORE.name].relief.water.level == 0.02
    assert not shown["water"].solid and shown["water"].level < 0


@pytest.mark.kernels
def test_a_hill_is_a_ramp_that_it_is_turned_with():
    """Downhill it goes farther than up, as it does on a ramp."""
    robot = crawler(friction=0.3, heading=30.0)
    points = some_points(robot, 2)
    found = {
        name: simulate(robot, points, terrain=KINDS["articulated"].world(name), **HERE).distance
        for name in ("hill:0", "flat", "hill:20", "hill:-20", "ramp:20,-1", "ramp:-20,-1")
    }
    assert np.array_equal(found["hill:0"], found["flat"])
    assert (found["hill:-20"] > found["flat"]).all() and (found["flat"] > found["hill:20"]).all()


@pytest.mark.kernels
def test_slopes_of_level_ground_can_be_drawn():
    robot = crawler(friction=0.3)
    design, unknown = robot.design(some_points(robot, 1)[0]), Uncertainty(slope=5.0)
    told = judge_uncertain(design, GROUND, unknown, Risk(0.0), 3, compute=Compute(**HERE)).document
    slopes = [drawn.slope for drawn in unknown.draw(3, HELD_OUT)]
    each = [design.simulate([()], Terrain(slope), compute=Compute(**HERE)).measures["speed"][0] for slope in slopes]
    assert told["worst"] == min(each) < told["mean"] == pytest.approx(np.mean(each))
    with pytest.raises(ValueError, match=r"friction=0.2 is not allowed; articulated robot has no friction to draw"):
        judge_uncertain(crawler(), GROUND, Uncertainty(friction=0.2), Risk(), 3)


@pytest.mark.kernels
def test_friction_can_be_drawn():
    robot, unknown = crawler(friction=0.3), Uncertainty(friction=0.5)
    (point,) = some_points(robot, 1)
    told = judge_uncertain(robot.design(point), GROUND, unknown, Risk(0.0), 3, compute=Compute(**HERE)).document
    robots = [crawler(friction=0.3 * drawn.gripping) for drawn in unknown.draw(3, HELD_OUT)]
    each = [one.simulate([point], GROUND, compute=Compute(**HERE)).measures["speed"][0] for one in robots]
    assert told["worst"] == min(each) < told["mean"] == pytest.approx(np.mean(each))


@pytest.mark.kernels
def test_runs_of_earlier_versions_keep_what_they_called_level_ground():
    """Their tables and logs have columns of that name."""
    kind, robot = KINDS["articulated"], crawler(duration=0.1, controller="rhythm")
    before = kind.world_of("ground")
    assert before == Place("ground") == kind.world_of(kind.world_record(before)) and kind.world("ground") == GROUND
    results = [robot.run(some_points(robot, 2), Trial(world, Compute(**HERE))) for world in (before, GROUND)]
    assert np.array_equal(*(result.measures["distance"] for result in results))
    assert robot.as_terrain(before) == Terrain()


def test_terrains_by_name():
    kind = KINDS["articulated"]
    assert kind.chosen_world({"terrain": UNEVEN}) == kind.world(UNEVEN.name) == kind.world_of(UNEVEN.name) == UNEVEN
    assert kind.world("flat") == kind.chosen_world({"terrain": Terrain()}) == GROUND
    assert kind.world("hill:5+rough:0.02,0.2") == Terrain(5.0, ground=UNEVEN.ground)
    assert kind.world("water") == Terrain.water() and kind.world(SHORE.name) == SHORE
    for terrain in (Terrain(5.0, high_friction=1.0), Terrain(ground="rough:0.01", high_friction=1.0)):
        with pytest.raises(ValueError, match=r"^terrain: .* is not allowed for an articulated robot; give"):
            kind.chosen_world({"terrain": terrain})
    assert kind.world("sand:3e4") == SAND and kind.world("hill:5+sand:3e4") == Terrain(5.0, ground=SAND.ground)
    with pytest.raises(ValueError, match="YIELD 0 of 'sand:0' is not allowed; give more than 0"):
        kind.world("sand:0")
    with pytest.raises(ValueError, match=r"^terrain: rough:0\.02,0\.2 is not allowed beside --world"):
        kind.chosen_world({"terrain": UNEVEN, "world": "ground"})
