"""Gaits for a real floor are screened and refined here: waves around the ring of bladders, then genetic searches."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed
from optim.experiments.results import Progress, computed_arrays
from optim.problem import Request, evaluate_request
from optim.problems.inflatable.graded_encoding import LEAST_MOTION, SETTLING
from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import read_history
from optim.studies.beyond.gait_hunt.searches import search_within
from optim.studies.beyond.robust_gaits.settings import BATCH, RobustGaits, file_of
from robots.inflatable.design import INCHING, InflatableDesign, load_design, save_design
from robots.inflatable.schedule import BLADDERS
from robots.robot import part_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

CYCLIC = ("level", "foot1", "foot2")  # kinds of variables of a wave, of which every column has one


def waves(most_full: int) -> list[tuple[int, ...]]:
    """All that a bladder can do, full (1) or empty, in the columns of a wave, of which none is another one shifted."""
    found, seen = [], set[tuple[int, ...]]()
    for levels in product((0, 1), repeat=BLADDERS):
        if 0 < sum(levels) <= most_full and levels not in seen:
            seen |= {levels[i:] + levels[:i] for i in range(BLADDERS)}
            found.append(levels)
    return found


def _points(problem: GaitProblem, rows: Sequence[Mapping[str, Any]]) -> Floats:
    """Points of a problem for waves in records; feet slide."""
    points = np.zeros((len(rows), problem.space.size))
    names = problem.space.names
    for point, row in zip(points, rows, strict=True):
        point[[names.index(f"level_{column + 1}") for column in range(BLADDERS)]] = list(map(int, row["levels"]))
        point[names.index("shift")], point[names.index("settle")] = row["shift"], row["settling"]
    return points


def screened(
    settings: RobustGaits, parts: ResultsFolder, threads: int | None, progress: Progress
) -> list[dict[str, Any]]:
    """Speeds of all waves on all slopes, without draws."""
    waved = product(waves(settings.most_full), (1, BLADDERS - 1), settings.settling)
    about = [
        {"levels": "".join(map(str, each)), "full": sum(each), "shift": shift, "settling": settling}
        for each, shift, settling in waved
    ]
    groups = [about[first : first + BATCH] for first in range(0, len(about), BATCH)]

    def speeds(slope: float, group: Sequence[Mapping[str, Any]], told: Progress) -> Floats:
        problem = settings.problem(slope, False, threads)
        speeds = evaluate_request(problem, Request(_points(problem, group), "points")).objectives[:, 0]
        return np.where(np.isfinite(speeds), speeds, -np.inf)

    tasks = {
        f"screen_{slope:g}_{number}": partial(speeds, slope, group)
        for slope in settings.slopes
        for number, group in enumerate(groups)
    }
    allowed = {name: Allowed((len(groups[n % len(groups)]),), failed=-np.inf) for n, name in enumerate(tasks)}
    found = np.concatenate(computed_arrays(parts, "speeds", tasks, progress, allowed))
    rows = [{"slope": slope, **each} for slope in settings.slopes for each in about]
    return [{**row, "speed": float(speed)} for row, speed in zip(rows, found, strict=True)]


def begun_at(wave: Mapping[str, Any], column: int) -> dict[str, Any]:
    """The values of a wave whose cycle begins with another one of its columns, counted from 0."""
    columns = {f"{kind}_{n + 1}": f"{kind}_{(n + column) % BLADDERS + 1}" for kind in CYCLIC for n in range(BLADDERS)}
    return {name: wave[columns.get(name, name)] for name in wave}


def starts_of(
    problem: GaitProblem, settings: RobustGaits, wave: Mapping[str, Any], below: Sequence[InflatableDesign]
) -> list[dict[str, Any]]:
    """Where a search may begin: with a wave, or with the gait found on the slope below, from any of their columns.

    A gait that goes round is the same from any column; but on the steepest slopes only some columns get it going.
    """
    known = [dict(zip(problem.space.names, _points(problem, [wave])[0].tolist(), strict=True))]
    known += [problem.start_values(design) for design in below]
    starts = [begun_at(each, column) for each in known for column in range(settings.begins)]
    return [start for n, start in enumerate(starts) if start not in starts[:n]]  # waves may repeat themselves


def best_start(
    problem: GaitProblem,
    starts: Sequence[dict[str, Any]],
    parts: ResultsFolder,
    name: str,
    progress: Progress = None,
) -> dict[str, Any]:
    """The start that is best in the problem itself: under its draws, if it has some."""
    if len(starts) == 1:
        return starts[0]

    def scores(told: Progress) -> Floats:
        points = np.stack([problem.space.from_dict(each) for each in starts])
        return evaluate_request(problem, Request(points, "points")).objectives[:, 0]

    tasks = {f"starts_{name}": scores}
    allowed = dict.fromkeys(tasks, Allowed((len(starts),), failed=np.nan))
    (found,) = computed_arrays(parts, "scores", tasks, progress, allowed)
    return starts[int(np.argmax(np.nan_to_num(found, nan=-np.inf)))]


def refined(
    problem: GaitProblem, settings: RobustGaits, start: Mapping[str, Any], path: Path, progress: Progress
) -> InflatableDesign:
    """The gait that a genetic search finds from a start."""
    own = {"population": settings.population, "seed": settings.seed, "start": start}
    search_within(problem, "genetic", own, path, settings.budget, progress)
    return _best(problem, path)


def led_up(
    settings: RobustGaits,
    slope: float,
    robust: bool,
    screen: Sequence[Mapping[str, Any]],
    known: Sequence[InflatableDesign],
    parts: ResultsFolder,
    path: Path,
    threads: int | None,
    progress: Progress,
) -> InflatableDesign:
    """The gait of a slope, searched in a run folder from the best screened wave there, or from gaits that are known."""
    best = max((row for row in screen if row["slope"] == slope), key=lambda row: row["speed"])
    problem = settings.problem(slope, robust, threads)
    starts = starts_of(problem, settings, best, known)
    start = best_start(problem, starts, parts, path.name, part_of(progress, 0, 10, 3))
    return refined(problem, settings, start, path, part_of(progress, 3, 10, 7))


def kept(
    folder: Path, gaits: Mapping[str, tuple[InflatableDesign, float]]
) -> dict[str, tuple[InflatableDesign, float]]:
    """Gaits and their slopes by name, saved in a folder, and as whoever plays their files finds them."""
    folder.mkdir(exist_ok=True)
    paths = {name: folder / f"{file_of(name)}.json" for name in gaits}
    for name, (design, _) in gaits.items():
        save_design(design, paths[name])
    return {name: (load_design(paths[name]), slope) for name, (_, slope) in gaits.items()}


def flat_walk(folder: Path, settings: RobustGaits, threads: int | None, progress: Progress) -> InflatableDesign:
    """The gait on level ground that a genetic search under draws finds from inching, of a body that cannot roll."""
    problem, columns = settings.problem(0.0, True, threads, False), INCHING.schedule.columns
    times: dict[str, Any] = {"motion_steps": np.full(columns, LEAST_MOTION), "settle_steps": np.full(columns, SETTLING)}
    start = problem.start_values(replace(INCHING, schedule=replace(INCHING.schedule, repeats=1, **times)))
    return refined(problem, settings, start, folder / "runs" / "flat-body", progress)


def _best(problem: GaitProblem, run: Path) -> InflatableDesign:
    """The best gait of a run."""
    found = read_history(run).generations[-1].best_point
    assert found is not None  # the start is a gait
    return problem.design(problem.space.from_dict(found))
