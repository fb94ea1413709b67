"""Programs of batches of inflatable designs, and how their events change with the designs.

Derivatives are those of the events' values and rates; their steps are whole and stay. So they are piecewise: where a
bladder arrives with a whole step, they are those of one side. Where it is told the same as before it moves by |change|
of a level, whose derivative is taken as 0, the mean of both sides. The published ramp of the core pressure takes longer
to a higher pressure; its derivative by pressure is that of the value it ends with.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.cores import highest_pressure
from robots.inflatable.design import InflatableDesign
from robots.inflatable.events import RobotEvents, Scalar
from robots.inflatable.timing import Column, play, stage_starts
from robots.world import Terrain, one_each
from taichi_sim.autodiff.arrays import Array, trace
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import check_fields, whole_number
from taichi_sim.lattice import LatticeProgram, ProgramBuilder

# Pressure of the core or cores, orientation, levels, core pressures of columns.
Numbers = tuple[Scalar | tuple[Scalar, ...], Scalar, Array, Array | None]


@dataclass(frozen=True)
class Counting:
    """Which part of a gait counts, and how it is divided.

    Attributes:
        warm_up: time steps of the gait before its distance begins to count, and the rest of the cycle in which they
            end.
        stages: equally long parts of which distances are known, see ``timing.stage_starts``.
    """

    warm_up: Annotated[int, partial(whole_number, low=0)] = 0
    stages: Annotated[int, partial(whole_number, low=1)] = 1

    def __post_init__(self) -> None:
        check_fields(self)


WHOLE = Counting()


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
    builder, lengths, marks = ProgramBuilder(len(designs)), [], []
    for robot, (design, ground) in enumerate(zip(designs, one_each(terrain, len(designs)), strict=True)):
        begin, columns, steps = write_gait(builder, robot, design, ground, actuation, geometry)
        if counting.warm_up >= steps:
            raise ValueError(f"warm_up: {counting.warm_up} is not allowed; a gait takes {steps} steps")
        starts = [column.start for column in columns[:: design.schedule.columns]]
        first, *others = (begin + start for start in stage_starts(starts, steps, counting.warm_up, counting.stages))
        end = begin + steps
        lengths.append(end)
        marks.append([first, end, *others, *(range(begin, end + 1, record_every) if record_every else ())])
    snapshots = np.full((len(marks), max(map(len, marks))), -1)  # rows of robots with fewer end with -1
    for row, taken in zip(snapshots, marks, strict=True):
        row[: len(taken)] = taken
    return builder.build(lengths, snapshots)


def write_gait(
    builder: ProgramBuilder,
    robot: int,
    design: InflatableDesign,
    terrain: Terrain,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
    numbers: Numbers | None = None,
) -> tuple[int, list[Column], int]:
    """Write the events of a robot that is initialised and plays a gait.

    Args:
        builder: takes the events.
        robot: place in the batch.
        design: what is played.
        terrain: where.
        actuation: how the robot is driven.
        geometry: of the robot.
        numbers: of the design, traced to carry derivatives; its own by default.

    Returns:
        The step at which the gait begins, its columns as they are played, and its steps.
    """
    schedule = design.schedule
    own = (design.pressure, design.orientation, schedule.levels, schedule.core_pressure)
    pressure, orientation, levels, after = numbers or own
    before: Any = pressure  # one number, if columns have pressures
    columns, steps = play(schedule, actuation, told=levels, core=None if after is None else (before, after))
    begin = actuation.initial_steps(highest_pressure(design.pressure))
    events = RobotEvents.of(builder, robot, pressure, orientation, terrain, actuation, geometry)
    events.initialise(begin)
    events.play(columns, begin)
    return begin, columns, steps


class _Kept(ProgramBuilder):
    """Keeps the values and rates of events, which may be traced, and nothing else of them."""

    def __init__(self) -> None:
        super().__init__(1)
        self.values: list[Any] = []
        self.rates: list[Any] = []

    def set(
        self,
        quantity: int,
        value: Any,
        *,
        regions: ArrayLike,
        step: ArrayLike = 0,
        rate: Any = 0.0,
        robots: ArrayLike | None = None,
    ) -> None:
        """Keep the numbers of an event in each region."""
        for numbers, number in ((self.values, value), (self.rates, rate)):
            numbers.append(np.broadcast_to(number, np.size(regions)))


def pull_back(
    design: InflatableDesign,
    terrain: Terrain,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
    values: Floats,
    rates: Floats,
) -> tuple[Floats, ...]:
    """Derivatives of a cost by the numbers of a design, from those by its events.

    Args:
        design: of one robot.
        terrain, actuation, geometry: of its program.
        values: derivatives of the cost by the values of the robot's events, in their order in the program, shape (E,).
        rates: likewise by their rates.

    Returns:
        Derivatives by the pressure, shape () or (cores,), the orientation, shape (), the levels, shape (10, T), and the
        core pressures of the columns, shape (T,), if there are some.
    """

    def events(pressure: Any, orientation: Any, levels: Any, after: Any = None) -> tuple[Array, Array]:
        kept, each = _Kept(), tuple(pressure) if pressure.ndim else pressure
        write_gait(kept, 0, design, terrain, actuation, geometry, (each, orientation, levels, after))
        return np.concatenate(kept.values), np.concatenate(kept.rates)

    core = design.schedule.core_pressure
    numbers = (design.pressure, design.orientation, design.schedule.levels, *(() if core is None else (core,)))
    return trace(events, *numbers)[1](values, rates)


def check_alike(designs: Sequence[InflatableDesign]) -> None:
    """Refuse designs whose derivatives have different shapes.

    Raises:
        ValueError: if designs differ in their numbers of columns or core pressures, or some have core pressures of
            columns that others have not.
    """
    if len({np.size(design.pressure) for design in designs}) > 1:
        raise ValueError("designs: a mixture is not allowed; give all one core pressure, or all one a core")
    if len({(design.schedule.columns, design.schedule.core_pressure is None) for design in designs}) > 1:
        raise ValueError(
            "designs: a mixture is not allowed; give gaits of one number of columns, all or none with pressures"
        )
