"""What is to be designed: a space of points and an evaluation of each, and what a search may ask of it."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.space import Space
from taichi_sim.base.arrays import Bools, Floats, Ints, copied
from taichi_sim.base.files import write_text
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.short_text import counted, decimal

OK = "ok"
FAILED = "failed"
GAIT, WALKER, VEHICLE, ROBOT, FILE = (
    "gait",
    "walker",
    "vehicle",
    "robot",
    "file",
)  # kinds of problems, as descriptions name them
DESIGN = "design"  # in the description of a file's problem, if that designs a robot: its own description, as JSON
ORDERS = 1_000_003  # stream of random numbers that no generation of a search has: of the orders of minibatches
Wants = Literal["points", "relaxed", "gradients"]  # what a search method wants evaluated


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Objectives of N points that were evaluated; points that failed have a status and NaN, so that they never win.

    Attributes:
        objectives: values to be maximised, shape (N, K), float64; NaN in the row of a point that failed. May
            be given as shape (N,) for a single objective. Infinite values count as failures.
        status: shape (N,), text: ``"ok"``, or why the point failed.
        details: more about each point, by name, each of shape (N, ...): numbers or text. Logs tell what is not finite
            as null.
        gradients: derivatives of a single objective by the D variables, in the objective's unit per unit of each
            variable, shape (N, D); NaN in the row of a point that failed. None if not asked for.

    Raises:
        ValueError: for arrays of other shapes, details that are neither numbers nor text, or gradients of several
            objectives.
    """

    objectives: Floats
    status: NDArray[np.str_] | Sequence[str] = ()
    details: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    gradients: Floats | None = None

    def __post_init__(self) -> None:
        objectives = copied(self.objectives, "objectives")
        if objectives.ndim == 1:
            objectives = objectives[:, None]
        if objectives.ndim != 2:
            raise ValueError(f"objectives: shape {objectives.shape} is not allowed; give (points, objectives)")
        details = {name: _detail(name, values) for name, values in dict(self.details).items()}
        for name, values in {"status": self.status, **details}.items():
            if len(values) not in ((0, len(objectives)) if name == "status" else (len(objectives),)):
                raise ValueError(f"{name}: {len(values)} given for {len(objectives)} points; give one for each")
        status = np.array(self.status if len(self.status) else [OK] * len(objectives), dtype=object)
        status[(status == OK) & ~np.isfinite(objectives).all(axis=1)] = FAILED
        objectives[status != OK] = np.nan
        object.__setattr__(self, "objectives", objectives)
        object.__setattr__(self, "status", status.astype(str))
        object.__setattr__(self, "details", details)
        if self.gradients is not None:
            gradients = copied(self.gradients, "gradients")
            if objectives.shape[1] != 1 or gradients.ndim != 2 or len(gradients) != len(objectives):
                raise ValueError(
                    f"gradients: shape {gradients.shape} is not allowed; give (points, variables) of one objective"
                )
            gradients[status != OK] = np.nan
            object.__setattr__(self, "gradients", gradients)

    @property
    def failed(self) -> Bools:
        """Mask of the points that failed, shape (N,)."""
        return np.asarray(self.status) != OK


def _detail(name: object, values: ArrayLike) -> NDArray[Any]:
    """A detail as an array of numbers or text that a log and the files of workers can hold; refuse any other."""
    if not isinstance(name, str):
        raise ValueError(f"details: the name {name!r} is not allowed; give text")
    try:
        found = np.asarray(values)
        found = np.array(found.tolist()) if found.dtype == object else found  # such as texts from a table
    except ValueError:
        raise ValueError(f"details: {name} has rows of different lengths; give equal ones") from None
    if found.dtype.kind not in "biufU":
        raise ValueError(f"details: {name} is of type {found.dtype}, which is not allowed; give numbers or text")
    if not found.ndim:
        raise ValueError(f"details: {name} is a single value; give one for each point")
    return found.astype(float) if found.dtype == np.longdouble else found


