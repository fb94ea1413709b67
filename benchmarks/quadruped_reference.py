"""Compare the three quadrupeds with runs of an Open Dynamics Engine scene that was built from the same numbers.

    python benchmarks/quadruped_reference.py [--precision f64] [--out PAGE.md]

``tests/data/quadruped_runs.npz`` holds, for each robot, where the main body was over 20 s under nine constant commands
(positions before each step), and where it ended and what its light sensor said after 999 steps with each of 500
controllers drawn evenly between -1 and 1, the light at (9, 0).

Commands are compared step by step, controllers by the distributions of what they came to: robots are chaotic, so that
single ends mean little. Numbers are rounded to 1e-6, as the published experiment printed them. Exit code 1 where a
bound does not hold.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp, norm

from robots.quadruped import LEGGED, WHEELED, WHEGGED, Quadruped, engine, simulate

Floats = np.ndarray
DATA = Path(__file__).parents[1] / "tests/data/quadruped_runs.npz"
ROBOTS = (LEGGED, WHEELED, WHEGGED)
LIGHT = (9.0, 0.0)  # m
STEPS = 1000  # looks at the sensors, as in the published experiment
DIGITS = 6

# Largest deviation of the main body at any step [m].
BOUNDS = {
    "settle": 0.001,
    "first_joints_plus": 0.005,
    "first_joints_minus": 0.005,
    "second_joints_plus": 0.005,
    "second_joints_opposed": 0.010,
    "second_joints_diagonal": 0.010,
    "first_joints_tilt": 0.050,
    "mixed": 0.050,
    "mixed2": 0.050,
}
# Runs that a change of the start by 1e-5 m moves by more than their bound: it holds up to these steps only.
ILL_CONDITIONED = {("wheeled", "mixed2"): 10, ("whegged", "mixed2"): 150}

QUANTILES = (0.9, 0.99)
COMPARISONS = len(ROBOTS) * 3 * len(QUANTILES)  # of quantiles; Bonferroni
LEVEL = 0.05
RESAMPLES = 2000


@dataclass(frozen=True)
class Agreement:
    """How one quantity of random controllers is distributed here and there.

    Attributes:
        name: of the quantity.
        distance: Kolmogorov and Smirnov's.
        limit: its 5 % limit.
        quantiles: of (ours, the reference), (quantiles, 2).
        intervals: of what the difference of each quantile would be by chance, (quantiles, 2), from the bootstrap.
    """

    name: str
    distance: float
    limit: float
    quantiles: Floats
    intervals: Floats

    @property
    def holds(self) -> bool:
        """Whether both are one distribution as far as these tests tell."""
        low, high = self.intervals.T
        return bool(self.distance < self.limit and np.all((low <= 0) & (high >= 0)))


def deviations(runs: Mapping[str, Floats], robot: Quadruped, precision: str = "f64") -> Floats:
    """Distance of the main body from where it was in the reference, (cases, steps) [m]."""
    reference = runs[f"{robot.kind}_trajectory"]
    found = engine(robot, precision=precision, threads=1).run(
        reference.shape[1] - 1, commands=runs["commands"][:, None], record_every=1
    )
    assert found.frames is not None
    return np.linalg.norm(found.frames.position.transpose(1, 0, 2) - reference, axis=-1)


def bounded_steps(kind: str, case: str, steps: int) -> int:
    """Steps over which a case's bound must hold."""
    return ILL_CONDITIONED.get((kind, case), steps)


def quantities(ends: Floats) -> dict[str, Floats]:
    """Distance travelled [m], height [m] and light [1/m^2] of ends (N, 4), as the published experiment prints them."""
    return {
        "distance": np.hypot(*ends[:, :2].T).round(DIGITS),
        "height": ends[:, 2].round(DIGITS),
        "light": ends[:, 3].round(DIGITS),
    }


def random_ends(runs: Mapping[str, Floats], robot: Quadruped, precision: str = "f64") -> Floats:
    """Where random controllers take the main body, and its light, (N, 4)."""
    found = simulate(robot, runs["weights"], [LIGHT], steps=STEPS, precision=precision, threads=1)
    return np.column_stack([found.position[:, 0], found.light[:, 0]])


def agreement(name: str, ours: Floats, reference: Floats, seed: int = 0) -> Agreement:
    """Compare two samples; intervals are those of all comparisons together at the 5 % level."""
    generator = np.random.default_rng(seed)
    tests = 1 - LEVEL / COMPARISONS
    drawn = [
        np.quantile(x[generator.integers(len(x), size=(RESAMPLES, len(x)))], QUANTILES, axis=1)
        for x in (ours, reference)
    ]
    spread = np.std(drawn[0] - drawn[1], axis=1) * norm.ppf((1 + tests) / 2)
    quantiles = np.quantile(np.column_stack([ours, reference]), QUANTILES, axis=0)
    difference = quantiles[:, 0] - quantiles[:, 1]
    limit = np.sqrt(-np.log(LEVEL / 2) / 2 * (1 / len(ours) + 1 / len(reference)))
    return Agreement(
        name,
        float(ks_2samp(ours, reference).statistic),
        float(limit),
        quantiles,
        np.column_stack([difference - spread, difference + spread]),
    )


def page(runs: Mapping[str, Floats], precision: str) -> tuple[str, bool]:
    """Both comparisons as Markdown, and whether all bounds hold."""
    sound = True
    lines = [
        "| robot | command | largest deviation [mm] | at step | bound [mm] | |",
        "| --- | --- | ---: | ---: | ---: | --- |",
    ]
    for robot in ROBOTS:
        for case, found in zip(runs["cases"], deviations(runs, robot, precision), strict=True):
            steps = bounded_steps(robot.kind, case, len(found))
            holds = found[:steps].max() <= BOUNDS[case]
            sound &= bool(holds)
            note = "" if holds else "**missed**"
            if steps < len(found):
                note += f"ill-conditioned: {1e3 * found[:steps].max():.3f} mm up to step {steps}"
            lines.append(
                f"| {robot.kind} | {case} | {1e3 * found.max():.4f} | {found.argmax()} "
                f"| {1e3 * BOUNDS[case]:g} | {note} |"
            )
    lines += [
        "",
        "| robot | quantity | KS distance (limit) | 90 %: ours, reference | 99 %: ours, reference | |",
        "| --- | --- | ---: | ---: | ---: | --- |",
    ]
    for robot in ROBOTS:
        theirs = quantities(runs[f"{robot.kind}_random_end"])
        for name, ours in quantities(random_ends(runs, robot, precision)).items():
            found = agreement(name, ours, theirs[name])
            sound &= found.holds
            pairs = " | ".join(f"{a:.5g}, {b:.5g}" for a, b in found.quantiles)
            lines.append(
                f"| {robot.kind} | {name} | {found.distance:.3f} ({found.limit:.3f}) | {pairs} "
                f"| {'' if found.holds else '**differs**'} |"
            )
    return "\n".join(lines) + "\n", sound


def main() -> int:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, nargs="?", default=DATA, help="quadruped_runs.npz")
    parser.add_argument("--precision", choices=("f32", "f64"), default="f64")
    parser.add_argument("--out", type=Path, help="write the tables here as Markdown")
    args = parser.parse_args()
    text, sound = page(np.load(args.path), args.precision)
    if args.out:
        args.out.write_text(text)
    print(text, end="")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
