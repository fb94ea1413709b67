"""Kinds of gaits among many: the best of each, so that what is not yet the fastest is not lost.

Source: Pétrowski, "A clearing procedure as a niching method for genetic algorithms", Proc. ICEC 1996.
"""

from collections.abc import Sequence

import numpy as np

from robots.inflatable.cores import each_pressure
from robots.inflatable.gaits import GaitDesign, as_graded
from robots.inflatable.robot import InflatableGeometry
from taichi_sim.base.arrays import Floats

APART = 0.25  # of a full stroke, root mean square over all actuators and columns: gaits closer are one kind
PRESSURE = 12_000.0  # [Pa], which counts as a full stroke of everything


def difference(one: GaitDesign, other: GaitDesign, body: InflatableGeometry) -> float:
    """How far two gaits of as many columns lie apart, 0 to 1, wherever their cycles begin.

    Headings and times do not count: what moves when is the kind.

    Args:
        one, other: the gaits.
        body: of the robot, whose cores' pressures count too: the larger of both differences is the result.
    """
    first, second = (_levels(design) for design in (one, other))
    turned = [np.roll(second, column, axis=1) for column in range(second.shape[1])]
    moves = min(float(np.sqrt(np.mean((first - levels) ** 2))) for levels in turned)
    pressures = [np.array(each_pressure(design.pressure, body)) for design in (one, other)]
    return max(moves, float(abs(pressures[0] - pressures[1]).max()) / PRESSURE)


def best_of_kinds(designs: Sequence[GaitDesign], scores: Floats, count: int, body: InflatableGeometry) -> list[int]:
    """Indices of the best designs of which none is of the kind of a better one, the best first.

    Args:
        designs: N of them.
        scores: shape (N,); what failed, NaN, is none.
        count: how many, at most.
        body: of the robot.
    """
    chosen: list[int] = []
    for number in (int(n) for n in np.argsort(-scores, kind="stable") if np.isfinite(scores[n])):
        if len(chosen) == count:
            break
        if all(difference(designs[number], designs[other], body) >= APART for other in chosen):
            chosen.append(number)
    return chosen


def _levels(design: GaitDesign) -> Floats:
    """What a gait tells its actuators in every column, shape (10, T)."""
    schedule = as_graded(design).schedule
    return np.concatenate([schedule.inflation, schedule.grip])
