"""Made the files beside it, with version 1.0: one of each kind that its users save, and its results folders.

git worktree add v1 ed12070
PYTHONPATH=v1 OMP_NUM_THREADS=1 python tests/data/v1_files/make.py OUT
"""

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np

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

    assert main(line.split()) == 0


def gaits():
    """Gaits of on and off, of levels, and of levels with times and core pressures of their own; their tables."""
    from robots.relaxed_schedule import RelaxedDesign, RelaxedSchedule

    from robots.gaits import save_gait
    from robots.inflatable import INCHING

    generator = np.random.default_rng(1)
    levels = generator.integers(0, 65, (8, 3)) / 64
    grip = generator.integers(0, 2, (2, 3)).astype(float)
    times = {"pressure": [0.0, 2500.0, 5000.0], "motion_steps": [0, 9000, 0], "settle_steps": [0, 1200, 4001]}
    save_gait(INCHING, "inching.json")
    save_gait(RelaxedDesign(1250.0, 30.0, RelaxedSchedule(levels, grip, repeats=2)), "graded.json")
    save_gait(RelaxedDesign(1250.0, 30.0, RelaxedSchedule(levels, grip, repeats=2, **times)), "timed.json")
    for name in ("inching", "graded", "timed"):
        command(f"export {name}.json --csv {name}.csv --on-violation clip")
    command("export inching --csv sampled.csv --rate 2 --units psi")


def machines():
    """A vehicle, a lattice robot and a soft walker."""
    from optim.vehicle_problem import VehicleProblem
    from robots.walker_body import WalkerDesign, save_walker

    from robots.lattice_robot import load_robot
    from robots.lattice_robot.record import save_robot

    vehicles = VehicleProblem(precision="f64")
    vehicles.save(np.linspace(0.1, 0.9, vehicles.space.size) * vehicles.space.high, Path("vehicle.json"))
    Path("block.py").write_text(ROBOT)
    save_robot(load_robot("block.py"), "block.json")
    os.remove("block.py")
    materials = np.arange(8).reshape(2, 2, 2) % 4
    save_walker(WalkerDesign(materials), "walker.json")


def folders():
    """What a calibration, a sweep and a training leave."""
    command("calibrate --example example.toml --seed 3")
    command("calibrate example.toml --fit friction --out calibrated --precision f64 --threads 1 --quiet")
    os.rename("calibrated/calibration.json", "calibration.json")
    shutil.rmtree("calibrated")  # with its picture
    task = "--threads 1 --quiet"
    command(f"sweep --designs 162,6553 --weights 11 --out sweep {task}")
    command(f"train --designs 162 --methods random,de --repetitions 2 --budget-evaluations 20 --out training {task}")


if __name__ == "__main__":
    os.makedirs(sys.argv[1])
    os.chdir(sys.argv[1])
    gaits()
    machines()
    folders()
    print(json.dumps(sorted(str(path) for path in Path().rglob("*") if path.is_file())))
