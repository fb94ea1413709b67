"""What is to be designed: a space of points and a judgement of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.space import Space
from taichi_sim.base.arrays import Bools, Floats

OK = "ok"
FAILED = "failed"
GAIT, WALKER, VEHICLE, ROBOT = "gait", "walker", "vehicle", "robot"  # kinds of problems, as descriptions name them


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The judgement of N points. A failure is data, never a number that could win.

    Attributes:
        objectives: values to be maximised, shape (N, K), float64; NaN in the row of a point that failed. May
            be given as shape (N,) for a single objective. Infinite values count as failures.
        status: shape (N,), text: ``"ok"``, or why the point failed.
        details: more about each point, by name, each of shape (N, ...); finite where it did not fail.
        gradients: d objective / d variable of a single objective, each in its own unit, shape (N, D); NaN in
            the row of a point that failed. None where nobody asked for them.
    """

    objectives: Floats
    status: NDArray[np.str_] | Sequence[str] = ()
    details: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    gradients: Floats | None = None

    def __post_init__(self) -> None:
        objectives = np.array(self.objectives, float)
        if objectives.ndim == 1:
            objectives = objectives[:, None]
        if objectives.ndim != 2:
            raise ValueError(f"objectives: shape {objectives.shape} is not allowed; give (points, objectives)")
        for name, values in {"status": self.status, **self.details}.items():
            if len(values) not in ((0, len(objectives)) if name == "status" else (len(objectives),)):
                raise ValueError(f"{name}: {len(values)} given for {len(objectives)} points; give one for each")
        status = np.array(self.status if len(self.status) else [OK] * len(objectives), dtype=object)
        status[(status == OK) & ~np.isfinite(objectives).all(axis=1)] = FAILED
        objectives[status != OK] = np.nan
        object.__setattr__(self, "objectives", objectives)
        object.__setattr__(self, "status", status.astype(str))
        if self.gradients is not None:
            gradients = np.array(self.gradients, float)
            if objectives.shape[1] != 1 or gradients.ndim != 2 or len(gradients) != len(objectives):
                raise ValueError(
                    f"gradients: shape {gradients.shape} is not allowed; give (points, variables) of one objective"
                )
            gradients[status != OK] = np.nan
            object.__setattr__(self, "gradients", gradients)

    @property
    def failed(self) -> Bools:
        """Which points failed, shape (N,)."""
        return np.asarray(self.status) != OK


class Problem(Protocol):
    """What a search needs to know of the thing designed."""

    @property
    def space(self) -> Space:
        """What may be changed."""

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the K objectives, all maximised."""

    def describe(self) -> dict[str, Any]:
        """What is needed to build the problem again; fits JSON and TOML."""

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Judge points, shape (N, D). A point's judgement must not depend on the others."""

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the design of one point, shape (D,), to a file, the same bytes for the same point."""


def check_kind(description: Mapping[str, Any], kind: str) -> None:
    """Raise a one-line ValueError if a description says that it is of another kind of problem; gaits' say nothing."""
    found = description.get("kind", GAIT)
    if found != kind:
        raise ValueError(f"problem: it is a {found}, but a {kind} is needed here")


@runtime_checkable
class RelaxableProblem(Problem, Protocol):
    """A problem that can also be judged between the values of its binary variables, and differentiated there."""

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points of ``space.relaxed()``, shape (N, D).

        Args:
            points: binary variables may have any value from 0 to 1; a point without such a value between is
                judged as :meth:`evaluate` judges it, but for what the problem says it does otherwise.
            sharpness: how strongly the problem pushes those values towards 0 and 1 before it judges them; 0
                leaves them as they are.
            gradients: whether ``Evaluation.gradients`` is wanted, with respect to ``points``; zero by integers,
                which stay whole.
        """
