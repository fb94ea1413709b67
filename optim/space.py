"""What a search may change: named variables with bounds, and vectors of their values."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Bools, Floats, copied, fixed
from taichi_sim.base.variables import Variable

__all__ = ["Space", "Variable"]

USUAL_STEP = 0.1  # of a range: standard deviation of a mutation of a variable that names none
LISTED, SHOWN = 100, 8  # variables that a message names in full; of more the first few


@dataclass(frozen=True)
class Space:
    """A search space: D variables in order, so that points are float64 arrays of shape (..., D).

    Raises:
        ValueError: for no variables, or two of the same name.

    Example:
        >>> space = Space((Variable("x", 0.0, 1.0), Variable("n", 0, 8, "integer")))
        >>> space.reflect([1.25, -1.0])
        array([0.75, 1.  ])
        >>> space.to_dict(space.round([0.75, 2.6]))
        {'x': 0.75, 'n': 3}
    """

    variables: tuple[Variable, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "variables", tuple(self.variables))
        if not self.variables:
            raise ValueError("variables: a space needs at least one")
        repeated = {name for name, count in Counter(self.names).items() if count > 1}
        if repeated:
            raise ValueError(f"variables: {', '.join(sorted(repeated))} given more than once; names must differ")

    @classmethod
    def of_parameters(cls, parameters: Iterable[Variable]) -> "Space":
        """Make the space of a robot's free parameters, with a usual mutation step for those that give none.

        The usual step is a tenth of the range, but at least 0.5 for whole numbers, which would hardly change otherwise.
        """
        return cls(tuple(each if each.step else replace(each, step=_usual_step(each)) for each in parameters))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies, and processes that are given a space, compute its arrays anew, which stay fixed so."""
        return type(self), (self.variables,)

    @property
    def size(self) -> int:
        """Number D of variables."""
        return len(self.variables)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables, in the order of the coordinates."""
        return tuple(variable.name for variable in self.variables)

    @property
    def listed(self) -> str:
        """Names of the variables as text for a message of one line."""
        return _listed(self.names)

    @cached_property
    def low(self) -> Floats:
        """Lower bounds of the variables, shape (D,)."""
        return fixed(np.array([variable.low for variable in self.variables], float))

    @cached_property
    def high(self) -> Floats:
        """Upper bounds of the variables, shape (D,)."""
        return fixed(np.array([variable.high for variable in self.variables], float))

    @cached_property
    def step(self) -> Floats:
        """Standard deviation of a mutation of each variable, shape (D,)."""
        return fixed(np.array([variable.step for variable in self.variables], float))

    @cached_property
    def span(self) -> Floats:
        """Range of each variable, upper minus lower bound, shape (D,)."""
        return fixed(self.high - self.low)

    @cached_property
    def angles(self) -> Bools:
        """Mask of the variables that are angles, which wrap round at their bounds, shape (D,)."""
        return fixed(np.array([variable.kind == "angle" for variable in self.variables]))

    @cached_property
    def integers(self) -> Bools:
        """Mask of the variables that take only whole numbers (integer or binary), shape (D,)."""
        return fixed(np.array([variable.is_integer for variable in self.variables]))

    @cached_property
    def mixes(self) -> bool:
        """Whether relaxed points are mixtures of designs, which a search should sharpen into single designs."""
        return any(variable.kind == "binary" or variable.mixes for variable in self.variables)

    def relaxed(self) -> "Space":
        """A copy of the space in which binary variables are continuous from 0 to 1; integers stay whole."""
        return self._relaxed

    @cached_property
    def _relaxed(self) -> "Space":
        binary_freed = (replace(v, kind="continuous") if v.kind == "binary" else v for v in self.variables)
        return Space(tuple(binary_freed))

    def reflect(self, points: ArrayLike) -> Floats:
        """Bring points into the bounds: folded back at a bound as by a mirror, angles wrapped round.

        Points inside stay exactly what they are.
        """
        points = np.asarray(points, float)
        beyond = np.mod(points - self.low, np.where(self.angles, self.span, 2 * self.span))
        folded = self.low + np.where(self.angles, beyond, np.minimum(beyond, 2 * self.span - beyond))
        return np.where(self.contains(points), points, self.clip(folded))  # clip: the sum above is rounded

    def clip(self, points: ArrayLike) -> Floats:
        """Bring points into the bounds: each coordinate to the nearest value allowed."""
        return np.clip(np.asarray(points, float), self.low, self.high)

    def bound(self, points: ArrayLike) -> Floats:
        """Bring points into the bounds: each coordinate to the nearest value allowed, angles wrapped round."""
        return np.where(self.angles, self.reflect(points), self.clip(points))

    def offset(self, points: ArrayLike, origin: ArrayLike) -> Floats:
        """Return ``points - origin`` as fractions of the ranges, shape (..., D); angles the shorter way round."""
        offset = (np.asarray(points, float) - np.asarray(origin, float)) / self.span
        return np.where(self.angles, offset - np.rint(offset), offset)

    def round(self, points: ArrayLike) -> Floats:
        """Round integer and binary variables to the nearest whole number, and leave the rest unchanged."""
        points = np.asarray(points, float)
        return np.where(self.integers, np.rint(points), points)

    def contains(self, points: ArrayLike) -> Bools:
        """Whether each coordinate lies within its bounds, shape (..., D); NaN does not."""
        points = np.asarray(points, float)
        return (points >= self.low) & (points <= self.high)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw random points uniformly, shape (count, D); all values of an integer variable are equally likely."""
        unit = rng.random((count, self.size))
        whole = np.floor(self.low + unit * (self.high - self.low + 1))
        return self.clip(np.where(self.integers, whole, self.low + unit * (self.high - self.low)))

    def validate(self, points: ArrayLike) -> Floats:
        """Check that points, shape (..., D), lie in this space, and return them as a new float64 array.

        Raises:
            ValueError: if one is not; it names the first variable at fault.
        """
        points = copied(points, "points")
        if points.ndim == 0 or points.shape[-1] != self.size:
            raise ValueError(
                f"points: shape {points.shape} is not allowed; the last axis must be {self.size} variables"
            )
        wrong = ~self.contains(points) | (self.round(points) != points)
        if wrong.any():
            index = tuple(np.argwhere(wrong)[0])
            variable = self.variables[index[-1]]
            raise ValueError(f"{variable.name}: {points[index]:g} is not allowed; give {variable.allowed}")
        return points

    def to_dict(self, point: ArrayLike) -> dict[str, float | int]:
        """Convert one point, shape (D,), to values by name; whole numbers become int.

        Raises:
            ValueError: if it is no point of this space.
        """
        values = self.validate(point).tolist()
        return {v.name: int(x) if v.is_integer else x for v, x in zip(self.variables, values, strict=True)}

    def from_dict(self, values: Mapping[str, Any]) -> Floats:
        """Convert values by name to a point, shape (D,).

        Raises:
            ValueError: if a name is unknown or missing, or a value is not allowed.
        """
        self.check_names("values", values)
        missing = [name for name in self.names if name not in values]
        if missing:
            raise ValueError(f"values: {_listed(missing)} missing")
        return self.validate([float(values[name]) for name in self.names])

    def check_names(self, field: str, values: Mapping[str, Any]) -> None:
        """Raise a ValueError that starts with ``field`` if a key is not a variable of this space."""
        unknown = [name for name in values if name not in self.names]
        if unknown:
            raise ValueError(f"{field}: {_listed(unknown)} not free to change; the variables are {self.listed}")


def _listed(names: Sequence[str]) -> str:
    """Names for a message of one line: of many the first ones and how many more there are."""
    shown = names if len(names) <= LISTED else names[:SHOWN]
    return ", ".join(shown) + (f" and {len(names) - len(shown)} more" if len(shown) < len(names) else "")


def _usual_step(variable: Variable) -> float:
    step = USUAL_STEP * (variable.high - variable.low)
    return max(step, 0.5) if variable.is_integer else step
