import math
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.robot import KINDS
from robots.world import FLOORS, Terrain


def test_names_of_terrains():
    assert Terrain().name == "flat"
    assert Terrain(15).name == "hill:15"
    assert Terrain(-7.5).name == "hill:-7.5"
    assert Terrain.parse("hill:15") == Terrain(15.0)


def test_a_terrain_may_have_a_light():
    for name in ("flat+light:0.5,-0.25", "hill:5+rough:0.01+light:1.0,0.0", "water+light:0.3,0.1"):
        terrain = Terrain.parse(name)
        assert terrain.name == name and Terrain(**terrain.document) == terrain
    assert Terrain(light=(0.5, -0.25)).spoken == "on flat ground, to a light at (0.5, -0.25) m"
    for name in ("flat+light:0.5", "flat+light:there", "flat+light:nan,0"):
        with pytest.raises(ValueError, match=r"^light: "):
            Terrain.parse(name)


@given(st.floats(-45, 45, allow_subnormal=False))  # Taichi, once started, has the process flush subnormals to zero
def test_every_slope_survives_its_name(slope):
    assert Terrain.parse(Terrain(slope).name) == Terrain(slope)


@pytest.mark.parametrize("text", ["", "Flat", "hill", "hill:", "hill:steep", "flat:3", "15"])
def test_an_unknown_name_is_refused(text):
    with pytest.raises(ValueError, match=r"^terrain: .* is unknown; give .flat., .hill:15. .*$"):
        Terrain.parse(text)


@pytest.mark.parametrize("slope", [math.nan, math.inf, 45.1, -46, "15", None, True])
def test_a_slope_out_of_range_is_refused(slope):
    with pytest.raises(ValueError, match=r"^slope: .* is not allowed; .* from -45 to 45 degrees$"):
        Terrain(slope)


def test_friction_is_told_where_a_terrain_is():
    wood = Terrain(15.0, *reversed(FLOORS["wood"]), seam_friction=0.25)
    assert wood.where == "on hill:15, friction 0.56,0.7 (wood), seam friction 0.25"
    assert wood.spoken == "up a slope of 15°, friction 0.56,0.7 (wood), seam friction 0.25"
    assert wood.name == "hill:15" and Terrain(high_friction=0.5).where == "on flat, friction 0.5"
    kind = KINDS["inflatable"]
    assert kind.world_told(wood) == "hill:15 with friction 0.56,0.7 with seam friction 0.25"
    for terrain in (wood, Terrain(), Terrain.water(), Terrain(-3.0, skin_friction=0.0)):
        values = kind.world_values(terrain)
        assert kind.chosen_world({**values, "terrain": Terrain.parse(values["terrain"])}) == terrain
        assert Terrain(**terrain.document) == terrain
    assert list(Terrain().document) == [field.name for field in fields(Terrain)][:6]


def test_friction_must_be_a_number_and_low_the_lower():
    assert Terrain(high_friction=1, low_friction=1.0) == Terrain(0.0, 1.0, 1.0)
    with pytest.raises(ValueError, match=r"^high_friction: -1 is not allowed; .*, at least 0$"):
        Terrain(high_friction=-1)
    with pytest.raises(ValueError, match=r"^low_friction: nan is not allowed"):
        Terrain(low_friction=math.nan)
    with pytest.raises(ValueError, match=r"^low_friction: 0.5 is not allowed; .* high_friction, 0.4$"):
        Terrain(high_friction=0.4, low_friction=0.5)


@pytest.mark.parametrize("name", ["quadruped", "rover", "vehicle"])
def test_robots_of_the_studies_refuse_uneven_ground(name):
    """They are on the planes of the studies; nothing else is ignored silently."""
    kind = KINDS[name]
    assert "terrain" not in {option.name for option in (*kind.options, *kind.world_options)}
    robot = kind.build(None, {})
    with pytest.raises(ValueError, match=r"^(light|environment): 'rough:0\.01' is not allowed"):
        robot.simulate(robot.start, Terrain(ground="rough:0.01"))
