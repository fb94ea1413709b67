"""Measurements of a robot whose properties are known, to try a calibration on."""

from dataclasses import replace

import numpy as np

from robots.calibration.experiments import Diameter, Drag, Experiment, Gait
from robots.calibration.laboratory import Laboratory, Replica
from robots.calibration.properties import Properties
from robots.inflatable.design import INCHING

TRUTH = Properties(friction=1.3, low_friction=0.15, modulus=480e3, inflation_rate=2.0)
NOISE = 0.02  # standard deviation, in parts of the root mean square of an experiment's values
READINGS = 3  # at each pressure
_START = 1000  # replica that the example is: its start is noisy in its own way


def example(laboratory: Laboratory, seed: int = 0, truth: Properties = TRUTH, noise: float = NOISE) -> list[Experiment]:
    """Two drags, heights of the pouch, and the first seconds of the inching gait, measured with Gaussian noise."""
    displacements, pressures = np.arange(2.5, 21.0, 2.5) * 1e-3, np.repeat(np.arange(2e3, 7e3, 1e3), READINGS)
    times = np.arange(0.25, 1.9, 0.25)
    planned: list[Experiment] = [
        Drag(displacements, np.zeros_like(displacements), 0.5),
        Drag(displacements, np.zeros_like(displacements), 0.5, grips=False),
        Diameter(pressures, np.zeros_like(pressures), "height"),
        Gait(times, np.zeros_like(times), INCHING, "inching"),
    ]
    rng, measured = np.random.default_rng(seed), []
    for experiment in planned:
        exact = experiment.predict([Replica(truth, _START)], laboratory)[0]
        deviations = np.full(len(exact), noise * np.sqrt(np.mean(exact**2)))
        values = exact + deviations * rng.standard_normal(len(exact))
        measured.append(replace(experiment, values=values, deviations=deviations))
    return measured
