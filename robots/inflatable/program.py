"""What happens to inflatable robots over time, as lattice programs: initialisation, then the columns of their gaits.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, InflatableActuation, each_actuation
from robots.inflatable.body import (
    BLADDER_COUNT,
    BLADDER_REGIONS,
    FIRST_BLADDER,
    FOOT_REGIONS,
    FOOT_SEAM,
    PUBLISHED,
    REGION_COUNT,
    SEAM,
    SKIN,
    SKIN_REGIONS,
    InflatableGeometry,
    skin_regions,
)
from robots.inflatable.design import InflatableDesign, each_pressure, highest_pressure
from robots.inflatable.numbers import Numbers, Scalar
from robots.inflatable.timing import WHOLE, Column, Counting, play, stage_starts
from robots.world import NO_WEIGHT, Terrain, Vector, one_each, weights
from taichi_sim.autodiff.arrays import Array, value_of
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeProgram, ProgramBuilder, Quantity


def build_program(
    designs: Sequence[InflatableDesign],
    terrain: Terrain | Sequence[Terrain],
    actuation: InflatableActuation | Sequence[InflatableActuation] = ACTUATION,
    record_every: int | None = None,
    geometry: InflatableGeometry = PUBLISHED,
    counting: Counting = WHOLE,
) -> LatticeProgram:
    """The program of a batch of designs on a terrain, or on one each; all with one actuation, or one each.

    Snapshot 0 is the end of the initialisation and of the warm-up, snapshot 1 the end of the gait; the ends of all
    stages but the last follow; then the beginning of the window, if there is one; with ``record_every``, the poses
    every so many steps from the end of the initialisation.

    Raises:
        ValueError: if a gait is not longer than the warm-up.
    """
    builder, lengths, marks = ProgramBuilder(len(designs)), [], []
    each = zip(designs, one_each(terrain, len(designs)), each_actuation(actuation, len(designs)), strict=True)
    for robot, (design, ground, drive) in enumerate(each):
        begin, columns, steps = write_gait(builder, robot, design, ground, drive, geometry)
        if counting.warm_up >= steps:
            raise ValueError(f"warm_up: {counting.warm_up} is not allowed; a gait takes {steps} steps")
        starts = [column.start for column in columns[:: design.schedule.columns]]
        first, *others = (begin + start for start in stage_starts(starts, steps, counting.warm_up, counting.stages))
        end = begin + steps
        lengths.append(end)
        windows = [begin + starts[-min(counting.window, len(starts))]] if counting.window else []
        marks.append([first, end, *others, *windows, *(range(begin, end + 1, record_every) if record_every else ())])
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
    own = numbers or Numbers.of(design)
    core, after = None, own.core_pressure
    if after is not None:
        before: Any = own.pressure  # one number, unless every core has pressures in columns
        core = (before if after.ndim == 1 else np.stack(each_pressure(before, geometry)), after)
    columns, steps = play(design.schedule, actuation, targets=own.levels, core=core, pace=own.pace)
    begin = actuation.initial_steps(highest_pressure(design.pressure))
    events = RobotEvents.of(
        builder, robot, own.pressure, own.orientation, terrain, actuation, geometry, own.friction, own.size
    )
    events.initialise(begin)
    events.play(columns, begin)
    return begin, columns, steps


@dataclass(frozen=True, eq=False)
class RobotEvents:
    """Writes the events of a robot of a batch, or of several that do the same, on a terrain.

    Numbers may be traced to carry derivatives.

    Attributes:
        builder: takes the events.
        robot: place in the batch, or places.
        cores: pressure of every core [Pa].
        felt: pressure that bladders feel [Pa]: they lie over all cores, and lengthen by the mean of the pressures, each
            weighted by the rows that the core has under bladders.
        gravity: on level ground, where the robot is put, and on the terrain [m/s^2].
        actuation: how the robot is driven on the terrain.
        terrain: what the robot is on.
        shares: of each core in what bladders feel.
        friction: of feet that grip, then of feet that slide, shape (2, 2); None is that of the actuation.
        skin_sizes: rest sizes of the skin of all cores across and along the pouch, in voxels; None is as built.
        bladder_sizes: of the bladders, relative, shape (2, 8); None is as built.
        absent: regions of bladders that the body does not have.
    """

    builder: ProgramBuilder
    robot: ArrayLike
    cores: tuple[Scalar, ...]
    felt: Scalar
    gravity: tuple[Vector, Vector]
    actuation: InflatableActuation
    terrain: Terrain
    shares: tuple[float, ...] = (1.0,)
    friction: Array | None = None
    skin_sizes: tuple[Array, Array] | None = None
    bladder_sizes: Array | None = None
    absent: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        builder: ProgramBuilder,
        robot: ArrayLike,
        pressure: Scalar | tuple[Scalar, ...],
        orientation: Scalar,
        terrain: Terrain,
        actuation: InflatableActuation = ACTUATION,
        geometry: InflatableGeometry = PUBLISHED,
        friction: Array | None = None,
        size: Array | None = None,
    ) -> "RobotEvents":
        """The events of a robot of a core pressure [Pa], or one each of several cores, and a heading [degrees].

        Args:
            builder: takes the events.
            robot: place in the batch, or places.
            pressure, orientation, friction, size: see ``Numbers``.
            terrain: what the robot is on.
            actuation: how it is driven.
            geometry: of its body.

        Raises:
            ValueError: if several pressures are not as many as the cores.
        """
        cores: tuple[Any, ...] = each_pressure(pressure, geometry)
        shares = tuple(geometry.bladder_shares)
        several = zip(shares, cores, strict=True)
        felt: Any = sum(share * one for share, one in several) if isinstance(pressure, tuple) else pressure
        more: dict[str, Any] = {"absent": geometry.absent_regions}
        if size is not None:
            skin = np.concatenate([skin_regions(SKIN_REGIONS, core) for core in range(len(cores))])
            built = geometry.rest_sizes(skin)
            more["skin_sizes"] = (built[0] * size[0][skin], built[1] * size[1][skin])
            more["bladder_sizes"] = size[:, BLADDER_REGIONS]
        tilt = weights(terrain, orientation)
        return cls(builder, robot, cores, felt, tilt, actuation.on(terrain), terrain, shares, friction, **more)

    @property
    def everywhere(self) -> Ints:
        """All regions of the robot."""
        every = np.concatenate([np.arange(REGION_COUNT), self.skin(SKIN_REGIONS)[len(SKIN_REGIONS) :]])
        return every[~np.isin(every, self.absent)]

    def skin(self, kinds: ArrayLike) -> Ints:
        """Regions of these kinds in all cores, core by core."""
        return np.concatenate([skin_regions(np.atleast_1d(kinds), core) for core in range(len(self.cores))])

    def initialise(self, end: int, inflate: bool = True) -> None:
        """Skin under level gravity until step ``end``, bladders under that of the terrain at once; cores inflate.

        Without ``inflate`` the pressure of the cores is left to the caller.
        """
        a, skin, (level, tilted) = self.actuation, self.skin(SKIN_REGIONS), self.gravity
        self._set_weight(level, skin, 0)
        self._set_weight(tilted, skin, end)
        self._set_weight(tilted, BLADDER_REGIONS, 0)
        self.set(Quantity.SCALE + 2, a.deflated, BLADDER_REGIONS)
        if inflate:
            self._inflate_cores(end - a.hold_steps)
        self._set_friction_of_skin(0)
        self.set_foot_seams(a.low_friction, 0)
        self._set_friction(a.friction_of_bladders, BLADDER_REGIONS, 0)
        if self.friction is not None:
            self._set_feet(self.friction[0], 0)
        if self.skin_sizes is not None and self.bladder_sizes is not None:
            for axis, sizes in enumerate(self.skin_sizes):
                self.set(Quantity.SCALE + axis, sizes, skin)
                self.set(Quantity.SCALE + axis, self.bladder_sizes[axis], BLADDER_REGIONS)
        self.set(Quantity.GLOBAL_DAMPING, 0.0, self.everywhere)
        if self.terrain.is_wet:
            for part, resistance in enumerate(self.terrain.resistance):
                self.set(Quantity.RESISTANCE + part, resistance, self.everywhere)

    def play(self, columns: Sequence[Column], begin: int, first: bool = True) -> None:
        """Columns one after the other, counted from step ``begin``; ``first`` if no column came before them."""
        for number, column in enumerate(columns):
            self.play_column(column, begin + column.start, first and number == 0)

    def play_column(self, column: Column, step: int, first: bool) -> None:
        """One column that begins at ``step``: motion, then settling."""
        a = self.actuation
        self._set_surroundings(column, step, first)
        self._move_bladders(column, step)
        if a.weight == "published":
            self._set_bladder_weights(column, step)
        settle = step + column.motion_steps
        self.set(Quantity.GLOBAL_DAMPING, a.settling_damping, self.everywhere, settle)
        if self.friction is None and a.seam_friction is None:
            self._set_friction(a.high_friction, self.skin([*FOOT_REGIONS, FOOT_SEAM]), settle)
        else:
            self.set_foot_seams(a.high_friction, settle)
            self._set_feet(a.high_friction if self.friction is None else self.friction[0], settle)

    def tilt_skin(self, step: int) -> None:
        """Have the skin feel the terrain's slope from a step on."""
        self._set_weight(self.gravity[1], self.skin(SKIN_REGIONS), step)

    def stand_on(self, carried: Floats, step: int) -> None:
        """Move a robot from another terrain to this one at a step: weights of skin and bladders, and their friction.

        Bladders carry a part of their weight, shape (8,). Friction of feet is up to the columns.
        """
        a, tilted = self.actuation, self.gravity[1]
        self._set_weight(tilted, self.skin(SKIN_REGIONS), step)
        share = np.ones(BLADDER_COUNT) if a.weight == "physical" else carried
        self._set_weight(_times(share, tilted), BLADDER_REGIONS, step)
        self._set_friction_of_skin(step)
        self._set_friction(a.friction_of_bladders, BLADDER_REGIONS, step)
        if self.friction is not None:
            self._set_feet(self.friction[0], step)

    def set_foot_seams(self, value: float, step: int) -> None:
        """Give seams within feet a friction, unless seams have one of their own."""
        own = self.actuation.seam_friction
        self._set_friction(value if own is None else own, self.skin(FOOT_SEAM), step)

    def set(self, quantity: int, value: Any, regions: ArrayLike, step: Any = 0, rate: Any = 0.0) -> None:
        """Write events of one channel each, see ``ProgramBuilder.set``, but none of bladders that are absent."""
        if self.absent:
            has = ~np.isin(regions, self.absent)
            value, step, rate = (each[..., has] if np.ndim(each) else each for each in (value, step, rate))
            regions = np.asarray(regions)[has]
        self.builder.set(quantity, value, regions=regions, step=step, rate=rate, robots=self.robot)

    def _set_friction(self, value: Any, regions: ArrayLike, step: int) -> None:
        for quantity in (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION):
            self.set(quantity, value, regions, step)

    def _set_friction_of_skin(self, step: int) -> None:
        """Give all skin the friction of gripping feet, or skin and seams that of their own."""
        a = self.actuation
        self._set_friction(a.high_friction, self.skin(SKIN_REGIONS), step)
        for own, kinds in ((a.skin_friction, [SKIN]), (a.seam_friction, [SEAM, FOOT_SEAM])):
            if own is not None:
                self._set_friction(own, self.skin(kinds), step)

    def _set_feet(self, value: Any, step: int) -> None:
        """Give the two feet a friction each, in all cores."""
        for core in range(len(self.cores)):
            self._set_friction(value, skin_regions(FOOT_REGIONS, core), step)

    def _set_weight(self, gravity: Vector, regions: ArrayLike, step: ArrayLike) -> None:
        """Give regions an acceleration [m/s^2] from a step on."""
        for axis in range(3):
            self.set(Quantity.ACCELERATION + axis, gravity[axis], regions, step)

    def _inflate_cores(self, full: int) -> None:
        """All cores at one rate, each until its own pressure, the highest by step ``full``; or all by that step."""
        a = self.actuation
        ramps = [a.initial_steps(float(value_of(pressure))) for pressure in self.cores]
        for core, (pressure, ramp) in enumerate(zip(self.cores, ramps, strict=True)):
            skin = skin_regions(SKIN_REGIONS, core)
            rate = a.pressure_ramp if a.ramp_steps is None else pressure / a.ramp_steps
            self.set(Quantity.PRESSURE, 0.0, skin, rate=rate)
            self.set(Quantity.PRESSURE, pressure, skin, full - (max(ramps) - ramp))

    def _set_surroundings(self, column: Column, step: int, first: bool) -> None:
        """What a column's motion begins with: damping, grip of the feet, change of the pressure of all cores."""
        a = self.actuation
        self.set(Quantity.GLOBAL_DAMPING, a.moving_damping, self.everywhere, step)
        high, low = (a.high_friction, a.low_friction) if self.friction is None else self.friction
        self._set_feet((1.0 - column.grip) * low + column.grip * high, step)
        self.set_foot_seams(a.low_friction if first else a.high_friction, step)
        if column.pressures:
            before, after = column.pressures
            rate, settle = (after - before) / column.motion_steps, step + column.motion_steps
            for skin, start, slope, end in self._pressed(before + rate, rate, after):
                self.set(Quantity.PRESSURE, start, skin, step, slope)
                self.set(Quantity.PRESSURE, end, skin, settle)

    def _pressed(self, *numbers: Any) -> list[tuple[Any, ...]]:
        """Regions of skin that share pressures, with the numbers that belong to them: all cores, or one each."""
        if np.ndim(numbers[0]) == 0:
            return [(self.skin(SKIN_REGIONS), *numbers)]
        cores = range(len(self.cores))
        return [(skin_regions(SKIN_REGIONS, core), *(each[core] for each in numbers)) for core in cores]

    def _felt(self, pressure: Any) -> Any:
        """Pressure that bladders feel, of that of all cores, or of each."""
        if np.ndim(pressure) == 0:
            return pressure
        return sum(share * pressure[core] for core, share in enumerate(self.shares))

    def _move_bladders(self, column: Column, step: int) -> None:
        """Bladders change together, each until it is done."""
        a, motion = self.actuation, column.motion
        moves, arrives = np.flatnonzero(motion.moving), np.flatnonzero(motion.arrives)
        done = step + motion.moving[arrives]
        rate = motion.direction * motion.rate
        for axis, share in enumerate(a.growth(self.felt)):
            if axis == 1 and column.pressures:
                self._lengthen(column, step)
                continue
            base = 1.0 - share * a.deflated if axis < 2 else 0.0
            grown, ends, slope = base + share * (motion.levels + rate), base + share * motion.ends, share * rate
            if axis < 2 and self.bladder_sizes is not None:
                grown, ends, slope = (self.bladder_sizes[axis] * each for each in (grown, ends, slope))
            self.set(Quantity.SCALE + axis, grown[moves], FIRST_BLADDER + moves, step, slope[moves])
            self.set(Quantity.SCALE + axis, ends[arrives], FIRST_BLADDER + arrives, done)

    def _lengthen(self, column: Column, step: int) -> None:
        """Lengths of bladders while the core pressure changes: by the law at the beginning, on arrival and in the end.

        In between they change linearly, as channels do.
        """
        assert column.pressures
        (before, after), motion, a = column.pressures, column.motion, self.actuation
        time = motion.arrival + motion.moving.astype(float)
        moves, along = np.flatnonzero(motion.moving), Quantity.SCALE + 1
        before, after = self._felt(before), self._felt(after)
        pressures = (before, before + (after - before) * (time / column.motion_steps), after)
        levels = (motion.levels, motion.ends, motion.ends)
        start, arrived, end = (
            1.0 + a.growth(p)[1] * (level - a.deflated) for p, level in zip(pressures, levels, strict=True)
        )
        rate = (arrived - start)[moves] / time[moves]
        self.set(along, start[moves] + rate, FIRST_BLADDER + moves, step, rate)
        rate = (end - arrived) / (column.motion_steps - time)
        self.set(along, arrived + rate * (1.0 - motion.arrival), BLADDER_REGIONS, step + motion.moving, rate)
        self.set(along, end, BLADDER_REGIONS, step + column.motion_steps)

    def _set_bladder_weights(self, column: Column, step: int) -> None:
        """The published quirk: no weight while a bladder moves or is inflated; partly inflated, a part of it.

        The step in which a bladder arrives is shared between the two, so that weight is continuous in the inflation.
        """
        motion, tilted = column.motion, self.gravity[1]
        self._set_weight(NO_WEIGHT, FIRST_BLADDER + np.flatnonzero(motion.moving), step)
        done, carried = step + motion.moving, 1.0 - column.inflation
        self._set_weight(_times(carried * (1.0 - motion.arrival), tilted), BLADDER_REGIONS, done)
        self._set_weight(_times(carried, tilted), BLADDER_REGIONS, done + 1)


def _times(factor: Array, vector: Vector) -> Vector:
    return factor * vector[0], factor * vector[1], factor * vector[2]
