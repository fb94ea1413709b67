"""Gymnasium environments: what a step costs for each robot of a vector environment, and for one alone.

Each measurement is a process of its own, by turns, and counts steps of random actions after a reset, other ones in each
round, without resets and compilation. Another version's environments of one robot are measured in the same turns. Only
ratios mean something, as speeds of shared machines drift; told are the median of the rounds and the range.

    python benchmarks/environments.py [--robots 16] [--threads 1] [--precision f32] [--rounds 5] [--against TREE]
"""

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# Names: environment, steps measured, whether it takes threads and a precision (the others compute in f64 on one).
CASES = {
    "pancake": ("morpholab/Pancake-v0", 8, True),
    "vehicle": ("morpholab/Vehicle-v0", 4000, False),
    "quadruped": ("morpholab/LeggedQuadruped-v0", 400, False),
    "lattice robot": ("morpholab/LatticeRobot-v0", 60, True),
}
NEW = ("lattice robot",)  # that version 1.0 does not have


def seconds(case: str, robots: int, seed: int, compute: dict[str, Any]) -> float:
    """Time of a step for each robot [s]; of an environment of one robot with 0 robots."""
    import gymnasium

    importlib.import_module("robots.gym")  # registers the environments
    name, steps, takes = CASES[case]
    settings = compute if takes else {}
    environment: Any
    if robots:
        environment = gymnasium.make_vec(name, num_envs=robots, **settings)
    else:
        environment = gymnasium.make(name, **settings, disable_env_checker=True)
    environment.action_space.seed(seed)
    environment.reset(seed=seed)
    environment.step(environment.action_space.sample())  # compiles what a reset does not
    environment.reset(seed=seed)
    actions = [environment.action_space.sample() for _ in range(steps)]
    begun = time.perf_counter()
    for action in actions:
        environment.step(action)
    return (time.perf_counter() - begun) / steps / max(robots, 1)


def measured(tree: Path, case: str, robots: int, seed: int, compute: dict[str, Any]) -> float:
    """The same in a process of a source tree."""
    own = ["--measure", case, "--robots", str(robots), "--seed", str(seed)]
    own += [text for name, value in compute.items() for text in (f"--{name}", str(value))]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    command = [sys.executable, str(Path(__file__).resolve()), *own]
    run = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, check=True)
    return float(json.loads(run.stdout.splitlines()[-1]))


def with_range(ratios: list[float]) -> str:
    """A ratio with its range."""
    return f"{np.median(ratios):6.2f} ({min(ratios):.2f} to {max(ratios):.2f})"


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=16)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--precision", choices=("f32", "f64"), help="default: that of each environment and version")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--against", type=Path, help="source tree of another version")
    parser.add_argument("--seed", type=int, default=0, help="of the first round")
    parser.add_argument("--measure", choices=CASES, help=argparse.SUPPRESS)
    given = parser.parse_args()
    compute = {"threads": given.threads} | ({"precision": given.precision} if given.precision else {})
    if given.measure:
        print(json.dumps(seconds(given.measure, given.robots, given.seed, compute)))
        return
    print(f"{given.rounds} rounds; times of a step for each robot, how many times less among {given.robots}:")
    for case in given.cases:
        ways = {"one": (ROOT, 0), "many": (ROOT, given.robots)}
        if given.against and case not in NEW:
            ways["before"] = (given.against.resolve(), 0)
        times: dict[str, list[float]] = {way: [] for way in ways}
        for seed in range(given.seed, given.seed + given.rounds):
            for way, (tree, robots) in ways.items():
                times[way].append(measured(tree, case, robots, seed, compute))
        middle = {way: 1e3 * float(np.median(each)) for way, each in times.items()}
        line = f"{case:14} one {middle['one']:8.3f} ms, among {given.robots} {middle['many']:8.3f} ms:"
        for way in [way for way in ways if way != "many"]:
            ratios = [alone / each for alone, each in zip(times[way], times["many"], strict=True)]
            line += f" {with_range(ratios)}" + (f" than before ({middle['before']:.3f} ms)" if way == "before" else "")
        print(line, flush=True)


if __name__ == "__main__":
    main()
