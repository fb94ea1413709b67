"""The search for a base body of the two-wheel vehicle repeated: a front of distance and effort, and a body from it.

Source: dissertation, chapter 3, "The empirical model", which names the Borg MOEA, both objectives, and that the sensors
sat in the canonical places: masses, radius of the wheels, torque, speed and target rate are free; one objective is the
distance from the light, summed over the four environments, the other the sum of torque, speed and target rate. It does
not say how the base body was chosen; here it is the body of least effort that reaches the light in all environments.
Nor does it say what steered the bodies. Of the 121 x 121 controllers of the base body that was found, only the one with
both weights at 1 solves all environments: probably the search had this one. So it is the default; as an option the
weights evolve along with each body.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, COLUMN, figure
from optim.experiments.results import Progress, cached, write_json
from optim.experiments.search_evaluations import SearchEvaluations, computed_searches, record_searches
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, select, write_records
from optim.measures.overlap import learnability_of, resistance_of
from optim.measures.pareto import non_dominated
from optim.plots.fronts import draw_points
from optim.problem import Evaluation
from optim.space import Space, Variable
from optim.studies.chapter3.rover_success import RoverGrid
from robots.rover import BEST, CANONICAL, STEPS, Rover, simulate
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.compute import Device, Precision, Threads
from taichi_sim.base.results_folder import ResultsFolder

MASSES = ("body_mass", "wheel_mass", "castor_mass")
DRIVES = ("speed", "command_range", "torque")  # in units of pi
WEIGHTS = ("w1", "w2")
CONTROLLERS = ("unit", "evolved")
MASS_RANGE, RADIUS_RANGE, DRIVE_RANGE = (0.001, 1000.0), (0.075, 0.3), (0.25, 10.0)  # kg, m, pi
SENSOR_RADIUS, SENSOR_HEIGHT = 0.02, 0.0  # m, in this search only
STEP = 0.1  # of ranges, standard deviation of a mutation


@dataclass(frozen=True, eq=False)
class RoverProblem:
    """Objectives, maximised: minus the sum of smallest distances from the lights [m], minus torque + speed + rate [pi].

    Nearer than the distance of success counts as that distance, where the light stops the vehicle.
    """

    controller: str = "unit"  # ``"unit"``: both weights are 1; ``"evolved"``: they are variables, too
    steps: int = STEPS  # looks at the light in every rollout
    precision: Precision = "f32"  # ``"f32"`` or ``"f64"``
    device: Device = "cpu"  # ``"cpu"``, ``"cuda"``, .
    threads: Threads = None  # of the CPU; changes no result

    def __post_init__(self) -> None:
        checks.choice("controller", self.controller, CONTROLLERS)

    @cached_property
    def space(self) -> Space:
        """Masses [kg], radius of the wheels [m], drives [pi], and weights if they evolve."""
        ranges = {
            **dict.fromkeys(MASSES, MASS_RANGE),
            "wheel_radius": RADIUS_RANGE,
            **dict.fromkeys(DRIVES, DRIVE_RANGE),
            **dict.fromkeys(WEIGHTS if self.controller == "evolved" else (), (-1.0, 1.0)),
        }
        return Space(tuple(Variable(name, low, high, step=STEP * (high - low)) for name, (low, high) in ranges.items()))

    def named(self, point: ArrayLike) -> dict[str, float]:
        """Values of a point, shape (D,), by name, with the weights."""
        return {**self.space.to_dict(point), **(dict.fromkeys(WEIGHTS, 1.0) if self.controller == "unit" else {})}

    def rover(self, point: ArrayLike) -> Rover:
        """The body of a point, shape (D,), as in this search."""
        return rover_of(self.space.to_dict(point))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Roll out all points, shape (N, D).

        Details: ``solved``, in how many environments the light is reached, shape (N,).
        """
        points = self.space.validate(np.atleast_2d(points))
        rovers = [self.rover(point) for point in points]
        weights = points[:, -len(WEIGHTS) :] if self.controller == "evolved" else np.ones((len(points), len(WEIGHTS)))
        compute: dict[str, Any] = {"precision": self.precision, "device": self.device, "threads": self.threads}
        done = simulate(rovers, weights, steps=self.steps, **compute)
        objectives = np.column_stack([-distances(rovers, done.closest), -effort(rovers)])
        status = np.where((done.status == "ok").all(axis=1), "ok", "diverged")
        return Evaluation(objectives, status, {"solved": done.success.sum(axis=1)})

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points as :meth:`evaluate` does, as nothing is binary; raises ValueError if asked for gradients."""
        if gradients:
            raise ValueError("gradients: not allowed with several objectives; ask for points")
        return self.evaluate(points)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values."""
        numbers = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "threads"}
        return {**numbers, "variables": {v.name: [v.low, v.high] for v in self.space.variables}}


