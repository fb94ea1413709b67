"""A closer look at a gait: how all parts slide, drift, turning, chatter, and the changed conditions."""

import dataclasses

import numpy as np
import pytest
from graded import GRIPPING, LOW, QUICK, TINY, settling

from robots.inflatable import INCHING
from robots.inflatable import robustness as judgement
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import FOOT_1, FOOT_2, PUBLISHED, kinds_of
from robots.inflatable.contact import Contact, chatter_of, footing_of, turning_of
from robots.inflatable.design import InflatableDesign
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.robustness import judge_gait
from robots.inflatable.scrutiny import Scrutiny
from robots.inflatable.simulation import sideways, simulate
from robots.inflatable.slip import slip_under_load
from robots.inflatable.timing import gait_steps
from robots.inflatable.variations import HALF_STEP, WEIGHT, Conditions, at_half_step, on_floor, variations_of
from robots.world import FLOORS, Terrain

KINDS = kinds_of(TINY.body.regions)
START = TINY.body.start_positions.astype(float)
LENGTH = TINY.body_length
IDLE = InflatableDesign(0.0, 0.0, settling(np.zeros((10, 2)), [1500, 1500]))


def contact(shifts, depth=1e-4, turns=0.0) -> Contact:
    """Frames of a robot that is shifted in the plane and turned to the left, all of it so deep in the floor."""
    shifts = np.asarray(shifts, float)
    places = np.repeat(START[None], len(shifts), axis=0)
    angles = np.deg2rad(np.broadcast_to(turns, len(shifts)))
    x, y = places[..., 0].copy(), places[..., 1].copy()
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    places[..., 0], places[..., 1] = cosine * x - sine * y, sine * x + cosine * y
    places[..., :2] += shifts[:, None]
    deep = np.broadcast_to(np.asarray(depth, float), (len(shifts), len(START)))
    return Contact(0.1 * np.arange(len(shifts)), places, deep, KINDS)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("incline", "friction", "slides"), [("hill:-15", 0.05, True), ("hill:-15", 2.0, False), ("ramp:-15,-3", 0.05, True)]
)
def test_a_block_that_slides_down_an_incline_slips_its_whole_path_and_one_that_holds_nothing(incline, friction, slides):
    floor = {"low_friction": friction, "high_friction": 3 * friction}  # bladders have a third
    ground = dataclasses.replace(Terrain.parse(incline), **floor)
    idle = dataclasses.replace(QUICK, deflated=0.9, inflated=1.0)
    drive = dataclasses.replace(idle, weight="physical", moving_damping=0.0, settling_damping=0.0)
    found = simulate(IDLE, ground, geometry=TINY, actuation=drive, record_every=20)
    footing = footing_of(found, IDLE, LENGTH)
    assert (abs(found.distance[0]) > 0.1 * LENGTH) == slides
    assert footing.slips["all"] == pytest.approx(float(slides), abs=0.03)
    assert sum(footing.loads.values()) == pytest.approx(1.0)
    assert abs(footing.turning) < 1.0


@pytest.mark.kernels
def test_contact_with_a_raised_plane_is_that_with_the_floor(tmp_path):
    np.save(tmp_path / "raised.npy", np.full((61, 61), 0.05))
    design, found = dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 2)), []
    for ground in (None, f"{tmp_path / 'raised.npy'}:0.05"):
        options = {"geometry": GRIPPING, "actuation": LOW, "record_every": 20, "precision": "f64"}
        result = simulate(design, Terrain(ground=ground), **options)
        footing = footing_of(result, design, GRIPPING.body_length)
        slip = slip_under_load(result, design, LOW)
        found.append([*slip, *footing.slips.values(), *footing.loads.values(), footing.chatter, footing.turning])
    assert found[1] == pytest.approx(found[0], rel=1e-6, nan_ok=True) and found[0][0] > 0


def robot_of(way: Contact):
    """What is left of a result when its contact is known."""
    return type("Result", (), {"body": TINY.body, "contact": way})()


