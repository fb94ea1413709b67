"""What happens to the inflatable robot over time: initialisation, then the columns of its gait schedule.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable_body import (
    BLADDER_COUNT,
    BLADDER_REGIONS,
    FIRST_BLADDER,
    FOOT_REGIONS,
    FOOT_SEAM,
    REGION_COUNT,
    SKIN_REGIONS,
)
from robots.schedule import GaitSchedule
from robots.terrain import Terrain
from taichi_sim.lattice import LatticeProgram, ProgramBuilder, Quantity

STANDARD_GRAVITY = 9.80665  # m/s^2
WEIGHTS = ("published", "physical")


class Design(Protocol):
    """What a program needs to know of a design."""

    @property
    def pressure(self) -> float:
        """Of the core [Pa]."""

    @property
    def orientation(self) -> float:
        """Heading [degrees]."""

    @property
    def schedule(self) -> GaitSchedule:
        """When bladders inflate and feet grip."""


@dataclass(frozen=True)
class InflatableActuation:
    """How the robot is driven. The defaults are those of the published experiment.

    Attributes:
        high_friction: of skin, seams and gripping feet, static and kinetic; bladders have a third of it.
        low_friction: of sliding feet.
        deflated, inflated: thickness of a bladder, in voxels per voxel.
        inflation_rate: change of that thickness per time step.
        widening: growth across the pouch per growth in thickness.
        lengthening_flat, lengthening_round: a bladder grows 1/c along the pouch per growth in thickness, with c
            rising linearly with core pressure from the first to the second.
        round_pressure: core pressure [Pa] at which c reaches ``lengthening_round``.
        pressure_ramp: rise of the core pressure per time step of the initialisation [Pa].
        hold_steps: steps at full pressure before the gait begins.
        settle_steps: steps between the end of one column's motion and the next column.
        moving_damping, settling_damping: damping ratio against the world while bladders move, and between.
        weight: "published": bladders have no weight while they move or stay inflated, a quirk of the experiment;
            "physical": they always have it.
    """

    high_friction: float = 2.0
    low_friction: float = 1e-4
    deflated: float = 0.2
    inflated: float = 2.5
    inflation_rate: float = 3e-4
    widening: float = 1 / 20
    lengthening_flat: float = 1.7
    lengthening_round: float = 10.0
    round_pressure: float = 12e3
    pressure_ramp: float = 0.5
    hold_steps: int = 2000
    settle_steps: int = 4001
    moving_damping: float = 0.002
    settling_damping: float = 0.01
    weight: str = "published"

    def __post_init__(self) -> None:
        if self.weight not in WEIGHTS:
            raise ValueError(f"weight: {self.weight!r} is unknown; choose one of {', '.join(WEIGHTS)}")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "weight" and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{field.name}: {value!r} is not allowed; it must not be negative")
        for name in (
            "deflated",
            "inflation_rate",
            "lengthening_flat",
            "lengthening_round",
            "pressure_ramp",
            "round_pressure",
        ):
            if getattr(self, name) == 0:
                raise ValueError(f"{name}: 0 is not allowed; it must be positive")
        if self.inflated <= self.deflated:
            raise ValueError(f"inflated: {self.inflated!r} is not allowed; it must exceed deflated, {self.deflated!r}")

    def on(self, terrain: Terrain) -> "InflatableActuation":
        """The same with the terrain's friction."""
        given = {"high_friction": terrain.high_friction, "low_friction": terrain.low_friction}
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return InflatableActuation(**values | {k: v for k, v in given.items() if v is not None})

    def initial_steps(self, pressure: float) -> int:
        """Steps of the initialisation: a ramp from 0 Pa in steps of ``pressure_ramp``, then the hold."""
        return self._ramp_steps(pressure) + self.hold_steps

    def _ramp_steps(self, pressure: float) -> int:
        return math.floor(pressure / self.pressure_ramp) + 1


ACTUATION = InflatableActuation()


