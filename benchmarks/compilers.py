"""Taichi and Quadrants beside each other: whether results are the same bits, and which is faster.

Each compiler runs in a process of its own, by turns, on one thread. Times are medians of the rounds; only their ratio
means something, as speeds of shared machines drift. The exit code is 1 if bits differ.

    python benchmarks/compilers.py [--taichi .venv/bin/python] [--quadrants .venv-quadrants/bin/python] [--rounds 3]
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
CONTROLLERS = np.random.default_rng(1).uniform(-1, 1, (64, 5, 8))


def lattice(precision: str, steps: int) -> Callable[[], Any]:
    """The published robot at the inching gait, from its 3000th step on: how a piece of it is run."""
    from robots.bench.lattice import WARM_UP, Batch

    robots = Batch(1, precision, threads=1)
    robots.advance(WARM_UP)

    def advance() -> Any:
        robots.advance(steps)
        return robots.engine.state()

    return advance


def lattice_gradient(precision: str) -> Callable[[], Any]:
    """The gradient of a small robot's gait."""
    from robots.inflatable import ROLLING, InflatableActuation, InflatableGeometry, differentiate
    from robots.world import Terrain

    geometry = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
    actuation = InflatableActuation(inflation_rate=0.03, pressure_ramp=50.0, hold_steps=200, settle_steps=100)
    keywords: dict[str, Any] = {"geometry": geometry, "actuation": actuation, "precision": precision, "threads": 1}
    return lambda: differentiate([ROLLING], Terrain(), **keywords)


def rigid(precision: str, gradient: bool) -> Callable[[], Any]:
    """Whegged robots with random controllers, and the derivatives of where they end."""
    from robots.quadruped import WHEGGED, engine

    robots = engine(WHEGGED, precision=precision, threads=1)
    light = np.array([[3.0, 1.0, 0.15]])
    if not gradient:
        return lambda: robots.run(4000, weights=CONTROLLERS, lights=light)
    ends = np.ones((len(CONTROLLERS), 3))
    return lambda: robots.record(600, weights=CONTROLLERS, lights=light).pull_back(position=ends)


def vehicles(precision: str, gradient: bool) -> Callable[[], Any]:
    """Vehicles with random bodies and controllers, in all environments."""
    from robots.braitenberg import STARTS
    from taichi_sim.vehicle import VehicleBatch, VehicleTask, differentiate, rollout

    rng = np.random.default_rng(0)
    count = 50 if gradient else 3000
    batch = VehicleBatch(rng.uniform(-0.5, 0.5, (5, 2, 2)), rng.uniform(-1, 1, (5, count, 2, 2)))
    task = VehicleTask(STARTS, steps=2000)
    return lambda: (differentiate if gradient else rollout)(batch, task, precision=precision, threads=1)


CASES: dict[str, Callable[[], Callable[[], Any]]] = {
    "lattice, one robot, f32": lambda: lattice("f32", 6000),
    "lattice, one robot, f64": lambda: lattice("f64", 6000),
    "lattice, gradient, f64": lambda: lattice_gradient("f64"),
    "rigid, 64 robots, f64": lambda: rigid("f64", False),
    "rigid, 64 robots, f32": lambda: rigid("f32", False),
    "rigid, gradient, f64": lambda: rigid("f64", True),
    "vehicles, f64": lambda: vehicles("f64", False),
    "vehicles, gradient, f64": lambda: vehicles("f64", True),
}


def numbers(result: Any) -> list[np.ndarray]:
    """All arrays of a result, however it nests them, in order."""
    if isinstance(result, np.ndarray):
        return [result] if result.dtype.kind in "fiub" else []
    parts = result.values() if isinstance(result, dict) else result if isinstance(result, list | tuple) else None
    if parts is None:
        parts = vars(result).values() if hasattr(result, "__dict__") else []
    return [array for part in parts for array in numbers(part)]


def measure(name: str) -> dict[str, Any]:
    """Run a case once for its bits and its compilation, then once more for its time."""
    started = time.perf_counter()
    work = CASES[name]()
    first = numbers(work())
    ready = time.perf_counter()
    again = numbers(work())
    done = time.perf_counter()
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in (*first, *again)))
    return {"bits": digest.hexdigest(), "seconds": done - ready, "first": ready - started}


def in_process(python: str, compiler: str, name: str) -> dict[str, Any]:
    """Measure a case in another process."""
    environment = {**os.environ, "MORPHOLAB_COMPILER": compiler, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    command = [python, __file__, "--case", name]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{name} with {compiler}: {done.stderr.strip()[-400:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def main() -> int:
    """Run all cases with both compilers by turns, and print a table; 1 if bits differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--taichi", default=".venv/bin/python", help="interpreter that has Taichi")
    parser.add_argument("--quadrants", default=".venv-quadrants/bin/python", help="interpreter that has Quadrants")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--case", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(measure(options.case)))
        return 0
    differing = 0
    print("| | speed of Quadrants, of Taichi's | bits |\n| --- | ---: | --- |", flush=True)
    for name in CASES:
        runs: dict[str, list[dict[str, Any]]] = {"taichi": [], "quadrants": []}
        for _ in range(options.rounds):
            for compiler, found in runs.items():
                found.append(in_process(getattr(options, compiler), compiler, name))
        seconds = {compiler: float(np.median([run["seconds"] for run in found])) for compiler, found in runs.items()}
        bits = {run["bits"] for found in runs.values() for run in found}
        ratio = seconds["taichi"] / seconds["quadrants"]
        differing += len(bits) > 1
        print(f"| {name} | {ratio:.2f} | {'the same' if len(bits) == 1 else 'differ'} |", flush=True)
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
