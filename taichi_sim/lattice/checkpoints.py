"""Which states to keep on the way forward so that a run can be undone within a bound on memory.

The run is cut into ``branching`` pieces, with a checkpoint at the start of each, and these again, ``levels`` deep;
the last pieces are short enough to record every state. Undoing goes through them from the last to the first. Each level
costs one more forward run and one more set of checkpoints: the memory grows with the logarithm of the horizon only.

Source: Griewank & Walther, "Evaluating Derivatives", 2nd ed., 2008, ch. 12.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from taichi_sim.base.checks import shown

FORWARD, RECORD = "forward", "record"
MOST_LEVELS = 12


@dataclass(frozen=True)
class Plan:
    """How to cut a run of ``steps`` steps.

    Attributes:
        steps: length of the run.
        record: most steps recorded at once.
        branching: pieces into which every longer stretch is cut.
        memory: bytes taken in all.
    """

    steps: int
    record: int
    branching: int
    memory: float

    def pieces(self, low: int, high: int) -> list[int]:
        """Steps at which the pieces of a stretch begin, ``low`` among them."""
        length = -(-(high - low) // self.branching)
        length = -(-length // self.record) * self.record if length > self.record else self.record
        return list(range(low, high, length))

    def undo(self, low: int, high: int) -> Iterator[tuple[str, int, int]]:
        """What to do, given a checkpoint at ``low``: restore there, then run forward to a new checkpoint, or record."""
        if high - low <= self.record:
            yield RECORD, low, high
            return
        marks = self.pieces(low, high)
        for start, mark in pairwise(marks):
            yield FORWARD, start, mark
        for start, end in zip(reversed(marks), reversed([*marks[1:], high]), strict=True):
            yield from self.undo(start, end)


def checked_memory(memory: object) -> float:
    """A bound on memory [B]; infinity is none.

    Raises:
        ValueError: for what is no positive number.
    """
    if isinstance(memory, int | float | np.integer | np.floating) and not isinstance(memory, bool) and memory > 0:
        return memory  # type: ignore[return-value]
    raise ValueError(f"memory: {shown(memory)} is not allowed; give a positive number of bytes")


def make_plan(
    steps: int, state: float, checkpoint: float, memory: float, besides: float = 0.0, most: int = 2**31
) -> Plan:
    """The plan with the fewest levels that fits into a memory.

    Args:
        steps: length of the run.
        state: bytes of a recorded state.
        checkpoint: bytes of a checkpoint.
        memory: bound [B].
        besides: what else it has to hold [B].
        most: states that can be recorded at once.

    Raises:
        ValueError: if no plan fits; says what is needed.
    """
    steps, least = max(steps, 1), math.inf
    for levels in range(1, MOST_LEVELS + 1):
        branching = max((steps * state / checkpoint) ** (1 / (levels + 1)), 2.0)
        record = min(max(math.ceil(steps / branching**levels), 2), max(most - 1, 1))
        branching = max(math.ceil((steps / record) ** (1 / levels)), 2)
        need = (record + 1) * state + (levels * branching + 1) * checkpoint + besides
        if need <= memory:
            return Plan(steps, record, branching, need)
        least = min(least, need)
    raise ValueError(
        f"memory: {memory:g} B is not allowed; {steps} steps of this batch need at least {math.ceil(least / 1e6)}e6 B"
    )
