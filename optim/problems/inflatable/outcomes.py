"""The conditions under which gaits are simulated, what comes out, and what their strokes cost."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import OK
from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.robustness import HARD_FRICTION, harder
from robots.inflatable.schedule import BLADDERS
from robots.inflatable.timing import gait_timeline, nominal_steps
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats, Indices

NEXT = 0.02  # body lengths/s: faster gaits on a ladder are tried on its next terrain
HARD = "_hard"  # how details end that are of the harder conditions
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
        least_friction: smallest friction here of sliding feet that have their own; the terrain says that of others.
    """

    name: str
    terrain: Terrain
    actuation: InflatableActuation
    follows: str | None = None
    carries: bool = True
    least: float = AHEAD
    least_friction: float = 0.0

    def simulated(self, speeds: Mapping[str, Floats]) -> Bools:
        """Which gaits are simulated here, by their speeds under all conditions, shape (N,)."""
        return np.full(len(speeds[self.name]), True) if self.follows is None else speeds[self.follows] > self.least


def hardened(usual: Condition) -> Condition:
    """The harder conditions beside usual ones, under which gaits are tried that get ahead there."""
    terrain, actuation = harder(usual.terrain, usual.actuation)
    return Condition(usual.name + HARD, terrain, actuation, usual.name, least_friction=HARD_FRICTION)


# Simulates some gaits, by their places, under the condition of a number: speeds, status and slopes.
Simulate = Callable[[int, Indices], tuple[Floats, NDArray[Any], Floats]]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What N gaits did under K conditions.

    Attributes:
        conditions: those that others follow come first; the first follows none.
        speeds: [body lengths/s], shape (K, N).
        status: shape (K, N).
        slopes: of the speeds by the D variables, shape (K, N, D); D is 0 if nobody asked for them.
    """

    conditions: Sequence[Condition]
    speeds: Floats
    status: NDArray[Any]
    slopes: Floats

    @classmethod
    def simulated(cls, conditions: Sequence[Condition], count: int, variables: int, simulate: Simulate) -> "Outcomes":
        """Simulate ``count`` gaits under each condition in turn, those that get so far."""
        names = [condition.name for condition in conditions]
        speeds, slopes = np.zeros((len(names), count)), np.zeros((len(names), count, variables))
        status = np.full((len(names), count), OK, dtype=object)
        for number, condition in enumerate(conditions):
            chosen = np.arange(count)
            if condition.follows is not None:
                before = names.index(condition.follows)
                status[number] = status[before]
                if condition.carries:
                    speeds[number], slopes[number] = speeds[before], slopes[before]
                chosen = np.flatnonzero((speeds[before] > condition.least) & (status[before] == OK))
            if chosen.size:
                speeds[number, chosen], status[number, chosen], slopes[number, chosen] = simulate(number, chosen)
        return cls(conditions, speeds, status, slopes)

    def capped(self, most: float) -> "Outcomes":
        """Cap the speeds on all terrains but the last; those that are cut have no slope.

        On a ladder nobody gains by being faster on easy ground than is asked for there, but loses by sliding down the
        next slope.

        Args:
            most: the highest speed that counts there [body lengths/s].
        """
        last = self.conditions[-1]
        spared = {last.name, last.follows if last.carries else None}  # what carries is the same terrain, harder
        easy = np.array([condition.name not in spared for condition in self.conditions])[:, None]
        cut = easy & ~(self.speeds < most)
        speeds = np.where(easy, np.minimum(self.speeds, most), self.speeds)
        return Outcomes(self.conditions, speeds, self.status, np.where(cut[..., None], 0.0, self.slopes))


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
