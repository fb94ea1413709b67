"""Names and keywords that version 1.0 had and that callers' own code relies on."""

import dataclasses
import inspect

import pytest

KEPT = [
    "from robots.inflatable import InflatableDesign, simulate, INCHING, ROLLING, load_design, save_design",
    "from robots.schedule import GaitSchedule",
    "from robots.gaits import simulate, load_gait",
    "from robots.terrain import Terrain",
    "from taichi_sim.lattice import LatticeBody, Material, LatticeEngine, LatticeProgram, body_from_array",
    "from robots.lattice_robot import LatticeRobot, Drive, Free",
    "from robots.braitenberg import VehicleBody, sweep",
    "from robots.quadruped import LEGGED, WHEELED, WHEGGED, simulate as simulate_quadruped",
    "from taichi_sim.rigid import World",
    "from robots.calibration import Trial",
    "from robots.hardware import export_csv, read_csv, PneumaticRig",
    "from optim.measures import learnability, interference, homeostasis",
    "from optim.lattice_robot_problem import LatticeRobotProblem",
    "from optim.search import build_method",
]


@pytest.mark.parametrize("line", KEPT)
def test_imports_work(line):
    exec(line, {})


def test_simulate_takes_the_keywords_and_its_result_has_the_fields():
    from robots.gaits import simulate
    from robots.inflatable import ROLLING
    from robots.inflatable.simulation import InflatableResult

    signature = inspect.signature(simulate)
    assert {"record_every", "perturbation", "seed", "geometry", "actuation", "progress"} <= {*signature.parameters}
    with pytest.raises(ValueError, match=r"^precision: 'f16' is unknown"):
        simulate([ROLLING], device="cpu", threads=1, precision="f16")
    told = {*dir(InflatableResult), *(field.name for field in dataclasses.fields(InflatableResult))}
    assert {"distance", "speed", "speed_simulated", "status", "steps", "frames"} <= told


def test_interference_of_1_0_is_the_resistance_that_it_told():
    from optim.measures import interference, resistance

    overlap = [[4, 2], [0, 4]]
    assert interference(overlap) == resistance(overlap) == 2 / 3
