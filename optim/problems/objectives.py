"""Objectives of searches for robots: how scores in several worlds become one objective, or several.

A package adds an objective by an entry point in the group ``morpholab.objectives``: a subclass of
:class:`RobotObjective`, which usually defines its name, its unit and :meth:`RobotObjective.score`.
"""

from collections.abc import Sequence

import numpy as np

from optim.problem import Objective
from robots.robot import Measure, Outcome, World
from taichi_sim.base.arrays import Floats
from taichi_sim.base.foreign import method_of
from taichi_sim.base.registry import Registry

DERIVATIVES = {"score": "slopes", "combined": "combined_slopes", "values": "gradients"}  # of methods


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
        self.differentiated(measure)
        if measure.name not in outcome.gradients:
            raise self._flat(measure)
        return outcome.gradients[measure.name]

    def differentiated(self, measure: Measure) -> tuple[str, ...]:
        """Names of the measures whose gradients :meth:`slopes` needs.

        Raises:
            ValueError: if the score has no derivatives.
        """
        own = self.own
        alone = any(law in own and slope not in own for law, slope in DERIVATIVES.items())  # its derivative is unknown
        if alone and "gradients" not in own:
            raise self._flat(measure)
        return (measure.name,)

    def objectives(self, measure: Measure, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Names and units of the K objectives."""
        return self.named(self.objective(measure), worlds)

    def values(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The objectives of N points, shape (N, K), of one outcome for each world."""
        return self.combined(self.scores_in(outcomes, measure))

    def gradients(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Derivatives of a single objective by the parameters, shape (N, P)."""
        return self.combined_slopes(self.scores_in(outcomes, measure), self.slopes_in(outcomes, measure))

    def scores_in(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """The scores in W worlds, shape (W, N).

        Raises:
            ValueError: if :meth:`score` gives no number for each point.
        """
        return np.array([self._checked("score", self.score(each, measure), each.status.shape) for each in outcomes])

    def slopes_in(self, outcomes: Sequence[Outcome], measure: Measure) -> Floats:
        """Derivatives of the scores by the parameters in W worlds, shape (W, N, P).

        Raises:
            ValueError: if :meth:`slopes` gives none for each parameter.
        """
        return np.array([self._checked("slopes", self.slopes(each, measure), _shape_of(each)) for each in outcomes])

    def named(self, one: Objective, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Names and units of the objectives made from a score in W worlds."""
        return (one,)

    def combined(self, scores: Floats) -> Floats:
        """Combine the scores in W worlds, shape (W, N), into objectives, shape (N, K)."""
        return np.asarray(np.mean(scores, axis=0))[:, None]

    def combined_slopes(self, scores: Floats, slopes: Floats) -> Floats:
        """Derivatives of a single objective, shape (N, P), of scores, shape (W, N), and slopes, shape (W, N, P)."""
        return np.asarray(np.mean(slopes, axis=0))

    @property
    def own(self) -> set[str]:
        """Names of the methods that a subclass defines in its own way."""
        return {name for name, one in vars(RobotObjective).items() if getattr(type(self), name) is not one}

    def _checked(self, method: str, given: object, shape: tuple[int, ...] | None) -> Floats:
        """What a method gave, of this shape, if that is known."""
        try:
            found = np.asarray(given, float)
        except (TypeError, ValueError):
            found = np.empty(())
        if shape is not None and found.shape != shape:
            what = f"objective: {method_of(self, method)}"
            raise ValueError(f"{what} returns a value of shape {found.shape}; return an array of shape {shape}")
        return found

    def _flat(self, measure: Measure) -> ValueError:
        return ValueError(f"objective: {self.objective(measure).name} has no gradient; choose another method")


def _shape_of(outcome: Outcome) -> tuple[int, ...] | None:
    """Shape (N, P) of gradients, if there are any."""
    return next((slopes.shape for slopes in outcome.gradients.values()), None)


class EachWorld(RobotObjective):
    """An objective for each world: the score there."""

    def named(self, one: Objective, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Names and units of the score in each world."""
        return tuple(Objective(f"{one.name}_{world.name}", one.unit) for world in worlds)

    def combined(self, scores: Floats) -> Floats:
        """Return the scores in all worlds as objectives, shape (N, W)."""
        return scores.T

    def differentiated(self, measure: Measure) -> tuple[str, ...]:
        """Several objectives have no single gradient."""
        raise ValueError("objective: one for each world has no single gradient; choose mean or worst")


class WorstWorld(RobotObjective):
    """One objective: the lowest score of a design in any of the worlds."""

    def named(self, one: Objective, worlds: Sequence[World]) -> tuple[Objective, ...]:
        """Name and unit of the one objective, the worst score."""
        return (Objective(f"worst {one.name}", one.unit),)

    def combined(self, scores: Floats) -> Floats:
        """Return the lowest score of each point, shape (N, 1)."""
        return np.asarray(np.min(scores, axis=0))[:, None]

    def combined_slopes(self, scores: Floats, slopes: Floats) -> Floats:
        """Derivatives of the score in the world where it is lowest, shape (N, P)."""
        worst = np.nan_to_num(scores, nan=-np.inf).argmin(axis=0)
        return np.asarray(slopes[worst, np.arange(slopes.shape[1])])


OBJECTIVES: Registry[type[RobotObjective]] = Registry(
    "morpholab.objectives",
    "objective",
    {
        "mean": "optim.problems.objectives:RobotObjective",
        "each": "optim.problems.objectives:EachWorld",
        "worst": "optim.problems.objectives:WorstWorld",
    },
    classes_of=RobotObjective,
)
