"""Made the files beside it, with version 1.0: a run of each kind of problem, what came next, and states of methods.

git worktree add v1 ed12070
PYTHONPATH=v1 OMP_NUM_THREADS=1 python tests/data/v1_runs/make.py OUT

Pictures of the gait's run are left out. ``next.json`` holds, for each run, the line that version 1.0 wrote after these,
and what it ran on. ``methods.npz`` holds for each method its state after some generations on an analytic problem,
and the points it asked for then.
"""

import hashlib
import json
import os
import platform
import re
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

SPLIT = 4  # generations of the methods before the state that is kept
GENERATIONS = 2  # of the runs

ROBOT = """
from robots.lattice_robot import Drive, Free, LatticeRobot
from taichi_sim.lattice import Material, body_from_array

rubber = Material(youngs_modulus=1e5, density=1e3, static_friction=0.9, kinetic_friction=0.6, name="rubber")
body = body_from_array([[[1]], [[1]]], rubber, 0.01, regions=[[[0]], [[1]]])
bend = Drive("bend", (1,), amplitude=Free(0.0, 0.3, start=0.2), phase=Free(0.0, 1.0), axes="x")
robot = LatticeRobot(body, (bend,), frequency=10.0, cycles=1, name="block")
"""


def command(line):
    """Run a command of version 1.0, as if it had been typed."""
    from optim.cli import main

    sys.argv = ["morpholab", *line.split()]
    assert main(sys.argv[1:]) == 0


def search(problem, method, settings, generations, folder):
    """Run or continue a search from Python."""
    from optim.runs import open_run, run_search
    from optim.runs.environment import environment
    from optim.search import build_method

    sys.argv = ["python"]
    config = {"problem": problem.describe(), "method": {"name": method, **settings}, "generations": generations}
    with open_run(folder, config, resume=True, environment=environment()) as opened:
        run_search(problem, build_method(method, problem.space, settings), opened, generations)


def gait(generations, folder):
    """The small inflatable robot; a gait of one column, in double precision."""
    if generations == GENERATIONS:
        options = "--terrain flat --geometry small --columns 1 --repeats 1 --precision f64 --climbers 2 --seed 4"
        command(f"codesign {options} --generations {generations} --quiet --out {folder}")
    else:
        command(f"codesign --resume --generations {generations} --quiet --out {folder}")


def robot(generations, folder):
    """A robot of two voxels of the user's own, by CMA-ES."""
    Path("block.py").write_text(ROBOT)
    if generations == GENERATIONS:
        options = "--robot block.py --terrain flat --method cma --population 4 --seed 4"
        command(f"codesign {options} --generations {generations} --quiet --out {folder}")
    else:
        command(f"codesign --resume --generations {generations} --quiet --out {folder}")


def walker(generations, folder):
    """A walker in a lattice of 2 x 2 x 2 voxels, by a genetic algorithm."""
    from optim.walker_problem import WalkerProblem
    from robots.walker import WalkerActuation

    problem = WalkerProblem((2, 2, 2), actuation=WalkerActuation(settling=0.02, cycles=1, frequency=20.0))
    search(problem, "genetic", {"population": 6, "seed": 4}, generations, folder)


def vehicle(generations, folder):
    """A Braitenberg vehicle with free sensors, four objectives and the Borg MOEA."""
    from dataclasses import replace

    from optim.vehicle_problem import VehicleProblem

    from robots.braitenberg import PUBLISHED

    problem = VehicleProblem(objectives="environments", task=replace(PUBLISHED, steps=60))
    search(problem, "borg", {"population": 6, "seed": 4}, generations, folder)


def flags():
    """What tells CPUs apart for which kernels are compiled."""
    found = re.search(r"^flags.*", Path("/proc/cpuinfo").read_text(), re.M)
    return hashlib.sha256(" ".join(sorted(found[0].split())).encode()).hexdigest() if found else platform.machine()


def methods(path):
    """States of every method on an analytic problem, and what it asks for next."""
    from optim.problem import Evaluation
    from optim.search import METHODS, build_method
    from optim.space import Space, Variable

    plain = Variable("x", -2.0, 6.0, step=0.5), Variable("a", -180.0, 180.0, "angle", step=20.0)
    binary = Variable("b", 0, 1, "binary", step=0.3)
    spaces = {True: Space((*plain, binary)), False: Space((*plain, Variable("n", -3, 4, "integer", step=1.0), binary))}
    arrays = {}
    for name in METHODS:
        space = spaces[name == "gradient"]
        several = METHODS[name].several_objectives
        size = "climbers" if name in ("generating-set", "gradient", "hill-climb", "random") else "population"
        method = build_method(name, space, {size: 6, "seed": 5})
        for _ in range(SPLIT):
            points = method.ask()
            inside = (points - space.low) / space.span
            values = -((inside - 0.4) ** 2).sum(axis=1)
            slopes = -2 * (inside - 0.4) / space.span if method.wants == "gradients" else None
            values = np.column_stack([values, inside[:, 0]]) if several else values
            method.tell(points, Evaluation(values, gradients=slopes))
        arrays |= {f"{name}/state/{key}": value for key, value in method.state().items()}
        arrays |= {f"{name}/asked": method.ask(), f"{name}/score": np.array(method.result().score)}
    np.savez_compressed(path, **arrays)


def main():
    """Make everything."""
    out = Path(sys.argv[1]).absolute()
    out.mkdir()
    platform.platform = lambda: "Linux"  # the rest names a machine
    told = {"cpu_flags": flags(), "lines": {}}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        methods(out / "methods.npz")
        for make in (gait, walker, vehicle, robot):
            name = make.__name__
            make(GENERATIONS, name)
            shutil.copytree(name, out / name, ignore=shutil.ignore_patterns("*.png", ".lock"))
            make(GENERATIONS + 1, name)
            told["lines"][name] = json.loads(Path(name, "log.jsonl").read_text().splitlines()[-1])
            told["versions"] = json.loads(Path(name, "environment.json").read_text())["versions"]
    (out / "next.json").write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
