"""Champions, run once more: their paths and what they saw; and robots trained on each light alone."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.results import Progress
from optim.experiments.tables import Record, column, distinct, select, write_records
from optim.studies.chapter2.evolution import Runs, by_treatment, evolve
from optim.studies.chapter2.settings import ROBOTS, ROWS, Interference, Treatment
from optim.studies.chapter2.tables import measure
from robots.quadruped import TIME_STEP
from robots.robot import part_of
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.files import write_text

FRAMES = 500  # of a signal, at most
NEAR = 0.5  # m, from the light
FARTHEST = 1000.0  # m, that no robot gets away in a trial
TRACES: dict[str, Kind] = {  # of ``traces.csv``: a moment [s] of a run in an environment, where it is, what it reads
    "fitness": ROWS,
    "robot": tuple(ROBOTS),
    **dict.fromkeys(("run", "environment"), int),
    **dict.fromkeys(("time", "x", "y", "light"), float),
}


@dataclass(frozen=True, eq=False)
class Champions:
    """Paths and readings of the champions of a treatment; R runs, E environments, F moments."""

    weights: Floats  # their controllers, (R, 5, 8)
    times: Floats  # (F,) [s]
    paths: Floats  # of the main body, seen from above, (R, E, F, 2) [m]
    light: Floats  # readings, (R, E, F) [1/m^2]
    distance: Floats  # from the light at the end, (R, E) [m]


def champions_of(settings: Interference, found: Runs, threads: int | None = None) -> dict[Treatment, Champions]:
    """Run the champions of all runs again, treatment by treatment."""
    seen = {}
    for treatment, measured in measure(found).items():
        pairs = zip(found[treatment], measured, strict=True)
        weights = np.stack([state["weights"][run.champion] for state, run in pairs])
        seen[treatment] = follow(settings, treatment.robot, weights, threads)
    return seen


def follow(settings: Interference, robot: str, weights: Floats, threads: int | None = None) -> Champions:
    """Simulate controllers, (R, 5, 8), and record their paths and readings."""
    every = max(1, -(-settings.steps // FRAMES))
    result = settings.simulate(robot, weights, threads, record_every=every)
    frames = result.rollouts.frames
    assert frames is not None  # they were asked for
    shape = (len(weights), len(settings.lights), len(frames.times))
    paths = frames.position[:, :, :2].swapaxes(0, 1).reshape(*shape, 2)
    return Champions(weights, frames.times, paths, frames.readings[:, :, -1].T.reshape(shape), result.distance)


def time_near(seen: Champions, lights: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
    """Time within half a metre of the light, seen from above [s], (R, E): in all, and without leaving to the end."""
    near: Bools = np.linalg.norm(seen.paths - np.array(lights, float)[:, None], axis=-1) <= NEAR
    step = seen.times[1] - seen.times[0] if len(seen.times) > 1 else TIME_STEP
    waiting = np.cumprod(near[..., ::-1], axis=-1)
    return near.sum(axis=-1) * step, waiting.sum(axis=-1) * step


def write_champions(champions: Mapping[Treatment, Champions], folder: Path) -> None:
    """Controllers of typical champions, a file a treatment, as ``morpholab view --controller`` reads them."""
    folder.mkdir(exist_ok=True)
    for treatment, seen in champions.items():
        name = f"{treatment.robot}_{treatment.row}".replace(", ", "_")
        write_text(folder / f"{name}.json", json.dumps(seen.weights[typical(seen)].tolist()) + "\n")


def traces_of(champions: Mapping[Treatment, Champions]) -> list[Record]:
    """Paths and readings of a typical champion of each treatment, a row for each moment: those of ``TRACES``."""
    rows: list[Record] = []
    for treatment, seen in champions.items():
        run = typical(seen)
        for environment, (path, light) in enumerate(zip(seen.paths[run], seen.light[run], strict=True)):
            for time, reading, *at in np.column_stack([seen.times, light, path]).tolist():
                moment = float(f"{time:.6g}"), *(round(each, 3) for each in at), float(f"{reading:.6g}")
                rows.append(dict(zip(TRACES, (*treatment.place, run, environment, *moment), strict=True)))
    return rows


def read_traces(data: Data, environments: int) -> list[Record]:
    """Read rows as of :func:`traces_of`; raises ValueError unless each treatment has one path in each environment."""
    rows, path = data.records("traces.csv", TRACES), data.path("traces.csv")
    for number, row in enumerate(rows, 2):
        for name in ("x", "y"):
            if abs(row[name]) > FARTHEST:  # failed ones have NaN
                told = f"row {number} has {row[name]:g} as {name}"
                raise ValueError(f"{path}: {told}; it must be from {-FARTHEST:g} to {FARTHEST:g} m")
    for place in dict.fromkeys((row["fitness"], row["robot"]) for row in rows):
        own, named = select(rows, fitness=place[0], robot=place[1]), " ".join(place)
        found, runs = distinct(own, "environment"), distinct(own, "run")
        if sorted(found) != list(range(environments)) or len(runs) > 1:
            told = f"{named} has environments {found} of runs {runs}"
            raise ValueError(f"{path}: {told}; give all {environments} environments from 0 on of one run")
        for environment in found:
            if not (np.diff(column(select(own, environment=environment), "time")) > 0).all():
                raise ValueError(f"{path}: {named} goes back in time in environment {environment}; sort its rows")
    return rows


def typical(seen: Champions) -> int:
    """The run whose champion's worst distance is the median of all, the better of two."""
    order = np.argsort(seen.distance.max(axis=1), kind="stable")
    return int(order[(len(order) - 1) // 2])


# Of ``alone.csv``: whose champion, of which light and run, after so many generations; and what it does.
MEANS = ("distance", "time_near", "time_near_at_the_end")
COLUMNS: dict[str, Kind] = {
    **{"robot": tuple(ROBOTS), "x": float, "y": float, "run": int},
    **dict.fromkeys(MEANS, float),
    "generations": int,
}


def train_alone(
    settings: Interference,
    robots: Sequence[str],
    runs: int,
    generations: int,
    out: Path,
    threads: int | None = None,
    progress: Progress = None,
) -> list[dict[str, Any]]:
    """Train each robot on each light alone, and write what its champions do, see :func:`write_alone`.

    Each of the lights has a folder of its own in ``out / "alone"``.
    """
    rows = []
    chosen = [Treatment(robot, "min") for robot in robots]  # all ways to combine one environment are the same
    for n, light in enumerate(settings.lights):
        single = replace(settings, lights=(light,))
        folder, share = out / "alone" / f"{light[0]:g},{light[1]:g}", part_of(progress, n, len(settings.lights))
        found = by_treatment(evolve(single, chosen, runs, generations, folder, threads, share))
        for treatment, seen in champions_of(single, found, threads).items():
            near, waiting = time_near(seen, single.lights)
            for run, values in enumerate(np.column_stack([seen.distance, near, waiting]).tolist()):
                cells = treatment.robot, *light, run, *values, generations
                rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return write_alone(rows, out)


def write_alone(rows: Sequence[Record], out: Path) -> list[dict[str, Any]]:
    """Write what champions that were trained on a light alone do as ``alone.csv``.

    Returns:
        For each robot, light and number of generations: means of the champions' distance from the light at the end
        [m], and of the time that they spend within half a metre of it, in all and up to the end [s].
    """
    write_records(out / "alone.csv", [{name: row[name] for name in COLUMNS} for row in rows])
    summary = []
    for robot, x, y, generations in dict.fromkeys((r["robot"], r["x"], r["y"], r["generations"]) for r in rows):
        part = select(rows, robot=robot, x=x, y=y, generations=generations)
        means = {name: float(column(part, name).mean()) for name in MEANS}
        about = {"robot": robot, "light": [x, y], "runs": len(part), "generations": generations}
        summary.append({**about, **means})
    return summary