def rover_of(values: Mapping[str, float]) -> Rover:
    """The body of masses, radius of the wheels and drives by name, as in this search."""
    drives = {name: values[name] * math.pi for name in DRIVES}
    others = {name: values[name] for name in (*MASSES, "wheel_radius")}
    return Rover(CANONICAL, **others, **drives, sensor_radius=SENSOR_RADIUS, sensor_height=SENSOR_HEIGHT)


def distances(rovers: list[Rover], closest: Floats) -> Floats:
    """Sums over environments of smallest distances, (N, E), none below that of success [m], (N,)."""
    reached = np.array([rover.success_distance for rover in rovers])
    return np.asarray(np.maximum(closest, reached[:, None]).sum(axis=1))


def effort(rovers: list[Rover]) -> Floats:
    """Torque [N m], speed and rate [rad/s], in units of pi, summed, (N,)."""
    return np.array([rover.torque + rover.speed + rover.command_range for rover in rovers]) / math.pi


BORG: dict[str, Any] = {"population": 100, "epsilons": 0.05, "window": 500}
SITES = {"canonical": CANONICAL, "best": BEST}
TABLE = "rover-fronts.csv"
COLUMNS: dict[str, Kind] = {
    **{"controller": CONTROLLERS, "distance": float, "effort": float, "solved": int},
    **dict.fromkeys((*MASSES, "wheel_radius", *DRIVES, *WEIGHTS), float),
}
LABELS = {"unit": "both weights 1", "evolved": "weights evolved"}


@dataclass(frozen=True)
class PreOptimisation(Settings):
    """Searches for a base body, and how what they find is judged."""

    runs: Count = 3  # searches with each controller
    budget: Count = 8000  # evaluations of each search
    seed: Whole = 1  # of the first search; the others have those that follow
    weights: Several = 31  # values of each weight, in the grid that base bodies are judged by afterwards
    steps: Count = STEPS  # looks at the light in every rollout
    threads: Threads = None  # of the CPU; changes no result


def front_of(searches: Sequence[SearchEvaluations]) -> list[Record]:
    """The non-dominated designs of several searches together, by falling effort.

    Returns:
        A record of each design: its ``point``, the ``distance`` summed over environments [m], the ``effort`` [pi], and
        how many environments are ``solved``.
    """
    points, objectives, solved = (
        np.concatenate([getattr(each, name)[0] for each in searches]) for name in ("points", "objectives", "solved")
    )
    _, first = np.unique(objectives, axis=0, return_index=True)
    chosen = first[non_dominated(objectives[first])]
    chosen = chosen[np.argsort(objectives[chosen, 1], kind="stable")]
    judged = zip(points[chosen], *-objectives[chosen].T.astype(float), solved[chosen], strict=True)
    return [dict(zip(("point", "distance", "effort", "solved"), each, strict=True)) for each in judged]


