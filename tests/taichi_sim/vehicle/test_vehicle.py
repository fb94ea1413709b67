"""The vehicle's equations, rollouts, traces and gradients, against analytic results and stored trajectories."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.braitenberg import STARTS, VehicleBody, contralateral
from taichi_sim.vehicle import VehicleBatch, VehicleTask, differentiate, equations, rollout, trace
from taichi_sim.vehicle import rollout_kernel as kernel

pytestmark = pytest.mark.kernels

REFERENCE = np.load(Path(__file__).parents[2] / "data/vehicle_sweep.npz")
TASK = VehicleTask(STARTS, steps=400)
FIELDS = ("reached", "closest", "arrival", "final", "diverged")


def batch(bodies=5, controllers=7, sensors=2, seed=0):
    rng = np.random.default_rng(seed)
    return VehicleBatch(
        rng.uniform(-0.5, 0.5, (bodies, sensors, 2)), rng.uniform(-1, 1, (bodies, controllers, 2, sensors))
    )


def euler(sites, matrix, start, light, time_step, steps):
    """The equations as they stand in the text, in the frame of the world: poses, shape (steps + 1, 3)."""
    poses = [np.array(start, float)]
    for _ in range(steps):
        a = poses[-1][2]
        turned = sites @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
        first, second = matrix @ (1 / ((turned - light + poses[-1][:2]) ** 2).sum(axis=1))
        speed = (first + second) / 2
        poses.append(poses[-1] + time_step * np.array([speed * np.cos(a), speed * np.sin(a), first - second]))
    return np.array(poses)


# the equations


@pytest.mark.parametrize("sensors", [1, 2, 3, 4, 5])
def test_readings_fall_with_the_square_of_the_distance(sensors):
    rng = np.random.default_rng(sensors)
    sites, place = rng.uniform(-0.5, 0.5, (sensors, 2)), np.array([2.0, -1.0])
    expected = 1 / ((place + sites) ** 2).sum(axis=1)
    assert np.allclose(equations.readings(*place, sites.ravel().tolist()), expected, rtol=1e-15)


def test_equal_motors_drive_straight_on():
    """One sensor at the centre, straight at the light: x' = -w / x^2, so x^3 = x0^3 - 3 w t."""
    one = VehicleBatch([[[0.0, 0.0]]], [[[[-1.0], [-1.0]]]])
    task = VehicleTask([[4.0, 0.0, 0.0]], time_step=1e-3, steps=15_000)
    path = trace(one, task, every=1000)
    assert np.allclose(path.poses[0, 0, 0, :, 0], np.cbrt(64 - 3 * path.times), rtol=2e-4)
    assert not path.poses[0, 0, 0, :, 1:].any()
    assert np.allclose(path.readings[0, 0, 0, 0], path.poses[0, 0, 0, :, 0] ** -2)


def test_opposite_motors_turn_on_the_spot():
    one = VehicleBatch([[[0.0, 0.0]]], [[[[0.5], [-0.5]]]])
    path = trace(one, VehicleTask([[2.0, 1.0, 0.3]], steps=100), every=10)
    assert np.allclose(path.poses[0, 0, 0, :, :2], [2.0, 1.0], atol=1e-12)
    assert np.allclose(path.poses[0, 0, 0, :, 2], 0.3 + path.times / 5)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 4), st.integers(0, 10**6), st.floats(-3, 3), st.floats(-2, 2))
def test_a_trace_is_what_the_text_says_for_any_sensors_and_light(sensors, seed, heading, shift):
    some = batch(1, 1, sensors, seed)
    light = np.array([shift, 1.0])
    task = VehicleTask([[3.0, 2.0 * shift + 4.0, heading]], light, time_step=0.1, steps=150)
    expected = euler(some.sites[0], some.controllers[0, 0], task.starts[0], light, 0.1, 150)
    assert np.allclose(trace(some, task).poses[0, 0, 0], expected, rtol=1e-9, atol=1e-9)


# stored trajectories


def test_trajectories_of_the_reference_to_1e_8_over_10000_steps():
    """The heading grows to hundreds of radians, which is what its error is relative to."""
    for (design, w1, w2, environment, least), expected in zip(
        REFERENCE["trajectory_setup"], REFERENCE["trajectories"], strict=True
    ):
        one = VehicleBatch([VehicleBody.published(int(design)).sensors], contralateral([w1, w2])[None, None])
        task = VehicleTask(STARTS[[int(environment)]])
        poses = trace(one, task, every=50).poses[0, 0, 0]
        assert np.abs(poses[:, :2] - expected[:, :2]).max() < 1e-8
        assert np.abs(poses[:, 2] - expected[:, 2]).max() < 1e-8 * max(1.0, np.abs(expected[:, 2]).max())
        done = rollout(one, task, until="end")
        assert abs(done.closest[0, 0, 0] - least) < 1e-8
        assert np.isclose(done.final[0, 0, 0], np.hypot(*poses[-1, :2]), rtol=0, atol=1e-12)


