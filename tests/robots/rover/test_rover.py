"""The two-wheel vehicle of chapter 3: its description, and its motion against an independent solver."""

import math
from pathlib import Path

import numpy as np
import pytest
from maximal_rover import MaximalRover

from robots.braitenberg import weight_grid
from robots.rover import (
    BEST,
    CANONICAL,
    LIGHT_HEIGHT,
    LIGHT_RADIUS,
    LIGHTS,
    TIME_STEP,
    Rover,
    controllers,
    differentiate,
    simulate,
)

ROVERS = {"canonical": Rover(CANONICAL), "best": Rover(BEST)}
EVERY = 50  # steps between samples of the reference
NEAR = 0.2  # m, beyond the distance of success: the reference's light, a ball, has perhaps stopped the vehicle


@pytest.fixture(scope="module")
def reference():
    with np.load(Path(__file__).parents[2] / "data" / "rover_runs.npz") as data:
        return dict(data)


@pytest.mark.kernels
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_vehicles_follow_the_reference_until_they_reach_the_light(reference, precision):
    for key, expected in reference.items():
        if not key.startswith("trajectory/"):
            continue
        name, *weights = key.removeprefix("trajectory/").split("_")
        done = simulate(ROVERS[name], [[float(w) for w in weights]], record_every=EVERY, precision=precision, threads=1)
        frames = done.rollouts.frames
        for k, light in enumerate(LIGHTS):
            away = np.hypot(*(expected[k, :, :2] - light).T)
            seconds = np.arange(len(away)) * EVERY * TIME_STEP
            before = ~np.maximum.accumulate(away <= ROVERS[name].success_distance + NEAR)
            error = np.linalg.norm(frames.position[: len(away), k] - expected[k, :, :3], axis=1)
            reading = frames.readings[: len(away), k] / expected[k, :, 7:] - 1
            for limit, most in ((2.5, 3e-5), (5.0, 3e-4), (10.0, 2e-3), (25.0, 2.5e-2), (125.0, 0.3)):
                assert error[before & (seconds <= limit)].max() < most
            assert np.abs(reading[before & (seconds <= 10)]).max() < 2e-3


@pytest.mark.kernels
def test_as_many_controllers_succeed_as_in_the_reference(reference):
    grid = weight_grid(31)[::2]
    for name, rover in ROVERS.items():
        expected = reference[f"{name}_min_distance"][::2, ::2]
        pairs = np.stack(np.meshgrid(grid[: len(expected)], grid, indexing="ij"), -1).reshape(-1, 2)
        done = simulate(rover, pairs, precision="f32", threads=1)
        closest = done.closest.reshape(expected.shape)
        reached = expected <= rover.success_distance
        assert (done.status == "ok").all()
        assert np.array_equal(done.success.reshape(expected.shape), reached) and reached.sum() > 25
        difference = np.abs(closest - expected)[~reached]
        assert np.median(difference) < 3e-3 and np.quantile(difference, 0.9) < 3e-2


@pytest.mark.kernels
def test_what_differs_from_the_reference_is_the_drift_of_hinges_axes(reference):
    """A solver in maximal coordinates repeats the reference; with axes held, it does what the vehicle does here."""
    expected = reference["trajectory/canonical_0.3_-0.9"][0, :5, :3]
    here = simulate(Rover(), (0.3, -0.9), [LIGHTS[0]], steps=201, record_every=EVERY, precision="f64", threads=1)
    paths = []
    for drifting in (True, False):
        solver, path = MaximalRover(Rover(), (0.3, -0.9), LIGHTS[0], drifting), []
        for step in range(len(expected) * EVERY - EVERY + 1):
            if step % EVERY == 0:
                path.append(solver.places[0].copy())
            solver.step()
        paths.append(path)
    assert np.abs(paths[0] - expected).max() < 1e-10
    error = np.linalg.norm(here.rollouts.frames.position[:, 0] - paths[1], axis=1)
    drift = np.linalg.norm(np.array(paths[1]) - expected, axis=1)
    assert error[-1] < 0.03 * drift[-1] and drift[-1] > 1e-3


def test_a_light_is_reached_before_it_could_be_touched():
    rover = Rover()
    radius, level = rover.wheel_radius, abs(rover.wheel_radius - LIGHT_HEIGHT)
    touching = math.sqrt((radius + LIGHT_RADIUS) ** 2 - level**2)
    corner, castor, wheel = math.hypot(0.5, 0.5) + LIGHT_RADIUS, 0.5 + touching, math.hypot(0.5, 0.025) + touching
    assert max(corner, castor, wheel) < rover.success_distance == pytest.approx(0.960994, abs=1e-6)


