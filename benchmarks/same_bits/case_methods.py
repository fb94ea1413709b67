"""Cases of search methods on problems without physics: what they ask for, hold and find."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import places
from cases import Arrays, case, plain

GENERATIONS = 15
SEVERAL, CLIMBING = {"population": 12, "seed": 3}, {"climbers": 4, "seed": 3}
# Settings of a method that version 1.0 did not have.
LATER = {
    "hill-climb": ("bounds", "streams"),
    "genetic": ("patches",),
    "nes": ("minibatch_size", "judging"),
    "race": ("returning",),
}
# Name of a case: method, settings, space, number of objectives.
SEARCHES: dict[str, tuple[str, dict[str, Any], str, int]] = {
    "borg": ("borg", SEVERAL, "mixed", 2),
    "borg-small-steps": ("borg", SEVERAL | {"children": 1, "window": 30, "epsilons": 0.05}, "mixed", 3),
    "cma": ("cma", SEVERAL, "mixed", 1),
    "cma-restarts": ("cma", SEVERAL | {"patience": 2, "random_mean": True}, "mixed", 1),
    "cma-gradient": ("cma-gradient", SEVERAL, "relaxable", 1),
    "cma-gradient-sampled": ("cma-gradient", SEVERAL | {"samples": 3, "every": 3}, "relaxable", 1),
    "de": ("de", SEVERAL, "mixed", 1),
    "de-rand": ("de", SEVERAL | {"strategy": "rand/1/bin", "dither": 0.0}, "mixed", 1),
    "generating-set": ("generating-set", CLIMBING, "mixed", 1),
    "generating-set-rotated": ("generating-set", CLIMBING | {"directions": "rotated", "polled": 2}, "mixed", 1),
    "genetic": ("genetic", SEVERAL, "mixed", 1),
    "genetic-other": ("genetic", SEVERAL | {"mutation": 0.3, "resetting": 0.2, "tournament": 3}, "mixed", 1),
    "gradient": ("gradient", CLIMBING, "relaxable", 1),
    "gradient-l-bfgs": ("gradient", CLIMBING | {"rule": "l-bfgs", "verify": True}, "relaxable", 1),
    "gradient-smoothed": ("gradient", CLIMBING | {"gradient": "smoothed", "samples": 3}, "relaxable", 1),
    "gradient-staged": ("gradient", CLIMBING | {"stage": 4, "candidates": 3, "patience": 3}, "relaxable", 1),
    "hill-climb": ("hill-climb", CLIMBING, "mixed", 1),
    "map-elites": ("map-elites", SEVERAL, "mixed", 1),
    "map-elites-details": (
        "map-elites", SEVERAL | {"descriptors": ["far"], "ranges": {"far": [0.0, 9.0]}, "bins": 5}, "mixed", 1,
    ),
    "memetic": ("memetic", SEVERAL | {"refine": 3}, "relaxable", 1),
    "nes": ("nes", SEVERAL, "mixed", 1),
    "nes-mirrored": ("nes", SEVERAL | {"mirrored": True, "random_mean": True}, "mixed", 1),
    "nsga2": ("nsga2", SEVERAL, "mixed", 2),
    "random": ("random", CLIMBING, "mixed", 1),
}  # fmt: skip


class StandIn:
    """A quick analytic problem, some of whose points fail."""

    def __init__(self, space: str, objectives: int) -> None:
        variable = places.Variable
        variables = [
            variable("x", -2.0, 6.0, step=0.8),
            variable("y", 0.0, 1.0, step=0.1),
            variable("a", -180.0, 180.0, "angle", step=30.0),
            variable("b", 0, 1, "binary", step=0.4),
        ]
        if space == "mixed":
            variables.insert(2, variable("n", -3, 4, "integer", step=1.2))
        self.space = places.Space(tuple(variables))
        self.objective_names = tuple(f"f{i}" for i in range(objectives))
        self.kind = space

    def describe(self) -> dict[str, Any]:
        """What tells it from others."""
        return {"space": self.kind, "count": len(self.objective_names)}

    def evaluate(self, points: Any) -> Any:
        """Judge true points."""
        return self.evaluate_relaxed(points, 0.0, False)

    def evaluate_relaxed(self, points: Any, sharpness: float, gradients: bool) -> Any:
        """Judge points between, with exact gradients by sums and products alone."""
        points = np.atleast_2d(np.asarray(points, float))
        inside = (points - self.space.low) / (self.space.high - self.space.low)
        weights, aims = np.arange(1.0, 1.0 + points.shape[1]), np.linspace(0.3, 0.8, points.shape[1])
        away = inside - aims
        bend = 1.0 + 0.1 * sharpness
        values = [-(weights * (away + shift) ** 2).sum(axis=1) * bend + (inside[:, 0] - shift) * inside[:, -1]
                  for shift in 0.25 * np.arange(len(self.objective_names))]  # fmt: skip
        values = np.where((inside[:, 1] < 0.05)[:, None], np.nan, np.stack(values, axis=1))
        slopes = None
        if gradients:
            slopes = -2 * weights * away * bend
            slopes[:, 0] += inside[:, -1]
            slopes[:, -1] += inside[:, 0]
            slopes = slopes / (self.space.high - self.space.low)
        return places.Evaluation(values, details={"far": (weights * away**2).sum(axis=1)}, gradients=slopes)

    def save(self, point: Any, path: Path) -> None:
        """Write a point as JSON."""
        path.write_text(json.dumps(self.space.to_dict(point)))


def search(method: str, settings: dict[str, Any], space: str, objectives: int) -> Arrays:
    """Ask and tell for some generations; once taken apart and put together again on the way."""
    from optim.search import build_method

    problem = StandIn(space, objectives)
    searching = build_method(method, problem.space, settings)
    found: Arrays = {}
    for generation in range(GENERATIONS):
        points, wants = searching.ask(), searching.wants
        found[f"asked.{generation:02}"] = points
        found[f"wants.{generation:02}"] = plain([wants, repr(float(searching.sharpness))])
        if wants == "points":
            judged = problem.evaluate(points)
        else:
            judged = problem.evaluate_relaxed(points, searching.sharpness, wants == "gradients")
        searching.tell(points, judged)
        found |= {f"state.{generation:02}.{name}": plain(value) for name, value in searching.state().items()}
        if generation == GENERATIONS // 2:
            state, searching = searching.state(), build_method(method, problem.space, settings)
            searching.restore(state)
    return found | _result(searching.result())


def _result(result: Any) -> Arrays:
    numbers = {f"result.numbers.{name}": plain(repr(value)) for name, value in result.numbers.items()}
    names = ("point", "score", "points", "objectives", "scores", "kind")
    return {f"result.{name}": plain(getattr(result, name)) for name in names} | numbers


for name, given in SEARCHES.items():
    case(f"methods/{name}", *given, quick=True)(search)


@case("methods/names", quick=True)
def names() -> Arrays:
    """Every method of version 1.0 is there, with its defaults; settings that came later are left out."""
    from optim.search import METHODS, default_settings

    known = sorted({method for method, *_ in SEARCHES.values()})
    missing = sorted(set(known) - set(METHODS))
    found = {"missing": np.array(missing, str)}
    for name in set(known) - set(missing):
        defaults = {key: value for key, value in default_settings(name).items() if key not in LATER.get(name, ())}
        found[name] = plain(json.dumps(defaults, sort_keys=True))
    return found