# batches


def same(first, second, names=FIELDS):
    return all(np.array_equal(getattr(first, n), getattr(second, n), equal_nan=n == "final") for n in names)


@pytest.mark.parametrize(
    ("precision", "until"), [("f32", "success"), ("f32", "end"), ("f64", "success"), ("f64", "closest")]
)
def test_neighbours_threads_and_width_change_no_bit(until, precision):
    some, options = batch(), {"until": until, "precision": precision}
    whole = rollout(some, TASK, **options, threads=1)
    names = FIELDS if until != "success" else ("reached", "arrival", "final", "diverged")
    for more in ({"width": 1}, {"width": 8}, {"width": 32}, {"threads": 2}):
        assert same(rollout(some, TASK, **options, **more), whole, names)
    for body in range(len(some.sites)):
        one = VehicleBatch(some.sites[[body]], some.controllers[[body]][:, ::-1])
        part = rollout(one, TASK, **options)
        assert all(np.array_equal(getattr(part, n)[0, ::-1], getattr(whole, n)[body], equal_nan=True) for n in names)


def test_many_rollouts_fill_lanes_again_and_lose_none():
    some = batch(bodies=3, controllers=900)
    whole = rollout(some, TASK, until="closest")
    some_again = VehicleBatch(some.sites[[1]], some.controllers[[1]][:, 400:420])
    assert np.array_equal(rollout(some_again, TASK).closest[0], whole.closest[1, 400:420])


def test_vehicles_without_any_connection_stay_where_they_are():
    """Their weights need no memory, and write none: the last slot of the last block is followed by others' data."""
    still = VehicleBatch(np.full((40, 2, 2), 0.1), np.zeros((1, 1, 2, 2)))
    assert kernel.slot_count(2, still.wiring) == kernel.slot_count(2, ((0,), ())) and still.weights.shape == (1, 1)
    done = rollout(still, TASK, until="end")
    assert np.allclose(done.final, 4.0) and not done.reached.any()
    assert not differentiate(still, TASK).of_final.sites.any()


def test_controllers_may_be_shared():
    some = batch(bodies=3)
    shared = VehicleBatch(some.sites, some.controllers[:1])
    each = VehicleBatch(some.sites, np.repeat(some.controllers[:1], 3, axis=0))
    assert same(rollout(shared, TASK), rollout(each, TASK))


def test_early_exits_change_nothing():
    """Neither which controllers succeed nor how close they come, over 10,000 steps of 800 controllers."""
    rng = np.random.default_rng(3)
    some = VehicleBatch(rng.uniform(-0.5, 0.5, (8, 2, 2)), contralateral(rng.uniform(-1, 1, (8, 100, 2))))
    task = VehicleTask(STARTS)
    end, closest, success = (rollout(some, task, until=until) for until in ("end", "closest", "success"))
    assert same(end, closest, ("reached", "closest", "arrival"))
    assert np.array_equal(end.reached, success.reached) and 10 < end.reached.sum() < end.reached.size - 10
    assert ((end.arrival >= 0) == end.reached).all() and np.isnan(closest.final).all()


def test_sensors_inside_the_radius_are_no_excuse_for_stopping():
    """With all sensors nearer to the centre than the radius the bound has to leave room for it."""
    some = VehicleBatch(np.full((1, 2, 2), 0.01), contralateral(np.full((1, 1, 2), -0.02)))
    task = VehicleTask([[1.0, 0.0, 0.0]], radius=0.9, time_step=0.05, steps=300)
    end, success = (rollout(some, task, until=until) for until in ("end", "success"))
    assert end.reached.all() and success.reached.all()


def test_arrival_counts_the_steps_to_the_first_success():
    one = VehicleBatch([VehicleBody.published(162).sensors], contralateral([[[-0.8, 0.6]]]))
    task = VehicleTask(STARTS)
    done, path = rollout(one, task), trace(one, task)
    distances = np.hypot(*np.moveaxis(path.poses[0, 0, ..., :2], -1, 0))
    assert done.arrival[0, 0].tolist() == [int(np.argmax(d < task.radius)) for d in distances]
    assert np.allclose(done.closest[0, 0], distances.min(axis=1), rtol=0, atol=1e-12)


def test_a_sensor_that_meets_the_light_is_reported():
    """Step by step straight into the light: the sensor is exactly there, and its reading infinite."""
    one = VehicleBatch([[[0.5, 0.0], [0.5, 0.0]]], contralateral([[[1.0, 1.0], [-1.0, -1.0]]]))
    task = VehicleTask([[-1.0, 0.0, 0.0]], time_step=0.125, steps=3)  # from 1 m by 1 / 0.25 / 8 to the light
    done = rollout(one, task, until="end")
    assert done.diverged[0, :, 0].tolist() == [True, False]
    assert np.isnan(differentiate(one, task).final[0, :, 0]).tolist() == [True, False]


