"""The interface of search methods, and their random numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation, Evaluator, Minibatch, Request, minibatches_of, relaxation_of
from optim.problem import Wants as Wants
from optim.space import Space
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints, mean_of
from taichi_sim.base.foreign import method_of, returned

MOST_POINTS = 100_000  # of a generation: more are an oversight, and may not fit into memory
LARGEST = 1e100  # of values and slopes: beyond it is failure, whose square would not be finite
Kept = Literal["climbers", "population", "front", "elites"]


@dataclass(frozen=True, eq=False)
class Grid:
    """Grid of a map of elites: its descriptors, and the cell of each elite.

    Attributes:
        axes: lower and upper end of each descriptor by name.
        bins: number of cells along each descriptor.
        cells: number of the cell of each elite, shape (C,); the last descriptor varies fastest.
    """

    axes: Mapping[str, tuple[float, float]]
    bins: int
    cells: Ints

    @property
    def places(self) -> Ints:
        """Index of each elite's cell along each descriptor, shape (C, axes)."""
        return np.stack(np.unravel_index(self.cells, (self.bins,) * len(self.axes)), axis=1)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search so far: its best point, and the points that it keeps.

    Attributes:
        point: the best point, shape (D,); one of the first points as long as every evaluation has failed.
        score: objective of the best point, or the mean of several; NaN as long as every evaluation has failed.
        points: points that the search keeps, shape (C, D), see ``kind``.
        objectives: objectives of these points, shape (C, K); NaN where every evaluation has failed.
        numbers: what else the log shall tell, by name, such as the size of a front; finite, or None.
        kind: what ``points`` are: the best point of each of the ``"climbers"``; a ``"population"``; a ``"front"``
            that holds only successes none of which dominates another; ``"elites"``, the best success in each cell
            of a grid. A front and elites are empty as long as every evaluation has failed.
        grid: grid of the elites; None for other kinds.
    """

    point: Floats
    score: float
    points: Floats
    objectives: Floats
    numbers: Mapping[str, float | int | None] = field(default_factory=dict)
    kind: Kept = "climbers"
    grid: Grid | None = None

    @property
    def scores(self) -> Floats:
        """Objective of each point that the search keeps, or the mean of several objectives, shape (C,)."""
        return mean_of(self.objectives, axis=1)


class Method(Protocol):
    """Interface of search methods: ask for points, evaluate them, tell the method the evaluation, and repeat.

    ``ask`` changes nothing and may be repeated. ``state`` is all that ``restore`` needs to continue exactly,
    in a method built with the same settings.

    Example:
        >>> for _ in range(generations + 1):
        ...     points = method.ask()
        ...     method.tell(points, problem.evaluate(points))  # if all it wants is points
    """

    through_mixtures: bool = False  # whether it asks for what lies between true points, as a relaxation has it
    along_true_gradients: bool = False  # whether it asks for gradients of true points only
    takes_gradients: bool = False  # whether it asks for gradients at all
    independent_climbers: bool = False  # whether its climbers share nothing, so that each is a sample for statistics

    @property
    def several_objectives(self) -> bool:
        """Whether the method searches for a front of several objectives; otherwise it takes a single one."""

    @property
    def wants(self) -> Wants:
        """How the next points are to be evaluated: ``"points"`` (the default), ``"relaxed"`` or ``"gradients"``.

        ``"points"``: points of the space, for ``Problem.evaluate``. ``"relaxed"`` and ``"gradients"``: points of its
        relaxation, for ``RelaxableProblem.evaluate_relaxed`` without and with gradients. The result is always a true
        point.
        """
        return "points"

    @property
    def sharpness(self) -> float:
        """Sharpness with which relaxed points are to be evaluated, see ``RelaxableProblem.evaluate_relaxed``."""
        return 0.0

    @property
    def minibatch(self) -> Minibatch | None:
        """The few worlds or draws in which the next points are to be evaluated; None for all."""
        return None

    def ask(self) -> Floats:
        """Return the points to evaluate next, shape (N, D), in the space, or in its relaxation if ``wants`` says so."""

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Learn from the evaluation of the points that :meth:`ask` returned, shape (N, D)."""

    def result(self) -> SearchResult:
        """Return the best point and the points kept so far."""

    def state(self) -> Arrays:
        """Return everything that changes during the search, as arrays by name."""

    def restore(self, state: Arrays) -> None:
        """Continue the search from what :meth:`state` returned."""


