"""Weight manifolds in changed vehicles and worlds: how far they shift, how large they stay, and what they share.

A body's weight manifold is the set of all controllers on a grid that solve every environment.

Source: dissertation, chapter 6 (figure of the two weight manifolds): a shift in physics is thought of as a shift of the
manifold in the space of all weights, so that bodies with larger manifolds lose fewer of the controllers in them.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from optim.experiments.data import Kind
from optim.experiments.results import Progress
from optim.experiments.tables import Record, column, distinct, select
from optim.measures.statistics import mean_band
from optim.studies.chapter4.perturbations import PERTURBATIONS, Perturbation
from robots.braitenberg import VehicleBody, contralateral, weight_grid
from taichi_sim.base.arrays import Arrays, Bools
from taichi_sim.base.checks import within
from taichi_sim.vehicle import VehicleBatch, VehicleTask, rollout

TABLE = "manifolds.csv"
NUMBERS = ("before", "after", "both", "shift")  # of each change; the first three are counts of controllers
COLUMNS: dict[str, Kind] = {
    "design": int,
    "perturbation": tuple(dict.fromkeys(p.name for p in PERTURBATIONS)),
    "strength": float,
    "draw": int,
    **dict.fromkeys(NUMBERS[:3], int),
    "shift": float | None,
}


def changes(draws: int) -> list[tuple[Perturbation, int]]:
    """All changes that a manifold is measured in: those that are random several times, each with its number."""
    return [(p, draw) for p in PERTURBATIONS for draw in range(draws if p.random else 1)]


def manifold(
    body: VehicleBody,
    task: VehicleTask,
    weights: int,
    change: Perturbation | None = None,
    rng: np.random.Generator | None = None,
    threads: int | None = None,
) -> Bools:
    """Which controllers of a grid solve all environments of a task in a body, shape (n, n) for n weights.

    A ``change`` is of the one vehicle that tries them all, so that it is the same for all of them.
    """
    grid = weight_grid(weights)
    controllers = contralateral(np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(1, -1, 2))
    sites = np.array([body.sensors])
    if change is not None:
        rng = rng or np.random.default_rng(0)
        sites, controllers, task = change.change(sites, controllers, task, rng, change.strength)
    done = rollout(VehicleBatch(sites, controllers), task, until="success", threads=threads)
    return np.asarray(done.reached[0].all(axis=-1).reshape(weights, weights))


def compared(before: Bools, after: Bools) -> tuple[int, int, int, float]:
    """Sizes of a manifold before and after a change, what both share, and how far the mean of its weights shifts.

    The first three are counts of controllers of the grid; the shift is a distance in the plane of both weights, NaN
    where a manifold is empty.
    """
    grid = weight_grid(len(before))
    sizes = int(before.sum()), int(after.sum()), int((before & after).sum())
    if not before.any() or not after.any():
        return *sizes, np.nan
    first, second = (grid[np.argwhere(each)].mean(axis=0) for each in (before, after))
    return *sizes, float(np.linalg.norm(second - first))


def measure(
    body: VehicleBody,
    task: VehicleTask,
    weights: int,
    draws: int,
    seed: int,
    threads: int | None = None,
    progress: Progress = None,
) -> Arrays:
    """What each of :func:`changes` does to the manifold of a body: an array of each of ``NUMBERS``, shape (N,)."""
    before, rows = manifold(body, task, weights, threads=threads), list[tuple[int, int, int, float]]()
    every = changes(draws)
    for number, (change, draw) in enumerate(every):
        after = manifold(body, task, weights, change, np.random.default_rng((seed, draw)), threads)
        rows.append(compared(before, after))
        if progress:
            progress((number + 1) / len(every))
    return {name: np.array(values) for name, values in zip(NUMBERS, zip(*rows, strict=True), strict=True)}


def check(weights: int, draws: int, arrays: Arrays) -> None:
    """Refuse numbers of a file that :func:`measure` cannot have found, by a ValueError."""
    for name in NUMBERS:
        if (shape := arrays[name].shape) != (len(changes(draws)),):
            raise ValueError(f"{name}: shape {shape} is not allowed; give ({len(changes(draws))},)")
    for name in NUMBERS[:3]:
        within(name, arrays[name], 0, weights**2)
    within("shift", np.nan_to_num(arrays["shift"]), 0, 3)  # weights are from -1 to 1


def rows_of(design: int, draws: int, arrays: Arrays) -> list[Record]:
    """The rows of a body in the table."""
    columns = zip(*(arrays[name].tolist() for name in NUMBERS), strict=True)
    return [
        {"design": design, "perturbation": change.name, "strength": change.strength, "draw": draw}
        | dict(zip(NUMBERS, (*counts, None if shift != shift else shift), strict=True))
        for (change, draw), (*counts, shift) in zip(changes(draws), columns, strict=True)
    ]


def summary(rows: Sequence[Record]) -> dict[str, Any]:
    """By body, its manifold's size, and means over kinds of changes, each the mean of its strengths, with intervals.

    ``kept`` is the share of the manifold that still solves all, ``size`` how large it is for what it was, ``shift`` how
    far its mean moved, where anything was left of it. Intervals are of the mean over kinds, bootstrap, 95 %.
    """
    found = {}
    for design in distinct(rows, "design"):
        own = select(rows, design=design)
        told: dict[str, Any] = {"controllers": own[0]["before"], "changes": len(own)}
        if own[0]["before"]:  # of an empty manifold nothing can be kept
            kinds = {kind: _means(select(own, perturbation=kind)) for kind in distinct(own, "perturbation")}
            for what in ("kept", "size", "shift"):
                told[what] = _with_interval([means[what] for means in kinds.values()])
            told["kinds"] = kinds
        found[str(design)] = told
    return found


def _with_interval(means: Sequence[float | None]) -> dict[str, Any] | None:
    """The mean of what is known, and its interval; None if nothing is."""
    if not (values := [mean for mean in means if mean is not None]):
        return None
    low, high = map(float, mean_band(values))
    return {"mean": float(np.mean(values)), "low": low, "high": high, "n": len(values)}


def _means(rows: Sequence[Record]) -> dict[str, float | None]:
    """Means over strengths of the means over draws of a kind of changes."""
    each: dict[str, list[float]] = {"kept": [], "size": [], "shift": []}
    for strength in distinct(rows, "strength"):
        own = select(rows, strength=strength)
        before, after, both = (column(own, name) for name in NUMBERS[:3])
        each["kept"].append(float(np.mean(both / before)))
        each["size"].append(float(np.mean(after / before)))
        if shifts := [row["shift"] for row in own if row["shift"] is not None]:
            each["shift"].append(float(np.mean(shifts)))
    return {name: float(np.mean(values)) if values else None for name, values in each.items()}