@lru_cache(maxsize=4096)
def stroke(actuation: InflatableActuation, level: float, inflate: bool) -> tuple[int, float]:
    """Steps that a bladder of this thickness still changes when told to inflate or deflate, and its last thickness.

    Counted by repeated addition, as the experiment did: rounding decides between 7667 and 7668 steps.
    """
    if (level >= actuation.inflated) if inflate else (level <= actuation.deflated):
        return 0, level
    rate = actuation.inflation_rate if inflate else -actuation.inflation_rate
    span = actuation.inflated - level if inflate else level - actuation.deflated
    path = np.full(math.ceil(span / actuation.inflation_rate) + 3, rate)
    path[0] = level
    path = np.add.accumulate(path)
    steps = int(np.argmax(path >= actuation.inflated if inflate else path <= actuation.deflated))
    return steps, float(path[steps])


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a schedule as it is played.

    Attributes:
        bits: state of the ten actuators, shape (10,).
        start: step of the gait at which it begins.
        levels: thickness of the bladders when it begins, shape (8,).
        moving: steps that each bladder changes, shape (8,).
        ends: thickness of the bladders when it ends, shape (8,).
    """

    bits: np.ndarray
    start: int
    levels: np.ndarray
    moving: np.ndarray
    ends: np.ndarray

    @property
    def motion_steps(self) -> int:
        """A bladder is found done in a step in which it no longer changes, and that step is run too."""
        return int(self.moving.max()) + 1


def play(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> tuple[list[Column], int]:
    """The columns of a schedule in the order played, and the steps of the whole gait."""
    columns, step = [], 0
    levels = np.full(BLADDER_COUNT, actuation.deflated)
    for bits in schedule.played.T:
        strokes = [stroke(actuation, level, bool(bit)) for level, bit in zip(levels.tolist(), bits, strict=False)]
        column = Column(bits, step, levels, np.array([s for s, _ in strokes]), np.array([z for _, z in strokes]))
        columns.append(column)
        levels, step = column.ends, step + column.motion_steps + actuation.settle_steps
    return columns, step


@lru_cache(maxsize=256)
def nominal_steps(columns: int, actuation: InflatableActuation = ACTUATION) -> int:
    """Steps of a gait in which every column moves a full stroke: 186,719 for the published 16 columns."""
    alternating = np.zeros((10, columns), bool)
    alternating[0, ::2] = True
    return play(GaitSchedule(alternating, repeats=1), actuation)[1]


def gravity_vector(slope: float, orientation: float) -> np.ndarray:
    """Acceleration [m/s^2] on a plane tilted by ``slope`` degrees for a robot that heads ``orientation`` degrees."""
    tilt, heading = math.radians(180 + slope), math.radians(orientation)
    direction = (math.sin(tilt) * math.cos(heading), math.sin(tilt) * math.sin(heading), math.cos(tilt))
    return STANDARD_GRAVITY * np.array(direction)


def build_program(
    designs: Sequence[Design],
    terrain: Terrain,
    actuation: InflatableActuation = ACTUATION,
    record_every: int | None = None,
) -> LatticeProgram:
    """The program of a batch of designs on a terrain.

    Snapshot 0 is the end of the initialisation, snapshot 1 the end of the gait; with ``record_every`` the poses every
    so many steps from the end of the initialisation follow.
    """
    actuation = actuation.on(terrain)
    builder = ProgramBuilder(len(designs))
    lengths, marks = [], []
    for robot, design in enumerate(designs):
        begin = actuation.initial_steps(design.pressure)
        columns, steps = play(design.schedule, actuation)
        tilted = gravity_vector(terrain.slope, design.orientation)
        _initialise(builder, robot, design.pressure, tilted, begin, actuation)
        for number, column in enumerate(columns):
            _play_column(builder, robot, column, begin, design.pressure, tilted, number == 0, actuation)
        lengths.append(begin + steps)
        recorded = range(begin, begin + steps + 1, record_every) if record_every else ()
        marks.append([begin, begin + steps, *recorded])
    snapshots = np.full((len(designs), max(map(len, marks))), -1)
    for row, steps_of in zip(snapshots, marks, strict=True):
        row[: len(steps_of)] = steps_of
    return builder.build(lengths, snapshots)


def _set_friction(builder: ProgramBuilder, robot: int, value: ArrayLike, regions: ArrayLike, step: int) -> None:
    for quantity in (Quantity.STATIC_FRICTION, Quantity.KINETIC_FRICTION):
        builder.set(quantity, value, regions=regions, step=step, robots=robot)


def _set_weight(builder: ProgramBuilder, robot: int, gravity: np.ndarray, regions: ArrayLike, step: ArrayLike) -> None:
    for axis in range(3):
        builder.set(Quantity.ACCELERATION + axis, gravity[axis], regions=regions, step=step, robots=robot)


def _initialise(
    builder: ProgramBuilder, robot: int, pressure: float, tilted: np.ndarray, end: int, a: InflatableActuation
) -> None:
    """Skin under level gravity until ``end``, bladders under the tilted one at once; the core pressure ramps up."""
    _set_weight(builder, robot, np.array([0.0, 0.0, -STANDARD_GRAVITY]), SKIN_REGIONS, 0)
    _set_weight(builder, robot, tilted, SKIN_REGIONS, end)
    _set_weight(builder, robot, tilted, BLADDER_REGIONS, 0)
    builder.set(Quantity.SCALE + 2, a.deflated, regions=BLADDER_REGIONS, robots=robot)
    builder.set(Quantity.PRESSURE, 0.0, rate=a.pressure_ramp, regions=SKIN_REGIONS, robots=robot)
    builder.set(Quantity.PRESSURE, pressure, regions=SKIN_REGIONS, step=end - a.hold_steps, robots=robot)
    _set_friction(builder, robot, a.high_friction, SKIN_REGIONS, 0)
    _set_friction(builder, robot, a.low_friction, FOOT_SEAM, 0)
    _set_friction(builder, robot, a.high_friction / 3, BLADDER_REGIONS, 0)
    builder.set(Quantity.GLOBAL_DAMPING, 0.0, regions=np.arange(REGION_COUNT), robots=robot)


def _play_column(builder: ProgramBuilder, robot: int, column: Column, begin: int, pressure: float, tilted: np.ndarray,
                 first: bool, a: InflatableActuation) -> None:  # fmt: skip
    """Bladders change together, each until it is done; then everything settles with gripping feet."""
    step = begin + column.start
    everywhere = np.arange(REGION_COUNT)
    builder.set(Quantity.GLOBAL_DAMPING, a.moving_damping, regions=everywhere, step=step, robots=robot)
    grip = np.where(column.bits[BLADDER_COUNT:], a.high_friction, a.low_friction)
    _set_friction(builder, robot, grip, FOOT_REGIONS, step)
    _set_friction(builder, robot, a.low_friction if first else a.high_friction, FOOT_SEAM, step)
    inflates = column.bits[:BLADDER_COUNT]
    moves = np.flatnonzero(column.moving)
    done = step + column.moving[moves]
    rate = np.where(inflates[moves], a.inflation_rate, -a.inflation_rate)
    regions = FIRST_BLADDER + moves
    for axis, share in enumerate(_growth(pressure, a)):
        base = 1.0 - share * a.deflated if axis < 2 else 0.0
        grown = base + share * (column.levels[moves] + rate)
        builder.set(Quantity.SCALE + axis, grown, rate=share * rate, regions=regions, step=step, robots=robot)
        builder.set(Quantity.SCALE + axis, base + share * column.ends[moves], regions=regions, step=done, robots=robot)
    if a.weight == "published":
        lifted = np.flatnonzero(inflates | (column.moving > 0))
        _set_weight(builder, robot, np.zeros(3), FIRST_BLADDER + lifted, step)
        fallen = np.flatnonzero(~inflates)
        _set_weight(builder, robot, tilted, FIRST_BLADDER + fallen, step + column.moving[fallen])
    settle = step + column.motion_steps
    builder.set(Quantity.GLOBAL_DAMPING, a.settling_damping, regions=everywhere, step=settle, robots=robot)
    _set_friction(builder, robot, a.high_friction, [*FOOT_REGIONS, FOOT_SEAM], settle)


def _growth(pressure: float, a: InflatableActuation) -> tuple[float, float, float]:
    """Growth of a bladder per growth in thickness: across, along, through."""
    along = a.lengthening_flat + (a.lengthening_round - a.lengthening_flat) * pressure / a.round_pressure
    return a.widening, 1 / along, 1.0