def next_request(method: Method) -> Request:
    """Collect what a method wants evaluated next: points, mode, sharpness and minibatch.

    Raises:
        ValueError: if its points are no array.
    """
    points = returned(method.ask(), np.ndarray, f"method: {method_of(method, 'ask')}", "an array of shape (N, D)")
    return Request(points, method.wants, method.sharpness, method.minibatch)


def check_fit(method: Method, problem: Evaluator) -> None:
    """Raise a one-line ValueError, before any work, unless a problem can be evaluated as a method wants.

    Details are checked where a problem names those of every evaluation; only others take the evaluation of one point.
    """
    if getattr(method, "through_mixtures", False) and hasattr(problem, "check_mixtures"):
        problem.check_mixtures()
    if getattr(method, "along_true_gradients", False) and hasattr(problem, "check_true_gradients"):
        problem.check_true_gradients()
    takes_gradients = getattr(method, "takes_gradients", False)
    if takes_gradients:
        relaxation_of(problem)
        # Gradients that are estimated from values alone need none of the problem's own.
        if getattr(method, "exact", True) and hasattr(problem, "check_gradients"):
            problem.check_gradients()
    if getattr(problem, "gradient_horizon", None) is not None and not takes_gradients:
        raise ValueError("gradient_horizon: it is not allowed with a method that takes no gradients; leave it out")
    if (size := getattr(method, "minibatch_size", None)) is not None:
        minibatches_of(problem).check_minibatch(size)
    if hasattr(method, "check_details") and hasattr(problem, "detail_names"):
        point = problem.space.sample(generator(0), 1)  # the method itself is not asked: that may change it
        method.check_details(problem.detail_names, lambda: problem.evaluate(point).details)


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Make a random number generator for one independent stream, such as (generation, climber).

    Streams are independent, and start anew wherever they are needed: no state of a generator has to be kept
    for an exact resume, and what one climber draws does not depend on how many there are.
    """
    return np.random.default_rng((seed, *stream))


def check_slopes(space: Space) -> None:
    """Raise a one-line ValueError if no variable has a gradient."""
    if space.relaxed().integers.all():
        raise ValueError(f"{space.names[0]}: an integer has no gradient, nor has any other; choose another method")


def refuse_integers(space: Space) -> None:
    """Raise a one-line ValueError if a variable is an integer that is not binary."""
    for variable in space.variables:
        if variable.kind == "integer":
            raise ValueError(f"{variable.name}: an integer has no gradient; leave it to another method")


def single_objective(evaluation: Evaluation, count: int) -> Floats:
    """Return the single objective of ``count`` points, shape (count,).

    Raises:
        ValueError: for several objectives, or another number of points.
    """
    if evaluation.objectives.shape != (count, 1):
        shape = evaluation.objectives.shape
        raise ValueError(f"evaluation: objectives of shape {shape} are not allowed; give ({count}, 1)")
    return evaluation.objectives[:, 0]


def slopes_per_range(evaluation: Evaluation, space: Space, count: int) -> Floats:
    """Return the gradients of ``count`` points [objective per range of the variable], shape (count, D).

    Raises:
        ValueError: if the evaluation has no gradients of this shape.
    """
    shape = None if evaluation.gradients is None else evaluation.gradients.shape
    if evaluation.gradients is None or shape != (count, space.size):
        raise ValueError(f"evaluation: gradients of shape {shape} are not allowed; give {(count, space.size)}")
    with np.errstate(over="ignore"):
        return evaluation.gradients * space.span


def sound(values: Floats, slopes: Floats) -> Bools:
    """Mask of the points whose values, shape (N,), and slopes, shape (N, D), did not fail, shape (N,)."""
    return np.asarray((abs(values) < LARGEST) & (abs(slopes) < LARGEST).all(axis=1))


def below_all(scores: ArrayLike) -> Floats:
    """Replace failures (NaN) among scores by minus infinity, below every success."""
    return np.where(np.isnan(scores), -np.inf, scores)


def with_values(space: Space, points: Floats, start: Mapping[str, float] | None) -> Floats:
    """Copy points, shape (N, D), with some variables set to given values by name, as in the setting ``start``.

    Raises:
        ValueError: if a name is no variable, or a value is not allowed there.
    """
    values = start or {}
    space.check_names("start", values)
    points = points.copy()
    for name, value in values.items():
        number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        if not number or not abs(value) <= LARGEST:
            raise ValueError(f"start: {value!r} of {name} is not allowed; give a number")
        points[:, space.names.index(name)] = value
    return space.validate(points)
