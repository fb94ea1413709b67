"""Batches of gaits, the conditions under which they are simulated, what comes out, and what their strokes cost."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import OK
from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS
from robots.inflatable.timing import gait_timeline, nominal_steps
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats, Indices

NEXT = 0.02  # body lengths/s: faster gaits on a ladder are tried on its next terrain
AHEAD = 1e-3  # body lengths/s: gaits that are faster get ahead; about every other gait that trembles is above zero


@dataclass(frozen=True)
class Condition:
    """Where and how gaits are simulated.

    Attributes:
        name: of the speed here in the details of evaluations.
        terrain: where.
        actuation: how the robot is driven.
        follows: name of the condition under which a gait has to get ahead to be simulated here.
        carries: whether one that does not counts here as it did there; else it counts nothing, a speed of 0.
        least: speed there that is getting ahead, if exceeded [body lengths/s].
    """

    name: str
    terrain: Terrain
    actuation: InflatableActuation
    follows: str | None = None
    carries: bool = True
    least: float = AHEAD

    def simulated(self, speeds: Mapping[str, Floats]) -> Bools:
        """Which gaits are simulated here, by their speeds under all conditions, shape (N,)."""
        return np.full(len(speeds[self.name]), True) if self.follows is None else speeds[self.follows] > self.least


@dataclass(frozen=True, eq=False)
class Batch:
    """Designs to be simulated by ``run``; with their points, shape (N, D), to be differentiated.

    ``relaxed`` says whether they are designs of relaxed points.
    """

    run: Callable[..., Any]
    designs: Sequence[Any]
    points: Floats | None = None
    sharpness: float = 0.0
    relaxed: bool = False

    def part(self, chosen: Indices) -> "Batch":
        """Some of them."""
        points = None if self.points is None else self.points[chosen]
        return dataclasses.replace(self, designs=[self.designs[i] for i in chosen], points=points)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Speeds, shape (N,), status, shape (N,), and slopes of speeds, shape (N, D) or None, of a simulation."""

    speeds: Floats
    status: NDArray[Any]
    slopes: Floats | None

    @property
    def nothing(self) -> "Outcome":
        """Speeds of 0 that nothing changes, and the same status."""
        slopes = None if self.slopes is None else np.zeros_like(self.slopes)
        return Outcome(np.zeros_like(self.speeds), self.status, slopes)

    def replaced(self, chosen: Indices, other: "Outcome | None") -> "Outcome":
        """The same with what another simulation said of some robots."""
        if other is None:
            return self
        speeds, status, slopes = self.speeds.copy(), self.status.copy(), self.slopes
        speeds[chosen], status[chosen] = other.speeds, other.status
        if slopes is not None and other.slopes is not None:
            slopes = slopes.copy()
            slopes[chosen] = other.slopes
        return Outcome(speeds, status, slopes)


def outcomes(
    conditions: Sequence[Condition], count: int, simulate: Callable[[int, Condition, Indices], Outcome]
) -> dict[str, Outcome]:
    """Of a batch of so many gaits under some conditions, one after the other, by their names.

    Args:
        conditions: those that others follow come first; the first follows none.
        count: N.
        simulate: some gaits, by their places, under the condition of that number.
    """
    found: dict[str, Outcome] = {}
    for number, condition in enumerate(conditions):
        before = found.get(condition.follows or "")
        if before is None:
            found[condition.name] = simulate(number, condition, np.arange(count))
            continue
        ahead = np.flatnonzero((before.speeds > condition.least) & (before.status == OK))
        again = simulate(number, condition, ahead) if ahead.size else None
        found[condition.name] = (before if condition.carries else before.nothing).replaced(ahead, again)
    return found


def capped(found: Mapping[str, Outcome], conditions: Sequence[Condition], most: float) -> dict[str, Outcome]:
    """The same with speeds of at most so much on all terrains but the last; those that are cut have no slope.

    On a ladder nobody gains by being faster on easy ground than is asked for there, but loses by sliding down the next
    slope.

    Args:
        found: what came out under the conditions, by their names.
        conditions: of the ladder, in order; the harder ones of the last terrain, if any, come last.
        most: [body lengths/s].
    """
    last = conditions[-1]
    spared = {last.name, last.follows if last.carries else None}  # what carries is the same terrain, harder
    result = dict(found)
    for condition in conditions:
        if condition.name in spared:
            continue
        outcome = found[condition.name]
        slopes = None if outcome.slopes is None else np.where((outcome.speeds < most)[:, None], outcome.slopes, 0.0)
        result[condition.name] = Outcome(np.minimum(outcome.speeds, most), outcome.status, slopes)
    return result


def effort(design: InflatableDesign, steps: int, actuation: InflatableActuation) -> tuple[float, Floats]:
    """How much the bladders are moved, and its derivative by what they are told in each column, shape (8, T).

    The effort is 1 where every bladder makes a full stroke in every column of a published gait: the mean over the
    bladders of their strokes, whole or in parts, in the time of 16 such columns.

    Args:
        design: the gait.
        steps: by which its speed is counted.
        actuation: how it is driven.
    """
    levels = gait_timeline(design, actuation).levels[:BLADDERS]
    strokes = np.diff(levels, axis=1, prepend=0.0)  # bladders begin empty
    unit = BLADDERS * PUBLISHED_COLUMNS * steps / nominal_steps(PUBLISHED_COLUMNS, actuation)
    way = np.sign(strokes)
    slope = way - np.append(way[:, 1:], np.zeros((BLADDERS, 1)), axis=1)
    columns = design.schedule.columns
    return float(np.abs(strokes).sum() / unit), slope.reshape(BLADDERS, -1, columns).sum(axis=1) / unit
