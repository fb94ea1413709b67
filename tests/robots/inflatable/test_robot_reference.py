"""The whole robot against the independent engine: poses of three runs, voxel by voxel."""

import json
from pathlib import Path

import numpy as np
import pytest

from robots.inflatable import PUBLISHED, InflatableDesign
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import play
from robots.world import Terrain
from taichi_sim.lattice import LatticeEngine, LatticeProgram

pytestmark = pytest.mark.kernels

RUNS = ("inch_flat", "roll_flat", "mixed_hill")


def load() -> tuple[dict, dict]:
    """The runs' settings, and (steps, positions of voxels [m]) of each with the early ones first.

    Kept are changes from one recorded step to the next in whole micrometres, and early positions exactly.
    """
    with np.load(Path(__file__).parents[2] / "data" / "robot_runs.npz") as data:
        meta = json.loads(str(data["meta"]))
        positions = {}
        for name in RUNS:
            steps, places = data[f"{name}/step"], data[f"{name}/position"].cumsum(axis=0) * 1e-6
            if f"{name}/early_step" in data:
                steps = np.concatenate([data[f"{name}/early_step"], steps])
                places = np.concatenate([data[f"{name}/early_position"], places])
            order = np.argsort(steps, kind="stable")
            positions[name] = steps[order], places[order]
    return meta, positions


def joint_program(meta: dict, positions: dict) -> LatticeProgram:
    """The three runs as one batch; each ends with its last recorded pose."""
    events, lengths = [], []
    for robot, name in enumerate(RUNS):
        run = meta[name]
        design = InflatableDesign(run["pressure"], run["theta"], GaitSchedule.from_text(run["matrix"]))
        program = build_program([design], Terrain(slope=run["slope"]))
        part = program.events.copy()
        part["robot"] = robot
        events.append(part)
        lengths.append(int(positions[name][0].max()))
    marks = np.full((len(RUNS), max(len(positions[n][0]) for n in RUNS)), -1)
    for robot, name in enumerate(RUNS):
        marks[robot, : len(positions[name][0])] = positions[name][0]
    return LatticeProgram(lengths, np.concatenate(events), marks)


def errors(precision: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Steps and largest position error [m] at each, per run."""
    meta, positions = load()
    engine = LatticeEngine(PUBLISHED.body, 3, time_step=PUBLISHED.time_step, floor=True, precision=precision, threads=1)
    result = engine.run(joint_program(meta, positions))
    assert (result.status == "ok").all()
    found = {}
    for robot, name in enumerate(RUNS):
        steps, places = positions[name]
        error = np.abs(result.positions[robot, : len(steps)] - places).max(axis=(1, 2))
        found[name] = steps, error
    return found


def test_poses_in_f64():
    found = errors("f64")
    for name in ("inch_flat", "mixed_hill"):
        steps, error = found[name]
        assert error[steps <= 50].max() < 1e-6
        assert error[steps <= 500].max() < 5e-5
    steps, error = found["inch_flat"]
    first_column = ACTUATION.initial_steps(0.0) + play(GaitSchedule(np.eye(10, 1), repeats=1))[1]
    assert error[steps <= first_column].max() < 3e-4
    assert error.max() < 2e-3
    assert found["roll_flat"][1].max() < 5e-3
    assert found["mixed_hill"][1].max() < 5e-3


@pytest.mark.slow
def test_poses_in_f32():
    for steps, error in errors("f32").values():
        assert len(steps) and error.max() < 1e-2
