"""What happens to the inflatable robot over time: initialisation, then the columns of its gait schedule.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, Column, InflatableActuation, play
from robots.inflatable.body import (
    BLADDER_COUNT,
    BLADDER_REGIONS,
    FIRST_BLADDER,
    FOOT_REGIONS,
    FOOT_SEAM,
    PUBLISHED,
    SKIN_REGIONS,
    InflatableGeometry,
    skin_regions,
)
from robots.inflatable.cores import InflatedCores, Pressure, Scalar, highest_pressure
from robots.inflatable.schedule import GaitSchedule
from robots.world import NO_WEIGHT, Terrain, Vector, one_each, weights
from taichi_sim.autodiff.dual import Real, value_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeProgram, ProgramBuilder, Quantity


class Design(Protocol):
    """What a program needs to know of a design."""

    @property
    def pressure(self) -> Pressure:
        """Of the cores [Pa]."""

    @property
    def orientation(self) -> float:
        """Heading [degrees]."""

    @property
    def schedule(self) -> GaitSchedule:
        """When bladders inflate and feet grip."""


class Builder(Protocol):
    """Where events go: a ``ProgramBuilder``, or one that keeps derivatives too."""

    def set(
        self,
        quantity: int,
        value: Any,
        *,
        regions: ArrayLike,
        step: ArrayLike = 0,
        rate: Any = 0.0,
        robots: int,
    ) -> None:
        """See ``ProgramBuilder.set``."""


def immerse(builder: Any, terrain: Terrain, **where: Any) -> None:
    """Have the terrain's fluid, if there is one, resist some regions of some robots."""
    if terrain.is_fluid:
        for part, resistance in enumerate(terrain.resistance):
            builder.set(Quantity.RESISTANCE + part, resistance, **where)


def build_program(
    designs: Sequence[Design],
    terrain: Terrain | Sequence[Terrain],
    actuation: InflatableActuation = ACTUATION,
    record_every: int | None = None,
    geometry: InflatableGeometry = PUBLISHED,
) -> LatticeProgram:
    """The program of a batch of designs on a terrain, or on one each.

    Snapshot 0 is the end of the initialisation, snapshot 1 the end of the gait; with ``record_every`` the poses every
    so many steps from the end of the initialisation follow.
    """
    builder = ProgramBuilder(len(designs))
    lengths, marks = [], []
    for robot, (design, ground) in enumerate(zip(designs, one_each(terrain, len(designs)), strict=True)):
        driven = actuation.on(ground)
        begin = driven.initial_steps(highest_pressure(design.pressure))
        columns, steps = play(design.schedule, driven)
        own, cores = weights(ground, design.orientation), InflatedCores.of(design.pressure, geometry)
        write_robot(builder, robot, cores, own, ground, columns, begin, driven)
        lengths.append(begin + steps)
        marks.append(snapshot_steps(begin, begin + steps, record_every))
    return builder.build(lengths, snapshot_table(marks))


def snapshot_steps(begin: int, end: int, record_every: int | None) -> list[int]:
    """The steps after which poses of a gait are kept: its first, its last, then every so many."""
    return [begin, end, *(range(begin, end + 1, record_every) if record_every else ())]


def snapshot_table(marks: Sequence[Sequence[int]]) -> Ints:
    """The same for all robots, shape (B, S); rows end with -1."""
    table = np.full((len(marks), max(map(len, marks))), -1)
    for row, steps in zip(table, marks, strict=True):
        row[: len(steps)] = steps
    return table


def write_robot(
    builder: Builder,
    robot: int,
    cores: InflatedCores,
    own: tuple[Vector, Vector],
    terrain: Terrain,
    columns: list[Column],
    begin: int,
    a: InflatableActuation,
    ramp_steps: int | None = None,
) -> None:
    """The events of one robot of these :func:`weights`: initialisation until step ``begin``, then its columns."""
    initialise(builder, robot, cores, own, begin, a, ramp_steps)
    immerse(builder, terrain, regions=cores.everywhere, robots=robot)
    for number, column in enumerate(columns):
        write_column(builder, robot, cores, own[1], column, begin + column.start, number == 0, a)


