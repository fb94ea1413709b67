"""Kinds of gaits among many: the best of each, so that what is not yet the fastest is not lost.

Source: Pétrowski, "A clearing procedure as a niching method for genetic algorithms", Proc. ICEC 1996.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.problems.inflatable.problem import GaitProblem
from optim.runs.generation import Generation
from optim.runs.history import History
from optim.runs.requests import Request
from optim.studies.beyond.gait_hunt.searches import cost
from robots.inflatable import simulation
from robots.inflatable.body import InflatableGeometry
from robots.inflatable.cores import each_pressure
from robots.inflatable.design import InflatableDesign
from robots.inflatable.timing import predicted_steps
from robots.world import Terrain
from taichi_sim.base.arrays import Arrays, Floats

APART = 0.25  # of a full stroke, root mean square over all actuators and columns: gaits closer are one kind
PRESSURE = 12_000.0  # [Pa], which counts as a full stroke of everything


def difference(one: InflatableDesign, other: InflatableDesign, body: InflatableGeometry) -> float:
    """Distance between two gaits of as many columns, 0 to 1, wherever their cycles begin.

    Headings and times do not count: what moves when is the kind. Pressures of the cores count too: the larger of both
    differences is the result.
    """
    first, second = one.schedule.levels, other.schedule.levels
    turned = [np.roll(second, column, axis=1) for column in range(second.shape[1])]
    moves = min(float(np.sqrt(np.mean((first - levels) ** 2))) for levels in turned)
    pressures = [np.array(each_pressure(design.pressure, body)) for design in (one, other)]
    return max(moves, float(abs(pressures[0] - pressures[1]).max()) / PRESSURE)


def best_of_kinds(
    designs: Sequence[InflatableDesign], scores: Floats, count: int, body: InflatableGeometry
) -> list[int]:
    """Indices of the best designs of which none is of the kind of a better one, the best first; scores may be NaN."""
    chosen: list[int] = []
    for number in (int(n) for n in np.argsort(-scores, kind="stable") if np.isfinite(scores[n])):
        if len(chosen) == count:
            break
        if all(difference(designs[number], designs[other], body) >= APART for other in chosen):
            chosen.append(number)
    return chosen


def heading_of(displacement: Floats) -> Floats:
    """The heading, 0 to 90 degrees, along which robots with displacements x and y, shape (..., 2), get furthest."""
    angle = np.rad2deg(np.arctan2(displacement[..., 1], displacement[..., 0]))
    away = np.where(angle < -135.0, angle + 360.0, angle)  # the nearer end of the range is the better one
    return np.asarray(np.clip(away, 0.0, 90.0))


def turned(problem: GaitProblem, designs: Sequence[InflatableDesign], options: Mapping[str, Any]) -> Arrays:
    """Turn N designs to where they go on flat ground, and judge them; ``options`` are those of ``simulate`` there.

    Returns:
        ``points`` of the problem, shape (N, D); ``scores``, shape (N,), NaN of what failed; ``speeds`` on every
        terrain, shape (N, T); ``spent`` [robot-steps] and ``wall_s`` on both simulations.
    """
    started = time.perf_counter()
    flat = simulation.simulate(designs, Terrain(), **options)
    ok = np.asarray(flat.status) == "ok"
    headings = heading_of(np.where(ok[:, None], flat.displacement, 0.0))
    facing = [replace(design, orientation=float(angle)) for design, angle in zip(designs, headings, strict=True)]
    points = np.array([problem.space.from_dict(problem.start_values(design)) for design in facing])
    judged = problem.evaluate(points)
    looked = sum(predicted_steps(design) for design in designs)
    return {
        "points": points,
        "scores": np.where(ok, judged.objectives[:, 0], np.nan),
        "speeds": np.stack([judged.details[f"speed_{terrain.name}"] for terrain in problem.terrains], axis=1),
        "spent": np.array(looked + cost(problem, Request(points), judged)),
        "wall_s": np.array(time.perf_counter() - started),
    }


def history_of(problem: GaitProblem, found: Arrays, folder: Path) -> History:
    """Present what :func:`turned` found as a run of a single generation."""
    scores, count = found["scores"], len(found["scores"])
    known = np.flatnonzero(np.isfinite(scores))
    value: float | None = None
    point = details = None
    if known.size:
        best = int(known[np.argmax(scores[known])])
        value, point = float(scores[best]), problem.space.to_dict(found["points"][best])
        names = [f"speed_{terrain.name}" for terrain in problem.terrains]
        details = dict(zip(names, found["speeds"][best].tolist(), strict=True))
    last = Generation(0, 2 * count, count - known.size, value, None, None, None, point, details, {})
    return History(folder, {}, (last,), (float(found["wall_s"]),), None, False)
