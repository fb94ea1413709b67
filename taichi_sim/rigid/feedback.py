"""Control in the loop: commands that are decided while robots move, from what they feel.

A decision reads robots at the step from which on its command is kept. So a run whose decisions are known is one under
commands given beforehand, to the bit; the way back goes through it as through any, and stops where each command began
to take derivatives back through its decision.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.rigid import slots
from taichi_sim.rigid.run import Part, Run, bodies_of
from taichi_sim.store import Store


@dataclass(frozen=True, eq=False)
class Felt:
    """What a decision reads of robots, or the derivatives of a cost by it.

    Attributes:
        position: of the base's centre, (B, 3) [m]; like all others NaN of robots that diverged.
        orientation: of the base, (B, 4).
        angles: of the hinges, (B, H) [rad].
        readings: of the sensors, (B, S); those of touch sensors have no derivatives.
    """

    position: Floats
    orientation: Floats
    angles: Floats
    readings: Floats


class Feedback(Protocol):
    """What decides, and takes derivatives back through its decisions."""

    def decide(self, number: int, felt: Felt) -> Floats:
        """Command number 0, 1, ... of the commands over time, to all motors, (B, M)."""
        ...

    def pull_back(self, number: int, commands: Floats) -> Felt:
        """Derivatives of a cost by what a decision felt, from those by its command; the last one first."""
        ...


@dataclass(frozen=True, eq=False)
class Rolled:
    """Robots that ran together.

    Attributes:
        part: the robots.
        frames: what was recorded, or None.
        tape: states before steps, or None.
    """

    part: Part
    frames: Store | None
    tape: Store | None

    def go(self) -> None:
        """Go on from the plan's first step until its last one."""
        self.part.run(self.frames, self.tape)

    def recorded(self) -> Floats:
        """What was recorded, (numbers, robots)."""
        return np.zeros((0, len(self.part.robots))) if self.frames is None else self._of_robots(self.frames.read())

    def back(self, cotangents: Floats) -> Floats:
        """Carry the batch's cotangents back over the recorded steps; return those of these robots."""
        assert self.tape is not None
        return self.part.go_back(self.tape, cotangents[:, self.part.robots])

    def _of_robots(self, values: Floats) -> Floats:
        return values[:, : len(self.part.robots)]


def roll(
    run: Run, feedback: Feedback | None = None, *, recording: bool = False, taping: bool = False
) -> Iterator[Rolled]:
    """Run to the end, part by part; with feedback all parts together."""

    def begun(part: Part) -> Rolled:
        return Rolled(part, part.frames() if recording else None, part.tape() if taping else None)

    if feedback is None:
        for part in run.parts():
            rolled = begun(part)
            rolled.go()
            yield rolled
        return
    every = [begun(part) for part in run.parts()]
    for number, (first, until) in enumerate(_spans(run)):
        if number:
            _decide(run, every, feedback, number - 1)
        run.plan[[slots.FIRST, slots.UNTIL]] = first, until
        for each in every:
            each.go()
    yield from every


def go_back(run: Run, rolled: Sequence[Rolled], seeds: Floats, feedback: Feedback | None) -> Floats:
    """Cotangents of all slots at the start of a run from those at its end, (slots, B)."""
    if feedback is None:
        return np.concatenate([each.back(seeds) for each in rolled], -1)
    spans, places = _spans(run), felt_slots(run)
    motors = int(run.plan[slots.MOTORS])
    for number in reversed(range(len(spans))):
        run.plan[[slots.FIRST, slots.UNTIL]] = spans[number]
        seeds = np.concatenate([each.back(seeds) for each in rolled], -1)
        if number:
            _forget_work(run, seeds)
            first = int(run.plan[slots.COMMAND]) + (number - 1) * motors
            felt = feedback.pull_back(number - 1, np.nan_to_num(seeds[first : first + motors].T))
            for each in fields(felt):
                seeds[places[each.name]] += getattr(felt, each.name).T
    return seeds


def felt_slots(run: Run) -> dict[str, Ints]:
    """Slots of what robots feel, by the names of the fields of ``Felt``."""
    plan, hinged = run.plan, np.array(run.trees[0].hinged, int)
    return {
        "position": slots.POSITION + np.arange(3),
        "orientation": slots.ORIENTATION + np.arange(4),
        "readings": plan[slots.READING] + np.arange(plan[slots.SENSORS]),
        "angles": plan[slots.BODY] + slots.BODY_WIDTH * hinged + slots.ANGLE,
    }


def _spans(run: Run) -> list[tuple[int, int]]:
    """First and last step of launches: one of no steps, then one for each command that is due."""
    steps, hold, commands = (int(run.plan[place]) for place in (slots.STEPS, slots.HOLD, slots.COMMANDS))
    starts = [number * hold for number in range(commands) if number * hold < steps]
    return [(0, 0), *zip(starts, [*starts[1:], steps] if starts else [], strict=True)]  # none in a run of no steps


def _decide(run: Run, every: Sequence[Rolled], feedback: Feedback, number: int) -> None:
    places = felt_slots(run)
    wanted = np.concatenate([*places.values(), [slots.DIVERGED]])
    *now, ended = np.concatenate([each.part.state(wanted) for each in every], -1)
    diverged = ended >= 0
    parts = np.split(np.where(diverged, np.nan, now), np.cumsum([len(each) for each in places.values()])[:-1])
    found = feedback.decide(number, Felt(**{name: part.T for name, part in zip(places, parts, strict=True)}))
    # Of robots that diverged nothing is known, and nothing depends on it.
    given = np.where(diverged[:, None], 0.0, np.asarray(found, float))
    checks.numbers("commands", given, run.batch, int(run.plan[slots.MOTORS]))
    for each in every:
        each.part.command(number, given[each.part.robots])


def _forget_work(run: Run, cotangents: Floats) -> None:
    """Clear cotangents of what is no state, as a step of the way back does before it."""
    bodies_of(cotangents, run.plan)[:, slots.STATE_WIDTH :] = 0.0
    first = int(run.plan[slots.READING])
    cotangents[first : first + int(run.plan[slots.SENSORS])] = 0.0
