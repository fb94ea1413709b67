"""Measurements that are too far off to be noise are told, and hardly ever where there are none."""

import dataclasses

import numpy as np
import pytest
from laboratory import BENCH, NEAR, drag, noisy

from optim.calibration import calibrate, document
from optim.calibration.misfit import Linearised
from optim.calibration.outliers import outliers
from robots.calibration import Drag


def fitted(errors, slopes):
    """What is left of errors after a fit by least squares."""
    left = errors - slopes @ np.linalg.lstsq(slopes, errors, rcond=None)[0]
    return Linearised(np.ones(len(errors)), left, slopes, np.zeros((len(errors), len(errors))))


def pulls(count):
    return Drag(np.arange(1.0, count + 1) * 1e-3, np.linspace(0.1, 1.0, count), 0.5)


def told(errors, rng, *experiments, properties=2):
    return outliers(fitted(errors, rng.normal(size=(len(errors), properties))), experiments)


@pytest.mark.parametrize("counts, properties", [((12, 8), 2), ((7, 7, 6), 3)])
def test_one_fit_in_twenty_has_a_false_outlier(counts, properties):
    """Of several experiments, too, whose residuals one fit makes."""
    rng, experiments = np.random.default_rng(0), [pulls(count) for count in counts]
    found = [bool(told(rng.normal(size=sum(counts)), rng, *experiments, properties=properties)) for _ in range(2000)]
    assert 0.02 < np.mean(found) < 0.07


def test_an_outlier_of_an_experiment_makes_none_of_another():
    rng, hits = np.random.default_rng(3), 0
    for _ in range(200):
        errors = rng.normal(size=20)
        errors[13] += 100.0
        (first, *others) = told(errors, rng, pulls(10), pulls(10))
        assert f"at displacement [m] {pulls(10).at[3]:.4g} lies" in first
        hits += bool(others)
    assert hits < 20


@pytest.mark.parametrize("places", [(3,), (3, 7)])
def test_outliers_are_named_by_their_values_even_if_there_are_two(places):
    rng, hits = np.random.default_rng(1), 0
    for _ in range(100):
        errors = rng.normal(size=20)
        errors[list(places)] += rng.choice([-12.0, 12.0], len(places))
        lines = told(errors, rng, pulls(20))
        names = [f"at displacement [m] {pulls(20).at[place]:.4g} lies" for place in places]
        hits += all(any(name in line for line in lines) for name in names)
    assert hits >= 90


def test_few_readings_and_those_that_fit_exactly_tell_none():
    rng = np.random.default_rng(2)
    assert told(np.array([0.1, 0.1, 50.0, 0.1]), rng, pulls(4)) == told(np.zeros(9), rng, pulls(9)) == ()
    exact = fitted(np.ones(6), np.eye(6))  # a property for each of the points
    assert outliers(exact, [pulls(6)]) == ()


@pytest.mark.kernels
def test_a_wrong_reading_is_warned_of():
    measured = noisy([drag()], 1)[0]
    values = np.array(measured.values)
    values[1] *= 1.4
    wrong = dataclasses.replace(measured, values=values)
    clean, found = (calibrate([each], BENCH, ("friction",), NEAR) for each in (measured, wrong))
    assert clean.outliers == () and document(clean, "small")["warnings"] == []
    line = document(found, "small")["warnings"][0]
    assert len(found.outliers) == 1
    assert f"force [N] {values[1]:.4g} at displacement [m] {measured.at[1]:.4g} lies" in line
    assert line.endswith("standard deviations of the others off; check it, or leave it out")
