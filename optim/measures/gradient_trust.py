"""Check up to which step size an exact gradient can be trusted.

Contact makes the objective of a long rollout piecewise smooth: the exact gradient is the slope between two jumps, but
the steps of a search cross many jumps. Therefore the exact slopes along random directions are compared with central
differences over a range of step sizes, and with the gradient of the objective smoothed by a normal distribution,
which averages over the jumps.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from optim.problem import RelaxableProblem
from taichi_sim.base.arrays import Floats

STEPS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2, 0.1)  # in ranges of the variables
TRUSTED, AGREES = 0.01, 0.9  # relative error of a slope, and cosine of two gradients, that count as agreement


@dataclass(frozen=True, eq=False)
class Horizon:
    """Slopes of one problem at one point, along D random directions [objective per range of the variables].

    Attributes:
        name: name of the problem.
        value: value of the objective.
        exact: slopes from the exact gradient, shape (D,).
        differences: central differences for every step size, shape (S, D); NaN where an evaluation failed.
        smoothed: slopes of the objective smoothed by normal deviates along these directions, shape (D,).
        smoothed_error: standard errors of the smoothed slopes, shape (D,).
    """

    name: str
    value: float
    exact: Floats
    differences: Floats
    smoothed: Floats
    smoothed_error: Floats

    @property
    def errors(self) -> Floats:
        """Relative error |difference - exact| / |exact| over all directions, for every step size, shape (S,)."""
        return np.asarray(np.linalg.norm(self.differences - self.exact, axis=1) / np.linalg.norm(self.exact))

    @property
    def exact_cosines(self) -> Floats:
        """Cosine between the exact gradient and the differences, for every step size, shape (S,)."""
        return np.array([cosine(self.exact, d) for d in self.differences])

    @property
    def smoothed_cosines(self) -> Floats:
        """Cosine between the smoothed gradient and the differences, for every step size, shape (S,)."""
        return np.array([cosine(self.smoothed, d) for d in self.differences])


@dataclass(frozen=True, eq=False)
class GradientReport:
    """Result of the check of several horizons.

    Attributes:
        steps: step sizes of the differences [ranges of the variables], shape (S,).
        smoothing: standard deviation of the smoothed gradient [ranges].
        horizons: one for each problem.
    """

    steps: Floats
    smoothing: float
    horizons: tuple[Horizon, ...]

    def verdict(self, horizon: Horizon) -> str:
        """Describe in words at which step sizes each gradient can be relied on."""
        good = {
            f"exact within {TRUSTED:.0%}": horizon.errors <= TRUSTED,
            "its direction": horizon.exact_cosines >= AGREES,
            "that of the smoothed": horizon.smoothed_cosines >= AGREES,
        }
        return "; ".join(
            f"{name} at {', '.join(f'{s:g}' for s in self.steps[mask]) or 'no step'}" for name, mask in good.items()
        )

    def text(self) -> str:
        """Format a table of the exact gradient's error and the cosines of both gradients for every step size."""
        lines = [f"{'horizon':<14}{'step':>8}{'error':>10}{'cosine':>9}{'smoothed':>10}"]
        for horizon in self.horizons:
            rows = zip(self.steps, horizon.errors, horizon.exact_cosines, horizon.smoothed_cosines, strict=True)
            for number, (step, error, exact, smooth) in enumerate(rows):
                name = horizon.name if number == 0 else ""
                lines.append(f"{name:<14}{step:>8.0e}{error:>10.1e}{exact:>9.3f}{smooth:>10.3f}")
            lines.append(f"{'':<14}{self.verdict(horizon)}")
        return "\n".join(lines)

    def document(self) -> dict[str, Any]:
        """Return all numbers as a dictionary for JSON, with None for NaN."""
        horizons = []
        for horizon in self.horizons:
            more = {name: getattr(horizon, name) for name in ("errors", "exact_cosines", "smoothed_cosines")}
            horizons.append({**_plain(asdict(horizon) | more), "verdict": self.verdict(horizon)})
        return {"steps": self.steps.tolist(), "smoothing": self.smoothing, "horizons": horizons}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    def number(x: Any) -> Any:
        return [number(y) for y in x] if isinstance(x, list) else x if np.isfinite(x) else None

    return {k: v if isinstance(v, str) else number(np.asarray(v).tolist()) for k, v in values.items()}


def cosine(a: Floats, b: Floats) -> float:
    """Cosine of the angle between two vectors; NaN if one is zero or not finite."""
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0 else np.nan


def check_gradient(
    problems: Mapping[str, tuple[RelaxableProblem, Floats]],
    *,
    steps: tuple[float, ...] = STEPS,
    directions: int = 6,
    smoothing: float = 0.05,
    samples: int = 48,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> GradientReport:
    """Check the gradients of problems, such as one robot over longer and longer horizons.

    Args:
        problems: by name, a problem and a point of its relaxed space, farther from the bounds than the largest step.
        steps: step sizes of the differences along unit vectors [ranges of the variables].
        directions: D, the number of random directions; they are orthonormal in ranges of the variables.
        smoothing: standard deviation of the smoothing along each direction [ranges].
        samples: number of antithetic pairs that estimate the smoothed gradient.
        seed: seed of directions and deviates.
        progress: called with the fraction done.

    Raises:
        ValueError: if a point is too near a bound, or its evaluation fails.
    """
    horizons = []
    for number, (name, (problem, point)) in enumerate(problems.items()):
        horizons.append(_check(name, problem, point, steps, directions, smoothing, samples, seed))
        if progress:
            progress((number + 1) / len(problems))
    return GradientReport(np.array(steps), smoothing, tuple(horizons))


def _check(
    name: str,
    problem: RelaxableProblem,
    point: Floats,
    steps: tuple[float, ...],
    directions: int,
    smoothing: float,
    samples: int,
    seed: int,
) -> Horizon:
    space, rng = problem.space.relaxed(), np.random.default_rng(seed)
    count = min(directions, space.size)
    basis = np.linalg.qr(rng.standard_normal((space.size, count)))[0].T
    sizes = np.array(steps)
    moves = [sign * size * basis for size in sizes for sign in (1, -1)]
    deviates = rng.standard_normal((samples, count))
    moves += [sign * smoothing * deviates @ basis for sign in (1, -1)]
    points = space.bound(point + np.concatenate(moves) * space.span)
    if (points[: 2 * len(sizes) * count] != (point + np.concatenate(moves[: 2 * len(sizes)]) * space.span)).any():
        raise ValueError(f"point: nearer to a bound of {name} than the largest step, {sizes.max():g} ranges")
    here = problem.evaluate_relaxed(point[None], 0.0, gradients=True)
    if here.failed[0] or here.gradients is None:
        raise ValueError(f"{name}: the evaluation of the point ended as {str(here.status[0])!r}; it has no gradient")
    values = problem.evaluate_relaxed(points, 0.0, gradients=False).objectives[:, 0]
    pairs = values[: 2 * len(sizes) * count].reshape(len(sizes), 2, count)
    rises = (values[-2 * samples : -samples] - values[-samples:])[:, None] * deviates / (2 * smoothing)
    rises = rises[np.isfinite(rises).all(axis=1)]
    return Horizon(
        name=name,
        value=float(here.objectives[0, 0]),
        exact=basis @ (here.gradients[0] * space.span),
        differences=(pairs[:, 0] - pairs[:, 1]) / (2 * sizes[:, None]),
        smoothed=rises.mean(axis=0),
        smoothed_error=rises.std(axis=0, ddof=1) / np.sqrt(len(rises)),
    )
