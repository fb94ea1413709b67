"""The interface of search methods, and their random numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation, Judging, Minibatch, Request, minibatches_of
from optim.problem import Wants as Wants
from optim.space import Space
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints, mean_of

MOST_POINTS = 100_000  # of a generation: more are an oversight, and may not fit into memory
LARGEST = 1e100  # of values and slopes: beyond it is failure, whose square would not be finite
Kept = Literal["climbers", "population", "front", "elites"]


@dataclass(frozen=True, eq=False)
class Grid:
    """The cells of a map of elites.

    Attributes:
        axes: lower and upper end of each descriptor by name.
        bins: cells along each.
        cells: number of the cell of each elite, shape (C,); the last descriptor varies fastest.
    """

    axes: Mapping[str, tuple[float, float]]
    bins: int
    cells: Ints

    @property
    def places(self) -> Ints:
        """The cell of each elite along each descriptor, shape (C, axes)."""
        return np.stack(np.unravel_index(self.cells, (self.bins,) * len(self.axes)), axis=1)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search has found so far.

    Attributes:
        point: the best point, shape (D,).
        score: its objective, of several their mean; NaN as long as every evaluation has failed.
        points: what the search keeps, shape (C, D): see ``kind``.
        objectives: of these, shape (C, K); NaN where every evaluation has failed.
        numbers: what else the log shall tell, by name, such as the size of a front; finite, or None.
        kind: what ``points`` are: the best point of each of the ``"climbers"``; a ``"population"``; a ``"front"``
            that holds only successes none of which dominates another; ``"elites"``, the best success in each cell
            of a grid. A front and elites are empty as long as every evaluation has failed.
        grid: of elites.
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
        """The objective of each point kept, of several their mean, shape (C,)."""
        return mean_of(self.objectives, axis=1)


class Method(Protocol):
    """A search method: ask for points, tell their judgement, and so on. By default it wants points only.

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

    @property
    def several_objectives(self) -> bool:
        """Whether it looks for a front of several objectives; else it takes a single one."""

    @property
    def wants(self) -> Wants:
        """The evaluation mode of the next points.

        ``"points"``: points of the space, for ``Problem.evaluate``. ``"relaxed"`` and ``"gradients"``: points of its
        relaxation, for ``RelaxableProblem.evaluate_relaxed`` without and with gradients. The result is always a true
        point.
        """
        return "points"

    @property
    def sharpness(self) -> float:
        """The sharpness with which relaxed points are evaluated, see ``RelaxableProblem.evaluate_relaxed``."""
        return 0.0

    @property
    def minibatch(self) -> Minibatch | None:
        """The few worlds, or draws, in which the next points are judged; None for all."""
        return None

    def ask(self) -> Floats:
        """The points to evaluate next, shape (N, D), inside the space, or its relaxation if ``wants`` says so."""

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Take in the judgement of the points asked for."""

    def result(self) -> SearchResult:
        """The best so far."""

    def state(self) -> Arrays:
        """Everything that changes, as arrays."""

    def restore(self, state: Arrays) -> None:
        """Take over what :meth:`state` returned."""


def next_request(method: Method) -> Request:
    """What a method wants evaluated next."""
    return Request(method.ask(), method.wants, method.sharpness, method.minibatch)


def check_fit(method: Method, problem: Judging) -> None:
    """Raise a one-line ValueError unless a problem can be judged as a method asks, before any work.

    Details are checked where a problem names those of every evaluation; only others take the evaluation of one point.
    """
    if getattr(method, "through_mixtures", False) and hasattr(problem, "check_mixtures"):
        problem.check_mixtures()
    if getattr(method, "along_true_gradients", False) and hasattr(problem, "check_true_gradients"):
        problem.check_true_gradients()
    if getattr(problem, "gradient_horizon", None) is not None and not getattr(method, "takes_gradients", False):
        raise ValueError("gradient_horizon: it is not allowed with a method that takes no gradients; leave it out")
    if (size := getattr(method, "minibatch_size", None)) is not None:
        minibatches_of(problem).check_minibatch(size)
    if hasattr(method, "check_details") and hasattr(problem, "detail_names"):
        point = problem.space.sample(generator(0), 1)  # the method itself is not asked: that may change it
        method.check_details(problem.detail_names, lambda: problem.evaluate(point).details)


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Random numbers of one stream, such as (generation, climber).

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
    """The scores of ``count`` points, shape (count,); a one-line ValueError if there are others."""
    if evaluation.objectives.shape != (count, 1):
        shape = evaluation.objectives.shape
        raise ValueError(f"evaluation: objectives of shape {shape} are not allowed; give ({count}, 1)")
    return evaluation.objectives[:, 0]


def slopes_per_range(evaluation: Evaluation, space: Space, count: int) -> Floats:
    """The gradients of ``count`` points [objective per range], shape (count, D); a one-line ValueError without."""
    shape = None if evaluation.gradients is None else evaluation.gradients.shape
    if evaluation.gradients is None or shape != (count, space.size):
        raise ValueError(f"evaluation: gradients of shape {shape} are not allowed; give {(count, space.size)}")
    with np.errstate(over="ignore"):
        return evaluation.gradients * space.span


def sound(values: Floats, slopes: Floats) -> Bools:
    """Which points, of values (N,) and slopes (N, D), failed in neither, shape (N,)."""
    return np.asarray((abs(values) < LARGEST) & (abs(slopes) < LARGEST).all(axis=1))


def below_all(scores: ArrayLike) -> Floats:
    """Scores in which a failure (NaN) is below every success."""
    return np.where(np.isnan(scores), -np.inf, scores)


def with_values(space: Space, points: Floats, start: Mapping[str, float] | None) -> Floats:
    """The points, shape (N, D), with the values of some variables, given by name as the setting ``start``.

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
