"""Friction of feet, bladders, skin and seams as users give it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from graded import GRIPPING, QUICK, settling
from program_values import values_after

from robots.inflatable import INCHING, PUBLISHED, InflatableDesign, differentiate, simulate
from robots.inflatable.body import BLADDER_REGIONS, FOOT_REGIONS, FOOT_SEAM, SEAM, SKIN
from robots.inflatable.journeys import Leg, build_journey
from robots.inflatable.program import build_program
from robots.robot import KINDS
from robots.world import STANDARD_GRAVITY, Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import Quantity

WATER = Terrain.water()
SHORT = {"geometry": "small", "columns": 1, "repeats": 1}


def test_friction_joins_any_terrain() -> None:
    kind = KINDS["inflatable"]
    assert kind.chosen_world({}) is None
    assert kind.chosen_world({"floor": "wood", "slope": 9.0}) == Terrain(9.0, 0.7, 0.56)
    assert kind.chosen_world({"friction": (0.1, 1.0)}) == Terrain(0.0, 1.0, 0.1)
    own = {"bladder_friction": 0.3, "skin_friction": 0.0, "seam_friction": 0.5}
    assert kind.chosen_world(own) == Terrain(**own)
    assert kind.chosen_world({"floor": "acrylic", "slope": 3.0, **own}) == Terrain(3.0, 0.51, 0.38, **own)


@pytest.mark.parametrize(
    "options",
    [
        {"floor": "wood", "friction": (0.1, 1.0)},
        {"floor": "gravel"},
        {"floor": "ice"},
        {"friction": (0.7, 0.5)},
        {"friction": (-0.1, 0.5)},
        {"floor": "wood", "terrain": WATER},
        {"bladder_friction": 0.3, "terrain": WATER},
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


STILL = InflatableDesign(0.0, 90.0, settling(np.zeros((10, 1)), [3000], motion=[10]))
FREE = replace(QUICK, hold_steps=1500, moving_damping=0.0, settling_damping=0.0, weight="physical")


def friction_of(terrain: Terrain) -> dict[int, list[float]]:
    """The different values that the friction of each region takes over a gait, in their order."""
    events = build_program([INCHING], terrain).events
    events = events[events["quantity"] == Quantity.STATIC_FRICTION]
    return {int(r): list(dict.fromkeys(events["value"][events["region"] == r])) for r in np.unique(events["region"])}


def test_bladders_skin_and_seams_have_a_friction_of_their_own() -> None:
    own = friction_of(Terrain(bladder_friction=0.3, skin_friction=0.4, seam_friction=0.5))
    assert all(own[region] == [0.3] for region in BLADDER_REGIONS)
    assert (own[SKIN][-1], own[SEAM][-1], own[FOOT_SEAM][-1]) == (0.4, 0.5, 0.5)
    usual = friction_of(Terrain())
    assert all(own[region] == usual[region] for region in FOOT_REGIONS)
    assert usual[BLADDER_REGIONS[0]] == [2.0 / 3] and usual[SKIN] == usual[SEAM] == [2.0]
    assert usual[FOOT_SEAM] == [2.0, 1e-4]


@pytest.mark.parametrize("given", [{"bladder_friction": 2.0 / 3}, {"skin_friction": 2.0}])
def test_what_a_part_has_anyway_changes_nothing(given: dict[str, float]) -> None:
    assert friction_of(Terrain(**given)) == friction_of(Terrain())


def test_a_robot_that_goes_on_takes_over_the_friction_of_the_next_ground() -> None:
    legs = [Leg(STILL, Terrain()), Leg(STILL, Terrain(bladder_friction=0.3, seam_friction=0.4))]
    program, steps = build_journey(legs, 1, QUICK, PUBLISHED, None)
    end = np.array([program.lengths[0]])
    for region, before, after in ((BLADDER_REGIONS[0], 2.0 / 3, 0.3), (FOOT_SEAM, 2.0, 0.4), (SEAM, 2.0, 0.4)):
        values = [values_after(program, 0, region, Quantity.STATIC_FRICTION, at)[0] for at in (end - steps[1] - 1, end)]
        assert values == [before, after]


@pytest.mark.kernels
@pytest.mark.parametrize("friction", [0.2, 0.4, 0.6])
def test_a_flat_robot_slides_on_its_bladders_as_a_block_does(friction: float) -> None:
    """Nothing else touches the ground: it stays where friction exceeds the tangent, else it gains g (sin - mu cos)."""
    slope = 25.0
    terrain = Terrain(slope, 0.0, 0.0, bladder_friction=friction)
    found = simulate(STILL, terrain, geometry=PUBLISHED, actuation=FREE, record_every=100, threads=1)
    assert found.frames is not None
    late = found.frames.times > 0.3 * found.frames.times[-1]
    way = found.frames.positions[late, 0, :, 1].mean(axis=1)
    gained = -2 * np.polyfit(found.frames.times[late], way, 2)[0]
    pull, weight = (STANDARD_GRAVITY * f(math.radians(slope)) for f in (math.sin, math.cos))
    if friction > math.tan(math.radians(slope)):
        assert abs(gained) < 0.01 and abs(found.distance[0]) < 0.2 * PUBLISHED.voxel_size
    else:
        assert gained == pytest.approx(pull - friction * weight, rel=0.01)


@pytest.mark.kernels
def test_gradients_are_those_on_such_ground() -> None:
    """Of a robot that slides down on bladders and seams, by its heading, against central differences."""
    design = replace(STILL, orientation=60.0)
    terrain = Terrain(25.0, 0.0, 0.0, bladder_friction=0.2, seam_friction=0.1)
    options: Any = {"geometry": GRIPPING, "actuation": FREE, "threads": 1}
    slope = differentiate(design, terrain, **options).orientation[0]
    low, high = simulate([replace(design, orientation=60.0 + d) for d in (-1e-3, 1e-3)], terrain, **options).distance
    assert slope == pytest.approx((high - low) / 2e-3, rel=1e-3)
