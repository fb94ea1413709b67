"""What every search method offers, and where its random numbers come from."""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.space import Vector

Wants = Literal["points", "relaxed", "gradients"]


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best that a search has found so far.

    Attributes:
        point: the best point, shape (D,).
        score: its score; NaN as long as every evaluation has failed.
        points: the best point of each climber, shape (C, D).
        scores: their scores, shape (C,); NaN where every evaluation has failed.
    """

    point: Vector
    score: float
    points: Vector
    scores: Vector


class Method(Protocol):
    """A search method: ask for points, tell their judgement, and so on.

    ``ask`` changes nothing and may be repeated. ``state`` is all that ``restore`` needs to continue exactly,
    in a method built with the same settings.

    Example:
        >>> for _ in range(generations + 1):
        ...     points = method.ask()
        ...     method.tell(points, problem.evaluate(points))  # if all it wants is points
    """

    @property
    def wants(self) -> Wants:
        """How the points asked for next shall be judged.

        ``"points"`` are those of the space. ``"relaxed"`` and ``"gradients"`` are those of its relaxation, for
        ``RelaxableProblem.evaluate_relaxed`` without and with gradients; only true points are ever the result.
        """

    @property
    def sharpness(self) -> float:
        """With which relaxed points shall be judged."""

    def ask(self) -> Vector:
        """The points to evaluate next, shape (N, D), inside the space, or its relaxation if ``wants`` says so."""

    def tell(self, points: Vector, evaluation: Evaluation) -> None:
        """Take in the judgement of the points asked for."""

    def result(self) -> SearchResult:
        """The best so far."""

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that changes, as arrays."""

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Take over what :meth:`state` returned."""


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Random numbers of one stream, such as (generation, climber).

    Streams are independent, and start anew wherever they are needed: no state of a generator has to be kept
    for an exact resume, and what one climber draws does not depend on how many there are.
    """
    return np.random.default_rng((seed, *stream))
