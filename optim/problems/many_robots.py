"""A problem whose points are numbers of robots: many robots, each simulated in its world."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation, Problem
from optim.space import Space
from robots.robot import Measure, Robot, World
from taichi_sim.base.compute import Compute
from taichi_sim.base.variables import Variable

STEPS = "steps"  # among the details of an evaluation
COLUMNS = ("source", "kind", "world", "status", STEPS, "numbers")  # of tables and parts, beside measures


@dataclass(frozen=True, eq=False)
class ManyRobots(Problem):
    """A problem whose points are numbers of robots, so that workers of searches can simulate any robots.

    Attributes:
        sources: what each of N robots is called, or was made from.
        robots: the robots, of any kinds, with nothing free.
        worlds: world of each.
        compute: device, precision and threads.
    """

    sources: Sequence[str]
    robots: Sequence[Robot]
    worlds: Sequence[World]
    compute: Compute

    @property
    def space(self) -> Space:
        """The number of the robot."""
        return Space((Variable("robot", 0, max(len(self.robots) - 1, 1), "integer"),))

    @cached_property
    def _own(self) -> list[tuple[Measure, ...]]:
        """Measures of each robot."""
        return [each.measures_in([place]) for each, place in zip(self.robots, self.worlds, strict=True)]

    @cached_property
    def measures(self) -> tuple[Measure, ...]:
        """Measures that any of the robots has, those of the first one first.

        What some robots measure in other units than others is one measure for each unit, such as ``speed [m/s]``, and
        what is called as another column is, is called so, too.
        """
        return tuple(self._called.values())

    @cached_property
    def _called(self) -> dict[tuple[str, str], Measure]:
        """The measures of all robots, by own name and unit."""
        found = {(m.name, m.unit): m for own in self._own for m in own}
        units = Counter(name for name, _ in found)
        plain = {key for key in found if units[key[0]] == 1 and key[0] not in COLUMNS}
        return {
            (name, unit): m if (name, unit) in plain else Measure(f"{name} [{unit or 'no unit'}]", "", m.title)
            for (name, unit), m in found.items()
        }

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Simulate the robots of these numbers, shape (N, 1); the objective of each is its own first measure.

        Details: the number of steps, and all measures by name, NaN where a robot does not have one. What refuses to be
        simulated in its world has failed, and its status says why.
        """
        numbers = np.asarray(points)[:, 0].astype(int)
        status, objectives = [], []
        details = {m.name: np.full(len(numbers), np.nan) for m in self.measures}
        steps = np.zeros(len(numbers), np.int64)
        for row, number in enumerate(numbers.tolist()):
            tried = self.robots[number]
            try:
                outcome = tried.simulate((), self.worlds[number], compute=self.compute)
            except ValueError as refusal:
                status.append(str(refusal))
                objectives.append(np.nan)
                continue
            status.append(str(outcome.status_or_reason[0]))
            objectives.append(float(outcome.measures[tried.measures[0].name][0]))
            steps[row] = outcome.steps[0]
            for measure in self._own[number]:
                called = self._called[measure.name, measure.unit].name
                details[called][row] = outcome.measures[measure.name][0]
        return Evaluation(np.array(objectives), status, {STEPS: steps, **details})
