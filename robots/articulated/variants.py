"""Variants of a file's robot: bodies of other sizes, and hinges with other actuation, given or free to be searched."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.articulated.factors import Factors, Given, Scale
from robots.free import Free
from taichi_sim.base.arrays import Floats
from taichi_sim.base.variables import Variable
from taichi_sim.ground.relief import Relief
from taichi_sim.rigid.gradient import RigidGradient
from taichi_sim.rigid.model.actuation import is_limited, is_stiff, stiffened_tree, strengthened_tree
from taichi_sim.rigid.model.assembly import check_start, depths_of
from taichi_sim.rigid.model.scaling import scaled_tree
from taichi_sim.rigid.model.tree import Tree

SIZES = Scale("body_sizes", "body", "body", "size", 0.1, 10.0)
STIFFNESS = Scale("hinge_stiffness", "hinge with a servo or a spring", "hinge", "stiffness", 0.01, 100.0)
TORQUE = Scale("drive_torque", "hinge with a drive that has a largest torque", "drive", "torque", 0.01, 100.0)
SCALES = SIZES, STIFFNESS, TORQUE
_SHIFT = 1e-5  # part of a factor by which trees are shifted; their numbers are smooth, mostly polynomials of low degree


@dataclass(frozen=True, eq=False)
class Variants:
    """All robots that differ from that of a file by factors, which may be free.

    Attributes:
        tree: the robot of the file, in which all factors are 1.
        sizes: of bodies, in the order of ``tree.ordered``.
        stiffness: of the hinges that carry these bodies.
        torques: of the drives of these hinges.

    Raises:
        ValueError: for names of no bodies or hinges, two for one, and sizes that a body cannot have.
    """

    tree: Tree
    sizes: Factors
    stiffness: Factors
    torques: Factors

    @classmethod
    def of(cls, tree: Tree, given: Mapping[str, Given]) -> "Variants":
        """Find the bodies and hinges of names and patterns, and check that there are robots of all sizes.

        Args:
            tree: the robot of the file.
            given: factors of each of ``SCALES``, by its field.
        """
        bodies = [body.name for body, _ in tree.ordered]
        hinges, drives = (
            [body.name if has(joint) else "" for body, joint in tree.ordered] for has in (is_stiff, is_limited)
        )
        if tree.ordered[0][0].mass == 0 and not tree.ordered[0][0].shapes:
            bodies[0] = ""  # what a robot hangs on is no body of it
        parts = zip(SCALES, (bodies, hinges, drives), strict=True)
        made = cls(tree, *(Factors.of(scale, names, given[scale.field]) for scale, names in parts))
        made._check_start()
        return made

    @property
    def kinds(self) -> tuple[Factors, ...]:
        """Factors of each of ``SCALES``."""
        return self.sizes, self.stiffness, self.torques

    @property
    def free(self) -> list[Free]:
        """The free ones, in the order of ``SCALES``."""
        return [factor for kind in self.kinds for factor in kind.free]

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """One for each free factor."""
        return tuple(parameter for kind in self.kinds for parameter in kind.parameters)

    @property
    def start(self) -> Floats:
        """The free factors before any search, (K,)."""
        return np.array([factor.middle for factor in self.free])

    def split(self, values: Floats) -> list[Floats]:
        """The values of free factors, (K,), of each of ``SCALES``."""
        return np.split(values, np.cumsum([len(kind.free) for kind in self.kinds[:-1]]))

    def settled(self, values: Floats) -> dict[str, Any]:
        """All factors by the names of their fields, with some values, (K,), in place of the free ones."""
        each = zip(self.kinds, self.split(values), strict=True)
        return {factors.scale.field: factors.settled(own) for factors, own in each}

    def of_parts(self, values: Floats) -> tuple[list[float], ...]:
        """Of values, (K,): the size of each body of ``tree.ordered``, the stiffness and the torque of its hinge."""
        return tuple(kind.of_parts(own) for kind, own in zip(self.kinds, self.split(values), strict=True))

    def tree_of(self, values: Floats) -> Tree:
        """The robot of some values of the free factors, (K,).

        Raises:
            ValueError: for values far beyond their bounds.
        """
        for kind, own in zip(self.kinds, self.split(values), strict=True):
            kind.check(own)
        tree, sizes = self._tree(values), self.split(values)[0]
        if self.tree.fixed and any(
            not free.low <= size <= free.high for free, size in zip(self.sizes.free, sizes, strict=True)
        ):
            check_start(tree)  # beyond the bounds, within which all sizes were looked at
        return tree

    def _tree(self, values: Floats) -> Tree:
        sizes, stiffness, torques = self.of_parts(values)
        return strengthened_tree(stiffened_tree(scaled_tree(self.tree, sizes), stiffness), torques)

    def _check_start(self) -> None:
        """Refuse sizes that no body can have, and with which a fixed robot starts in the ground.

        The height of a point is linear in the sizes, so each of its lowest places is at one end of every range.
        """
        low, high = (np.array([getattr(factor, end) for factor in self.free]) for end in ("low", "high"))
        shallow, _ = (self.tree_of(values) for values in (low, high))
        if not self.tree.fixed:  # others are raised
            return
        depths = depths_of(shallow)
        ends = [np.where(one, high, low) for one in np.eye(len(low), dtype=bool)]
        changes = np.array([depths_of(self.tree_of(end)) - depths for end in ends]).reshape(len(low), len(depths))
        deepest = (depths + np.maximum(changes, 0.0).sum(axis=0)).argmax() if len(depths) else 0
        values = np.where(changes[:, deepest] > 0, high, low) if len(depths) else low
        try:
            check_start(self.tree_of(values))
        except ValueError as error:
            if not self.sizes.given:
                raise
            sizes = self.sizes.settled(self.split(values)[0])
            named = ", ".join(f"{name}={size:g}" for name, size in sizes.items())
            raise ValueError(f"{SIZES.field}: with {named} {str(error).partition(': ')[2]}") from None

    def shifted(self, values: Floats, number: int) -> tuple[list[Tree], list[Tree], Floats]:
        """Trees of robots, (B, K), of which one factor is a little less, and a little more; and by how much, (B,).

        They are not looked at for a start in the ground, as sizes at a bound are moved beyond it.
        """
        shifts = _SHIFT * values[:, number]
        by = np.zeros_like(values)
        by[:, number] = shifts
        lower, upper = ([self._tree(each) for each in values + side * by] for side in (-1, 1))
        return lower, upper, 2 * shifts

    def slopes(
        self,
        values: Floats,
        judge: Callable[[Sequence[Tree]], Floats],
        back: RigidGradient | None = None,
        put: Floats | None = None,
        relief: Relief | None = None,
    ) -> Floats:
        """Derivatives of a measure by the free factors: through the motion, and through what the trees mean at its end.

        Args:
            values: of the free factors of B robots, (B, K).
            judge: the measure, (B,), if the robots ended as they did but had other trees.
            back: derivatives of the measure by the numbers of their trees, as the robots ended; None if how they move
                does not matter.
            put: derivatives by where robots know that they were put, (B, 3); None for robots that feel nothing.
            relief: uneven ground that they stand on at the start.
        """
        found = np.empty(values.shape)
        for number in range(values.shape[1]):
            lower, upper, span = self.shifted(values, number)
            change = np.zeros(len(values)) if back is None else self._change(lower, upper, back, put, relief)
            found[:, number] = (change + judge(upper) - judge(lower)) / span
        return found

    def _change(
        self,
        lower: Sequence[Tree],
        upper: Sequence[Tree],
        back: RigidGradient,
        put: Floats | None,
        relief: Relief | None,
    ) -> Floats:
        """Change of a measure through the motion, from one tree to another of each robot, (B,)."""
        before, after = (np.array([start_of(tree, relief) for tree in trees]) for trees in (lower, upper))
        change = back.between_trees(lower, upper, after - before)
        return change if put is None else change + (put * (after - before)).sum(1)


def start_of(tree: Tree, relief: Relief | None) -> Floats:
    """Where the base starts, (3,) [m]: on uneven ground as far above it as the tree is above z = 0."""
    place = np.array(tree.ordered[0][0].position, float)
    if relief is not None:  # as ``RigidEngine.standing`` has it
        centres, radii = tree.balls()
        place[2] += relief.rise_of_balls(centres, radii) - (radii - centres[:, 2]).max()
    return place