@pytest.fixture
def footing(monkeypatch):
    monkeypatch.setattr(Contact, "of", classmethod(lambda cls, result, design, robot=0: result.contact))
    return lambda way, design=INCHING: footing_of(robot_of(way), design, LENGTH)


LINE = np.outer(np.arange(6), [0.01, 0.0])


def test_each_part_slips_while_it_bears_load(footing):
    """Only the feet touch the floor, at the first four frames: so long they slide the whole path."""
    depth = np.where(np.isin(KINDS, (FOOT_1, FOOT_2)), 1e-4, 0.0) * (np.arange(6) < 4)[:, None]
    found = footing(contact(LINE, depth))
    assert found.slips["feet"] == found.slips["all"] == pytest.approx(1.0)
    assert np.isnan([found.slips[name] for name in ("seams", "bladders", "core")]).all()
    assert found.loads == {"feet": 1.0, "seams": 0.0, "bladders": 0.0, "core": 0.0}


def test_a_part_that_holds_while_the_rest_moves_on_does_not_slip(footing):
    way = contact(LINE)
    foot = KINDS == FOOT_1
    way.places[:, foot] = way.places[:1, foot]
    found = footing(way)
    share = foot.sum() / len(KINDS)
    other = (KINDS == FOOT_2).sum() / (foot | (KINDS == FOOT_2)).sum()
    assert found.slips["feet"] == pytest.approx(other / (1 - share))
    assert found.slips["core"] == pytest.approx(1 / (1 - share))


def test_softer_regions_bear_less_load(footing):
    even = footing(contact(LINE)).loads["feet"]
    modulus = np.where(np.isin(np.arange(TINY.region_count), (FOOT_1, FOOT_2)), 0.5, 1.0)
    soft = dataclasses.replace(INCHING, materials=RegionMaterials(modulus=tuple(modulus)))
    assert footing(contact(LINE), soft).loads["feet"] == pytest.approx(even / (2 - even))


def test_a_robot_in_the_air_bears_and_slides_nothing(footing):
    found = footing(contact(LINE, 0.0))
    assert np.isnan([*found.slips.values(), *found.loads.values()]).all() and found.chatter == 0.0


@pytest.mark.parametrize(
    ("shifts", "depth", "expected"),
    [
        (LINE, 1e-4, 0.0),
        (np.zeros((6, 2)), 1e-4, 0.0),
        (np.zeros((6, 2)), 1e-4 * (np.arange(6) % 2)[:, None], 1.0),  # contact comes and goes at every frame
        (np.outer(np.arange(6) % 2, [0.01, 0.0]), 1e-4, 0.8),  # it turns round at four of five intervals
        (np.outer(np.arange(6) % 2, [1e-7, 0.0]), 1e-4, 0.0),  # it creeps, and rests
    ],
)
def test_chatter_is_the_share_of_changes(shifts, depth, expected):
    assert chatter_of(contact(shifts, depth), LENGTH) == pytest.approx(expected)


@pytest.mark.parametrize("degrees", [90.0, -90.0, 360.0])
def test_a_robot_that_turns_says_so(degrees):
    turns = np.linspace(0.0, degrees, 9)
    assert turning_of(contact(np.zeros((9, 2)), turns=turns)) == pytest.approx(degrees)
    assert turning_of(contact(np.outer(np.arange(9), [0.1, 0.1]))) == pytest.approx(0.0)


@pytest.mark.parametrize(("heading", "expected"), [(0.0, 0.0), (90.0, -0.3), (45.0, -0.3 / np.sqrt(2))])
def test_what_is_ahead_of_one_robot_is_drift_of_one_turned_by_90_degrees(heading, expected):
    drift = sideways(np.tile([0.3, 0.0], (2, 1)), [heading] * 2)
    assert drift == pytest.approx([expected] * 2)
    ahead = np.full(2, 0.3 * np.cos(np.deg2rad(heading)))
    found = Scrutiny((1e-4, 2.0), "published", 0.1, ahead, drift, (), {})
    assert found.drift == pytest.approx(abs(np.tan(np.deg2rad(heading)))) or heading == 90.0
    assert dataclasses.replace(found, distances=np.zeros(2)).to_document()["drift"] is None


