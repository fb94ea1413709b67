"""How the inflatable robot is driven, and when: rates and friction, strokes of bladders, columns in time.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from robots.inflatable.body import BLADDER_COUNT
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain
from taichi_sim.autodiff.dual import Real
from taichi_sim.base.arrays import Bools, Floats, Ints

WEIGHTS = ("published", "physical")
PUBLISHED_COLUMNS = 16  # of a gait, 8 played twice
PUBLISHED_STEPS = 186_719  # that they take where bladders always move; what published speeds are counted by


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
            rising linearly with core pressure from the first to the second. Of several cores it is the mean of their
            pressures, weighted by the rows that each has under the bladders.
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
        """The same with the terrain's friction; in a fluid, that alone resists motion."""
        given = {"high_friction": terrain.high_friction, "low_friction": terrain.low_friction}
        if terrain.is_fluid:
            given |= {"moving_damping": 0.0, "settling_damping": 0.0}
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return InflatableActuation(**values | {k: v for k, v in given.items() if v is not None})

    def initial_steps(self, pressure: float, ramp_steps: int | None = None) -> int:
        """Steps of the initialisation: a ramp from 0 Pa in steps of ``pressure_ramp``, then the hold.

        Of several cores the highest pressure counts.

        With ``ramp_steps`` the ramp takes so many steps at any pressure.
        """
        published = math.floor(pressure / self.pressure_ramp) + 1
        return (published if ramp_steps is None else ramp_steps) + self.hold_steps


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
    """One column of a schedule as it is played. Numbers that a relaxed gait changes smoothly are ``Real``.

    Attributes:
        start: step of the gait at which it begins.
        motion_steps: steps until it settles.
        inflation: what the bladders are told, from 0 (deflate) to 1 (inflate), shape (8,).
        grip: of the feet, from 0 (slide) to 1 (grip), shape (2,).
        levels: thickness of the bladders when it begins, shape (8,).
        ends: thickness of the bladders when it ends, shape (8,).
        direction: 1 for bladders that grow, -1 for those that shrink, shape (8,).
        moving: steps in which each bladder changes at the full rate, shape (8,).
        arrives: bladders that are set to their ``ends`` after that, shape (8,).
        lands: bladders that take their weight back after that, shape (8,).
        arrival: part of a further step that each bladder needs to arrive, shape (8,); None where there is none.
        pressures: of the core when it begins and when it settles [Pa]; None where the design's is kept.
    """

    start: int
    motion_steps: int
    inflation: Real
    grip: Real
    levels: Real
    ends: Real
    direction: Floats
    moving: Ints
    arrives: Bools
    lands: Bools
    arrival: Real | None = None
    pressures: tuple[Real, Real] | None = None


def play(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> tuple[list[Column], int]:
    """The columns of a schedule in the order played, and the steps of the whole gait."""
    columns, step = [], 0
    levels = np.full(BLADDER_COUNT, actuation.deflated)
    for bits in schedule.played.T:
        column = column_of(bits, levels, step, actuation)
        columns.append(column)
        levels, step = np.asarray(column.ends, float), step + column.motion_steps + actuation.settle_steps
    return columns, step


def column_of(bits: Bools, levels: Floats, start: int, actuation: InflatableActuation) -> Column:
    """The column that begins at a step with bladders of some thickness, shape (8,), and tells them these ten bits."""
    inflates, told = bits[:BLADDER_COUNT], bits.astype(float)
    strokes = [stroke(actuation, level, bit) for level, bit in zip(levels.tolist(), inflates.tolist(), strict=True)]
    moving, ends = np.array([s for s, _ in strokes]), np.array([z for _, z in strokes])
    return Column(
        start=start,
        # A bladder is found done in a step in which it no longer changes, and that step is run too.
        motion_steps=int(moving.max()) + 1,
        inflation=told[:BLADDER_COUNT],
        grip=told[BLADDER_COUNT:],
        levels=levels,
        ends=ends,
        direction=np.where(inflates, 1.0, -1.0),
        moving=moving,
        arrives=moving > 0,
        lands=~inflates,
    )


@lru_cache(maxsize=256)
def nominal_steps(columns: int, actuation: InflatableActuation = ACTUATION) -> int:
    """Steps of a gait in which every column moves a full stroke: 186,719 for the published 16 columns."""
    alternating = np.zeros((10, columns), bool)
    alternating[0, ::2] = True
    return play(GaitSchedule(alternating, repeats=1), actuation)[1]