def study(folder: Path, settings: PreOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, the fronts as CSV and a figure, search by search."""
    problems = {name: RoverProblem(name, settings.steps, threads=settings.threads) for name in CONTROLLERS}
    described = {name: problem.describe() for name, problem in problems.items()}
    about = {**settings.describe(), "borg": BORG, "problems": described}
    results = ResultsFolder(folder, "rover-pre-optimisation", about)
    runs = {name: [f"{name}_{run}" for run in range(settings.runs)] for name in problems}
    arms = {
        run: partial(record_searches, problems[name], "borg", BORG, [seed], settings.budget)
        for name, each in runs.items()
        for seed, run in enumerate(each, settings.seed)
    }
    searches = computed_searches(results, arms, progress)
    rows = []
    for name, each in runs.items():
        for row in front_of([searches[run] for run in each]):
            judged = {"controller": name, **{key: row[key] for key in ("distance", "effort", "solved")}}
            rows.append({**judged, **problems[name].named(row["point"])})
    bases = _bases(rows)
    _report(folder, rows, {name: _judged(name, base, settings, results) for name, base in bases.items()})


def rewrite(data: Data, folder: Path) -> None:
    """Write what :func:`study` does from the table of fronts, and from what ``summary.json`` has of base bodies."""
    rows = data.records(TABLE, COLUMNS)
    _report(folder, rows, data.from_summary(partial(_known, _bases(rows))))


def _known(names: Iterable[str], summary: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """What was simulated of base bodies, as :func:`_judged` gives it, from ``summary.json``."""
    found = {}
    for name in names:
        base = summary["published_base"] if name == "published" else checks.table(name, summary[name])["base"]
        base = checks.table(f"base of {name}", base)
        least = {"solved_with_weights_1": 0, "controllers": 1}
        counts = {each: checks.integer(each, base[each], low) for each, low in least.items()}
        grids = {
            sites: {
                each: checks.integer(each, base["grids"][sites][each], 0) for each in ("solving_all", "solving_any")
            }
            for sites in SITES
        }
        distance = checks.positive("distance_with_weights_1", base["distance_with_weights_1"])
        found[name] = {"distance_with_weights_1": distance, **counts, "grids": grids}
    return found


def _bases(rows: Sequence[Record]) -> dict[str, Rover]:
    """The published base body, and of each front that of least effort that reaches all lights, if there is one."""
    solving = {name: select(rows, controller=name, solved=4) for name in CONTROLLERS}
    return {"published": Rover(), **{name: rover_of(front[-1]) for name, front in solving.items() if front}}


def _report(folder: Path, rows: Sequence[Record], judged: Mapping[str, Mapping[str, Any]]) -> None:
    """Write all from the fronts, by falling effort, and from what was simulated of base bodies."""
    write_records(folder / TABLE, rows)
    bases = {name: _described(base, judged[name]) for name, base in _bases(rows).items()}
    published = bases["published"]
    fronts = {name: select(rows, controller=name) for name in CONTROLLERS}
    summary: dict[str, Any] = {"published_base": published}
    for name, front in fronts.items():
        near = [row for row in front if row["distance"] <= published["distance_with_weights_1"]]
        summary[name] = {"front": len(front), "base": bases.get(name), "as_near_as_published": None}
        if near:
            numbers = {key: float(near[-1][key]) for key in ("effort", "distance")}
            summary[name]["as_near_as_published"] = {"parameters": _shown(rover_of(near[-1])), **numbers}
    write_json(folder / "summary.json", summary)
    draw(fronts, published, folder / "rover-pre-optimisation.png")


def _judged(name: str, base: Rover, settings: PreOptimisation, results: ResultsFolder) -> dict[str, Any]:
    """A base body's distance and lights with both weights 1, and success over weights with sensors as in the sweep.

    The success is that of the canonical and of the best sites.
    """

    def compute() -> Arrays:
        run = partial(simulate, steps=settings.steps, precision="f32", threads=settings.threads)
        alone = run(replace(base, sensor_radius=SENSOR_RADIUS, sensor_height=SENSOR_HEIGHT), (1.0, 1.0))
        pairs, bodies = RoverGrid(settings.weights).pairs, [Rover(at, **_parameters(base)) for at in SITES.values()]
        swept = [run(body, pairs).success.sum(axis=1, dtype=np.uint8) for body in bodies]
        return {"closest": alone.closest, "overlaps": np.array(swept).reshape(-1, *[settings.weights] * 2)}

    solved = Allowed((len(SITES), settings.weights, settings.weights), 0, 4, kind="u")
    check = partial(check_arrays, {"closest": Allowed((1, 4), 0.0, failed=np.nan), "overlaps": solved})
    found = cached(results, f"judged_{name}", compute, check)
    return {
        "distance_with_weights_1": float(distances([base], found["closest"])[0]),
        "solved_with_weights_1": int((found["closest"] <= base.success_distance).sum()),
        "controllers": settings.weights**2,
        "grids": {
            sites: {
                "solving_all": int(np.count_nonzero(overlap == 4)),
                "solving_any": int(np.count_nonzero(overlap)),
            }
            for sites, overlap in zip(SITES, found["overlaps"], strict=True)
        },
    }


def _described(base: Rover, judged: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters and effort of a base body, what was simulated of it, and metrics from that."""
    grids = {
        sites: {
            **counts,
            "M_L": float(learnability_of(counts["solving_all"], judged["controllers"])),
            "M_CF": float(resistance_of(counts["solving_all"], counts["solving_any"])),
        }
        for sites, counts in judged["grids"].items()
    }
    return {"parameters": _shown(base), "effort": float(effort([base])[0]), **judged, "grids": grids}


def _parameters(base: Rover) -> dict[str, float]:
    return {name: getattr(base, name) for name in (*MASSES, "wheel_radius", *DRIVES)}


def _shown(base: Rover) -> dict[str, float]:
    """Parameters, the drives' in units of pi."""
    return {key: value / math.pi if key in DRIVES else value for key, value in _parameters(base).items()}


def draw(fronts: Mapping[str, Sequence[Record]], published: Record, path: Path) -> None:
    """Fronts of both controllers, filled where all lights are reached, and the published base body."""
    with figure(path, COLUMN, 2.8) as (_, panels):
        axes = panels[0, 0]
        for (name, front), colour in zip(fronts.items(), COLOURS, strict=False):
            places = column(front, "effort"), column(front, "distance")
            draw_points(axes, *places, column(front, "solved") == 4, colour=colour, label=LABELS[name])
        base = published["effort"], published["distance_with_weights_1"]
        axes.plot(*base, "*", color=COLOURS[7], markersize=8, label="published base")
        axes.plot([], [], "o", color="black", markersize=3, label="filled: all four lights reached")
        axes.set(xlabel="torque + speed + rate [$\\pi$]", ylabel="sum of smallest distances [m]", ylim=(0, None))
        axes.legend(loc="upper right")


STUDY = Study(
    title="the search for the two-wheel vehicle's base body: distance from the light against effort of its drives",
    source="chapter 3, the empirical model",
    scales={"small": PreOptimisation(1, 400, weights=11), "full": PreOptimisation()},
    run=study,
    rewrite=rewrite,
    writes=("summary.json", TABLE, "rover-pre-optimisation.png"),
)