# gradients


def differences(function, values, step=1e-5):
    """Central differences of fourth order of a function with results of shape (E,), shape (E,) + values.shape."""
    found = np.zeros((len(TASK.starts), *values.shape))
    for index in np.ndindex(values.shape):
        for distance, share in ((1, 2 / 3), (-1, -2 / 3), (2, -1 / 12), (-2, 1 / 12)):
            moved = values.copy()
            moved[index] += distance * step
            found[(slice(None), *index)] += share * function(moved) / step
    return found


@pytest.mark.parametrize("steps", [100, 2000])
@pytest.mark.parametrize("matrix", ["contralateral", "full"])
def test_gradients_are_central_differences(steps, matrix):
    """To 1e-6 of the largest, where differences of two widths agree so: the step of the smallest distance may jump."""
    task = VehicleTask(STARTS, steps=steps)
    sites = np.array([[0.5, 0.4], [0.3, -0.5]])
    weights = np.diag([0.2, 0.35]) if matrix == "contralateral" else np.array([[0.2, 0.05], [-0.1, 0.3]])
    found = differentiate(VehicleBatch([sites], weights[None, None]), task)
    assert np.array_equal(found.closest, rollout(VehicleBatch([sites], weights[None, None]), task).closest)
    for name in ("final", "closest"):

        def value(s, w, name=name):
            return getattr(rollout(VehicleBatch([s], w[None, None]), task, until="end"), name)[0, 0]

        slopes = getattr(found, f"of_{name}")
        ours = slopes.sites[0, 0], slopes.controllers[0, 0]
        numeric, wider = (
            (
                differences(lambda s: value(s, weights), sites, step),
                differences(lambda w: value(sites, w), weights, step) * (weights != 0),
            )
            for step in (1e-6, 2e-6)
        )
        for exact, fine, coarse in zip(ours, numeric, wider, strict=True):
            scale = max(np.abs(fine).max(), 1e-3)
            sure = np.abs(fine - coarse) < 5e-7 * scale
            assert sure.mean() > (0.99 if name == "final" else 0.7)
            assert np.abs(exact - fine)[sure].max() < 1e-6 * scale


def test_gradients_do_not_depend_on_neighbours():
    some = batch(bodies=5, controllers=3)
    whole = differentiate(some, TASK)
    one = differentiate(VehicleBatch(some.sites[[3]], some.controllers[[3]]), TASK)
    assert np.array_equal(whole.of_closest.sites[3], one.of_closest.sites[0])
    assert np.array_equal(whole.of_final.controllers[3], one.of_final.controllers[0])


# bad input


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: VehicleTask([[0, 0.01, 0]]), r"starts: \[0.0, 0.01\] is not allowed; it is closer to the light"),
        (lambda: VehicleTask([[1, 1]]), r"starts: shape \(1, 2\) is not allowed; give \(E, 3\)"),
        (lambda: VehicleTask(STARTS, lights=[1.0]), r"lights: shape \(4, 1\) is not allowed; give \(4, 2\)"),
        (lambda: VehicleTask(STARTS, radius=0.0), "radius: 0.0 is not allowed; give a positive finite number"),
        (lambda: VehicleTask(STARTS, time_step=float("nan")), "time_step: nan is not allowed"),
        (lambda: VehicleTask(STARTS, steps=0), "steps: 0 is not allowed; give a whole number, at least 1"),
        (lambda: VehicleTask([[np.nan, 1, 0]]), "starts: nan is not allowed; give finite numbers"),
        (lambda: VehicleBatch(np.zeros((0, 2, 2)), np.zeros((1, 1, 2, 2))), r"sites: shape \(0, 2, 2\)"),
        (lambda: VehicleBatch(np.zeros((1, 2, 2)), np.zeros((1, 1, 2, 3))), r"give \(B, C, 2, 2\)"),
        (
            lambda: VehicleBatch(np.zeros((3, 2, 2)), [[1.0], [1.0, 2.0]]),
            "controllers: .* give numbers",
        ),
        (lambda: VehicleTask("here"), "starts: 'here' is not allowed; give numbers of shape"),
        (lambda: VehicleTask(STARTS, steps=np.float64(5)), "steps: .* is not allowed; give a whole number"),
        (lambda: rollout(batch(), TASK, until="never"), "until: 'never' is unknown; choose one of success"),
        (lambda: trace(batch(), TASK, every=0), "every: 0 is not allowed"),
        (lambda: trace(batch(100, 60), VehicleTask(STARTS)), "too many; give a larger one"),
    ],
)
def test_bad_input_is_one_line(build, message):
    with pytest.raises(ValueError, match=message) as error:
        build()
    assert "\n" not in str(error.value)
