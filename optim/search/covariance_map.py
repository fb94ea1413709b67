"""Covariance-matrix adaptation that fills a map of elites, by the emitters and archives of pyribs.

Sources: Fontaine, Togelius, Nikolaidis & Hoover, Covariance matrix adaptation for the rapid illumination of behavior
space, GECCO 2020 (CMA-ME); Fontaine & Nikolaidis, Covariance matrix adaptation MAP-annealing, GECCO 2023 (CMA-MAE);
Tjanaka et al., pyribs: a bare-bones Python library for quality diversity optimization, GECCO 2023.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.base import hidden, number, positive, whole
from optim.search.map_elites import MapElites
from optim.search.method import LARGEST, generator
from optim.search.unit_cube import into_cube, out_of_cube
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.foreign import needing


@dataclass(eq=False, kw_only=True)
class CovarianceMapElites(MapElites):
    """Search by CMA-ME: MAP-Elites whose children come from normal distributions that adapt to what improves the map.

    Generation 0 is that of MAP-Elites. As soon as something has succeeded, emitters begin at the best elites; each
    adapts its distribution to those of its points that entered the map or improved a cell, and begins anew at a random
    elite when none does. Distributions are in the unit cube; what they put outside is set to the bounds, and whole
    numbers are rounded. A failure ranks below every point that failed to enter the map.
    The state is all that emitters were told: restoring tells them again, which is exact.

    Attributes:
        emitters: number of distributions, which share the population as evenly as possible, at least two points each.
        step: first standard deviation of each distribution [ranges].
    """

    arrays: ClassVar[tuple[str, ...]] = ("first_elites", "first_scores", "first_places", "told_scores", "told_places")
    variation: Literal["gaussian", "line"] = hidden("gaussian")

    emitters: int = whole(4, 1)
    step: float = positive(0.2, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        with needing("method", "pyribs", "qd"):
            import ribs  # noqa: F401
        axes = len(self.axes)
        self.first_elites, self.first_scores = np.empty((0, self.space.size)), np.empty(0)
        self.first_places = np.empty((0, axes))
        self.told_scores, self.told_places = np.empty((0, self.population)), np.empty((0, self.population, axes))
        self._guides: _Guides | None = None

    def ask(self) -> Floats:
        """Return random points until one has succeeded, and then points that the emitters draw, shape (N, D)."""
        if self._guides is None:
            return super().ask()
        return out_of_cube(self.space, self._guides.drawn, self._middle)

    @property
    def _middle(self) -> Floats:
        """The point in the middle of the unit cube, shape (D,)."""
        return (self.space.low + self.space.high) / 2

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Fill the map, and tell emitters."""
        super()._take(points, evaluation)
        scores, places = evaluation.objectives[:, 0], self._places(points, evaluation)
        if self._guides is not None:
            self.told_scores = np.concatenate([self.told_scores, scores[None]])
            self.told_places = np.concatenate([self.told_places, places[None]])
            self._guides.tell(scores, places)
        elif len(self.elites):
            fine = ~np.isnan(scores)
            self.first_elites, self.first_scores, self.first_places = points[fine], scores[fine], places[fine]
            self._guides = self._begin()

    def _places(self, points: Floats, evaluation: Evaluation) -> Floats:
        """Descriptors as shares of their ranges, shape (N, axes); those of failures do not count."""
        ends = self.axes.items()
        columns = [(self._descriptor(name, points, evaluation) - low) / (high - low) for name, (low, high) in ends]
        return np.clip(np.nan_to_num(np.stack(columns, axis=1)), 0.0, 1.0)

    def _begin(self) -> "_Guides":
        """Emitters at the best of the first successes."""
        unit = into_cube(self.space, self.first_elites, self._middle)
        order = np.argsort(-self.first_scores, kind="stable")
        origins = unit[np.resize(order, min(self.emitters, max(1, self.population // 2)))]
        guides = _Guides(self, origins, len(self.axes))
        guides.add(unit, self.first_scores, self.first_places)
        return guides

    def archive_settings(self) -> dict[str, float]:
        """pyribs' settings of the archive that guides emitters: how it accepts points."""
        return {}

    @property
    def ranker(self) -> str:
        """pyribs' name of the ranking by which emitters order points."""
        return "2imp"

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from :meth:`state`, by telling the emitters again all that they were told."""
        super().restore(state)
        self._guides = None
        if len(self.first_elites):
            self._guides = self._begin()
            for scores, places in zip(self.told_scores, self.told_places, strict=True):
                self._guides.tell(scores, places)


@dataclass(eq=False, kw_only=True)
class AnnealedMapElites(CovarianceMapElites):
    """Search by CMA-MAE: CMA-ME whose cells demand higher and higher scores of new points.

    A cell's threshold rises by a share of what a point exceeds it, so emitters stay where points are good before they
    move on to new cells; the map that is kept has the best of each cell all the same.

    Attributes:
        learning_rate: share by which thresholds rise, 0 to 1; at 1 emitters act as in CMA-ME, at 0 they only seek the
            best point.
        lowest: first threshold of every cell; points with a lower score do not guide emitters.
    """

    learning_rate: float = number(0.01, 0, 1)
    lowest: float = number(0.0, -LARGEST, LARGEST)

    def archive_settings(self) -> dict[str, float]:
        """pyribs' settings of the archive that guides emitters: how it accepts points."""
        return {"learning_rate": self.learning_rate, "threshold_min": self.lowest}

    @property
    def ranker(self) -> str:
        """pyribs' name of the ranking by which emitters order points."""
        return "imp"


class _Guides:
    """Emitters of pyribs and the archive that they share, in the unit cube."""

    def __init__(self, search: CovarianceMapElites, origins: Floats, axes: int) -> None:
        """Begin at origins, shape (E, D)."""
        from ribs.archives import GridArchive
        from ribs.emitters import EvolutionStrategyEmitter

        settings: dict[str, Any] = dict(search.archive_settings())
        seeds = generator(search.seed, 3).integers(2**31, size=len(origins) + 1).tolist()
        self.shares = np.array_split(np.arange(search.population), len(origins))
        self.archive: Any = GridArchive(
            solution_dim=search.space.size,
            dims=[search.bins] * axes,
            ranges=[(0.0, 1.0)] * axes,
            seed=seeds[0],
            **settings,
        )
        self.emitters: list[Any] = [
            EvolutionStrategyEmitter(
                self.archive,
                x0=origin,
                sigma0=search.step,
                ranker=search.ranker,
                batch_size=len(rows),
                seed=seed,
            )
            for origin, rows, seed in zip(origins, self.shares, seeds[1:], strict=True)
        ]
        self.drawn: Floats = np.empty((0, search.space.size))

    def add(self, unit: Floats, scores: Floats, places: Floats) -> None:
        """Put first successes into the archive, and let emitters draw."""
        self.archive.add(unit, scores, places)
        self._draw()

    def _draw(self) -> None:
        """Let emitters draw once a generation, as drawing changes them."""
        self.drawn = np.concatenate([np.asarray(emitter.ask(), float) for emitter in self.emitters])

    def tell(self, scores: Floats, places: Floats) -> None:
        """Tell emitters what came of the points that they drew; NaN for failures."""
        fine = ~np.isnan(scores)
        if fine.any():
            added: Arrays = self.archive.add(self.drawn[fine], scores[fine], places[fine])
            worst = float(np.min(added["value"])) - 1.0
            told = {name: np.full(len(scores), 0 if name == "status" else worst) for name in added}
            for name, values in added.items():
                told[name] = told[name].astype(values.dtype)
                told[name][fine] = values
            given = np.where(fine, scores, scores[fine].min())
            for emitter, rows in zip(self.emitters, self.shares, strict=True):
                if self.archive.empty:
                    break  # as long as nothing is good enough for the map there is nothing to learn from
                emitter.tell(self.drawn[rows], given[rows], places[rows], {name: told[name][rows] for name in told})
        self._draw()