@pytest.mark.kernels
def test_wires_cross_and_a_positive_weight_turns_towards_the_other_side():
    assert controllers((0.3, -0.9)).tolist() == [[[0, 0.3], [-0.9, 0]]]  # one row a sensor; columns left, right
    ahead = [(0.0, 6.0)]
    left, right, both = (
        simulate(Rover(), w, ahead, steps=600, precision="f32", threads=1).position[0, 0]
        for w in ((1, 0), (0, 1), (1, 1))
    )
    assert left[0] < -1e-2 < 1e-2 < right[0] and left[0] == pytest.approx(-right[0], abs=1e-3)
    assert abs(both[0]) < 1e-3 and both[1] > 0.1
    still = simulate(Rover(), (0, 0), ahead, steps=600, precision="f32", threads=1).position[0, 0]
    assert np.abs(still - [0, 0, Rover().wheel_radius]).max() < 1e-3


@pytest.mark.kernels
def test_a_mirrored_body_does_the_mirror_image():
    pairs = np.random.default_rng(1).uniform(-1, 1, (8, 2))
    rover = Rover(BEST)
    one = simulate(rover, pairs, precision="f64", steps=800, threads=1)
    other = simulate(rover.mirrored, pairs[:, ::-1], precision="f64", steps=800, threads=1)
    assert np.abs(one.closest - other.closest[:, [1, 0, 3, 2]]).max() < 1e-9
    assert np.abs(one.position * [-1, 1, 1] - other.position[:, [1, 0, 3, 2]]).max() < 1e-9


def test_bodies_have_the_numbers_of_the_theoretical_model():
    assert Rover(CANONICAL).vehicle.design == 6553 and Rover.published(6553) == Rover(CANONICAL)
    assert Rover.published(Rover(BEST).vehicle.design) == Rover(BEST)
    assert Rover().rate == pytest.approx(33.150, abs=5e-4) and Rover().torque == pytest.approx(6.1269, abs=5e-5)
    assert Rover(BEST).mirrored.mirrored == Rover(BEST)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Rover(((0.6, 0), (0, 0))), "sensors: 0.6 is not allowed; give a number from -0.5 to 0.5"),
        (lambda: Rover(((0, 0),)), "sensors: ((0, 0),) is not allowed; give two places"),
        (lambda: Rover((0.5, 0.5)), "sensors: (0.5, 0.5) is not allowed; give two places"),
        (lambda: Rover(castor_mass=0), "castor_mass: 0 is not allowed; give a finite number, at least 1e-06"),
        (lambda: Rover(torque=-1), "torque: -1 is not allowed; give a finite number, at least 0"),
        (lambda: simulate([], (1, 1)), "rovers: 0 are not allowed; give one, or one for each of 1"),
        (lambda: simulate(Rover(), [[1, 2, 3]]), "weights: shape (1, 3) is not allowed; give (N, 2)"),
        (lambda: simulate(Rover(), (1, math.nan)), "weights: numbers that are not finite are not allowed"),
        (lambda: simulate([Rover()] * 2, np.ones((3, 2))), "rovers: 2 are not allowed; give one, or one for each of 3"),
        (lambda: simulate(Rover(), (1, 1), [(1, 2, 3)]), "lights: shape (1, 3) is not allowed; give (E, 2)"),
    ],
)
def test_mistakes_are_one_line(make, message):
    with pytest.raises(ValueError) as raised:
        make()
    assert str(raised.value).startswith(message) and "\n" not in str(raised.value)


@pytest.mark.kernels
def test_derivatives_of_distances_by_the_weights_are_central_differences():
    settings = {"steps": 120, "precision": "f64", "threads": 1}
    pairs, shift = np.array([[0.3, -0.9], [1.0, 0.6]]), 1e-6
    found = differentiate(Rover(), pairs, LIGHTS[:2], **settings)
    plain = simulate(Rover(), pairs, LIGHTS[:2], **settings)
    assert plain.gradient is None and np.array_equal(found.distance, plain.distance)
    for n in range(2):
        moved = shift * np.eye(2)[n]
        ends = [simulate(Rover(), pairs + sign * moved, LIGHTS[:2], **settings).distance for sign in (1, -1)]
        assert found.gradient[..., n] == pytest.approx((ends[0] - ends[1]) / (2 * shift), rel=1e-5)
