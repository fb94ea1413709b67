"""Benchmark of vehicles: rollouts of 10,000 steps per second and core.

All 58,564 rollouts of the best published body count, also those that end early, as in a sweep. Times are wall times on
one thread, the best of several rounds being the machine undisturbed; with a reference program the rounds alternate, and
the ratio is that of the medians.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np

from robots.bench.rates import best_and_median, prototype_rate
from robots.braitenberg import VehicleBody, contralateral, sweep
from robots.braitenberg.experiment import PUBLISHED, batch_of
from taichi_sim.signals import warping_distances
from taichi_sim.vehicle import VehicleBatch, differentiate

DESIGN = VehicleBody.published(162)
ROUNDS = 5
SAMPLES = 10_001  # of a whole trace


def measure(quick: bool, prototype: Path | None) -> dict[str, Any]:
    """Measure all rates of the benchmark."""
    rates = {"f64": list[float](), "f32": list[float](), "prototype": list[float]()}
    for precision in ("f64", "f32"):
        sweep([DESIGN], weights=11, steps=100, precision=precision, threads=1)  # compiles
    for _ in range(2 if quick else ROUNDS):
        for precision in ("f64", "f32"):
            rates[precision].append(_sweep_rate(precision))
        if prototype:
            arguments = ("F", "f64", "nofast", "32")
            rate = prototype_rate("vehicle-prototype", prototype, arguments, r"([0-9.]+) traj/s", "before traj/s")
            rates["prototype"].append(rate)
    found: dict[str, Any] = {
        "rollouts_per_core_second": {name: best_and_median(each) for name, each in rates.items() if each},
        "gradients_per_core_second": _gradient_rate(256 if quick else 1024),
        "warping_distances_per_core_second": _warping_rate(2001 if quick else SAMPLES),
    }
    if prototype:
        found["ratio_to_prototype"] = float(np.median(rates["f64"]) / np.median(rates["prototype"]))
    return found


def _sweep_rate(precision: str) -> float:
    begun = time.perf_counter()
    overlap = sweep([DESIGN], precision=precision, threads=1)
    return overlap.size * len(PUBLISHED.starts) / (time.perf_counter() - begun)


def _some(count: int) -> VehicleBatch:
    """Batch of ``count`` rollouts of the body with controllers drawn uniformly at random."""
    weights = np.random.default_rng(0).uniform(-1, 1, (1, count // len(PUBLISHED.starts), 2))
    return batch_of([DESIGN], contralateral(weights))


def _gradient_rate(count: int) -> float:
    """Measure rollouts with derivatives per second."""
    differentiate(_some(8), PUBLISHED, threads=1)
    begun = time.perf_counter()
    differentiate(_some(count), PUBLISHED, threads=1)
    return count / (time.perf_counter() - begun)


def _warping_rate(samples: int) -> float:
    """Time warping distances of pairs of ``samples`` samples, and scale to pairs of whole traces per second."""
    signals = np.random.default_rng(0).random((16, samples))
    warping_distances(signals[:, :9], signals[:, :9], threads=1)
    begun = time.perf_counter()
    warping_distances(signals[:8], signals[8:], threads=1)
    return 8 / (time.perf_counter() - begun) * (samples / SAMPLES) ** 2


def lines(figures: dict[str, Any]) -> list[str]:
    """Lines of a table of the rates."""
    found = [
        f"{name}  rollouts, one core       {rate['median']:>8.0f} of up to 10,000 steps/s (best {rate['best']:.0f})"
        for name, rate in figures["rollouts_per_core_second"].items()
        if name != "prototype"
    ]
    found += [
        f"f64  gradients, one core      {figures['gradients_per_core_second']:>8.0f} rollouts/s",
        f"f64  time warping, one core   {figures['warping_distances_per_core_second']:>8.1f} pairs of whole traces/s",
    ]
    if "ratio_to_prototype" in figures:
        found.insert(1, f"f64  ratio to the prototype   {figures['ratio_to_prototype']:>8.2f}")
    return found
