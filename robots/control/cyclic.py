"""Programs that repeat a cycle: every channel follows straight pieces through given values, over and over.

A sine through 16 pieces is off by at most 1 - cos(pi / 16) = 1.9 % of its amplitude, between its nodes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.world import Terrain, weights
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeProgram, Quantity
from taichi_sim.lattice.program import EVENT

LEAST_FREQUENCY, MOST_FREQUENCY = 0.1, 100.0  # [Hz]
SEGMENTS = 16  # straight pieces of a cycle
ROUNDING = 1e-9  # of a weight [m/s^2]
MOMENTS = 4  # of each piece of the last cycle that are recorded: the top of a flight lies between its nodes
# Snapshots: the ends of the first and of the last cycle, the moments of the last cycle with both its ends, then frames.
LAST_CYCLE = slice(2, 2 + SEGMENTS * MOMENTS + 1)
FRAMES_FROM = LAST_CYCLE.stop


@dataclass(frozen=True)
class Cycle:
    """When what happens.

    Attributes:
        frequency: cycles per second [Hz].
        settling: time on the floor before they begin [s].
        cycles: that count; another one comes before them, so that falling over does not.
        time_step: dt [s], of which a whole number makes a segment: see :meth:`fit`.
    """

    frequency: float
    settling: float
    cycles: int
    time_step: float

    @staticmethod
    def fit(frequency: float, largest: float) -> float:
        """The largest dt [s] up to ``largest`` of which a whole number makes a segment of the cycle."""
        segment = 1.0 / (frequency * SEGMENTS)
        return segment / math.ceil(segment / largest)

    @property
    def begin(self) -> int:
        """Steps before the first cycle."""
        return round(self.settling / self.time_step)

    @property
    def segment(self) -> int:
        """Steps of a straight piece."""
        return round(1.0 / (self.frequency * SEGMENTS * self.time_step))

    @property
    def end(self) -> int:
        """Steps of the whole program."""
        return self.begin + (self.cycles + 1) * SEGMENTS * self.segment

    @property
    def moments(self) -> Ints:
        """Steps after the last cycle begins at which it is recorded, shape (65,); some twice where it has fewer."""
        return np.arange(SEGMENTS * MOMENTS + 1) * self.segment // MOMENTS

    @property
    def duration(self) -> float:
        """Duration of the cycles that count [s]."""
        return self.cycles / self.frequency


class Cyclic:
    """Base class of robots that repeat a cycle: how long their motions are."""

    @property
    def cycle(self) -> Cycle:
        """Timing of the cycles."""
        raise NotImplementedError

    @property
    def steps(self) -> int:
        """Number of time steps in the cycles."""
        return self.cycle.end - self.cycle.begin

    @property
    def lasts(self) -> float:
        """Time that a motion takes, if nothing ends it before [s]."""
        return self.steps * self.cycle.time_step


def surroundings(terrains: Sequence[Terrain], heading: float) -> dict[int, Floats]:
    """What terrains, one each, do to all regions of B robots that head somewhere [degrees], shape (B,) each.

    That is their weight and, if all are wet, a fluid's resistance.
    """
    pulls = np.array([weights(terrain, np.array(heading))[1] for terrain in terrains])
    found = {Quantity.ACCELERATION + axis: part for axis, part in enumerate(pulls.T)}
    if terrains[0].is_wet:
        resistances = np.array([terrain.resistance for terrain in terrains])
        found |= {Quantity.RESISTANCE + part: values for part, values in enumerate(resistances.T)}
    return found


def without_rounding(around: Mapping[int, Floats]) -> dict[int, Floats]:
    """What is around robots, without parts of their weight that are 0 but for rounding.

    Anything at all that pulls sideways frees feet that carry nothing yet, which then creep by what friction turns back
    in each step; and it squeezes a voxel with a Poisson's ratio and one link along that axis.
    """
    pulls = range(Quantity.ACCELERATION, Quantity.ACCELERATION + 3)
    return {what: np.where(abs(part) < ROUNDING, 0.0, part) if what in pulls else part for what, part in around.items()}


def build_cyclic_program(
    regions: ArrayLike,
    quantities: ArrayLike,
    rest: ArrayLike,
    swing: Floats,
    cycle: Cycle,
    around: Mapping[int, Floats],
    region_count: int,
    record_every: int | None = None,
) -> LatticeProgram:
    """The program of B robots. While they settle, channels go straight from rest to where the cycle begins.

    Snapshot 0 is the end of the first cycle, snapshot 1 the end of the last; then come those of the last cycle, see
    ``LAST_CYCLE``, and frames. The events of the cycle are the last of all, in the order of :func:`cycle_events`.

    Args:
        regions: of the C channels, shape (C,).
        quantities: of the channels, see ``Quantity``, shape (C,).
        rest: their values before anything moves, broadcast to shape (B, C).
        swing: what the cycle adds to them at its nodes, shape (B, C, 16).
        cycle: when what happens.
        around: values of quantities that all regions feel all the time, shape (B,), see :func:`surroundings`.
        region_count: of the body.
        record_every: steps between frames, from the start of the first cycle on; None for no frames.
    """
    robots = len(swing)
    begin, segment, end = cycle.begin, cycle.segment, cycle.end
    pull = np.empty((robots, region_count, len(around)), EVENT)
    pull["robot"], pull["region"] = np.arange(robots)[:, None, None], np.arange(region_count)[:, None]
    pull["quantity"], pull["step"] = list(around), 0
    pull["value"], pull["rate"] = np.stack(list(around.values()), axis=-1)[:, None], 0.0
    values, rates = cycle_events(cycle, rest, swing)
    driven = np.empty(values.shape, EVENT)
    driven["robot"], driven["region"], driven["quantity"] = np.arange(robots)[:, None], regions, quantities
    steps = begin + np.arange((cycle.cycles + 1) * SEGMENTS) * segment
    driven["step"] = np.concatenate([[0], steps] if begin else [steps])[:, None, None]
    driven["value"], driven["rate"] = values, rates
    last = end - SEGMENTS * segment + cycle.moments
    marks = [begin + SEGMENTS * segment, end, *last, *(range(begin, end + 1, record_every) if record_every else ())]
    events = np.concatenate([pull.ravel(), driven.ravel()])
    return LatticeProgram(np.full(robots, end), events, np.tile(marks, (robots, 1)))


def cycle_events(cycle: Cycle, rest: ArrayLike, swing: Any) -> tuple[Any, Any]:
    """Values and rates of the events of channels that swing so: a ramp if there is time for it, then the pieces.

    Shapes (events, B, C); ``swing`` may be traced, see ``taichi_sim.autodiff.arrays``.
    """
    swung = np.moveaxis(swing, -1, 0)
    rate = (np.roll(swung, -1, axis=0) - swung) / cycle.segment
    values = np.asarray(rest) + np.tile(swung, (cycle.cycles + 1, 1, 1))
    rates = np.tile(rate, (cycle.cycles + 1, 1, 1))
    if not cycle.begin:
        return values, rates
    start = np.broadcast_to(np.asarray(rest, float), swing.shape[:2])[None]
    return np.concatenate([start, values]), np.concatenate([swung[:1] / cycle.begin, rates])
