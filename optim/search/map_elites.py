"""MAP-Elites: a search for the best point in each cell of a grid over features of the points.

Sources: Mouret & Clune, Illuminating search spaces by mapping elites, arXiv:1504.04909, 2015, figure 2; Vassiliades &
Mouret, Discovering the elite hypervolume by leveraging interspecies correlation, GECCO 2018 (the line operator).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.base import number, table, whole
from optim.search.method import LARGEST, Grid, Kept
from optim.search.population import PopulationSearch
from optim.search.variation import mutation_steps
from taichi_sim.base.arrays import Floats, Ints

SPREAD, LINE = 0.01, 0.2  # sigma_1 and sigma_2 of the line operator (Vassiliades & Mouret 2018)
MOST_CELLS = 1_000_000


@dataclass(eq=False, kw_only=True)
class MapElites(PopulationSearch):
    """Search by MAP-Elites: a grid over descriptors of points, each of whose cells keeps its best point, the elite.

    Generation 0 evaluates N random points; afterwards each of N children comes from elites drawn uniformly. Values of
    a descriptor beyond its range count as those at the end of the range.

    Attributes:
        descriptors: what tells kinds of points apart: names of variables, or of details of their evaluation, of
            shape (N,), if ``ranges`` has them. The first two continuous variables or angles, if None.
        bins: number of cells along each descriptor.
        ranges: [low, high] of a descriptor by name; of a variable its bounds, if not given.
        variation: ``"gaussian"``: a child is an elite plus normal deviates of the variables' steps, reflected at
            the bounds, and of a variable without a step of a tenth of its range (whole numbers: at least 1/2).
            ``"line"``: an elite plus deviates of 1 % of the ranges (whole numbers: their steps) and a step along
            the line to another elite, of 20 % of its length.
        offset: score from which the QD score counts.
    """

    kind: ClassVar[Kept] = "elites"
    arrays: ClassVar[tuple[str, ...]] = ("cells", "elites", "elite_objectives")

    descriptors: Sequence[str] | None = None
    bins: int = whole(10, 1)
    ranges: Mapping[str, Sequence[float]] | None = table()
    variation: Literal["gaussian", "line"] = "gaussian"
    offset: float = number(0.0, -LARGEST, LARGEST)

    def __post_init__(self) -> None:
        super().__post_init__()
        space, ranges = self.space, self.ranges or {}
        self.axes = self._axes(ranges)
        for name in ranges:
            if name not in self.axes:
                raise ValueError(f"ranges: {name} is no descriptor; these are {', '.join(self.axes)}")
        if self.count > MOST_CELLS:
            raise ValueError(
                f"bins: {self.bins} is not allowed for {len(self.axes)} descriptors; give at most {MOST_CELLS} cells"
            )
        steps = mutation_steps(space)
        self.steps = np.where(space.integers & (space.step == 0), np.maximum(steps, 0.5), steps)
        self.spread = np.where(space.integers, self.steps, SPREAD * space.span)
        self.cells = np.empty(0, np.int64)
        self.elites, self.elite_objectives = np.empty((0, space.size)), np.empty((0, 1))

    @property
    def count(self) -> int:
        """Number of cells of the grid."""
        return int(self.bins ** len(self.axes))

    def _axes(self, ranges: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
        """Lower and upper end of each descriptor that is given, or else of those that the space suggests."""
        names = self.descriptors
        if names is None:
            names = [v.name for v in self.space.variables if not v.is_integer][:2]
        if not _is_list(names, str) or not names or len(set(names)) < len(names):
            raise ValueError(f"descriptors: {names!r} is not allowed; give a list of names that differ, at least one")
        return {name: self._range(name, ranges) for name in names}

    def _range(self, name: str, ranges: Mapping[str, Sequence[float]]) -> tuple[float, float]:
        """Lower and upper end of a descriptor."""
        if name in ranges:
            ends = ranges[name]
            if not _is_list(ends, float, int) or len(ends) != 2 or not -LARGEST <= ends[0] < ends[1] <= LARGEST:
                raise ValueError(f"ranges: {ends!r} of {name} is not allowed; give [low, high]")
            return float(ends[0]), float(ends[1])
        if name not in self.space.names:
            raise ValueError(
                f"descriptors: {name} is no variable ({self.space.listed}); give its [low, high] in ranges"
            )
        variable = self.space.variables[self.space.names.index(name)]
        return variable.low, variable.high

    def check_details(self, known: Collection[str], details_of_one: Callable[[], Mapping[str, object]]) -> None:
        """Refuse descriptors that are neither variables nor details of an evaluation.

        Args:
            known: names of details that every evaluation contains.
            details_of_one: function that returns the details of one evaluation by name; called only if some
                descriptor is not in ``known``.

        Raises:
            ValueError: for one that is neither a variable nor a detail.
        """
        asked = [name for name in self.axes if name not in self.space.names and name not in known]
        details = details_of_one() if asked else {}
        for name in asked:
            _check_detail(name, details)

    def ask(self) -> Floats:
        """Return the starting points, and later children of elites, shape (N, D)."""
        if self.generation == 0:
            return self._starts()
        rng = self._generator(1)
        if not len(self.elites):
            return self.space.sample(rng, self.population)
        shape = (self.population, self.space.size)
        parents, others = self.elites[rng.integers(len(self.elites), size=(2, self.population))]
        deviates = rng.standard_normal(shape)
        if self.variation == "gaussian":
            return self.space.reflect(self.space.round(parents + self.steps * deviates))
        along = LINE * rng.standard_normal((self.population, 1)) * self.space.offset(others, parents) * self.space.span
        return self.space.reflect(self.space.round(parents + self.spread * deviates + along))

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Let the best success of each cell, the earliest of equals, be its elite."""
        self.points, self.objectives = points.copy(), evaluation.objectives.copy()
        succeeded = ~np.isnan(evaluation.objectives[:, 0])
        cells = np.append(self.cells, self._cells(points, evaluation)[succeeded])
        everyone = np.concatenate([self.elites, points[succeeded]])
        objectives = np.concatenate([self.elite_objectives, evaluation.objectives[succeeded]])
        order = np.lexsort((-objectives[:, 0], cells))  # stable, so elites come before their equals
        self.cells, first = np.unique(cells[order], return_index=True)
        self.elites, self.elite_objectives = everyone[order[first]], objectives[order[first]]

    def _cells(self, points: Floats, evaluation: Evaluation) -> Ints:
        """Number of the cell of each point, shape (N,); the last descriptor varies fastest. Of failures 0."""
        numbers = np.zeros(len(points), np.int64)
        for name, (low, high) in self.axes.items():
            place = np.nan_to_num((self._descriptor(name, points, evaluation) - low) / (high - low))
            numbers = numbers * self.bins + np.clip(np.floor(place * self.bins), 0, self.bins - 1).astype(np.int64)
        return numbers

    def _descriptor(self, name: str, points: Floats, evaluation: Evaluation) -> Floats:
        """Values of one descriptor, shape (N,)."""
        if name in self.space.names:
            column = self.space.names.index(name)
            values, top = points[:, column], self.space.high[column]
            same = self.space.angles[column] & (values == top)  # the two ends of an angle are one direction
            return np.where(same, self.space.low[column], values)
        _check_detail(name, evaluation.details)
        details: NDArray[Any] = np.asarray(evaluation.details[name], float)
        if details.shape != (len(points),):
            raise ValueError(f"descriptors: {name} of shape {details.shape} is not allowed; give one number a point")
        return details

    def _grid(self) -> Grid:
        """The cells of the elites."""
        return Grid(dict(self.axes), self.bins, self.cells.copy())

    def _kept(self) -> tuple[Floats, Floats]:
        """The elites in the order of their cells."""
        return self.elites, self.elite_objectives

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Cells that have an elite, their share of all cells, and the sum of scores above the offset (QD score)."""
        with np.errstate(over="ignore"):
            total = float(np.maximum(self.elite_objectives[:, 0] - self.offset, 0).sum())
        score = total if np.isfinite(total) else None
        return {"cells": len(self.cells), "coverage": len(self.cells) / self.count, "qd_score": score}


def _check_detail(name: str, details: Mapping[str, object]) -> None:
    """Raise a one-line ValueError for a descriptor that is not among details."""
    if name not in details:
        raise ValueError(f"descriptors: {name} is no detail of the evaluation; it has {', '.join(details) or 'none'}")


def _is_list(value: object, *kinds: type) -> bool:
    """Whether a setting is a list of such values."""
    return isinstance(value, list | tuple) and all(type(item) in kinds for item in value)
