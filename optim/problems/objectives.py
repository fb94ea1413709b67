"""What a search of a robot maximises: how trials in several worlds become one objective, or several.

A package adds an objective by an entry point in the group ``morpholab.objectives``: a subclass of
:class:`RobotObjective`, which usually defines its name, its unit and :meth:`RobotObjective.score`.
"""

from collections.abc import Sequence

import numpy as np

from optim.problem import Objective
from robots.robot import Measure, Outcome, World
from taichi_sim.base.arrays import Floats
from taichi_sim.base.registry import Registry


class RobotObjective:
    """The mean over the worlds of a score, which is a measure of the robot unless a subclass says otherwise."""

    def objective(self, measure: Measure) -> Objective:
        """Name and unit of the score, of a robot and in one world."""
        return Objective(measure.name, measure.unit)

    def score(self, outcome: Outcome, measure: Measure) -> Floats:
        """The score of each point in one world, shape (N,); NaN where it has none."""
        return outcome.measures[measure.name]

    def slopes(self, outcome: Outcome, measure: Measure) -> Floats:
        """Derivatives of the score by the parameters in one world, shape (N, P).

        Raises:
            ValueError: if they are not known.
        """
        if type(self).score is not RobotObjective.score or measure.name not in outcome.gradients:
            raise ValueError(f"objective: {self.objective(measure).name} has no gradient; choose another method")
        return outcome.gradients[measure.name]

    def objectives(self, measure: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Names and units of the K objectives."""
        return (self.objective(measure),)

    def values(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The objectives of N points, shape (N, K), of one outcome for each world."""
        return np.mean([self.score(outcome, measure) for outcome in outcomes], axis=0)[:, None]

    def gradients(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Derivatives of a single objective by the parameters, shape (N, P)."""
        return np.asarray(np.mean([self.slopes(outcome, measure) for outcome in outcomes], axis=0))


class EachWorld(RobotObjective):
    """The score in each world is an objective."""

    def objectives(self, measure: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """One for each world."""
        one = self.objective(measure)
        return tuple(Objective(f"{one.name}_{world.name}", one.unit) for world in worlds)

    def values(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The scores in all worlds."""
        return np.stack([self.score(outcome, measure) for outcome in outcomes], axis=1)

    def gradients(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Several objectives have no single gradient."""
        raise ValueError("objective: one for each world has no single gradient; choose mean or worst")


class WorstWorld(RobotObjective):
    """The score in the world in which it is lowest."""

    def objectives(self, measure: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """One, named after the score."""
        one = self.objective(measure)
        return (Objective(f"worst {one.name}", one.unit),)

    def values(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The lowest score."""
        return np.min([self.score(outcome, measure) for outcome in outcomes], axis=0)[:, None]

    def gradients(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The derivatives in the world that is worst."""
        scores = np.nan_to_num([self.score(outcome, measure) for outcome in outcomes], nan=-np.inf)
        slopes = np.array([self.slopes(outcome, measure) for outcome in outcomes])
        return np.asarray(slopes[scores.argmin(axis=0), np.arange(slopes.shape[1])])


OBJECTIVES: Registry[type[RobotObjective]] = Registry(
    "morpholab.objectives",
    "objective",
    {
        "mean": "optim.problems.objectives:RobotObjective",
        "each": "optim.problems.objectives:EachWorld",
        "worst": "optim.problems.objectives:WorstWorld",
    },
)