def test_what_is_not_known_is_null_and_told_as_such():
    lost = {"wood": np.array([0.05, np.nan]), "acrylic": np.array([0.05, 0.1])}
    found = Scrutiny((1e-4, 2.0), "published", 0.1, np.full(2, 0.3), np.zeros(2), (), lost)
    document = found.to_document()
    assert document["changed"] == {"wood": None, "acrylic": pytest.approx(0.075)} and document["kept"]["wood"] is None
    assert document["part_slip"]["all"] is None and document["drift"] == 0.0
    assert found.lines[-1] == "changed, BL/s and share kept: wood unknown (unknown), acrylic 0.0750 (0.75)"


GIVEN = Conditions(INCHING, Terrain(5.0, low_friction=0.1, high_friction=1.5), PUBLISHED, ACTUATION)


def test_changed_conditions_are_changes_of_those_given():
    changed = variations_of(GIVEN)
    assert {each.terrain.slope for each in changed.values()} == {5.0}
    assert {name: changed[name].friction for name in FLOORS} == FLOORS
    assert [changed[name].actuation.weight for name in FLOORS] == ["physical"] * 2
    assert {changed[f"{name}, weight as published"].friction for name in FLOORS} == set(FLOORS.values())
    assert {changed[f"{name}, weight as published"].actuation.weight for name in FLOORS} == {"published"}
    assert changed[WEIGHT].actuation.weight == "physical" and changed[WEIGHT].friction == (0.1, 1.5)
    assert changed["0.8 of the friction"].friction == pytest.approx((0.08, 1.2))
    assert changed["1.2 of the friction"].friction == pytest.approx((0.12, 1.8))
    assert changed["1.2 of the friction"].actuation == ACTUATION
    assert changed[HALF_STEP].friction == (0.1, 1.5)


def test_weight_and_floor_are_apart_only_where_bladders_have_the_published_weight():
    heavy = dataclasses.replace(GIVEN, actuation=dataclasses.replace(ACTUATION, weight="physical"))
    apart = {WEIGHT, *(f"{floor}, weight as published" for floor in FLOORS)}
    assert set(variations_of(GIVEN)) - set(variations_of(heavy)) == apart
    for floor in FLOORS:
        assert variations_of(heavy)[floor].actuation == heavy.actuation
        assert variations_of(heavy)[floor].friction == on_floor(heavy, floor).friction == FLOORS[floor]


def test_feet_with_friction_of_their_own_are_varied_too():
    own = dataclasses.replace(INCHING, materials=RegionMaterials(friction=((4.0, 1.0), (0.5, 0.25))))
    given = dataclasses.replace(GIVEN, design=own)
    changed = variations_of(given)
    less, more = (changed[f"{part} of the friction"].design.materials.friction for part in (0.8, 1.2))
    assert np.array(less) == pytest.approx(np.array([[3.2, 0.8], [0.4, 0.2]]))
    assert np.array(more) == pytest.approx(np.array([[4.0, 1.2], [0.6, 0.3]]))
    assert changed["wood"].design.materials.friction is None


@pytest.mark.parametrize("own", [None, [900, 40]])
def test_half_the_time_step_takes_the_same_time(own):
    gait = INCHING.schedule.cut(2, 2)
    if own:
        gait = dataclasses.replace(gait, motion_steps=own, settle_steps=own)
    given = dataclasses.replace(GIVEN, design=dataclasses.replace(INCHING, schedule=gait))
    half = variations_of(given)[HALF_STEP]
    assert half.geometry.time_step == pytest.approx(PUBLISHED.time_step / 2)
    steps = [gait_steps(each.design.schedule, each.actuation) for each in (given, half)]
    assert steps[1] == pytest.approx(2 * steps[0], abs=20)
    begin = [each.actuation.initial_steps(INCHING.pressure) for each in (given, half)]
    assert begin[1] == pytest.approx(2 * begin[0], abs=2)


