"""Friction of feet as users give it."""

from typing import Any

import pytest

from robots.robot import KINDS
from robots.world import Terrain
from taichi_sim.base.compute import Compute

WATER = Terrain.water()
SHORT = {"geometry": "small", "columns": 1, "repeats": 1}


def test_friction_joins_any_terrain() -> None:
    kind = KINDS["inflatable"]
    assert kind.chosen_world({}) is None
    assert kind.chosen_world({"floor": "wood", "slope": 9.0}) == Terrain(9.0, 0.7, 0.56)
    assert kind.chosen_world({"friction": (0.1, 1.0)}) == Terrain(0.0, 1.0, 0.1)


@pytest.mark.parametrize(
    "options",
    [
        {"floor": "wood", "friction": (0.1, 1.0)},
        {"floor": "gravel"},
        {"floor": "ice"},
        {"friction": (0.7, 0.5)},
        {"friction": (-0.1, 0.5)},
        {"floor": "wood", "terrain": WATER},
    ],
)
def test_friction_that_is_not_allowed(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"^\w+: .*(not allowed|unknown|must|give|choose|at least)"):
        KINDS["inflatable"].chosen_world(options)


@pytest.mark.kernels
def test_feet_slide_as_the_floor_says() -> None:
    """Inching hardly gains on wood, where sliding feet hold nearly as well as gripping ones; pairs are as floors."""
    kind = KINDS["inflatable"]
    robot = kind.build("inching", SHORT)
    compute = Compute(precision="f32", threads=1)
    speeds = []
    for options in ({"floor": "wood"}, {"friction": (0.56, 0.70)}, {"friction": (1e-4, 2.0)}):
        world = kind.chosen_world(options)
        assert world is not None
        speeds.append(robot.simulate((), world, compute=compute).measures["speed"][0])
    usual = robot.simulate((), Terrain(), compute=compute).measures["speed"][0]
    assert speeds[0] == speeds[1]
    assert speeds[2] == usual
    assert abs(speeds[0]) < 0.5 * usual
