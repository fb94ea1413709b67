"""Friction of feet as users give it."""

from typing import Any

import pytest

from robots.robot import KINDS
from robots.world import Terrain

WATER = Terrain.water()


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