def write_column(
    builder: Builder,
    robot: int,
    cores: InflatedCores,
    tilted: Vector,
    column: Column,
    step: int,
    first: bool,
    a: InflatableActuation,
) -> None:
    """The events of one column, which begins at ``step``: motion, then settling."""
    _set_surroundings(builder, robot, cores, column, step, first, a)
    _move_bladders(builder, robot, column, step, cores.mean, a)
    if a.weight == "published":
        _set_bladder_weights(builder, robot, column, step, tilted)
    settle = step + column.motion_steps
    builder.set(Quantity.GLOBAL_DAMPING, a.settling_damping, regions=cores.everywhere, step=settle, robots=robot)
    _set_friction(builder, robot, a.high_friction, cores.skin([*FOOT_REGIONS, FOOT_SEAM]), settle)


def _set_friction(builder: Builder, robot: int, value: Scalar, regions: ArrayLike, step: int) -> None:
    for quantity in (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION):
        builder.set(quantity, value, regions=regions, step=step, robots=robot)


def set_weight(builder: Builder, robot: int, gravity: Vector, regions: ArrayLike, step: ArrayLike) -> None:
    """Give regions an acceleration [m/s^2] from a step on."""
    for axis in range(3):
        builder.set(Quantity.ACCELERATION + axis, gravity[axis], regions=regions, step=step, robots=robot)


def initialise(
    builder: Builder,
    robot: int,
    cores: InflatedCores,
    own: tuple[Vector, Vector],
    end: int,
    a: InflatableActuation,
    ramp_steps: int | None = None,
) -> None:
    """Skin under level gravity until ``end``, bladders under the tilted one at once; the core pressures ramp up."""
    (level, tilted), skin = own, cores.skin(SKIN_REGIONS)
    set_weight(builder, robot, level, skin, 0)
    set_weight(builder, robot, tilted, skin, end)
    set_weight(builder, robot, tilted, BLADDER_REGIONS, 0)
    builder.set(Quantity.SCALE + 2, a.deflated, regions=BLADDER_REGIONS, robots=robot)
    _inflate_cores(builder, robot, cores, end - a.hold_steps, a, ramp_steps)
    _set_friction(builder, robot, a.high_friction, skin, 0)
    _set_friction(builder, robot, a.low_friction, cores.skin(FOOT_SEAM), 0)
    _set_friction(builder, robot, a.high_friction / 3, BLADDER_REGIONS, 0)
    builder.set(Quantity.GLOBAL_DAMPING, 0.0, regions=cores.everywhere, robots=robot)


def _inflate_cores(
    builder: Builder, robot: int, cores: InflatedCores, full: int, a: InflatableActuation, ramp_steps: int | None
) -> None:
    """All cores at the same rate, each until its own pressure, the highest by step ``full``; or all by that step."""
    ramps = [a.initial_steps(float(value_of(pressure)), ramp_steps) for pressure in cores.each]
    for core, (pressure, ramp) in enumerate(zip(cores.each, ramps, strict=True)):
        skin = skin_regions(SKIN_REGIONS, core)
        rate = a.pressure_ramp if ramp_steps is None else pressure / ramp_steps
        builder.set(Quantity.PRESSURE, 0.0, rate=rate, regions=skin, robots=robot)
        builder.set(Quantity.PRESSURE, pressure, regions=skin, step=full - (max(ramps) - ramp), robots=robot)


def stand_on(
    builder: Builder,
    robot: int,
    cores: InflatedCores,
    tilted: Vector,
    carried: Floats,
    step: int,
    a: InflatableActuation,
) -> None:
    """Change the ground under a robot at a step: weights of skin and bladders, and the friction of both.

    Bladders carry a part of their weight, shape (8,). Friction of feet is up to the columns.
    """
    skin = cores.skin(SKIN_REGIONS)
    set_weight(builder, robot, tilted, skin, step)
    share = np.ones(BLADDER_COUNT) if a.weight == "physical" else carried
    set_weight(builder, robot, _times(share, tilted), BLADDER_REGIONS, step)
    _set_friction(builder, robot, a.high_friction, skin, step)
    _set_friction(builder, robot, a.high_friction / 3, BLADDER_REGIONS, step)


def _set_surroundings(
    builder: Builder, robot: int, cores: InflatedCores, column: Column, step: int, first: bool, a: InflatableActuation
) -> None:
    """What a column's motion begins with: damping, grip of the feet, change of the pressure of all cores."""
    builder.set(Quantity.GLOBAL_DAMPING, a.moving_damping, regions=cores.everywhere, step=step, robots=robot)
    grip = (1.0 - column.grip) * a.low_friction + column.grip * a.high_friction
    for core in range(len(cores.each)):
        _set_friction(builder, robot, grip, skin_regions(FOOT_REGIONS, core), step)
    _set_friction(builder, robot, a.low_friction if first else a.high_friction, cores.skin(FOOT_SEAM), step)
    if column.pressures:
        before, after = column.pressures
        rate, settle = (after - before) / column.motion_steps, step + column.motion_steps
        skin = cores.skin(SKIN_REGIONS)
        builder.set(Quantity.PRESSURE, before + rate, rate=rate, regions=skin, step=step, robots=robot)
        builder.set(Quantity.PRESSURE, after, regions=skin, step=settle, robots=robot)


