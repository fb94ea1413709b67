import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.articulated.worlds import on_ground
from robots.inflatable.actuation import InflatableActuation
from robots.lattice_robot.ground import WITHOUT_PROPS, material_friction
from robots.lattice_robot.walker import check_terrain
from robots.robot import KINDS, Measure, Outcome, Robot
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("flat+hill:3", "as two grounds cannot be combined; give one of flat, hill:3, or ground on a slope, as hill:5"),
        ("rough:0.01+stairs:0.01,0.1", "as two grounds cannot be combined; give one of rough:0.01, stairs:0.01,0.1, "),
        ("hill:3+rough:0.01+gap:0.1+light:1,0", "as two grounds cannot be combined; give one of hill:3, rough:0.01, g"),
        ("rough:0.1+hill:3", "give the slope first, as hill:3\\+rough:0.1$"),
    ],
)
def test_two_grounds_are_not_combined(text, told):
    with pytest.raises(ValueError, match=rf"^terrain: .* is not allowed[,;] {told}"):
        Terrain.parse(text)


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
    with pytest.raises(ValueError, match=r"^high_friction: -1 is not allowed; give a number from 0 to 1e\+06$"):
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


GIVEN = {
    "slope": "hill:5",
    "high_friction": Terrain(high_friction=0.5),
    "low_friction": Terrain(low_friction=0.1),
    "fluid_density": "water",
    "bladder_friction": Terrain(bladder_friction=0.5),
    "static_friction": Terrain(static_friction=0.5, kinetic_friction=0.4),
    "ground": "rough:0.01",
    "light": "flat+light:0.5,0.1",
    "props": "flat+ball:0.04,0.12,0.0",
}
REFUSED = {
    "slope": "slope: 5.0 is not allowed; leave it out",
    "high_friction": "high_friction: 0.5 is not allowed; leave it out",
    "low_friction": "low_friction: 0.1 is not allowed; leave it out",
    "fluid_density": "fluid_density: 1000.0 is not allowed; give ground in place of a fluid",
    "bladder_friction": "bladder_friction: 0.5 is not allowed; it is of the inflatable robot",
    "static_friction": "static_friction: 0.5 is not allowed; it is of lattice robots",
    "ground": "ground: rough:0.01 is not allowed; give a plane",
    "light": "light: (0.5, 0.1) is not allowed; leave it out",
    "props": "props: ball:0.04,0.12,0.0 is not allowed, as only lattice robots meet any; leave it out",
}
TAKING = {
    "inflatable": (
        InflatableActuation().on,
        {
            "static_friction": "static_friction: 0.5 is not allowed, as it is of lattice robots; give "
            "high_friction and low_friction",
            "props": REFUSED["props"],
        },
    ),
    "lattice": (
        material_friction,
        {
            "low_friction": "low_friction: 0.1 is not allowed; drive the friction of a region",
            "bladder_friction": REFUSED["bladder_friction"],
        },
    ),
    "mixture": (
        lambda terrain: material_friction(terrain, taken=WITHOUT_PROPS),
        {
            "low_friction": "low_friction: 0.1 is not allowed; drive the friction of a region",
            "bladder_friction": REFUSED["bladder_friction"],
            "props": REFUSED["props"],
        },
    ),
    "walker": (
        check_terrain,
        {
            "low_friction": "low_friction: 0.1 is not allowed; a walker has no sliding feet",
            "bladder_friction": REFUSED["bladder_friction"],
            "props": REFUSED["props"],
        },
    ),
    "articulated": (
        on_ground,
        {
            name: "terrain: .* is not allowed for an articulated robot; give a slope, uneven ground or water, such as "
            "hill:5, rough:0.01.sand:2e5 or ramp:-5.water:0, and friction by the robot"
            for name in GIVEN
            if name not in ("slope", "fluid_density", "ground")
        },
    ),
}


class Level(Robot):
    """A robot that says that it takes nothing of a terrain."""

    kind = "lattice"
    measures = (Measure("speed", "m/s", "how fast it is"),)
    worlds = (Terrain(),)
    terrain_fields = ()
    feels = True

    def run(self, points, trial):
        return Outcome({"speed": np.zeros(len(points))})

    def felt_over_time(self, points, world, compute):
        return np.zeros((len(points), 1, 1))


def terrain_given(name: str) -> Terrain:
    """The terrain that gives a field."""
    return Terrain.parse(given) if isinstance(given := GIVEN[name], str) else given


@pytest.mark.parametrize("name", GIVEN)
@pytest.mark.parametrize("kind", TAKING)
def test_each_kind_refuses_what_it_does_not_take(kind, name):
    """In one line each, as it always did; all else it takes."""
    check, refused = TAKING[kind]
    if name not in refused:
        check(terrain_given(name))
        return
    with pytest.raises(ValueError, match=f"^{refused[name].replace('(', '.').replace(')', '.')}$"):
        check(terrain_given(name))


@pytest.mark.parametrize("name", GIVEN)
def test_a_new_kind_only_says_what_it_takes(name):
    """And trials, also of a fixed design and of what it feels, refuse the rest."""
    robot, terrain = Level(), terrain_given(name)
    for tried in (robot.simulate, robot.design(()).simulate, lambda points, world: robot.readings(points, world, 1)):
        tried(np.zeros((1, 0)), Terrain())
        with pytest.raises(ValueError) as found:
            tried(np.zeros((1, 0)), terrain)
        assert str(found.value) == REFUSED[name]
    robot.terrain_fields = tuple(each.name for each in fields(Terrain))
    assert robot.simulate(np.zeros((1, 0)), terrain).measures["speed"][0] == 0


def test_every_field_of_a_terrain_survives_its_record():
    """Those of the first versions always stand in it, later ones where they are given."""
    for name in GIVEN:
        document, terrain = terrain_given(name).document, terrain_given(name)
        assert Terrain(**document) == terrain and name in document
        later = {"static_friction", "kinetic_friction"} if name == "static_friction" else {name}
        assert set(document) == {*Terrain().document, *later}
