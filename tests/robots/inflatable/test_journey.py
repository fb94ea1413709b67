"""Journeys: one leg is a gait, legs go on where others ended, the ground changes between them."""

from dataclasses import replace

import numpy as np
import pytest
from graded import QUICK, TINY, settling
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robots.inflatable import PUBLISHED
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import Leg, simulate_journey
from robots.inflatable.simulation import simulate
from robots.inflatable.transition import TransitionJudgement, change_of_shape, deepest_contact, shape_error, turned_by
from robots.inflatable.view.motion import journey_motion
from robots.world import Terrain

HILL = Terrain(10.0)
OPTIONS = {"geometry": TINY, "actuation": QUICK, "threads": 1}
RNG = np.random.default_rng(3)
LEVELS = RNG.random((10, 4)).round(2)
WALK = InflatableDesign(1000.0, 60.0, settling(LEVELS, np.array([50, 80, 20, 60])))


def part(columns: slice) -> InflatableDesign:
    return InflatableDesign(1000.0, 60.0, settling(LEVELS[:, columns], np.array([50, 80, 20, 60])[columns]))


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_journey_of_one_leg_is_the_gait(precision):
    alone = simulate(WALK, HILL, precision=precision, record_every=100, **OPTIONS)
    found = simulate_journey([Leg(WALK, HILL)], precision=precision, record_every=100, **OPTIONS)
    assert found.distances[0, 0] == pytest.approx(alone.distance[0], rel=1e-6)
    assert found.steps[0] == alone.steps[0]
    np.testing.assert_array_equal(found.frames.positions, alone.frames.positions)


@pytest.mark.kernels
def test_a_gait_in_two_legs_goes_on_as_if_it_were_one():
    """Nothing is put back between legs: not even by a bit."""
    whole = simulate_journey([Leg(WALK, HILL)], record_every=50, **OPTIONS)
    parts = simulate_journey([Leg(part(slice(0, 2)), HILL), Leg(part(slice(2, 4)), HILL)], record_every=50, **OPTIONS)
    np.testing.assert_array_equal(parts.frames.positions, whole.frames.positions)
    assert parts.distances.sum() == pytest.approx(whole.distances.sum())
    assert parts.steps.sum() == whole.steps.sum()


@pytest.mark.kernels
def test_the_ground_changes_between_legs():
    """A robot whose feet slide stays on level ground, and slides down once the ground is tilted."""
    still = InflatableDesign(0.0, 90.0, settling(np.zeros((10, 1)), [400], motion=[400]))
    level, down = Terrain(high_friction=0.0, low_friction=0.0), Terrain(20.0, high_friction=0.0, low_friction=0.0)
    found = simulate_journey([Leg(still, level), Leg(still, down)], **OPTIONS)
    assert abs(found.distances[0, 0]) < 1e-4 and found.distances[0, 1] < -1e-3
    heading = found.positions[0, 2].mean(axis=0) - found.positions[0, 1].mean(axis=0)
    assert abs(heading[0]) < 0.02 * abs(heading[1])


@pytest.mark.kernels
def test_friction_is_that_of_the_ground_of_each_leg():
    still = InflatableDesign(0.0, 90.0, settling(np.zeros((10, 1)), [400], motion=[400]))
    rough, slick = Terrain(20.0), Terrain(20.0, high_friction=0.0, low_friction=0.0)
    found = simulate_journey([Leg(still, slick), Leg(still, rough)], **OPTIONS)
    alone = simulate_journey([Leg(still, slick), Leg(still, slick)], **OPTIONS)
    assert abs(found.distances[0, 1]) < 0.2 * abs(alone.distances[0, 1])


@pytest.mark.kernels
def test_runs_of_a_journey_differ_by_their_noise_alone():
    noisy = simulate_journey([Leg(WALK, HILL)], runs=3, perturbation=1e-6, seed=4, **OPTIONS)
    again = simulate_journey([Leg(WALK, HILL)], runs=3, perturbation=1e-6, seed=4, **OPTIONS)
    assert len(set(noisy.distances[:, 0].tolist())) == 3
    np.testing.assert_array_equal(noisy.distances, again.distances)
    np.testing.assert_allclose(
        noisy.speeds[:, 0], noisy.distances[:, 0] / (TINY.body_length * noisy.steps[0] * TINY.time_step)
    )


@pytest.mark.kernels
def test_a_journey_that_diverges_is_no_number():
    torn = InflatableDesign(0.0, 0.0, settling(np.ones((10, 1)), [600], motion=[10]))
    fast = replace(QUICK, inflation_rate=500.0, inflated=50_000.0)  # far beyond what any processor rounds away
    found = simulate_journey([Leg(torn, Terrain())], geometry=TINY, actuation=fast, threads=1)
    assert found.status[0] == "diverged" and np.isnan(found.distances).all()


