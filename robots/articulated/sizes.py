"""Sizes of the bodies of a file's robot: what is free of them, and the trees of robots of some sizes."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.free import Free
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.names import matching
from taichi_sim.base.variables import Variable
from taichi_sim.ground.relief import Relief
from taichi_sim.rigid.gradient import RigidGradient
from taichi_sim.rigid.model.assembly import check_start, depths_of
from taichi_sim.rigid.model.scaling import scaled_tree
from taichi_sim.rigid.model.tree import Tree

FIELD = "body_sizes"
LEAST, MOST = 0.1, 10.0  # of a factor
BEYOND = 2.0  # times as small or large a point may be, as differences at the bounds need
USUAL = Free(0.5, 2.0, 1.0)
STEP = 0.1  # of a mutation, of the range
_SHIFT = 1e-5  # part of a size by which trees are shifted; their numbers are polynomials of low degree

Size = float | Free
Bodies = Mapping[str, Size]


def size_of_text(text: str) -> dict[str, Size]:
    """Parse the size of bodies, such as ``thigh*``, ``thigh*=0.5:2`` or ``torso=1.2``; without a range 0.5 to 2.

    Raises:
        ValueError: for anything else.
    """
    name, given, size = text.rpartition("=") if "=" in text else (text, "", "")
    try:
        parts = [float(part) for part in size.split(":")] if given else []
        if len(parts) > 2:
            raise ValueError
    except ValueError:
        parts, name = [], ""
    if not name:
        raise ValueError(f"{FIELD}: {text!r} is not allowed; give NAME, NAME=LOW:HIGH or NAME=SIZE, as thigh*=0.5:2")
    return {name: USUAL if not parts else parts[0] if len(parts) == 1 else _free(name, *parts)}


def checked_sizes(given: object) -> dict[str, Size]:
    """Sizes by names of bodies or patterns of these: each a factor, or free between two.

    Raises:
        ValueError: for anything else.
    """
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise ValueError(f"{FIELD}: {given!r} is not allowed; give sizes by names of bodies, as thigh*: Free(0.5, 2)")
    return {name: _checked(name, size) for name, size in given.items()}


def _checked(name: str, size: object) -> Size:
    if isinstance(size, list | tuple) and len(size) in (2, 3):
        return _free(name, *size)
    if isinstance(size, Free):
        return _free(name, size.low, size.high, size.start)
    return checks.number(f"{FIELD} of {name}", size, LEAST, MOST)


def _free(name: str, low: Any, high: Any, start: Any = None) -> Free:
    """A free size, which starts at 1 if that is between its bounds."""
    field = f"{FIELD} of {name}"
    low, high = (checks.number(field, each, LEAST, MOST) for each in (low, high))
    if low >= high:
        raise ValueError(f"{field}: {low:g} to {high:g} is not allowed; give the lower one first, as 0.5 to 2")
    usual = 1.0 if low <= 1 <= high else None
    return Free(low, high, usual if start is None else checks.number(f"{field}: start", start, low, high))


def record_of_sizes(given: Bodies) -> dict[str, Any]:
    """Describe sizes as JSON values, of which :func:`checked_sizes` makes them again; free: lowest, highest, start."""
    return {name: [s.low, s.high, s.middle] if isinstance(s, Free) else s for name, s in given.items()}


@dataclass(frozen=True, eq=False)
class Sizes:
    """Sizes of the bodies of a tree.

    Attributes:
        tree: the robot of the file, in which all sizes are 1.
        given: sizes by names of bodies or patterns, see :func:`checked_sizes`.
        which: number in ``given`` of the size of each body in the order of ``tree.ordered``; -1 for none.

    Raises:
        ValueError: for names of no bodies, two for one body, and sizes that a body cannot have.
    """

    tree: Tree
    given: Bodies
    which: tuple[int, ...]

    @classmethod
    def of(cls, tree: Tree, given: Bodies) -> "Sizes":
        """Find the bodies of names and patterns, and check that there are robots of all sizes."""
        names = [body.name for body, _ in tree.ordered]
        if tree.ordered[0][0].mass == 0 and not tree.ordered[0][0].shapes:
            names[0] = ""  # what a robot hangs on is no body of it
        which = [-1] * len(names)
        for number, pattern in enumerate(given):
            found = [n for n in matching(pattern, names) if names[n]]
            if not found:
                known = ", ".join(filter(None, names))
                raise ValueError(f"{FIELD}: {pattern!r} is no body; give one of {known}, or a pattern of them")
            for n in found:
                if which[n] >= 0:
                    other = list(given)[which[n]]
                    raise ValueError(f"{FIELD}: {other!r} and {pattern!r} are both {names[n]}; give each body once")
                which[n] = number
        made = cls(tree, given, tuple(which))
        made._check_start()
        return made

    @property
    def free(self) -> list[Free]:
        """The free ones, in the order of their parameters."""
        return [size for size in self.given.values() if isinstance(size, Free)]

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """One for each name or pattern whose size is free: ``thigh_size`` for ``thigh*``."""
        patterns = [pattern for pattern, size in self.given.items() if isinstance(size, Free)]
        short = [re.sub(r"\[[^]]*\]|[*?]", "", each).strip(" _-.") or "body" for each in patterns]
        names = [name if short.count(name) == 1 else each for name, each in zip(short, patterns, strict=True)]
        spans = [size.high - size.low for size in self.free]
        return tuple(
            Variable(f"{name}_size", size.low, size.high, step=STEP * span, start=size.middle)
            for name, size, span in zip(names, self.free, spans, strict=True)
        )

    @property
    def spoken(self) -> str:
        """What is given, for people."""
        told = (
            (name, f"{s.low:g} to {s.high:g}" if isinstance(s, Free) else f"{s:g}") for name, s in self.given.items()
        )
        return "sizes " + ", ".join(f"{name} {size}" for name, size in told)

    @property
    def start(self) -> Floats:
        """The free sizes before any search, (K,)."""
        return np.array([size.middle for size in self.free])

    def tree_of(self, sizes: Floats) -> Tree:
        """The robot of some free sizes, (K,).

        Raises:
            ValueError: for sizes far beyond their bounds.
        """
        for parameter, size in zip(self.parameters, sizes.tolist(), strict=True):
            checks.number(parameter.name, size, LEAST / BEYOND, MOST * BEYOND)
        tree = self._tree(sizes)
        if self.tree.fixed and any(
            not free.low <= size <= free.high for free, size in zip(self.free, sizes, strict=True)
        ):
            check_start(tree)  # beyond the bounds, within which all sizes were looked at
        return tree

    def _check_start(self) -> None:
        """Refuse sizes that no body can have, and with which a fixed robot starts in the ground.

        The height of a point is linear in the sizes, so each of its lowest places is at one end of every range.
        """
        low, high = (np.array([getattr(size, end) for size in self.free]) for end in ("low", "high"))
        shallow, _ = (self.tree_of(sizes) for sizes in (low, high))
        if not self.tree.fixed:  # others are raised
            return
        depths = depths_of(shallow)
        ends = [np.where(one, high, low) for one in np.eye(len(low), dtype=bool)]
        changes = np.array([depths_of(self.tree_of(end)) - depths for end in ends]).reshape(len(low), len(depths))
        deepest = (depths + np.maximum(changes, 0.0).sum(axis=0)).argmax() if len(depths) else 0
        sizes = np.where(changes[:, deepest] > 0, high, low) if len(depths) else low
        try:
            check_start(self.tree_of(sizes))
        except ValueError as error:
            named = ", ".join(f"{name}={size:g}" for name, size in self.settled(sizes).items())
            raise ValueError(f"{FIELD}: with {named} {str(error).partition(': ')[2]}") from None

    def factors(self, sizes: Floats) -> list[float]:
        """The size of each body in the order of ``tree.ordered``, of some free sizes, (K,)."""
        each = list(self.settled(sizes).values())
        return [1.0 if number < 0 else each[number] for number in self.which]

    def _tree(self, sizes: Floats) -> Tree:
        return scaled_tree(self.tree, self.factors(sizes))

    def settled(self, sizes: Floats) -> dict[str, float]:
        """What is given, with these sizes, (K,), in place of the free ones."""
        left = iter(sizes.tolist())
        return {name: next(left) if isinstance(size, Free) else size for name, size in self.given.items()}

    def shifted(self, sizes: Floats, number: int) -> tuple[list[Tree], list[Tree], Floats]:
        """Trees of robots, (B, K), of which one size is a little less, and a little more; and by how much, (B,).

        They are not looked at for a start in the ground, as sizes at a bound are moved beyond it.
        """
        shifts = _SHIFT * sizes[:, number]
        by = np.zeros_like(sizes)
        by[:, number] = shifts
        lower, upper = ([self._tree(each) for each in sizes + side * by] for side in (-1, 1))
        return lower, upper, 2 * shifts

    def slopes(
        self,
        sizes: Floats,
        back: RigidGradient,
        judge: Callable[[Sequence[Tree]], Floats],
        put: Floats | None,
        relief: Relief | None,
    ) -> Floats:
        """Derivatives of a measure by the free sizes: through the motion, and through what the trees mean at its end.

        Args:
            sizes: of B robots, (B, K).
            back: derivatives of the measure by the numbers of their trees, as the robots ended.
            judge: the measure, (B,), if the robots ended as they did but had other trees.
            put: derivatives by where robots know that they were put, (B, 3); None for robots that feel nothing.
            relief: uneven ground that they stand on at the start.
        """
        found = np.empty(sizes.shape)
        for number in range(sizes.shape[1]):
            lower, upper, span = self.shifted(sizes, number)
            before, after = (np.array([start_of(tree, relief) for tree in trees]) for trees in (lower, upper))
            change = back.between_trees(lower, upper, after - before)
            if put is not None:
                change = change + (put * (after - before)).sum(1)
            found[:, number] = (change + judge(upper) - judge(lower)) / span
        return found


def start_of(tree: Tree, relief: Relief | None) -> Floats:
    """Where the base starts, (3,) [m]: on uneven ground as far above it as the tree is above z = 0."""
    place = np.array(tree.ordered[0][0].position, float)
    if relief is not None:  # as ``RigidEngine.standing`` has it
        centres, radii = tree.balls()
        place[2] += relief.rise_of_balls(centres, radii) - (radii - centres[:, 2]).max()
    return place
