"""Co-optimisation that is also asked to be homeostatic, once it solves everything.

Source: dissertation, chapter 6, which proposes the similarity of sensor signals between environments as an objective.
Controllers that never see the light have the most similar signals of all; so similarity counts only among those that
solve all environments, and any of these is better in it than all others.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation
from optim.problems.braitenberg import VehicleProblem
from optim.space import Space
from optim.studies.chapter4.sensor_homeostasis import decimation, distances_of
from taichi_sim.base import checks

UNSOLVED = -1.0  # below every similarity


@dataclass(frozen=True, eq=False)
class HomeostasisProblem:
    """The objectives of a vehicle problem, and one more: homeostasis.

    It is -d / (1 + d), between -1 and 0, of the mean warping distance d of light signals [1/m^2] that are decimated
    to ``samples``, for points that solve all environments, else -1.
    """

    vehicle: VehicleProblem  # the problem without it, with an objective for each environment
    samples: int = 1000  # of a trace, at most, beside the start

    def __post_init__(self) -> None:
        checks.integer("samples", self.samples, 1)

    @property
    def space(self) -> Space:
        """The space of the vehicle."""
        return self.vehicle.space

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Judge points; details as of the vehicle."""
        judged, points = self.vehicle.evaluate(points), np.atleast_2d(np.asarray(points, float))
        solved = np.asarray(~judged.failed & (judged.details["solved"] == len(self.vehicle.task.starts)))
        distance = distances_of(self.vehicle, points, solved, decimation(self.vehicle.task, self.samples))["raw"]
        homeostasis = np.nan_to_num(-distance / (1 + distance), nan=UNSOLVED)
        return replace(judged, objectives=np.column_stack([judged.objectives, homeostasis]))

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points as :meth:`evaluate` does, as nothing is binary; raises ValueError if asked for gradients."""
        if gradients:
            raise ValueError("gradients: not allowed with several objectives; ask for points")
        return self.evaluate(points)