@pytest.mark.parametrize(
    ("legs", "message"),
    [
        ([], "legs: none given; give at least one"),
        ([Leg(WALK, HILL), Leg(WALK, Terrain.water())], "legs: ground and a fluid are not allowed in one journey"),
        ([Leg(WALK, HILL), Leg(replace(WALK, pressure=0.0), HILL)], "legs: leg 2 begins with 0 kPa, but the one"),
    ],
)
def test_legs_that_cannot_follow_each_other_are_refused(legs, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        simulate_journey(legs, **OPTIONS)


# changes of shape


def test_a_change_of_shape_takes_the_measured_times():
    up, down = (change_of_shape(*ends, 0.0).schedule for ends in ((0.0, 12e3), (12e3, 0.0)))
    seconds = [float(gait.motion_steps[-1]) * PUBLISHED.time_step for gait in (up, down)]
    assert seconds == pytest.approx([11.5, 4.7], abs=1e-4)
    assert up.core_pressure.tolist() == [0.0, 12e3] and down.core_pressure.tolist() == [12e3, 0.0]
    together = change_of_shape(0.0, 12e3, 0.0, together=True).schedule
    assert together.columns == 1 and together.core_pressure.tolist() == [12e3]


@pytest.mark.kernels
def test_a_change_of_shape_ends_with_the_shape():
    """Of a small pouch: round, then flat again; and its rows alone say the same."""
    slow = {**OPTIONS, "actuation": replace(QUICK, hold_steps=4000)}
    legs = [
        Leg(change_of_shape(*ends, 0.0, times=(0.3, 0.3), geometry=TINY, actuation=QUICK), Terrain())
        for ends in ((0.0, 6e3), (6e3, 0.0))
    ]
    found = simulate_journey(legs, **slow)
    target = simulate_journey([legs[1]], **slow).positions[0, 0]
    flat, full, end = found.positions[0]
    assert shape_error(full, target) < 0.2 * shape_error(flat, target)
    assert shape_error(end, flat) < 0.2 * shape_error(full, flat)


@given(st.integers(0, 1000), st.floats(0.0, 180.0))
def test_the_shape_knows_no_rigid_motion(seed, angle):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(12, 3))
    turn = Rotation.from_rotvec(np.deg2rad(angle) * unit(rng.normal(size=3)))
    moved = turn.apply(places) + rng.normal(size=3)
    assert shape_error(moved, places) == pytest.approx(0.0, abs=1e-9)
    assert turned_by(moved, places) == pytest.approx(angle, abs=1e-4)
    mirrored = places * [1, 1, -1]
    assert shape_error(mirrored, places) > 1e-3  # a mirror image is another shape


def test_contact_is_seen_where_voxels_are_in_each_other():
    body = TINY.body
    sizes = np.full((body.voxel_count, 3), body.voxel_size)
    apart = body.start_positions.copy()
    apart[body.voxels[:, 2] >= 3, 2] += body.voxel_size  # the skins, which begin a quarter in each other
    assert deepest_contact(body, apart, sizes) == 0.0
    assert deepest_contact(body, body.start_positions, sizes) == pytest.approx(0.25)


def test_a_change_has_the_faults_that_its_numbers_tell():
    good = TransitionJudgement(shape_error=1e-3, moved=0.1, turned=5.0, deepest=0.3, diverged=False)
    assert good.faults() == ()
    for changes, fault in (
        ({"shape_error": 6e-3}, "ends 6.0 mm from the shape, more than 5"),
        ({"moved": 0.7}, "the robot moves away by 0.70 body lengths, more than 0.5"),
        ({"deepest": 0.9}, "voxels are 0.90 of their size in each other, more than 0.75"),
        ({"diverged": True}, "the simulation diverged"),
        ({"shape_error": float("nan")}, "ends nan mm"),
    ):
        (found,) = replace(good, **changes).faults()
        assert found.startswith(fault)


def unit(vector):
    return vector / np.linalg.norm(vector)


@pytest.mark.kernels
def test_the_way_of_a_journey_that_is_shown_is_along_the_heading_of_each_leg():
    turned = replace(part(slice(2, 4)), orientation=0.0)
    legs = [Leg(part(slice(0, 2)), HILL), Leg(turned, Terrain())]
    found = simulate_journey(legs, record_every=1, **OPTIONS)
    motion = journey_motion(found, legs, actuation=QUICK)
    shown = next(channel for channel in motion.channels if channel.name == "distance")
    assert shown.values[-1] == pytest.approx(found.distances[0].sum(), abs=1e-5)
    middle = np.interp(found.steps[0] * found.time_step, shown.times, shown.values)
    assert middle == pytest.approx(found.distances[0, 0], abs=1e-5)