def _move_bladders(
    builder: Builder, robot: int, column: Column, step: int, pressure: Scalar, a: InflatableActuation
) -> None:
    """Bladders change together, each until it is done."""
    moves, arrives = np.flatnonzero(column.moving), np.flatnonzero(column.arrives)
    done = step + column.moving[arrives]
    rate = column.direction * a.inflation_rate
    for axis, share in enumerate(_growth(pressure, a)):
        if axis == 1 and column.pressures:
            _lengthen(builder, robot, column, step, a)
            continue
        base = 1.0 - share * a.deflated if axis < 2 else 0.0
        grown, ends = base + share * (column.levels + rate), base + share * column.ends
        builder.set(
            Quantity.SCALE + axis,
            grown[moves],
            rate=(share * rate)[moves],
            regions=FIRST_BLADDER + moves,
            step=step,
            robots=robot,
        )
        builder.set(Quantity.SCALE + axis, ends[arrives], regions=FIRST_BLADDER + arrives, step=done, robots=robot)


def _lengthen(builder: Builder, robot: int, column: Column, step: int, a: InflatableActuation) -> None:
    """Lengths of bladders while the core pressure changes: by the law at the beginning, on arrival and in the end.

    In between they change linearly, as channels do.
    """
    assert column.pressures and column.arrival is not None
    before, after = column.pressures
    time = column.arrival + column.moving.astype(float)
    moves, along = np.flatnonzero(column.moving), Quantity.SCALE + 1
    pressures = (before, before + (after - before) * (time / column.motion_steps), after)
    levels = (column.levels, column.ends, column.ends)
    start, arrived, end = (
        1.0 + _growth(p, a)[1] * (level - a.deflated) for p, level in zip(pressures, levels, strict=True)
    )
    rate = (arrived - start)[moves] / time[moves]
    builder.set(along, start[moves] + rate, rate=rate, regions=FIRST_BLADDER + moves, step=step, robots=robot)
    rate = (end - arrived) / (column.motion_steps - time)
    value = arrived + rate * (1.0 - column.arrival)
    builder.set(along, value, rate=rate, regions=BLADDER_REGIONS, step=step + column.moving, robots=robot)
    builder.set(along, end, regions=BLADDER_REGIONS, step=step + column.motion_steps, robots=robot)


def _set_bladder_weights(builder: Builder, robot: int, column: Column, step: int, tilted: Vector) -> None:
    """The published quirk: none while a bladder moves or is inflated; partly inflated, it has part of its weight.

    The step in which a bladder arrives is shared between the two, so that weight is continuous in the inflation.
    """
    lifted = np.flatnonzero((column.moving > 0) | ~column.lands)
    set_weight(builder, robot, NO_WEIGHT, FIRST_BLADDER + lifted, step)
    lands = np.flatnonzero(column.lands)
    done, regions = step + column.moving[lands], FIRST_BLADDER + lands
    carried = (1.0 - column.inflation)[lands]
    if column.arrival is not None:
        shared = carried * (1.0 - column.arrival[lands])
        set_weight(builder, robot, _times(shared, tilted), regions, done)
        done = done + 1
    set_weight(builder, robot, _times(carried, tilted), regions, done)


def _times(factor: Real | Floats, vector: Vector) -> Vector:
    return factor * vector[0], factor * vector[1], factor * vector[2]


def bladder_scales(pressure: float, levels: Floats, a: InflatableActuation) -> Floats:
    """Rest sizes of bladders of some thickness, shape (8,), in voxels per voxel: across, along, through, (8, 3).

    The pressure [Pa] is that which bladders feel, see ``InflatedCores``.
    """
    across, along, _ = (1.0 + np.asarray(share) * (levels - a.deflated) for share in _growth(pressure, a))
    return np.column_stack([across, along, levels])


def _growth(pressure: Scalar, a: InflatableActuation) -> Vector:
    """Growth of a bladder per growth in thickness: across, along, through."""
    along = a.lengthening_flat + (a.lengthening_round - a.lengthening_flat) * pressure / a.round_pressure
    return a.widening, 1 / along, 1.0
