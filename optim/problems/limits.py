"""Limits that designs should keep: bounds on measures, which cost score where they are broken.

A limit is written ``NAME >= NUMBER`` or ``NAME <= NUMBER``, or with a weight, ``WEIGHT*NAME >= NUMBER``. Every
objective loses ``LOSS`` times the weight for all of the bound that is missing, a tenth of it for a tenth, and nothing
where the limit is kept. So the best of designs that keep it is the best of all, if only the weight is large enough, and
searches, which rank designs or follow gradients, are led to it from outside (an exact penalty: Nocedal & Wright,
Numerical Optimization, 2006, section 17.2).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optim.problem import Objective
from optim.problems.objectives import RobotObjective
from robots.robot import Measure, Outcome, World
from robots.tasks import Success
from taichi_sim.base.arrays import Floats
from taichi_sim.base.short_text import shortest

LOSS = 10.0  # of score, for all of a bound that is missing
LOST = "lost_to_limits"  # a detail of points: by how much limits lower their scores, in the draw where it is most


@dataclass(frozen=True)
class Limit:
    """A bound on a measure that a design should keep in every world.

    Attributes:
        bound: measure, sign and number.
        weight: factor of the score lost to a shortfall, above 0.
    """

    bound: Success
    weight: float = 1.0

    @classmethod
    def of(cls, text: str) -> "Limit":
        """Parse a limit from text.

        Raises:
            ValueError: for what is no limit, and a weight that is not allowed.
        """
        weight, star, rest = text.rpartition("*")
        try:
            found = cls(Success.parse(rest), float(weight) if star else 1.0)
        except ValueError:
            found = None
        if found is None or not 0 < found.weight < math.inf:
            raise ValueError(
                f"objective: {text!r} is not allowed; a limit is MEASURE >= NUMBER or MEASURE <= NUMBER, or such with "
                "a finite weight above 0 before it, as in 2*MEASURE >= NUMBER"
            )
        return found

    @property
    def text(self) -> str:
        """The limit as text, always the same for the same limit."""
        return ("" if self.weight == 1 else f"{shortest(self.weight)}*") + self.bound.text

    @property
    def loss(self) -> float:
        """Score lost when a measure misses the whole bound."""
        return LOSS * self.weight


@dataclass(frozen=True)
class Missing(RobotObjective):
    """The shortfall of designs from a bound, as a fraction of the bound: 0 where it is kept.

    Attributes:
        bound: whose measure this is about; parts of a bound of 0 are units of the measure.
    """

    bound: Success

    def objective(self, measure: Measure) -> Objective:
        """Name and unit of the shortfall: the name of the bound, and no unit."""
        return Objective(self.bound.text)

    def score(self, outcome: Outcome, measure: Measure) -> Floats:
        """Compute the shortfall of each design as a fraction of the bound, shape (N,)."""
        return np.maximum(self._per_unit * (outcome.measures[measure.name] - self.bound.bound), 0.0)

    def slopes(self, outcome: Outcome, measure: Measure) -> Floats:
        """Compute derivatives of the shortfall, shape (N, P): 0 where the bound is kept."""
        slopes = self._per_unit * super().slopes(outcome, measure)
        return np.where(self.score(outcome, measure)[:, None] > 0, slopes, 0.0)

    @property
    def _per_unit(self) -> float:
        """Parts that are missing for each unit of the measure."""
        size = abs(self.bound.bound) or 1.0
        return (-1.0 if self.bound.sign == ">=" else 1.0) / size


def broken_limits(
    bounds: Sequence[Success], details: Mapping[str, float], worlds: Sequence[World], draws: int
) -> list[str]:
    """List the limits that a point breaks by its details, such as ``mass <= 0.1: 0.12``, world by world.

    Args:
        bounds: that shall be kept.
        details: of the point, means over draws, if something is uncertain; limits that hold for these may be broken in
            some draws.
        worlds: where the point was tried; of several, details end with their names.
        draws: how many there were.
    """
    if not details.get(LOST, 0.0) > 0:
        return []
    ends = [("", "")] if len(worlds) == 1 else [(f"_{world.name}", f" on {world.name}") for world in worlds]
    found = [
        f"{bound.text}: {details[bound.measure + end]:.6g}{place}"
        for bound in bounds
        for end, place in ends
        if not bound.allows(details[bound.measure + end])
    ]
    return found or [f"{' and '.join(bound.text for bound in bounds)}: not in all of {draws} draws"]
