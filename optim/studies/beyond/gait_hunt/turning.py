"""Gaits turned to where they go on flat ground, and tried on a ladder of slopes."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.problems.inflatable.problem import GaitProblem
from optim.problems.inflatable.start import start_values
from optim.runs.generation import Generation
from optim.runs.history import History
from optim.runs.requests import Request
from optim.studies.beyond.gait_hunt.spending import cost
from robots.inflatable import gaits
from robots.inflatable.gaits import GaitDesign
from robots.world import Terrain
from taichi_sim.base.arrays import Arrays, Floats


def heading_of(displacement: Floats) -> Floats:
    """The heading, 0 to 90 degrees, along which robots that go so far get furthest.

    Args:
        displacement: along x and y, shape (..., 2).
    """
    angle = np.rad2deg(np.arctan2(displacement[..., 1], displacement[..., 0]))
    away = np.where(angle < -135.0, angle + 360.0, angle)  # the nearer end of the range is the better one
    return np.asarray(np.clip(away, 0.0, 90.0))


def turned(problem: GaitProblem, designs: Sequence[GaitDesign], options: Mapping[str, Any]) -> Arrays:
    """Turn designs to where they go on flat ground, and judge them.

    Args:
        problem: that judges them, of graded gaits.
        designs: N of them.
        options: of the simulation on flat ground, see ``robots.inflatable.gaits.simulate``.

    Returns:
        ``points`` of the problem, shape (N, D); ``scores``, shape (N,), NaN of what failed; ``speeds`` on every
        terrain, shape (N, T); ``spent`` [robot-steps] and ``wall_s`` on both simulations.
    """
    started = time.perf_counter()
    flat = gaits.simulate(designs, Terrain(), **options)
    ok = np.asarray(flat.status) == "ok"
    headings = heading_of(np.where(ok[:, None], flat.displacement, 0.0))
    facing = [replace(design, orientation=float(angle)) for design, angle in zip(designs, headings, strict=True)]
    points = np.array([problem.space.from_dict(start_values(problem, design)) for design in facing])
    judged = problem.evaluate(points)
    looked = sum(gaits.simulated_steps(design) for design in designs)
    return {
        "points": points,
        "scores": np.where(ok, judged.objectives[:, 0], np.nan),
        "speeds": np.stack([judged.details[f"speed_{terrain.name}"] for terrain in problem.terrains], axis=1),
        "spent": np.array(looked + cost(problem, Request(points), judged)),
        "wall_s": np.array(time.perf_counter() - started),
    }


def history_of(problem: GaitProblem, found: Arrays, folder: Path) -> History:
    """What :func:`turned` found as a run of a single generation.

    Args:
        problem: that judged the designs.
        found: see there.
        folder: where it is kept.
    """
    scores, count = found["scores"], len(found["scores"])
    known = np.flatnonzero(np.isfinite(scores))
    best = int(known[np.argmax(scores[known])]) if known.size else None
    point = details = None
    if best is not None:
        point = problem.space.to_dict(found["points"][best])
        names = [f"speed_{terrain.name}" for terrain in problem.terrains]
        details = dict(zip(names, found["speeds"][best].tolist(), strict=True))
    value = None if best is None else float(scores[best])
    last = Generation(0, 2 * count, count - known.size, value, None, None, None, point, details, {})
    return History(folder, {}, (last,), (float(found["wall_s"]),), None, False)
