"""Switching between gaits by what is sensed."""

import numpy as np
import pytest

from robots.control.switching import Switcher, Switching, features, fitted, steady


def rule(**changed):
    """Two gaits, two grounds: the score of ground 1 is the mean of one reading, that of ground 0 is 0.5."""
    weights = np.array([[[0.0, 0.0, 0.5], [1.0, 0.0, 0.0]]] * 2)
    return Switching(weights, **{"answers": (0, 1), "window": 2, **changed})


def played(switching: Switching, readings) -> list[int]:
    switcher = Switcher(switching, [0])
    return [int(switcher.look(np.array([[reading]]))[0]) for reading in readings]


def test_a_machine_switches_when_the_score_of_another_ground_is_ahead():
    """As soon as the mean over the window is."""
    assert played(rule(), [0, 0, 0.8, 0.8, 0.8, 0, 0, 0]) == [0, 0, 0, 1, 1, 0, 0, 0]


def test_hysteresis_keeps_a_gait():
    """Scores that swing less than the margin about each other change nothing; a gait stays for some looks at least."""
    swinging = [0.4, 0.4, 0.6, 0.6, 0.4, 0.4, 0.6, 0.6, 0.4]
    assert len(set(played(rule(), swinging))) == 2
    assert set(played(rule(margin=0.2), swinging)) == {0}
    assert played(rule(margin=0.2), [0, 0, 0.9, 0.9, 0.6, 0.4, 0.4, 0, 0])[3:] == [1, 1, 1, 1, 0, 0]
    assert played(rule(stay=4), [0.9, 0.9, 0.9, 0.9, 0.0, 0.0, 0.0, 0.0]) == [0, 0, 0, 1, 1, 1, 1, 0]


def test_grounds_with_the_same_gait_do_not_rival_each_other():
    """The margin is against the best ground of the gait that is played."""
    weights = np.array([[[0.0, 0.0, 0.5], [0.0, 0.0, 0.9], [1.0, 0.0, 0.0]]] * 2)
    switching = Switching(weights, (0, 0, 1), window=1)
    assert played(switching, [0.0, 0.8, 0.95]) == [0, 0, 1]


def test_weights_tell_grounds_apart_however_rare_they_are():
    """By the gait that is played, of which the readings of the same ground differ."""
    rng = np.random.default_rng(0)
    gaits, grounds = rng.integers(2, size=600), (rng.random(600) < 0.1).astype(int)
    felt = np.column_stack([np.where(gaits == 0, 1.0, -1.0) * (2.0 * grounds - 1), rng.normal(size=600)])
    felt += 0.1 * rng.normal(size=felt.shape)
    switching = Switching(fitted(felt, gaits, grounds, (3, 2)), (0, 1))
    scores = switching.scores(gaits, felt)
    assert (scores.argmax(axis=1) == grounds).all()
    assert np.allclose([scores[grounds == ground, ground].mean() for ground in (0, 1)], 1.0, atol=0.1)
    assert np.isfinite(switching.weights[2]).all()  # of a gait that was never played


def test_features_and_windows_in_which_nothing_changed():
    """Means and standard deviations."""
    looks = np.array([[[1.0, 5.0], [3.0, 5.0]]])
    assert np.array_equal(features(looks), [[2.0, 5.0, 1.0, 0.0]])
    assert steady(np.array([[0, 0, 0, 1, 1, 1]]), 3).tolist() == [[False, False, True, False, False, True]]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"margin": -1.0}, "margin: -1.0 is not allowed"),
        ({"stay": -1}, "stay: -1 is not allowed"),
        ({"window": 0}, "window: 0 is not allowed"),
        ({"answers": (0, 2)}, r"answers: \(0, 2\) is not allowed; give 2 numbers below 2"),
        ({"answers": (0,)}, r"answers: \(0,\) is not allowed; give 2 numbers below 2"),
    ],
)
def test_bad_input(changed, message):
    """One line."""
    with pytest.raises(ValueError, match=f"^{message}"):
        rule(**changed)
    with pytest.raises(ValueError, match=r"^weights: shape"):
        Switching(np.zeros(3), (0,))
