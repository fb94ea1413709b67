from functools import partial

import numpy as np
import pytest

from optim.measures import homeostasis
from taichi_sim.signals import warping_distances

WARPING = partial(warping_distances, threads=1)
TIMES = np.linspace(0, 4 * np.pi, 200)


def mean_difference(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.abs(first - second).mean(axis=1)


def light_of_vehicles(sites: np.ndarray, weights: np.ndarray, steps: int = 10_000, dt: float = 0.05) -> np.ndarray:
    """Light at the two sensors of Braitenberg vehicles, shape (B, 4, 2, steps + 1), from the four corners.

    Args:
        sites: of the sensors in the frame of each vehicle, shape (B, 2, 2).
        weights: from sensors to wheels, shape (B, 2).
    """
    corner = 4 / np.sqrt(2)
    x, y = np.array([[1, 1, -1, -1], [1, -1, -1, 1]])[:, None, :] * corner * np.ones((len(sites), 1))
    heading = np.zeros_like(x)
    light = np.empty((steps + 1, 2, *x.shape))
    for seen in light:
        cos, sin = np.cos(heading), np.sin(heading)
        for s in range(2):
            along, across = sites[:, s, :1], sites[:, s, 1:]
            seen[s] = 1 / ((x + cos * along - sin * across) ** 2 + (y + sin * along + cos * across) ** 2)
        left, right = weights[:, :1] * seen[0], weights[:, 1:] * seen[1]
        speed = (left + right) / 2
        x, y, heading = x + dt * speed * cos, y + dt * speed * sin, heading + dt * (left - right)
    return light.transpose(2, 3, 1, 0)


@pytest.mark.kernels
def test_four_controllers_that_another_program_measured():
    """Baseline and best body of chapter 4, with the settings of its experiment: dt 0.05, 10,000 steps."""
    baseline, best = [[0.5, 0.5], [0.5, -0.5]], [[-0.5, -0.375], [0.5, 0.5]]
    weights = np.array([[0.77, 0.77], [1, 1], [-1, 1], [-0.8, 0.6]])
    light = light_of_vehicles(np.array([baseline, baseline, best, best]), weights)
    assert homeostasis(light, WARPING) == pytest.approx([0.0174, 0.0099, 0.00233, 0.00338], rel=2e-3)


def test_by_hand():
    signals = np.zeros((2, 3, 2, 4))  # controllers, environments, sensors, samples
    signals[0, :, 0] = [[1.0], [2.0], [4.0]]  # differ by 1, 3 and 2
    signals[0, :, 1] = [[0.0], [0.0], [6.0]]  # by 0, 6 and 6
    assert np.array_equal(homeostasis(signals, mean_difference), [(2 + 4) / 2, 0])


def test_pairs_of_environments_meet_once_sensor_by_sensor():
    signals = np.arange(2 * 4 * 3).reshape(2, 4, 3, 1)
    asked = []

    def distances(first, second):
        asked.extend(zip(first.ravel().astype(int), second.ravel().astype(int), strict=True))
        return np.zeros(len(first))

    homeostasis(signals, distances)
    wanted = [(s[i, k, 0], s[j, k, 0]) for s in signals for i in range(4) for j in range(i) for k in range(3)]
    assert len(asked) == 2 * 6 * 3 and {frozenset(p) for p in asked} == {frozenset(map(int, p)) for p in wanted}


@pytest.mark.kernels
def test_controllers_are_judged_alone_and_failures_stay_failures():
    signals = np.random.default_rng(0).normal(size=(5, 4, 2, 30))
    whole = homeostasis(signals, WARPING)
    assert np.array_equal(whole, np.concatenate([homeostasis(s[None], WARPING) for s in signals]))
    signals[3, 2, 1, 17] = np.nan
    spoilt = homeostasis(signals, WARPING)
    assert np.array_equal(np.isnan(spoilt), np.arange(5) == 3)
    assert np.array_equal(spoilt[[0, 1, 2, 4]], whole[[0, 1, 2, 4]])


@pytest.mark.kernels
def test_what_is_the_same_but_later_or_fainter():
    """Warping forgives delays; only normalised signals forgive amplitude."""
    late = np.sin(np.array([TIMES, np.clip(TIMES - 1, 0, None)]))[None, :, None]
    faint, different = (
        np.sin(TIMES) * np.array([[[[1.0]], [[0.3]]]]),
        np.sin(np.array([TIMES, 2.7 * TIMES]))[None, :, None],
    )
    plain = [homeostasis(s, WARPING)[0] for s in (late, faint, different)]
    normalised = [homeostasis(s, partial(WARPING, normalise=True))[0] for s in (late, faint, different)]
    assert plain[0] < 0.2 * plain[1] and plain[0] < 0.2 * plain[2]
    assert normalised[1] < 1e-12 and normalised[2] > 0.1


@pytest.mark.kernels
def test_no_controllers_have_no_scores():
    assert homeostasis(np.empty((0, 4, 2, 10)), WARPING).shape == (0,)


@pytest.mark.parametrize("shape", [(4, 2, 10), (3, 1, 2, 10), (3, 4, 0, 10)], ids=str)
def test_signals_of_another_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"signals: shape \(.*\) is not allowed; give \(controllers, environments,"):
        homeostasis(np.zeros(shape), mean_difference)


def test_distances_of_another_number_are_refused():
    with pytest.raises(ValueError, match=r"distances: shape \(1,\) is not allowed; give one for each of 12 pairs"):
        homeostasis(np.zeros((1, 4, 2, 10)), lambda first, second: np.zeros(1))
