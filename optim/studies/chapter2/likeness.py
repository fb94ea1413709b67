"""Whether two environments look alike to a robot, and are treated alike by it.

Source: dissertation, chapter 2, "Discussion": whegged robots "may 'sidestep' catastrophic interference by rapidly
turning unfamiliar environments into familiar ones". Then the light signals of a robot's environments are alike, and its
paths too, once they are turned so that the lights coincide: those of the whegged robot in the figure "trace" are
rotationally symmetric, while those of the legged robot "take longer to diverge".
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.comparison import compare
from optim.experiments.data import Kind
from optim.experiments.tables import cell, distinct, markdown, write_table
from optim.measures.homeostasis import homeostasis
from optim.search.method import generator
from optim.studies.chapter2.champions import Champions, follow
from optim.studies.chapter2.settings import ROBOTS, Interference, Treatment
from optim.studies.chapter2.tables import Cells
from robots.control.neural import random_weights
from robots.quadruped import MOTORS, SENSORS
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text
from taichi_sim.signals import warping_distances

EARLY = 10.0  # s
APART = 0.3  # m, a body length
RANDOM, CONTROLLERS = "random", 100  # beside champions, to tell what bodies do of themselves
QUANTITIES = {
    "warping": "distance of light signals by dynamic time warping, each with mean 0 and deviation 1",
    "warping_early": f"the same in the first {EARLY:g} s",
    "asymmetry": "mean distance of paths once turned so that the lights coincide [m]",
    "divergence": "when paths are a body length apart [s]",
}
COLUMNS: dict[str, Kind] = {"quantity": tuple(QUANTITIES), "fitness": str, "robot": tuple(ROBOTS), "value": float}


def warping(light: Floats, threads: int | None = None) -> Floats:
    """Distance between the light signals, (R, E, F), of a robot's environments by dynamic time warping, (R,).

    Signals have mean 0 and deviation 1 before, and pairs of environments are averaged.
    """
    return homeostasis(light[:, :, None, :], partial(warping_distances, normalise=True, threads=threads))


def turned(paths: Floats, lights: Sequence[Sequence[float]]) -> Floats:
    """Paths, (R, E, F, 2), each turned about the start so that its light lies where the first one's does."""
    angle = np.arctan2(*np.array(lights, float).T[::-1])
    back = angle[0] - angle
    turn = np.array([[np.cos(back), -np.sin(back)], [np.sin(back), np.cos(back)]])
    return np.asarray(np.einsum("ije,refj->refi", turn, paths))


def asymmetry(paths: Floats, lights: Sequence[Sequence[float]]) -> Floats:
    """Mean distance over time between the turned paths of a robot's environments, (R,) [m]; 0: it treats all alike."""
    return np.asarray(_apart(turned(paths, lights)).mean(axis=(1, 2)))


def divergence(paths: Floats, times: Floats) -> Floats:
    """Time [s] at which a robot's paths in two environments first lie a body length apart, mean of all pairs, (R,).

    Paths that never are count as if they were at the end.
    """
    far = _apart(paths) > APART
    first = np.where(far.any(axis=2), far.argmax(axis=2), len(times) - 1)
    return np.asarray(times[first].mean(axis=1))


def _apart(paths: Floats) -> Floats:
    """Distances between each two environments' paths at the same time, (R, pairs, F) [m]."""
    one, other = np.triu_indices(paths.shape[1], k=1)
    return np.asarray(np.linalg.norm(paths[:, one] - paths[:, other], axis=-1))


def likeness(
    champions: Mapping[Treatment, Champions], settings: Interference, threads: int | None = None
) -> dict[str, Cells]:
    """By quantity, the numbers of each treatment's champions, and of random controllers; failures are left out."""
    seen = {treatment.place: each for treatment, each in champions.items()}
    weights = random_weights(CONTROLLERS, SENSORS, MOTORS, generator(0))
    for robot in dict.fromkeys(treatment.robot for treatment in champions):
        seen[RANDOM, robot] = follow(settings, robot, weights, threads)
    found: dict[str, Cells] = {name: {} for name in QUANTITIES}
    for place, each in seen.items():
        early = each.times < EARLY
        signals = warping(each.light, threads), warping(each.light[:, :, early], threads)
        numbers = (*signals, asymmetry(each.paths, settings.lights), divergence(each.paths, each.times))
        for name, values in zip(QUANTITIES, numbers, strict=True):
            found[name][place] = values[np.isfinite(values)]
    return found


def write_likeness(found: Mapping[str, Cells], out: Path) -> dict[str, Any]:
    """Write ``likeness.csv`` and ``likeness.md``; return means, and tests between the robots of a row."""
    summary: dict[str, Any] = {}
    rows, text = [], ["# Whether environments look alike\n"]
    for name, cells in found.items():
        rows += [(name, *place, number) for place, numbers in cells.items() for number in numbers.tolist()]
        known = {place: float(numbers.mean()) for place, numbers in cells.items() if len(numbers)}
        means = [{"fitness": row, "robot": robot, "mean": mean} for (row, robot), mean in known.items()]
        tests = {}
        for row in dict.fromkeys(row for row, _ in cells):
            samples = {robot: numbers for (other, robot), numbers in cells.items() if other == row and len(numbers) > 1}
            tests[row] = compare(samples, list(combinations(samples, 2)), "two-sided")
        summary[name] = {"means": means, "tests": tests}
        text += _readable(name, summary[name])
    write_table(out / "likeness.csv", tuple(COLUMNS), rows)
    write_text(out / "likeness.md", "\n".join(text) + "\n")
    return summary


def _readable(name: str, part: Mapping[str, Any]) -> list[str]:
    """A table of means, and p of the tests (Bonferroni by row)."""
    means = {(row["fitness"], row["robot"]): row["mean"] for row in part["means"]}
    robots = distinct(part["means"], "robot")
    lines = []
    for row, tests in part["tests"].items():
        told = "; ".join(f"{t['first']} and {t['second']}: p = {t['p_bonferroni']:.2g}" for t in tests)
        lines.append((row, *(cell(means.get((row, robot)), ".3f") for robot in robots), told))
    header = "", *robots, "tests of pairs"
    return [f"## {QUANTITIES[name]}\n", *markdown(header, "l" * len(header), lines), ""]
