"""The program of relaxed designs, and how it changes with them.

A gait that is all 0 and 1, and in which some bladder makes a full stroke in every column, has the program of
``build_program``, to the bit. Columns last as long as those of the gait that is on where this one is at least 1/2.

Derivatives are those of the events' values and rates; their steps are whole and stay. So they are piecewise: where a
bladder arrives with a whole step, they are those of one side. Where it is told the same as before it moves by |change|
of u, whose derivative is taken as 0, the mean of both sides. The published ramp of the core pressure takes longer
to a higher pressure; its derivative by pressure is that of the value it ends with.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.cores import InflatedCores, Scalar, highest_pressure
from robots.inflatable.program import snapshot_steps, snapshot_table, write_robot
from robots.inflatable.relaxed_motion import play_relaxed, stage_starts
from robots.inflatable.relaxed_schedule import RelaxedDesign
from robots.inflatable.robot import InflatableDesign
from robots.inflatable.schedule import BLADDERS, FEET
from robots.world import Terrain, weights
from taichi_sim.autodiff.dual import Dual, slope_of, value_of, variables
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.lattice import LatticeProgram, ProgramBuilder


@dataclass(frozen=True, eq=False)
class DesignGradient:
    """Derivatives of one number per robot by its design.

    Attributes:
        pressure: by the core pressure [1/Pa], shape (B,); by that of each core, shape (B, N), where designs have
            several.
        orientation: by the heading [1/degree], shape (B,).
        inflation: by the inflation of the bladders, shape (B, 8, T).
        grip: by the grip of the feet, shape (B, 2, T).
        core_pressure: by the core pressure of the columns [1/Pa], shape (B, T); None where the gait has none.
    """

    pressure: Floats
    orientation: Floats
    inflation: Floats
    grip: Floats
    core_pressure: Floats | None


@dataclass(frozen=True)
class Parameters:
    """The numbers of one robot's design, in a row: those of ``DesignGradient``, in its order.

    Attributes:
        columns: T.
        shapes: whether columns have core pressures.
        cores: how many core pressures designs have; 1 where it is one for all.
    """

    columns: int
    shapes: bool
    cores: int = 1

    @classmethod
    def of(cls, designs: Sequence[RelaxedDesign]) -> "Parameters":
        """Those that a batch has in common.

        Raises:
            ValueError: in one line, when there are none.
        """
        if any(isinstance(d, InflatableDesign) for d in designs):
            raise ValueError("designs: a binary schedule has no gradient; give RelaxedDesign.from_design(design)")
        if not designs or not all(isinstance(d, RelaxedDesign) for d in designs):
            raise ValueError("designs: give at least one RelaxedDesign")
        kinds = {cls(d.schedule.columns, d.schedule.pressure is not None, np.size(d.pressure)) for d in designs}
        if len({kind.cores for kind in kinds}) > 1:
            raise ValueError("designs: a mixture is not allowed; give all one core pressure, or all one a core")
        if len(kinds) > 1:
            raise ValueError(
                "designs: a mixture is not allowed; give gaits of one number of columns, all or none with pressures"
            )
        return kinds.pop()

    @property
    def sizes(self) -> list[int]:
        """How many numbers each part has."""
        return [self.cores, 1, BLADDERS * self.columns, FEET * self.columns, self.columns * self.shapes]

    def variables(self, design: RelaxedDesign) -> list[Dual]:
        """The parts of a design as variables; the last is empty without core pressures."""
        gait, count = design.schedule, sum(self.sizes)
        core = np.zeros(0) if gait.pressure is None else gait.pressure
        parts = [np.array(design.pressure), np.array(design.orientation), gait.inflation, gait.grip, core]
        first = np.cumsum([0, *self.sizes[:-1]])
        return [variables(part, int(place), count) for part, place in zip(parts, first, strict=True)]

    def split(self, gradient: Floats) -> DesignGradient:
        """A gradient from rows of shape (B, number of parameters)."""
        pressure, orientation, inflation, grip, core = np.split(gradient, np.cumsum(self.sizes[:-1]), axis=1)
        return DesignGradient(
            pressure[:, 0] if self.cores == 1 else pressure,
            orientation[:, 0],
            inflation.reshape(-1, BLADDERS, self.columns),
            grip.reshape(-1, FEET, self.columns),
            core if self.shapes else None,
        )


@dataclass(frozen=True, eq=False)
class Slopes:
    """A sparse matrix: derivatives of one number per event by the parameters of all robots in a row.

    Attributes:
        event, parameter, slope: of the entries that are not zero, shape (N,) each.
    """

    event: Ints
    parameter: Ints
    slope: Floats

    def pull_back(self, cotangents: Floats, count: int) -> Floats:
        """The transpose times cotangents (E,): shape (count,)."""
        gradient = np.zeros(count)
        np.add.at(gradient, self.parameter, self.slope * cotangents[self.event])
        return gradient


@dataclass(frozen=True, eq=False)
class RelaxedProgram:
    """A program, and the derivatives of its events by the designs.

    Attributes:
        program: snapshot 0 is the end of the initialisation, snapshot 1 the end of the gait.
        parameters: of every robot.
        value_slopes: derivatives of the events' values.
        rate_slopes: derivatives of the events' rates.
    """

    program: LatticeProgram
    parameters: Parameters
    value_slopes: Slopes
    rate_slopes: Slopes

    def pull_back(self, values: ArrayLike, rates: ArrayLike) -> DesignGradient:
        """Derivatives of a cost by the designs from those by the events' values and rates, shape (E,) each.

        A design has a part in its own robot's events only, so the cost may be the sum of one per robot.

        Raises:
            ValueError: in one line, for another shape.
        """
        shape = self.program.events.shape
        given = np.asarray(values, float), np.asarray(rates, float)
        for name, array in zip(("values", "rates"), given, strict=True):
            if array.shape != shape:
                raise ValueError(f"{name}: shape {array.shape} is not allowed; give {shape}, one per event")
        robots, count = self.program.robot_count, sum(self.parameters.sizes)
        gradient = self.value_slopes.pull_back(given[0], robots * count)
        gradient += self.rate_slopes.pull_back(given[1], robots * count)
        return self.parameters.split(gradient.reshape(robots, count))


class Recorder:
    """A ``ProgramBuilder`` that takes dual numbers and keeps their derivatives."""

    def __init__(self, robot_count: int, parameter_count: int) -> None:
        """Start an empty program for robots of so many parameters each."""
        self._builder = ProgramBuilder(robot_count)
        self._parameters, self._events = parameter_count, 0
        self._entries: tuple[list[Floats], list[Floats]] = ([], [])

    def set(
        self, quantity: int, value: Scalar, *, regions: ArrayLike, step: ArrayLike = 0, rate: Scalar = 0.0, robots: int
    ) -> None:
        """See ``ProgramBuilder.set``; for one robot."""
        self._builder.set(quantity, value_of(value), regions=regions, step=step, rate=value_of(rate), robots=robots)
        count = np.size(regions)
        for number, entries in zip((value, rate), self._entries, strict=True):
            slope = slope_of(number)
            slope = np.broadcast_to(slope, (count, slope.shape[-1]))
            event, parameter = np.nonzero(slope)
            place = self._events + event, robots * self._parameters + parameter
            entries.append(np.array([*place, slope[event, parameter]]))
        self._events += count

    def build(self, lengths: list[int], marks: list[list[int]], parameters: Parameters) -> RelaxedProgram:
        """The program of so many steps, with snapshots after the marked ones."""
        values, rates = (np.concatenate(entries, axis=1) for entries in self._entries)
        slopes = (Slopes(e.astype(np.int64), p.astype(np.int64), s) for e, p, s in (values, rates))
        return RelaxedProgram(self._builder.build(lengths, snapshot_table(marks)), parameters, *slopes)


def build_relaxed_program(
    designs: Sequence[RelaxedDesign],
    terrain: Terrain,
    actuation: InflatableActuation = ACTUATION,
    ramp_steps: int | None = None,
    warm_up: int = 0,
    stages: int = 1,
    record_every: int | None = None,
    geometry: InflatableGeometry = PUBLISHED,
) -> RelaxedProgram:
    """The program of a batch of relaxed designs on a terrain; snapshots as of ``build_program``.

    Args:
        designs: gaits of one number of columns, all or none with core pressures per column.
        terrain: what they move on.
        actuation: how they are driven.
        ramp_steps: steps in which the core pressure first rises to the design's, linearly; so the length of a program
            does not depend on it. By default the published ramp, of a given rate. From 6000 steps on, the small robot
            is left as by the published one, within what noise of 1e-6 m does to it; 3000 shake it too much.
        warm_up: steps of the gait before snapshot 0, and the rest of the cycle in which they end: what it does first is
            not counted.
        stages: snapshots between the first and the second divide the gait in so many parts, see ``stage_starts``; they
            come after these two.
        record_every: steps between recorded poses.
        geometry: that they have; its cores count.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    parameters = Parameters.of(designs)
    ramp_steps = None if ramp_steps is None else whole_number("ramp_steps", ramp_steps, 1)
    warm_up, stages = whole_number("warm_up", warm_up, 0), whole_number("stages", stages, 1)
    actuation = actuation.on(terrain)
    recorder = Recorder(len(designs), sum(parameters.sizes))
    lengths, marks = [], []
    for robot, design in enumerate(designs):
        pressure, orientation, inflation, grip, core = parameters.variables(design)
        begin = actuation.initial_steps(highest_pressure(design.pressure), ramp_steps)
        each = tuple(pressure[number] for number in range(parameters.cores)) if parameters.cores > 1 else pressure
        cores = InflatedCores.of(each, geometry)
        pressures = core if parameters.shapes else None
        columns, steps = play_relaxed(inflation, grip, pressures, pressure, design.schedule, actuation)
        own = weights(terrain, orientation)
        write_robot(recorder, robot, cores, own, terrain, columns, begin, actuation, ramp_steps)
        if warm_up >= steps:
            raise ValueError(f"warm_up: {warm_up} is not allowed; a gait takes {steps} steps")
        lengths.append(begin + steps)
        _, end, *recorded = snapshot_steps(begin, begin + steps, record_every)
        starts = [column.start for column in columns[:: parameters.columns]]
        parts = [begin + start for start in stage_starts(starts, steps, warm_up, stages)]
        marks.append([parts[0], end, *parts[1:], *recorded])
    return recorder.build(lengths, marks, parameters)
