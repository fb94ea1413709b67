"""Programs of batches of inflatable designs, and how their events change with the designs.

Derivatives are those of the events' values and rates; their steps are whole and stay. So they are piecewise: where a
bladder arrives with a whole step, they are those of one side. Where it is told the same as before it moves by |change|
of a level, whose derivative is taken as 0, the mean of both sides. The published ramp of the core pressure takes longer
to a higher pressure; its derivative by pressure is that of the value it ends with.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.cores import Scalar, highest_pressure
from robots.inflatable.design import InflatableDesign
from robots.inflatable.events import RobotEvents
from robots.inflatable.schedule import BLADDERS, ROWS
from robots.inflatable.timing import play, stage_starts
from robots.world import Terrain, one_each
from taichi_sim.autodiff.dual import Dual, Real, slope_of, value_of, variables
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.lattice import LatticeProgram, ProgramBuilder


@dataclass(frozen=True)
class Counting:
    """Which part of a gait counts, and how it is divided.

    Attributes:
        warm_up: time steps of the gait before its distance begins to count, and the rest of the cycle in which they
            end.
        stages: equally long parts of which distances are known, see ``timing.stage_starts``.
    """

    warm_up: int = 0
    stages: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "warm_up", whole_number("warm_up", self.warm_up, 0))
        object.__setattr__(self, "stages", whole_number("stages", self.stages, 1))


WHOLE = Counting()


@dataclass(frozen=True, eq=False)
class DesignGradient:
    """Derivatives of one number per robot by its design.

    Attributes:
        pressure: by the core pressure [1/Pa], shape (B,); by that of each core, shape (B, N), where designs have
            several.
        orientation: by the heading [1/degree], shape (B,).
        inflation: by the levels of the bladders, shape (B, 8, T).
        grip: by the levels of the feet, shape (B, 2, T).
        core_pressure: by the core pressure of the columns [1/Pa], shape (B, T); None where the gait has none.
    """

    pressure: Floats
    orientation: Floats
    inflation: Floats
    grip: Floats
    core_pressure: Floats | None


@dataclass(frozen=True)
class Parameters:
    """The numbers of one robot's design in a row: pressures, orientation, levels, core pressures of columns.

    Attributes:
        columns: T.
        shapes: whether columns have core pressures.
        cores: how many core pressures designs have; 1 where it is one for all.
    """

    columns: int
    shapes: bool
    cores: int = 1

    @classmethod
    def of(cls, designs: Sequence[InflatableDesign]) -> "Parameters":
        """The parameters that all designs of a batch have.

        Raises:
            ValueError: if designs have different ones.
        """
        kinds = {cls(d.schedule.columns, d.schedule.core_pressure is not None, np.size(d.pressure)) for d in designs}
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
        return [self.cores, 1, ROWS * self.columns, self.columns * self.shapes]

    def variables(self, design: InflatableDesign) -> list[Dual]:
        """The parts of a design as variables; the last is empty without core pressures."""
        gait, count = design.schedule, sum(self.sizes)
        core = np.zeros(0) if gait.core_pressure is None else gait.core_pressure
        parts = [np.array(design.pressure), np.array(design.orientation), gait.levels, core]
        first = np.cumsum([0, *self.sizes[:-1]])
        return [variables(part, int(place), count) for part, place in zip(parts, first, strict=True)]

    def split(self, gradient: Floats) -> DesignGradient:
        """A gradient from rows of shape (B, number of parameters)."""
        pressure, orientation, levels, core = np.split(gradient, np.cumsum(self.sizes[:-1]), axis=1)
        levels = levels.reshape(-1, ROWS, self.columns)
        return DesignGradient(
            pressure[:, 0] if self.cores == 1 else pressure,
            orientation[:, 0],
            levels[:, :BLADDERS],
            levels[:, BLADDERS:],
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
class DifferentiableProgram:
    """A program, and the derivatives of its events by the designs.

    Attributes:
        program: see :func:`build_program`.
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
            ValueError: if a shape is another.
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
    """A ``ProgramBuilder`` that takes numbers with derivatives too, and keeps these."""

    def __init__(self, robot_count: int, parameter_count: int = 0) -> None:
        """Start an empty program for robots of so many parameters each."""
        self.builder = ProgramBuilder(robot_count)
        self._parameters, self._events = parameter_count, 0
        self._entries: tuple[list[Floats], list[Floats]] = ([np.zeros((3, 0))], [np.zeros((3, 0))])

    def set(
        self, quantity: int, value: Scalar, *, regions: ArrayLike, step: ArrayLike = 0, rate: Scalar = 0.0, robots: int
    ) -> None:
        """Let channels of one robot take a value at a step, see ``ProgramBuilder.set``."""
        self.builder.set(quantity, value_of(value), regions=regions, step=step, rate=value_of(rate), robots=robots)
        count = np.size(regions)
        for number, entries in zip((value, rate), self._entries, strict=True):
            if not isinstance(number, Dual):
                continue
            slope = slope_of(number)
            slope = np.broadcast_to(slope, (count, slope.shape[-1]))
            event, parameter = np.nonzero(slope)
            place = self._events + event, robots * self._parameters + parameter
            entries.append(np.array([*place, slope[event, parameter]]))
        self._events += count

    def slopes(self) -> tuple[Slopes, Slopes]:
        """Derivatives of the values and of the rates of all events."""
        values, rates = (np.concatenate(entries, axis=1) for entries in self._entries)
        return Slopes(*_indices(values[:2]), values[2]), Slopes(*_indices(rates[:2]), rates[2])