@dataclass(frozen=True)
class Objective:
    """Name and unit of an objective.

    Attributes:
        name: such as ``speed``.
        unit: such as ``m/s``; empty for a plain number.
    """

    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """Name and unit for an axis or a table, such as ``speed [m/s]``."""
        return self.name.replace("_", " ") + (f" [{self.unit}]" if self.unit else "")

    def value(self, number: float | None) -> str:
        """A value with its unit, such as ``0.1234 m/s``; ``none`` for None."""
        return "none" if number is None else f"{decimal(number)} {self.unit}".rstrip()


class Problem(Protocol):
    """A problem for a search: variables that may change, and an evaluation of points that gives their objectives.

    A class that derives from this one needs ``space`` and ``evaluate`` only; :func:`optim.problem_of` makes a problem
    of a function.
    """

    @property
    def space(self) -> Space:
        """Space of the D variables that may change."""

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the K objectives, all maximised."""
        return ("objective",)

    @property
    def objective_units(self) -> tuple[str, ...]:
        """Units of the K objectives, such as ``"m/s"``; empty for plain numbers."""
        return ("",) * len(self.objective_names)

    def describe(self) -> dict[str, Any]:
        """Describe everything that results depend on, as values that fit JSON and TOML, for run folders to keep."""
        return {"kind": type(self).__name__}

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Evaluate points, shape (N, D). The result of one point must not depend on the others."""

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of one point, shape (D,), to a file: always the same bytes for the same point."""
        write_text(path, json.dumps(self.space.to_dict(point), indent=1) + "\n")


@runtime_checkable
class RelaxableProblem(Problem, Protocol):
    """A problem that can also be evaluated between the values of its binary variables, and differentiated there."""

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Evaluate points of ``space.relaxed()``, shape (N, D).

        Args:
            points: binary variables may have any value from 0 to 1. A point whose binary variables are all 0 or 1
                is evaluated as by :meth:`evaluate`, unless the problem says otherwise.
            sharpness: how strongly the problem pushes those values towards 0 and 1 before it evaluates them; 0
                leaves them as they are; infinite, points are rounded and evaluated as by :meth:`evaluate`.
            gradients: whether to compute ``Evaluation.gradients``, with respect to ``points``; integers stay whole
                and have gradient zero.
        """


