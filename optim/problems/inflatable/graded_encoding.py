"""How a search writes a schedule by levels and times: gene by gene, as a pattern in space and time, or as a wave."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.problems.inflatable.body_genes import EMPTY_CORE
from optim.problems.inflatable.encoding import BIT_STEP, GaitEncoding
from optim.problems.inflatable.full_bladders import limited, slopes_before
from optim.problems.inflatable.gait_pattern import GAIT_WIRING, pattern
from optim.space import Variable
from robots.inflatable.actuation import ACTUATION, PUBLISHED_STEPS, InflatableActuation
from robots.inflatable.schedule import BLADDERS, ROWS, GaitSchedule
from robots.inflatable.timing import cycle_starts, most_repeats, play
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import whole_number

LEAST_MOTION = 100  # time steps of a column's motion; valves switch no faster
LEVEL_STEP = 0.2  # of a level, from -0.5 to 1.5
SLOWEST, PACE_END, PACE_STEP = 0.5, 1.5, 0.1  # of a pace; above 1 it is cut, so that full speed is easily kept
SETTLING, SETTLING_STEP = 4001, 800  # time steps; published columns settle for as many


@dataclass(frozen=True)
class GradedGait(GaitEncoding):
    """How far every bladder inflates in every column, whether feet grip, and how long the robot settles after each.

    Columns last as long as their slowest bladder moves, and ``LEAST_MOTION`` at least. The cycle is played as often as
    ``steps`` allow, see ``most_repeats``; ``repeats`` say nothing. Genes beyond empty and full, or of less than no
    time, are cut: so a search stays there easily.

    Attributes:
        steps: time steps that a gait may take.
        warm_up: time steps that do not count: a gait is played until a whole cycle after them does.
        actuation: how the robot is driven, which tells how long strokes take.
        cores: rows of core pressures of the columns, one for each core of the body, or none.
        paced: whether every bladder has a pace of its own in every column.
        most_full: bladders that may be full at a time, the sum of a column's levels; None is all. The levels of a
            column with more are scaled down, so every genome has a gait within it.
    """

    steps: int = PUBLISHED_STEPS
    warm_up: int = 0
    actuation: InflatableActuation = ACTUATION
    cores: int = 0
    paced: bool = False
    most_full: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("steps", self.steps, 1)

    def variables(self) -> list[Variable]:
        """Levels ``bladder1_1`` to ``bladder8_T``, bits ``foot1_1`` to ``foot2_T``, steps ``settle_1`` and on.

        Behind them core pressures ``core1_1`` to ``coreN_T`` and paces ``pace1_1`` to ``pace8_T``, where they are free.
        """
        columns = range(1, self.columns + 1)
        bladders, feet = GaitSchedule.row_names[:BLADDERS], GaitSchedule.row_names[BLADDERS:]
        return [
            *(Variable(f"{row}_{column}", -0.5, 1.5, step=LEVEL_STEP) for row in bladders for column in columns),
            *(Variable(f"{row}_{column}", 0, 1, "binary", step=BIT_STEP) for row in feet for column in columns),
            *self._times(),
            *(
                Variable(f"core{core}_{column}", EMPTY_CORE, 12_000.0, step=1200.0)
                for core in range(1, self.cores + 1)
                for column in columns
            ),
            *(
                Variable(f"pace{bladder}_{column}", SLOWEST, PACE_END, step=PACE_STEP)
                for bladder in range(1, 1 + BLADDERS * self.paced)
                for column in columns
            ),
        ]

    def _times(self) -> list[Variable]:
        """How long the robot settles after each column."""
        columns = range(1, self.columns + 1)
        return [Variable(f"settle_{column}", -SETTLING, SETTLING, step=SETTLING_STEP) for column in columns]

    def schedule(self, values: Floats) -> GaitSchedule:
        """The schedule of a genome, with feet that either grip or slide."""
        return self.relaxed(values, 0.0)

    def relaxed(self, values: Floats, sharpness: float) -> GaitSchedule:
        """The schedule with feet that may grip in part, sharpened; repeated as often as the steps allow."""
        gait, drive = self._graded(values), self.actuation
        repeats = most_repeats(gait, self.steps, drive)
        while self.warm_up and cycle_starts(dataclasses.replace(gait, repeats=repeats), drive)[-1] < self.warm_up:
            repeats += 1
        levels = np.concatenate([gait.inflation, gait.sharpened(sharpness).grip])
        return dataclasses.replace(gait, levels=levels, repeats=repeats)

    def slopes(self, values: Floats, sharpness: float, slopes: Floats, **others: Floats) -> Floats:
        """Derivatives by the genes: by levels that are not clipped, by grip through the sharpening; zero for times."""
        return np.concatenate(
            [
                self._by_levels(values, slopes[:BLADDERS]).ravel(),
                self._by_grip(values, sharpness, slopes[BLADDERS:]).ravel(),
                np.zeros(self.columns),
                *((np.where(within, others[name], 0.0)).ravel() for name, within in self._inside(values).items()),
            ]
        )

    def _by_levels(self, values: Floats, slopes: Floats) -> Floats:
        """Derivatives with respect to the inflation that genes encode, shape (8, T): zero where it is clipped."""
        inflation = self._present_tables(values)[0]
        by_levels = slopes_before(np.clip(inflation, 0.0, 1.0), slopes, self.most_full)
        return by_levels * ((inflation > 0) & (inflation < 1))

    def _by_grip(self, values: Floats, sharpness: float, slopes: Floats) -> Floats:
        """Derivatives with respect to the grip that genes encode, shape (2, T)."""
        return slopes * self._graded(values).sharpening_slope(sharpness)[BLADDERS:]

    @property
    def more_tables(self) -> tuple[str, ...]:
        """Core pressures and paces of the columns, where they are free."""
        return ("core_pressure",) * (self.cores > 0) + ("pace",) * self.paced

    def _own(self, values: Floats) -> dict[str, Floats]:
        """Core pressures, shape (N, T), and paces, shape (8, T), as the genes have them, where they are free."""
        if not (self.cores or self.paced):
            return {}
        table = np.asarray(values, float).reshape(-1, self.columns)[ROWS + 1 :]
        core, pace = table[: self.cores], table[self.cores :]
        return {**({"core_pressure": core} if self.cores else {}), **({"pace": pace} if self.paced else {})}

    def _inside(self, values: Floats) -> dict[str, Bools]:
        """Which core pressures and paces are not clipped, by name."""
        ends = {"core_pressure": (0.0, np.inf), "pace": (-np.inf, 1.0)}
        return {name: (own > ends[name][0]) & (own < ends[name][1]) for name, own in self._own(values).items()}

    @staticmethod
    def genome(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> Floats:
        """Genes of all columns that a schedule plays, one after the other.

        Raises:
            ValueError: for what they cannot say: times of motion, core pressures of columns, and paces.
        """
        return GradedGait.genome_with(schedule, actuation, 0, False)

    @staticmethod
    def genome_with(schedule: GaitSchedule, actuation: InflatableActuation, cores: int, paced: bool) -> Floats:
        """Genes, where core pressures of so many cores are free, which the schedule then has, and paces or not.

        Raises:
            ValueError: for what they cannot say: times of motion, and core pressures and paces that are not free.
        """
        core, pace = schedule.core_pressure, schedule.pace
        if core is not None and not cores:
            raise ValueError("core_pressure: one per column is not allowed; graded genes keep that of the design")
        if pace is not None and not paced:
            raise ValueError("pace: one per stroke is not allowed; graded genes move as fast as bladders do")
        same = dataclasses.replace(schedule, motion_steps=np.full(schedule.columns, LEAST_MOTION))
        moves = [[column.motion_steps for column in play(gait, actuation)[0]] for gait in (schedule, same)]
        if schedule.settle_steps is None or moves[0] != moves[1]:
            raise ValueError(
                f"motion_steps: graded genes move as fast as bladders do; give at most {LEAST_MOTION}, and settle_steps"
            )
        own = [] if core is None else [np.broadcast_to(core, (cores, schedule.columns))]
        own += [np.ones((BLADDERS, schedule.columns)) if pace is None else pace] if paced else []
        return np.tile(np.vstack([schedule.levels, schedule.settle_steps, *own]), schedule.repeats).ravel()

    def _tables(self, values: Floats) -> tuple[Floats, ...]:
        """Inflation, shape (8, T), grip, (2, T), and settling, (T,), as the genes have them."""
        table = np.asarray(values, float).reshape(-1, self.columns)
        return table[:BLADDERS], table[BLADDERS:ROWS], table[ROWS]

    def _present_tables(self, values: Floats) -> tuple[Floats, ...]:
        """The tables of :meth:`_tables`, with no inflation of absent bladders."""
        inflation, *others = self._tables(values)
        return np.where(self._absent[:, None], 0.0, inflation), *others

    def _graded(self, values: Floats) -> GaitSchedule:
        """Played once, its feet as the genes have them."""
        inflation, grip, genes = self._present_tables(values)
        levels = np.concatenate([limited(np.clip(inflation, 0.0, 1.0), self.most_full), grip])
        motion, settle = np.full(self.columns, LEAST_MOTION), np.rint(np.maximum(genes, 0.0)).astype(np.int64)
        most: dict[str, float | None] = {"core_pressure": None, "pace": 1.0}
        own: dict[str, Any] = {n: np.clip(table, 0.0, most[n]) for n, table in self._own(values).items()}
        return GaitSchedule(levels, 1, motion_steps=motion, settle_steps=settle, **own)


class GradedPatternGait(GradedGait):
    """A network says of every actuator in every column how far it is on; how long the robot settles is said as it is.

    A bladder inflates by 1/2 more than the output of the network, cut at empty and full; a foot grips where the output
    is positive. What lies alike is told alike, so whole gaits are tried where single levels would have to meet.
    """

    def variables(self) -> list[Variable]:
        """The genome of the network, then ``settle_1`` and on."""
        return [*GAIT_WIRING.variables(), *self._times()]

    slopes = GaitEncoding.slopes  # zero: networks are searched without gradients

    def _tables(self, values: Floats) -> tuple[Floats, ...]:
        """What the network says, and settling."""
        values = np.asarray(values, float)
        output = pattern(values[: -self.columns], self.columns)
        return output[:BLADDERS] + 0.5, (output[BLADDERS:] > 0).astype(float), values[-self.columns :]


class GradedWaveGait(GradedGait):
    """A wave around the robot: every bladder plays the same levels, each so many columns before the one before it.

    Bladders 1 to 8 are a ring: over the top, and back underneath. Whatever the ring does, it does again once the robot
    has turned by a bladder. Rolling is such a wave, of one bladder in eight columns with a shift of 1. Feet, which are
    not part of the ring, have bits of their own. After all columns the robot settles for as long.
    """

    def variables(self) -> list[Variable]:
        """Levels ``level_1`` to ``level_T``, ``shift``, bits ``foot1_1`` to ``foot2_T``, steps ``settle``."""
        feet = [variable for variable in super().variables() if variable.kind == "binary"]
        levels = [Variable(f"level_{column + 1}", -0.5, 1.5, step=LEVEL_STEP) for column in range(self.columns)]
        shift = Variable("shift", 0, max(1, self.columns - 1), "integer", step=1.0)
        return [*levels, shift, *feet, Variable("settle", -SETTLING, SETTLING, step=SETTLING_STEP)]

    def slopes(self, values: Floats, sharpness: float, slopes: Floats, **others: Floats) -> Floats:
        """Derivatives by the genes: those by a level are the sum over bladders; zero for the shift and times."""
        told = self._by_levels(values, slopes[:BLADDERS])
        levels = sum(np.roll(row, self._shift(values) * bladder) for bladder, row in enumerate(told))
        grip = self._by_grip(values, sharpness, slopes[BLADDERS:])
        return np.concatenate([levels, [0.0], grip.ravel(), [0.0]])

    @staticmethod
    def genome(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> Floats:
        """Genes of a wave.

        Raises:
            ValueError: for what is no wave, and for what graded genes cannot say.
        """
        levels, grip, settle = np.split(
            GradedGait.genome(dataclasses.replace(schedule, repeats=1), actuation).reshape(-1, schedule.columns),
            [BLADDERS, ROWS],
        )
        shifts = [s for s in range(schedule.columns) if np.array_equal(levels, _wave(levels[0], s))]
        if not shifts or np.ptp(settle):
            raise ValueError("inflation: it is no wave, the same levels in every bladder, shifted, and even settling")
        return np.concatenate([levels[0], shifts[:1], grip.ravel(), settle[0, :1]])

    def _tables(self, values: Floats) -> tuple[Floats, ...]:
        """The levels, shifted from bladder to bladder, grip, and settling."""
        values = np.asarray(values, float)
        levels, feet = values[: self.columns], values[self.columns + 1 : -1]
        return _wave(levels, self._shift(values)), feet.reshape(-1, self.columns), np.full(self.columns, values[-1])

    def _shift(self, values: Floats) -> int:
        """How many columns a bladder is behind the one before it."""
        return int(values[self.columns])


def _wave(levels: Floats, shift: int) -> Floats:
    """Levels of all bladders, shape (8, T): each plays those of the one before, ``shift`` columns earlier."""
    return np.stack([np.roll(levels, -shift * bladder) for bladder in range(BLADDERS)])
