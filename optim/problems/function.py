"""Problems whose objectives a plain Python function computes, from a batch of points."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation, Objective, Problem
from optim.space import USUAL_STEP, Space, Variable
from taichi_sim.base.arrays import Floats, copied
from taichi_sim.base.variables import Kind

Function = Callable[[Floats], "ArrayLike | Evaluation"]
Bounds = Mapping[str, "tuple[float, float] | tuple[float, float, Kind]"]
FIELDS = ("name", "low", "high", "kind", "step")  # of a variable, as run folders keep them


class PlainProblem(Problem):
    """A problem whose space of variables and whose objectives are given explicitly."""

    def __init__(self, space: Space, objectives: Sequence[Objective]) -> None:
        """Keep them."""
        self._space, self._objectives = space, tuple(objectives)

    @property
    def space(self) -> Space:
        """Space of the D variables."""
        return self._space

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the K objectives."""
        return tuple(objective.name for objective in self._objectives)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Units of the K objectives."""
        return tuple(objective.unit for objective in self._objectives)

    def table(self) -> dict[str, Any]:
        """Variables and objectives as values that fit JSON and TOML."""
        return {
            "variables": [{field: getattr(v, field) for field in FIELDS} for v in self.space.variables],
            "objective_names": list(self.objective_names),
            "objective_units": list(self.objective_units),
        }


class FunctionProblem(PlainProblem):
    """The problem of maximising a Python function; made by :func:`problem_of`.

    Attributes:
        function: takes points, shape (N, D), and returns objectives.
        gradient: takes points, and returns the slopes of a single objective, shape (N, D); None if there is none.
    """

    def __init__(
        self, function: Function, space: Space, objectives: Sequence[Objective], gradient: Function | None
    ) -> None:
        super().__init__(space, objectives)
        self.function, self.gradient = function, gradient

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Evaluate points, shape (N, D), in one call of the function."""
        return self._judged(self.space.validate(np.atleast_2d(points)), gradients=False)

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Call the function, and the gradient if wanted, with binary variables between 0 and 1."""
        if sharpness == math.inf:  # of a finite one the function is told nothing
            points = self.space.round(points)
        if gradients and self.gradient is None:
            raise ValueError("gradient: the method needs one; give gradient=..., or choose another method")
        return self._judged(self.space.relaxed().validate(np.atleast_2d(points)), gradients)

    def _judged(self, points: Floats, gradients: bool) -> Evaluation:
        found = self.function(points.copy())
        evaluation = found if isinstance(found, Evaluation) else Evaluation(copied(found, "function"))
        shape = len(points), len(self.objective_names)
        if evaluation.objectives.shape != shape:
            raise ValueError(
                f"function: it gave objectives of shape {evaluation.objectives.shape} for {len(points)} points; "
                f"give {shape}, one column for each of {', '.join(self.objective_names)}"
            )
        if not gradients or self.gradient is None:
            return evaluation
        slopes = copied(self.gradient(points.copy()), "gradient")
        if slopes.shape != points.shape:
            raise ValueError(f"gradient: shape {slopes.shape} is not allowed; give {points.shape}")
        return Evaluation(evaluation.objectives, evaluation.status, evaluation.details, slopes)

    def describe(self) -> dict[str, Any]:
        """Variables and objectives, as JSON values; the function itself is described by its name alone."""
        return {
            "kind": "function",
            "name": getattr(self.function, "__qualname__", type(self.function).__name__),
            **self.table(),
        }


def problem_of(
    function: Function,
    bounds: Bounds | Space,
    name: str | Sequence[str] = "score",
    unit: str | Sequence[str] = "",
    gradient: Function | None = None,
) -> FunctionProblem:
    """Make a problem that maximises a Python function of a batch of points.

    Args:
        function: takes points, an array of shape (N, D) in the order of the bounds, and returns what is to be
            maximised: shape (N,), or (N, K) for K objectives, or an ``Evaluation``. NaN marks a point that failed.
        bounds: (low, high) of each variable by name, or (low, high, kind) for another kind than ``"continuous"``:
            ``"integer"``, ``"angle"`` or ``"binary"``. Or a ``Space``.
        name: what the objective is called; a list of K names for K objectives.
        unit: of the objective, such as ``"m/s"``; a list for several.
        gradient: takes points and returns the slopes of the single objective, shape (N, D), each in its own unit;
            for methods that follow gradients.

    Raises:
        ValueError: if bounds, names or units are not allowed.

    Example:
        >>> bowl = problem_of(lambda points: -((points - 0.5) ** 2).sum(axis=1), {"x": (0, 1), "y": (0, 1)})
        >>> float(bowl.evaluate([[0.5, 0.0]]).objectives[0, 0])
        -0.25
    """
    if not callable(function):
        raise ValueError(f"function: {function!r} is not allowed; give a function of points, shape (N, D)")
    names = (name,) if isinstance(name, str) else tuple(name)
    units = (unit,) * len(names) if isinstance(unit, str) else tuple(unit)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"name: {names!r} is not allowed; give names that differ, at least one")
    if len(units) != len(names):
        raise ValueError(f"unit: {len(units)} given for {len(names)} objectives; give one, or one for each")
    if gradient is not None and len(names) > 1:
        raise ValueError("gradient: not allowed with several objectives")
    if not isinstance(bounds, Space | Mapping):
        raise ValueError(f"bounds: {bounds!r} is not allowed; give (low, high) by name, such as {{'x': (0, 1)}}")
    space = bounds if isinstance(bounds, Space) else Space(tuple(_variable(*item) for item in bounds.items()))
    return FunctionProblem(function, space, [Objective(*each) for each in zip(names, units, strict=True)], gradient)


def _variable(name: str, bounds: Sequence[Any]) -> Variable:
    if not isinstance(bounds, Sequence) or isinstance(bounds, str) or len(bounds) not in (2, 3):
        raise ValueError(f"bounds: {bounds!r} of {name} is not allowed; give (low, high) or (low, high, kind)")
    low, high = float(bounds[0]), float(bounds[1])
    kind: Kind = bounds[2] if len(bounds) == 3 else "continuous"
    return Variable(name, low, high, kind, USUAL_STEP * (high - low))
