"""The archive of the Borg MOEA: one point for each box of objectives that no other box dominates.

Sources: Laumanns, Thiele, Deb & Zitzler, Combining convergence and diversity in evolutionary multiobjective
optimization, Evolutionary Computation 10(3), 2002 (epsilon-boxes); Hadka & Reed, Borg: an auto-adaptive many-objective
evolutionary computing framework, Evolutionary Computation 21(2), 2013, section 3 (epsilon-progress).
"""

from dataclasses import dataclass

import numpy as np

from optim.measures.pareto import dominates
from taichi_sim.base.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class EpsilonArchive:
    """The A points of an archive, which differ by more than epsilon in some objective.

    Objectives, all maximised, are divided into boxes of side epsilon that begin at 0; a box is as good as its upper
    corner. Which boxes are held does not depend on the order in which points came. Nor does the point in a box, the
    one nearest to the corner (the first of equals), where no other objective values are as near.

    Attributes:
        epsilons: sides of a box, in units of the objectives, shape (K,).
        points: shape (A, D).
        objectives: shape (A, K).
        labels: a whole number that came with each point, shape (A,).
    """

    epsilons: Floats
    points: Floats
    objectives: Floats
    labels: Ints

    @classmethod
    def empty(cls, epsilons: Floats, size: int) -> "EpsilonArchive":
        """An archive for points of D = ``size`` variables that holds none."""
        return cls(epsilons, np.empty((0, size)), np.empty((0, len(epsilons))), np.empty(0, np.int64))

    def with_point(self, point: Floats, objectives: Floats, label: int) -> tuple["EpsilonArchive", bool]:
        """The archive after a success, shapes (D,) and (K,), was offered; whether it made epsilon-progress.

        It did if it was taken into a box that held no point before.
        """
        box, boxes = (np.ceil(values / self.epsilons) for values in (objectives, self.objectives))
        if dominates(boxes, box).any():
            return self, False
        same = (boxes == box).all(axis=1)
        if same.any():
            distance, distances = (
                np.sum((box - values / self.epsilons) ** 2, axis=-1) for values in (objectives, self.objectives[same])
            )
            if distance >= distances.min():
                return self, False
        left = ~same & ~dominates(box, boxes)
        points = np.concatenate([self.points[left], point[None]])
        kept = np.concatenate([self.objectives[left], objectives[None]])
        labels = np.append(self.labels[left], np.int64(label))
        return EpsilonArchive(self.epsilons, points, kept, labels), not same.any()
