"""Walkers whose columns are variables: legs and back of a body, with or without its controller."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from optim.studies.beyond.body_and_learning.bodies import ACROSS, ALONG, LONGEST, THICKEST, WORLDS, walker_of
from robots.lattice_robot import LatticeRobot
from robots.robot import INVALID, Measure, Outcome, Parameter, Robot, Trial, World
from taichi_sim.base.arrays import Floats

COLUMNS = ALONG * ACROSS
BODY = (
    *(Parameter(f"leg_{n + 1}", 0, LONGEST, "integer", 0.1 * LONGEST) for n in range(COLUMNS)),
    *(Parameter(f"back_{n + 1}", 1, THICKEST, "integer", 0.1 * (THICKEST - 1)) for n in range(COLUMNS)),
)
GENES = len(BODY)


def stands(genes: ArrayLike) -> bool:
    """Whether a body, shape (12,), has legs, of which two or more are the longest."""
    legs = np.asarray(genes)[:COLUMNS]
    return bool(legs.max() > 0 and (legs == legs.max()).sum() >= 2)


@cache
def _body(genes: tuple[int, ...], cycles: int) -> LatticeRobot:
    legs, back = np.array(genes).reshape(2, ALONG, ACROSS)
    return walker_of(legs, back, cycles, f"walker {code(genes)}")


def body_of(genes: ArrayLike, cycles: int) -> LatticeRobot:
    """The walker of genes, shape (12,), whose controller is free."""
    return _body(tuple(np.asarray(genes).astype(int).tolist()), cycles)


def code(genes: ArrayLike) -> str:
    """Genes as digits: lengths of legs, then thickness of the back."""
    return "".join(str(int(gene)) for gene in np.asarray(genes))


def drawn_body(rng: np.random.Generator) -> Floats:
    """Random genes of a walker that stands, shape (12,)."""
    low, high = np.array([(gene.low, gene.high) for gene in BODY]).astype(int).T
    while True:
        genes = rng.integers(low, high + 1).astype(float)
        if stands(genes):
            return genes


@dataclass(frozen=True)
class EvolvableWalker(Robot):
    """A walker of which body and controller are free together; gradients are those by the controller.

    Attributes:
        cycles: of a trial.
    """

    cycles: int

    kind = "lattice"
    worlds = WORLDS
    differentiable = True
    relaxable = True  # at true bodies alone, where whole numbers have no gradient

    @property
    def name(self) -> str:
        """Its name for people."""
        return "walker"

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The body, then its controller."""
        return (*BODY, *body_of([1] * GENES, self.cycles).parameters)

    @property
    def measures(self) -> tuple[Measure, ...]:  # type: ignore[override]
        """The measures of the walker, a lattice robot."""
        return body_of([1] * GENES, self.cycles).measures

    def measures_in(self, worlds: Sequence[World]) -> tuple[Measure, ...]:
        """The measures of the walker, a lattice robot, in all of some worlds."""
        return body_of([1] * GENES, self.cycles).measures_in(worlds)

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Try every body with its controllers."""
        bodies, which = np.unique(points[:, :GENES], axis=0, return_inverse=True)
        found: list[tuple[np.ndarray, Outcome]] = []
        wrong = np.array([not stands(genes) for genes in bodies])[which]
        for number, genes in enumerate(bodies):
            rows = np.flatnonzero(which == number)
            if stands(genes):
                part = replace(trial, sharpness=np.inf, progress=None)
                found.append((rows, body_of(genes, self.cycles).run(points[rows, GENES:], part)))
        return self._joined(points, trial, found, wrong)

    def _joined(
        self, points: Floats, trial: Trial, found: list[tuple[np.ndarray, Outcome]], wrong: np.ndarray
    ) -> Outcome:
        """One outcome of those of several bodies; bodies that do not stand are invalid."""
        count = len(points)
        names = [measure.name for measure in self.measures_in((trial.world,))]
        measures = {name: np.full(count, np.nan) for name in names}
        gradients = {name: np.full(points.shape, np.nan) for name in trial.gradients}
        status, reason = np.full(count, INVALID, object), np.where(wrong, "body: it has no two longest legs", "")
        for rows, outcome in found:
            status[rows] = outcome.status
            for name, values in measures.items():
                values[rows] = outcome.measures[name]
            for name, slopes in gradients.items():
                slopes[np.ix_(rows, np.arange(GENES))] = 0.0
                slopes[rows, GENES:] = outcome.gradients[name]
        return Outcome(measures, status, reason, gradients=gradients)

    def design(self, point: ArrayLike) -> Robot:
        """The walker of a point, with nothing free."""
        (given,) = self.points(point)
        return body_of(given[:GENES], self.cycles).design(given[GENES:])

    def describe(self) -> dict[str, object]:
        """All that results depend on, as JSON values."""
        return {
            "evolvable": json.loads(json.dumps(body_of([1] * GENES, self.cycles).describe())),
            "cycles": self.cycles,
        }
