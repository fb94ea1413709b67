"""Benchmark of quadrupeds: time steps of 0.05 s per second and core.

Random controllers, half of which fall over, for a simulated 50 s. CPU times on one thread, the best of several rounds
being the machine undisturbed; with a reference program (whose output reads "... 480000 per core-second") the rounds
alternate, and the ratio is that of the medians, of the whegged robot in f32.
"""

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from robots.bench.rates import best_and_median, prototype_rate
from robots.control.neural import random_weights
from robots.quadruped import LEGGED, MOTORS, SENSORS, STEPS, WHEELED, WHEGGED, Quadruped, simulate

ROBOTS = (LEGGED, WHEELED, WHEGGED)
CONTROLLERS, ROUNDS = 256, 5
LIGHT = ((9.0, 0.0),)


def measure(quick: bool, prototype: Path | None) -> dict[str, Any]:
    """Measure all rates of the benchmark."""
    rates = {precision: {robot.kind: list[float]() for robot in ROBOTS} for precision in ("f32", "f64")}
    others: list[float] = []
    begun = time.perf_counter()
    _rate(LEGGED, "f32", 2)
    first = time.perf_counter() - begun
    for _ in range(2 if quick else ROUNDS):
        for precision, of_robot in rates.items():
            for robot in ROBOTS:
                of_robot[robot.kind].append(_rate(robot, precision, STEPS // 10 if quick else STEPS))
        if prototype:
            others.append(_prototype_rate(prototype))
    found: dict[str, Any] = {
        "first_call_s": first,
        "steps_per_core_second": {
            precision: {kind: best_and_median(each) for kind, each in of_robot.items()}
            for precision, of_robot in rates.items()
        },
    }
    if prototype:
        found["ratio_to_prototype"] = float(np.median(rates["f32"]["whegged"]) / np.median(others))
    return found


def _rate(robot: Quadruped, precision: str, steps: int) -> float:
    weights = random_weights(CONTROLLERS, SENSORS, MOTORS, np.random.default_rng(0))
    simulate(robot, weights[:1], LIGHT, steps=2, precision=precision, threads=1)  # loads the kernel
    begun = time.process_time()
    simulate(robot, weights, LIGHT, steps=steps, precision=precision, threads=1)
    return CONTROLLERS * (steps - 1) / (time.process_time() - begun)


def _prototype_rate(path: Path) -> float:
    """Rate that a reference program reports, which may leave files where it runs."""
    arguments, environment = ("bench", str(CONTROLLERS), str(STEPS)), {**os.environ, "FP": "32", "NT": "1"}
    with tempfile.TemporaryDirectory() as folder:
        pattern, place = r"([0-9.]+) per core-second", "before 'per core-second'"
        return prototype_rate("rigid-prototype", path, arguments, pattern, place, environment, Path(folder))


def lines(figures: dict[str, Any]) -> list[str]:
    """Lines of a table of the rates."""
    found = [
        f"{precision}  {kind:<8} robot, one core    {rate['median']:>8.0f} robot-steps/s (best {rate['best']:.0f})"
        for precision, of_robot in figures["steps_per_core_second"].items()
        for kind, rate in of_robot.items()
    ]
    if "ratio_to_prototype" in figures:
        found.insert(3, f"f32  whegged, ratio to the prototype {figures['ratio_to_prototype']:>6.2f}")
    return [*found, f"f32  first call, compiling     {figures['first_call_s']:>8.1f} s"]