@pytest.mark.kernels
def test_shorter_and_shorter_time_steps_agree_more_and_more():
    """Where nothing touches anything, the same strokes in half the time step, and in half of that, move it alike."""
    drive = dataclasses.replace(QUICK, inflation_rate=0.003)
    design = dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 1))
    whole = Conditions(design, Terrain.water(), TINY, drive)
    half = at_half_step(whole)
    way = []
    for tried in (whole, half, at_half_step(half)):
        options = {"geometry": tried.geometry, "actuation": tried.actuation, "precision": "f64"}
        way.append(simulate(tried.design, tried.terrain, **options).distance[0])
    assert abs(way[2] - way[1]) < 0.25 * abs(way[1] - way[0]) and way[2] == pytest.approx(way[1], rel=0.01)


@pytest.mark.kernels
def test_in_water_steps_are_short_enough_for_bladders_that_swell():
    """Full bladders shake where steps are too long for them, so that rounding moves a robot by micrometres."""
    design = dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 1))
    drive = dataclasses.replace(QUICK, inflation_rate=0.003)
    moved = [
        simulate(dataclasses.replace(design, pressure=pressure), Terrain.water(), geometry=TINY, actuation=drive)
        for pressure in (2e3, 2e3 * (1 + 1e-12))
    ]
    np.testing.assert_allclose(moved[1].displacement, moved[0].displacement, rtol=0, atol=1e-11)
    assert TINY.substeps(is_wet=False, largest=drive.largest_size) == 1 and drive.largest_size == 2.5
    assert TINY.substeps(is_wet=True, largest=2.5) == 6 and TINY.substeps(is_wet=True, largest=1.0) == 2
    thin = dataclasses.replace(drive, inflated=1.0)
    with pytest.raises(
        ValueError, match=r"^inflated: 1 and 2.5 are not allowed in one batch in water, where they take"
    ):
        simulate([design] * 2, Terrain.water(), geometry=TINY, actuation=[drive, thin])


def test_bladders_are_largest_through_the_pouch_or_along_it():
    assert ACTUATION.largest_size == 2.5
    assert dataclasses.replace(ACTUATION, lengthening_flat=0.5).largest_size == pytest.approx(1 + 2.3 / 0.5)


def test_columns_too_long_for_half_the_time_step_are_not_tried_with_it():
    gait = dataclasses.replace(INCHING.schedule.cut(2, 2), settle_steps=[600_000, 40])
    given = dataclasses.replace(GIVEN, design=dataclasses.replace(INCHING, schedule=gait))
    assert set(variations_of(given)) == set(variations_of(GIVEN)) - {HALF_STEP}


@pytest.mark.kernels
def test_a_closer_look_leaves_the_other_numbers_their_bits(monkeypatch):
    monkeypatch.setattr(judgement, "RECORD_EVERY", 20)
    design = dataclasses.replace(INCHING, schedule=INCHING.schedule.cut(2, 2))
    options = {"geometry": TINY, "actuation": QUICK, "runs": 2, "precision": "f64"}
    parts = []
    before = judge_gait(design, Terrain(5.0), **options).to_document()
    found = judge_gait(design, Terrain(5.0), **options, closely=True, progress=parts.append)
    after = found.to_document()
    assert {name: after[name] for name in before} == before
    assert set(after["changed"]) == set(after["kept"]) == set(variations_of(GIVEN))
    assert after["weight"] == "published" and after["friction"] == [1e-4, 2.0]
    assert sum(after["part_load"].values()) == pytest.approx(1.0) and 0 <= after["chatter"] <= 1
    assert parts == sorted(parts) and parts[-1] == pytest.approx(1.0)
    heavy = judge_gait(design, Terrain(5.0), **options | {"actuation": dataclasses.replace(QUICK, weight="physical")})
    assert heavy.hard_speeds.tolist() == found.hard_speeds.tolist() and heavy.speed != found.speed
