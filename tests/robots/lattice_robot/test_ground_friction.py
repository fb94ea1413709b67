"""Friction that the ground gives to the materials of lattice robots."""

import math
from typing import Any

import numpy as np
import pytest

from robots.freeform import FreeformRobot, Grid
from robots.lattice_robot.robustness import trust_in
from robots.lattice_robot.walker import ACTIVE, WalkerActuation, WalkerDesign, simulate, walker_robot
from robots.robot import KINDS, Trial
from robots.world import STANDARD_GRAVITY, Terrain
from taichi_sim.base.compute import Compute

GRIPPY = Terrain(static_friction=0.5, kinetic_friction=0.3)
STILL = WalkerActuation(amplitude=0.0, cycles=1)
BLOCK = WalkerDesign(np.full((4, 3, 1), ACTIVE))
WALKER = WalkerDesign(np.array([[[ACTIVE, ACTIVE]], [[0, ACTIVE]], [[ACTIVE, ACTIVE]]]))


@pytest.mark.parametrize("kind", ["lattice", "walker", "freeform"])
def test_every_kind_of_lattice_robot_takes_it(kind: str) -> None:
    offered = KINDS[kind]
    given = {"ground_friction": (0.5, 0.3)}
    assert offered.chosen_world({}) is None
    assert offered.chosen_world(given) == GRIPPY
    hill = offered.chosen_world({"slope": 9.0, **given})
    assert hill == Terrain(9.0, static_friction=0.5, kinetic_friction=0.3)
    assert offered.world_values(hill) == {"terrain": "hill:9", **given}
    assert offered.world_values(Terrain(high_friction=0.4)) == {"terrain": "flat", "ground_friction": (0.4, 0.4)}
    assert hill.spoken == "up a slope of 9°, friction 0.5 static, 0.3 kinetic"
    assert offered.world_of(offered.world_record(hill)) == hill


def test_materials_have_it_and_nothing_changes_without() -> None:
    robot = walker_robot(WALKER)
    assert robot.on(Terrain()) is robot
    assert {(m.static_friction, m.kinetic_friction) for m in robot.on(GRIPPY).body.materials} == {(0.5, 0.3)}


@pytest.mark.kernels
@pytest.mark.parametrize("slope", [20.0, 30.0])
def test_a_block_slides_as_its_kinetic_friction_says(slope: float) -> None:
    """It starts loose, so it slides where friction does not exceed the tangent, and gains g (sin - mu cos)."""
    terrain = Terrain(slope, static_friction=0.5, kinetic_friction=0.3)
    found = simulate(BLOCK, terrain, actuation=STILL, record_every=50, threads=1).frames[0]
    assert found is not None
    gained = -2 * np.polyfit(found.times, found.positions[:, 0, :, 0].mean(axis=1), 2)[0]
    pull, weight = (STANDARD_GRAVITY * f(math.radians(slope)) for f in (math.sin, math.cos))
    assert gained == pytest.approx(pull - 0.3 * weight, rel=1e-9)


@pytest.mark.kernels
def test_one_number_for_both_is_the_high_friction_of_a_terrain_to_the_bit() -> None:
    """Of walkers, and of freeform robots and mixtures of them, whose gradients by friction vanish."""
    both, pair = Terrain(high_friction=0.6), Terrain(static_friction=0.6, kinetic_friction=0.6)
    walked = [simulate(WALKER, terrain, threads=1).distance[0] for terrain in (both, pair, Terrain())]
    assert walked[0] == walked[1] != walked[2]
    robot, compute = FreeformRobot(Grid((3, 2, 2))), Compute(precision="f64", threads=1)
    point = np.random.default_rng(0).uniform(0.2, 0.8, (1, len(robot.parameters)))
    for sharpness in (3.0, math.inf):
        a, b = (
            robot.run(point, Trial(terrain, compute, gradients=("speed",), sharpness=sharpness))
            for terrain in (both, pair)
        )
        assert a.measures["speed"] == b.measures["speed"]
        np.testing.assert_array_equal(a.gradients["speed"], b.gradients["speed"])


@pytest.mark.kernels
def test_judges_try_a_part_of_the_friction_of_the_ground() -> None:
    robot, compute = walker_robot(WALKER, actuation=WalkerActuation(cycles=2)), Compute(precision="f32", threads=1)
    found = trust_in(robot, GRIPPY, compute=compute)
    same = trust_in(robot.on(GRIPPY), Terrain(), compute=compute)
    assert found.changed == same.changed and np.array_equal(found.speeds, same.speeds)
    assert len(set(found.changed.values())) == len(found.changed)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ground_friction": (0.3, 0.5)}, "ground_friction: 0.3,0.5 is not allowed; kinetic friction is at most"),
        ({"ground_friction": (-0.3, -0.5)}, "ground_friction: -0.3 is not allowed"),
        ({"ground_friction": (0.5, 0.3), "terrain": Terrain.water()}, "ground_friction: 0.5,0.3 is not allowed in a"),
    ],
)
def test_bad_options_are_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        KINDS["walker"].chosen_world(options)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"static_friction": 0.5}, "static_friction: 0.5 is not allowed without kinetic_friction; give both"),
        ({"kinetic_friction": 0.5}, "kinetic_friction: 0.5 is not allowed without static_friction; give both"),
        ({"static_friction": 0.3, "kinetic_friction": 0.5}, "kinetic_friction: 0.5 is not allowed; give at most"),
        (
            {"static_friction": 0.3, "kinetic_friction": 0.3, "high_friction": 1.0},
            "high_friction: 1.0 is not allowed beside static_friction; give one of them",
        ),
        (
            {"static_friction": 0.3, "kinetic_friction": 0.3, "fluid_density": 1e3},
            "static_friction: 0.3 is not allowed in a fluid",
        ),
    ],
)
def test_terrains_that_make_no_sense_are_one_line(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        Terrain(**fields)


def test_each_robot_refuses_the_friction_of_the_other() -> None:
    from robots.inflatable import ACTUATION

    with pytest.raises(ValueError, match=r"^static_friction: 0.5 is not allowed, as it is of lattice robots"):
        ACTUATION.on(GRIPPY)
    with pytest.raises(ValueError, match=r"^bladder_friction: 0.5 is not allowed; it is of the inflatable robot"):
        walker_robot(WALKER).on(Terrain(bladder_friction=0.5))
