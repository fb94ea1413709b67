"""Control in the loop: events of a program whose values are decided while it runs, from what robots feel.

A decision reads robots at a step, as a snapshot records them, and says what some events hold that follow it by a step
or more. So open-loop programs are those without decisions, and a run whose decisions are known is an open-loop one: the
way back goes through it as through any, and stops after each decision's events to take derivatives back through it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taichi_sim.lattice.program import LatticeProgram

if TYPE_CHECKING:
    from taichi_sim.lattice.drivers.driver import Reverse, Run


@dataclass(frozen=True, eq=False)
class Felt:
    """Readings of robots from which a feedback decides, or derivatives of a cost by these.

    Attributes:
        positions: voxel centres [m], body's voxel order, shape (B, V, 3); NaN of robots that diverged.
        orientations: quaternions, shape (B, V, 4).
        strains: of every link, shape (B, L).
    """

    positions: np.ndarray
    orientations: np.ndarray
    strains: np.ndarray


@dataclass(frozen=True, eq=False)
class Decision:
    """A decision of a feedback: the step at which robots are read, and the events whose values are decided.

    Attributes:
        step: step at which robots are read; the program records a snapshot of every robot there.
        snapshot: its place among the snapshots.
        events: of the program whose value and rate are decided, none before the step after; any number of them.
    """

    step: int
    snapshot: int
    events: np.ndarray


class Feedback(Protocol):
    """Interface of feedback: decides values of a program's events, and differentiates its decisions."""

    decisions: Sequence[Decision]  # in order of time

    def decide(self, number: int, felt: Felt) -> tuple[np.ndarray, np.ndarray]:
        """Return value and rate per step of every event of a decision."""
        ...

    def pull_back(self, number: int, values: np.ndarray, rates: np.ndarray) -> Felt:
        """Derivatives of a cost by what a decision felt, from those by its values and rates; the last one first."""
        ...


def check_feedback(feedback: Feedback, program: LatticeProgram) -> None:
    """Refuse decisions that a program has no room for.

    Raises:
        ValueError: for decisions out of order, without a snapshot of all robots at their step, on events that are not
            later or of another decision, and programs whose robots run for different times.
    """
    lengths, decisions, snapshots = program.lengths, feedback.decisions, program.snapshots
    if (lengths != lengths[0]).any():
        raise ValueError("feedback: robots that run for different times are not allowed; give equal lengths")
    # All decisions at once: one after the other, this would take as long as some steps for each.
    steps, slots = (np.array([getattr(one, name) for one in decisions], int) for name in ("step", "snapshot"))
    number, events = _joined([one.events for one in decisions])
    faults = np.zeros((4, len(decisions)), bool)
    unordered, unread, twice, early = faults
    unordered[...] = (steps < 0) | (steps >= lengths[0] - 1)
    unordered[1:] |= steps[1:] <= steps[:-1]
    unread[...] = (slots < 0) | (slots >= snapshots.shape[1])
    unread[~unread] = (snapshots[:, slots[~unread]] != steps[~unread]).any(axis=0)
    event = np.arange(len(program.events))[events]
    order = np.argsort(event, kind="stable")
    twice[number[order[1:][event[order[1:]] == event[order[:-1]]]]] = True
    early[number[program.events["step"][event] <= steps[number]]] = True
    if faults.any():
        first = int(np.argmax(faults.any(axis=0)))
        wrong = (
            f"is not allowed; give steps in order, before {int(lengths[0]) - 1}",
            f"has no snapshot {slots[first]} there",
            "decides an event twice",
            "decides an event that is not later",
        )
        raise ValueError(f"feedback: decision {first} at step {steps[first]} {wrong[np.argmax(faults[:, first])]}")


def _joined(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Arrays of whole numbers one after the other, with the number of the array that each comes from."""
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts]), np.concatenate([np.zeros(0, int), *parts])


def _rows_of(source: np.ndarray, decided: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The marks of a program that come from decisions' events, decision by decision; which of these each is; the ends.

    Args:
        source: number of the program's event that each mark comes from, -1 for none.
        decided: events of each decision, D of them.

    Returns:
        The marks, the place of each among the events of its decision, and where those of a decision end, shape (D + 1,)
        with a 0 before them.
    """
    number, events = _joined(decided)
    firsts = np.searchsorted(number, np.arange(len(decided) + 1))
    order = np.full(max(int(source.max(initial=0)), int(events.max(initial=0))) + 1, -1)
    order[events] = np.arange(len(events))
    found = np.where(source >= 0, order[np.maximum(source, 0)], -1)
    by_event = np.argsort(found, kind="stable")[np.count_nonzero(found < 0) :]
    places = found[by_event]
    return by_event, places - firsts[number[places]], np.searchsorted(places, firsts)


class Course:
    """A run in which decisions are made as they are due, and its way back."""

    def __init__(self, run: "Run", feedback: Feedback | None, place: np.ndarray, links: int) -> None:
        """Begin at the start of a run; ``place`` is that of the body's voxels in the engine's order."""
        self._run, self._feedback, self._place, self._links = run, feedback, place, links
        self._made = 0
        decisions = feedback.decisions if feedback else ()
        rows, source, ends = _rows_of(run.program.source, [one.events for one in decisions])
        self._rows = [(rows[a:b], source[a:b]) for a, b in pairwise(ends.tolist())]
        self._sizes = run.sizes_among(rows, ends)

    def advance(self, until: int | None = None, tick: Callable[[float], None] | None = None) -> None:
        """Go on to a step, or to the end, and decide on the way what has not been decided."""
        decisions = self._feedback.decisions if self._feedback else ()
        for number in range(self._made, len(decisions)):
            step = decisions[number].step + 1
            if until is not None and step > until:
                break
            self._run.advance(step, tick=tick)
            self._decide(number)
            self._made = number + 1
        self._run.advance(until, tick=tick)

    def _decide(self, number: int) -> None:
        assert self._feedback is not None
        run, driver = self._run, self._run.driver
        slot = self._feedback.decisions[number].snapshot
        poses = driver.snapshot(run.marks.poses, slot).take(self._place, axis=1, mode="clip").astype(float, copy=False)
        strains = driver.snapshot(run.marks.strains, slot)[:, : self._links].astype(float)
        values, rates = self._feedback.decide(number, Felt(poses[..., :3], poses[..., 3:], strains))
        rows, source = self._rows[number]
        told = np.empty((len(source), 2))
        told[:, 0], told[:, 1] = values[source], rates[source]
        told[np.isnan(told)] = 0  # of robots that diverged nothing is known, and nothing depends on it
        run.decide(rows, told, self._sizes[number])

    def take_back(self, reverse: "Reverse") -> None:
        """Have the way back stop after each decision's events."""
        if self._feedback is not None:
            numbers = {one.step + 1: number for number, one in enumerate(self._feedback.decisions)}
            reverse.stop_at(numbers, lambda step: self._pull_back(reverse, numbers[step]))

    def _pull_back(self, reverse: "Reverse", number: int) -> None:
        assert self._feedback is not None
        one, (rows, source) = self._feedback.decisions[number], self._rows[number]
        by_event = np.zeros((len(one.events), 2))
        np.add.at(by_event, source, reverse.events[rows].astype(float))
        felt = self._feedback.pull_back(number, by_event[:, 0], by_event[:, 1])
        poses = np.concatenate([felt.positions, felt.orientations], axis=2)
        reverse.add_seeds(one.snapshot, poses[:, np.argsort(self._place)], felt.strains)