@dataclass(frozen=True)
class Minibatch:
    """A few of the worlds, or draws, in which a problem evaluates points: the next ones of an order shuffled by a seed.

    Attributes:
        size: how many.
        number: of the minibatch, from 0. Those of one shuffled order follow each other; then all are shuffled anew.
        seed: of the orders.
    """

    size: int
    number: int = 0
    seed: int = 0

    def of(self, count: int) -> Ints:
        """Numbers of those that belong to it, ascending, out of ``count``: all if there are no more than its size."""
        if count <= self.size:
            return np.arange(count)
        order, part = divmod(self.number, -(-count // self.size))
        shuffled = np.random.default_rng((self.seed, ORDERS, order)).permutation(count)
        first = min(part * self.size, count - self.size)  # the last of an order is full, too
        return np.sort(shuffled[first : first + self.size])


class MinibatchProblem(Problem, Protocol):
    """A problem that evaluates points in several worlds, or draws, and can do so in a few of them."""

    def check_minibatch(self, size: int) -> None:
        """Raise a one-line ValueError if minibatches of this size are not allowed, before any work."""

    def in_minibatch(self, minibatch: Minibatch) -> "Evaluator":
        """The problem in these worlds or draws only; a mean over worlds or draws is, on average, the objective."""


@dataclass(frozen=True, eq=False)
class Request:
    """Points to evaluate, shape (N, D), and how.

    Attributes:
        points: to evaluate.
        wants: as in ``Method``.
        sharpness: of a relaxation.
        minibatch: where they are evaluated; None is everywhere.
    """

    points: Floats
    wants: Wants = "points"
    sharpness: float = 0.0
    minibatch: Minibatch | None = None

    def part(self, begin: int, end: int) -> "Request":
        """Request for the points from ``begin`` up to ``end``."""
        return replace(self, points=self.points[begin:end])


Evaluate = Callable[[Request], Evaluation]


class Evaluator(Protocol):
    """The part of a ``Problem`` that evaluates points; it may have ``evaluate_relaxed``, too."""

    @property
    def space(self) -> Space:
        """The variables that may change."""

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Evaluate points, shape (N, D)."""


def relaxation_of(problem: Evaluator, wanted: str = "gradients") -> Callable[..., Evaluation]:
    """The function by which a problem evaluates relaxed points.

    Raises:
        ValueError: if it has none; ``wanted`` is for what it was needed.
    """
    found: Callable[..., Evaluation] | None = getattr(problem, "evaluate_relaxed", None)
    if found is None:
        raise ValueError(
            f"method: it wants {wanted}, but {type(problem).__name__} has no relaxation; choose another method"
        )
    return found


def evaluate_request(problem: Evaluator, request: Request) -> Evaluation:
    """Evaluate a request in this process; the problem gets points of its own, which it may change.

    Raises:
        ValueError: if the problem has no relaxation, or no minibatches, but one is wanted, or gives no evaluation of
            these points.
    """
    if request.minibatch is not None:
        problem = minibatches_of(problem).in_minibatch(request.minibatch)
    if request.wants == "points":
        return _checked(problem, problem.evaluate(request.points.copy()), len(request.points))
    relaxed = relaxation_of(problem, request.wants)
    found = relaxed(request.points.copy(), request.sharpness, request.wants == "gradients")
    return _checked(problem, found, len(request.points))


judge = evaluate_request  # its name up to 2.0


def _checked(problem: Evaluator, found: object, count: int) -> Evaluation:
    """Return what a problem, which may be a user's own, gave for so many points.

    Raises:
        ValueError: if it is no evaluation of so many points.
    """
    if not isinstance(found, Evaluation):
        raise ValueError(f"evaluate: it gave {type(found).__name__}, which is not allowed; give an optim.Evaluation")
    names = getattr(problem, "objective_names", None) or ("",) * found.objectives.shape[1]
    if found.objectives.shape != (count, len(names)):
        raise ValueError(
            f"evaluate: it gave objectives of shape {found.objectives.shape} for {counted(count, 'point')}; "
            f"give {(count, len(names))}"
        )
    return found


def has_minibatches(problem: object) -> bool:
    """Whether a problem can evaluate points in minibatches."""
    return hasattr(problem, "in_minibatch") and hasattr(problem, "check_minibatch")


def minibatches_of(problem: Evaluator) -> MinibatchProblem:
    """The problem, which has minibatches.

    Raises:
        ValueError: if it has none.
    """
    if has_minibatches(problem):
        return cast(MinibatchProblem, problem)
    raise ValueError(
        f"minibatch_size: {type(problem).__name__} judges in all worlds at once, and cannot in a few of them; leave it "
        "out, or choose another method"
    )


def objectives_of(problem: Problem) -> tuple[Objective, ...]:
    """Names and units of a problem's objectives; without units if it names none."""
    names = tuple(problem.objective_names)
    units = getattr(problem, "objective_units", None) or ("",) * len(names)
    return tuple(Objective(name, unit) for name, unit in zip(names, units, strict=True))


def score_of(objectives: Sequence[Objective]) -> Objective:
    """What a search calls the score: the objective, or the mean of several, with their unit if they share one."""
    if len(objectives) == 1:
        return objectives[0]
    units = {objective.unit for objective in objectives}
    return Objective("mean objective", units.pop() if len(units) == 1 else "")


def check_kind(description: Mapping[str, Any], kind: str) -> None:
    """Raise a one-line ValueError if a description is of another kind of problem; those of gaits name no kind."""
    found = description.get("kind", GAIT)
    if found != kind:
        raise ValueError(f"problem: it is a {found}, but a {kind} is needed here")


def design_in(description: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the description of the problem of a robot that a file's problem keeps; None if it keeps none.

    Raises:
        ValueError: if it is damaged.
    """
    if DESIGN not in description:
        return None
    try:
        found = parse_json(description[DESIGN])
    except (ValueError, TypeError):
        found = None
    if not isinstance(found, dict):
        raise ValueError(f"problem: its {DESIGN} is damaged, no JSON object")
    return found