def _indices(numbers: Floats) -> tuple[Ints, Ints]:
    event, parameter = numbers.astype(np.int64)
    return event, parameter


def build_program(
    designs: Sequence[InflatableDesign],
    terrain: Terrain | Sequence[Terrain],
    actuation: InflatableActuation = ACTUATION,
    record_every: int | None = None,
    geometry: InflatableGeometry = PUBLISHED,
    counting: Counting = WHOLE,
) -> LatticeProgram:
    """The program of a batch of designs on a terrain, or on one each.

    Snapshot 0 is the end of the initialisation and of the warm-up, snapshot 1 the end of the gait; the ends of all
    stages but the last follow; with ``record_every``, the poses every so many steps from the end of the initialisation.

    Raises:
        ValueError: if a gait is not longer than the warm-up.
    """
    recorder = Recorder(len(designs))
    numbers = [(d.pressure, d.orientation, d.schedule.levels, d.schedule.core_pressure) for d in designs]
    return _build(recorder, designs, numbers, terrain, actuation, record_every, geometry, counting)


def build_differentiable_program(
    designs: Sequence[InflatableDesign],
    terrain: Terrain | Sequence[Terrain],
    actuation: InflatableActuation = ACTUATION,
    geometry: InflatableGeometry = PUBLISHED,
    counting: Counting = WHOLE,
) -> DifferentiableProgram:
    """The program of :func:`build_program` with its derivatives.

    Raises:
        ValueError: if designs differ in their numbers of columns, or some have core pressures that others have not.
    """
    parameters = Parameters.of(designs)
    recorder = Recorder(len(designs), sum(parameters.sizes))
    numbers = []
    for design in designs:
        pressure, orientation, levels, core = parameters.variables(design)
        each = tuple(pressure[number] for number in range(parameters.cores)) if parameters.cores > 1 else pressure
        numbers.append((each, orientation, levels, core if parameters.shapes else None))
    program = _build(recorder, designs, numbers, terrain, actuation, None, geometry, counting)
    return DifferentiableProgram(program, parameters, *recorder.slopes())


# Pressure of the core or cores, orientation, levels, core pressures of columns.
Numbers = tuple[Scalar | tuple[Scalar, ...], Scalar, Real, Real | None]


def _build(
    recorder: Recorder,
    designs: Sequence[InflatableDesign],
    numbers: Sequence[Numbers],
    terrain: Terrain | Sequence[Terrain],
    actuation: InflatableActuation,
    record_every: int | None,
    geometry: InflatableGeometry,
    counting: Counting,
) -> LatticeProgram:
    """Write the events of designs whose numbers may carry derivatives."""
    lengths, marks = [], []
    for robot, (design, ground) in enumerate(zip(designs, one_each(terrain, len(designs)), strict=True)):
        pressure, orientation, levels, core = numbers[robot]
        begin = actuation.initial_steps(highest_pressure(design.pressure))
        pressures = None if core is None or isinstance(pressure, tuple) else (pressure, core)
        columns, steps = play(design.schedule, actuation, told=levels, core=pressures)
        if counting.warm_up >= steps:
            raise ValueError(f"warm_up: {counting.warm_up} is not allowed; a gait takes {steps} steps")
        events = RobotEvents.of(recorder, robot, pressure, orientation, ground, actuation, geometry)
        events.initialise(begin)
        events.play(columns, begin)
        starts = [column.start for column in columns[:: design.schedule.columns]]
        first, *others = (begin + start for start in stage_starts(starts, steps, counting.warm_up, counting.stages))
        end = begin + steps
        lengths.append(end)
        marks.append([first, end, *others, *(range(begin, end + 1, record_every) if record_every else ())])
    return recorder.builder.build(lengths, snapshot_table(marks))


def snapshot_table(marks: Sequence[Sequence[int]]) -> Ints:
    """Steps of snapshots of robots with different numbers of them, shape (B, S); rows end with -1."""
    table = np.full((len(marks), max(map(len, marks))), -1)
    for row, steps in zip(table, marks, strict=True):
        row[: len(steps)] = steps
    return table
