"""The search for a base body of the two-wheel vehicle repeated: a front of distance and effort, and a body from it.

Source: dissertation, chapter 3, "The empirical model", which names the Borg MOEA, both objectives, and that the sensors
sat in the canonical places. It does not say how the base body was chosen; here it is the body of least effort that
reaches the light in all environments.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.figures import COLOURS, COLUMN, figure
from optim.experiments.results import Budget, Progress, cached, check_counts, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.experiments.trials import Trials, cached_trials
from optim.measures.overlap import interference, learnability
from optim.measures.pareto import non_dominated
from optim.plots.fronts import draw_points
from optim.studies.chapter3.rover_grid import RoverGrid
from optim.studies.chapter3.rover_problem import (
    CONTROLLERS,
    DRIVES,
    MASSES,
    SENSOR_HEIGHT,
    SENSOR_RADIUS,
    RoverProblem,
    distances,
    effort,
)
from robots.rover import BEST, CANONICAL, STEPS, Rover, simulate
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

BORG: dict[str, Any] = {"population": 100, "epsilons": 0.05, "window": 500}
SITES = {"canonical": CANONICAL, "best": BEST}
LABELS = {"unit": "both weights 1", "evolved": "weights evolved"}


@dataclass(frozen=True)
class PreOptimisation:
    """Settings.

    Attributes:
        runs: searches with each controller.
        budget: evaluations of each search.
        seed: of the first search; the others have those that follow.
        weights: values of each weight, in the grid that base bodies are judged by afterwards.
        steps: looks at the light in every rollout.
        threads: CPU threads, all available if None; changes no result.
    """

    runs: int = 3
    budget: int = 8000
    seed: int = 1
    weights: int = 31
    steps: int = STEPS
    threads: int | None = None

    def __post_init__(self) -> None:
        check_counts(self, runs=1, budget=1, seed=0, weights=2, steps=1)

    def problem(self, controller: str) -> RoverProblem:
        """The problem with a controller."""
        return RoverProblem(controller, self.steps, threads=self.threads)


@dataclass(frozen=True, eq=False)
class Front:
    """The non-dominated designs of the searches with one controller, by falling effort.

    Attributes:
        points: (F, D).
        distance: sum over environments [m], (F,).
        effort: [pi], (F,).
        solved: environments whose light is reached, (F,).
    """

    points: Floats
    distance: Floats
    effort: Floats
    solved: NDArray[np.int8]

    @classmethod
    def of(cls, trials: list[Trials]) -> "Front":
        """The common front of several searches."""
        points, objectives = (np.concatenate([getattr(t, n)[0] for t in trials]) for n in ("points", "objectives"))
        solved = np.concatenate([t.solved[0] for t in trials])
        _, first = np.unique(objectives, axis=0, return_index=True)
        chosen = first[non_dominated(objectives[first])]
        chosen = chosen[np.argsort(objectives[chosen, 1], kind="stable")]
        return cls(points[chosen], -objectives[chosen, 0], -objectives[chosen, 1], solved[chosen])

    def least_effort(self, allowed: Bools) -> int | None:
        """Place of the member of least effort among those allowed, (F,); None if none is."""
        places = np.flatnonzero(allowed)
        return int(places[-1]) if len(places) else None


SCALES: Mapping[Budget, PreOptimisation] = {"small": PreOptimisation(1, 400, weights=11), "full": PreOptimisation()}


def study(folder: Path, settings: PreOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, the fronts as CSV and a figure, search by search.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    numbers = {name: value for name, value in asdict(settings).items() if name != "threads"}
    problems = {name: settings.problem(name) for name in CONTROLLERS}
    described = {name: problem.describe() for name, problem in problems.items()}
    results = ResultsFolder(folder, "rover-pre-optimisation", {**numbers, "borg": BORG, "problems": described})
    fronts, parts = {}, len(CONTROLLERS) * settings.runs
    for n, (name, problem) in enumerate(problems.items()):
        trials = []
        for run in range(settings.runs):
            search = problem, "borg", BORG, [settings.seed + run], settings.budget
            trials.append(cached_trials(results, f"{name}_{run}", *search))
            if progress:
                progress((n * settings.runs + run + 1) / parts)
        fronts[name] = Front.of(trials)
    rows = [
        (name, *judged, *problems[name].named(point).values())
        for name, front in fronts.items()
        for point, *judged in zip(front.points, front.distance, front.effort, front.solved, strict=True)
    ]
    header = ("controller", "distance", "effort", "solved", *RoverProblem("evolved").space.names)
    write_table(folder / "rover-fronts.csv", header, rows)
    published = _judged("published", Rover(), settings, results)
    summary: dict[str, Any] = {"published_base": published}
    for name, front in fronts.items():
        near = front.least_effort(front.distance <= published["distance_with_weights_1"])
        base = front.least_effort(front.solved == 4)
        summary[name] = {"front": len(front.points), "base": None, "as_near_as_published": None}
        if base is not None:
            summary[name]["base"] = _judged(name, problems[name].rover(front.points[base]), settings, results)
        if near is not None:
            numbers = {"effort": float(front.effort[near]), "distance": float(front.distance[near])}
            body = problems[name].rover(front.points[near])
            summary[name]["as_near_as_published"] = {"parameters": _shown(body), **numbers}
    write_json(folder / "summary.json", summary)
    draw(fronts, published, folder / "rover-pre-optimisation.png")


def _judged(name: str, base: Rover, settings: PreOptimisation, results: ResultsFolder) -> dict[str, Any]:
    """A base body's parameters, objectives with both weights 1, and success over weights with sensors as in the sweep.

    The success is that of the canonical and of the best sites.
    """

    def compute() -> Arrays:
        run = partial(simulate, steps=settings.steps, precision="f32", threads=settings.threads)
        alone = run(replace(base, sensor_radius=SENSOR_RADIUS, sensor_height=SENSOR_HEIGHT), (1.0, 1.0))
        pairs, bodies = RoverGrid(settings.weights).pairs, [Rover(at, **_parameters(base)) for at in SITES.values()]
        swept = [run(body, pairs).success.sum(axis=1, dtype=np.uint8) for body in bodies]
        return {"closest": alone.closest, "overlaps": np.array(swept).reshape(-1, *[settings.weights] * 2)}

    found = cached(results, f"judged_{name}", compute)
    return {
        "parameters": _shown(base),
        "effort": float(effort([base])[0]),
        "distance_with_weights_1": float(distances([base], found["closest"])[0]),
        "solved_with_weights_1": int((found["closest"] <= base.success_distance).sum()),
        "controllers": settings.weights**2,
        "grids": {
            sites: {
                "solving_all": int(np.count_nonzero(overlap == 4)),
                "solving_any": int(np.count_nonzero(overlap)),
                "M_L": float(learnability(overlap)),
                "M_CF": float(interference(overlap)),
            }
            for sites, overlap in zip(SITES, found["overlaps"], strict=True)
        },
    }


def _parameters(base: Rover) -> dict[str, float]:
    return {name: getattr(base, name) for name in (*MASSES, "wheel_radius", *DRIVES)}


def _shown(base: Rover) -> dict[str, float]:
    """Parameters, the drives' in units of pi."""
    return {key: value / math.pi if key in DRIVES else value for key, value in _parameters(base).items()}


def draw(fronts: dict[str, Front], published: dict[str, Any], path: Path) -> None:
    """Fronts of both controllers, filled where all lights are reached, and the published base body."""
    with figure(path, COLUMN, 2.8) as (_, panels):
        axes = panels[0, 0]
        for (name, front), colour in zip(fronts.items(), COLOURS, strict=False):
            draw_points(axes, front.effort, front.distance, front.solved == 4, colour=colour, label=LABELS[name])
        base = published["effort"], published["distance_with_weights_1"]
        axes.plot(*base, "*", color=COLOURS[7], markersize=8, label="published base")
        axes.plot([], [], "o", color="black", markersize=3, label="filled: all four lights reached")
        axes.set(xlabel="torque + speed + rate [$\\pi$]", ylabel="sum of smallest distances [m]", ylim=(0, None))
        axes.legend(loc="upper right")


STUDY = Study(
    title="the search for the two-wheel vehicle's base body: distance from the light against effort of its drives",
    source="chapter 3, the empirical model",
    scales=SCALES,
    run=study,
    writes=("summary.json", "rover-fronts.csv", "rover-pre-optimisation.png"),
)
