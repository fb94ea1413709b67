"""How a search writes a schedule, the last variables of a point: as codes, bit by bit, or as a pattern on and off."""

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from optim.problems.inflatable.gait_pattern import GAIT_WIRING, pattern
from optim.space import Variable
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.layout import EVERY_BLADDER, Layout, layout_mask
from robots.inflatable.schedule import ROWS, GaitSchedule
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import whole_number

BIT_STEP = 0.22  # a mutation flips a bit where a deviate exceeds 0.5: 2.3 % of them, 2 of 80


@dataclass(frozen=True)
class GaitEncoding(ABC):
    """Genomes of a schedule. ``values`` are those of :meth:`variables`, shape (G,).

    Attributes:
        columns: T, of the schedule.
        repeats: of the schedule.
        bladders: that the body has; genes of the others say nothing, and the schedule leaves them empty.
    """

    columns: int
    repeats: int
    bladders: Layout = field(default=EVERY_BLADDER, kw_only=True)

    def __post_init__(self) -> None:
        whole_number("columns", self.columns, 1)

    @property
    def _absent(self) -> Bools:
        """Which places have no bladder, shape (8,)."""
        return ~layout_mask(self.bladders)

    @property
    def more_tables(self) -> tuple[str, ...]:
        """Names of the schedule's tables, beside its levels, that genes say and that have derivatives."""
        return ()

    @abstractmethod
    def variables(self) -> list[Variable]:
        """The genes."""

    @abstractmethod
    def schedule(self, values: Floats) -> GaitSchedule:
        """The schedule of a genome; every genome has one."""

    def relaxed(self, values: Floats, sharpness: float) -> GaitSchedule:
        """The schedule of a genome whose binary genes lie between 0 and 1, sharpened; here of one without such."""
        return dataclasses.replace(self.schedule(values), skip_idle=False)

    def slopes(self, values: Floats, sharpness: float, slopes: Floats, **others: Floats) -> Floats:
        """Derivatives by the genes, shape (G,), from those by the relaxed schedule's levels; zero by whole numbers.

        Args:
            values: of a genome.
            sharpness: of the relaxed schedule.
            slopes: by its levels.
            others: by its other tables, where it has them: ``pace`` and ``core_pressure``.
        """
        return np.zeros(len(values))


@dataclass(frozen=True)
class FixedGait(GaitEncoding):
    """A schedule that is not free to change.

    Attributes:
        given: the schedule.
    """

    given: GaitSchedule

    def variables(self) -> list[Variable]:
        """No variables: the schedule is fixed."""
        return []

    def schedule(self, values: Floats) -> GaitSchedule:
        """The one given."""
        return self.given.emptied(self._absent)


class CodedGait(GaitEncoding):
    """For every actuator the code (f, phi) of its row, ``f_bladder1`` and so on, see ``GaitSchedule.from_codes``."""

    def variables(self) -> list[Variable]:
        """All f, then all phi: whole numbers from 0 to ``columns``; the step is the published one."""
        names = [f"{code}_{row}" for code in ("f", "phi") for row in GaitSchedule.row_names]
        return [Variable(name, 0, self.columns, "integer", step=0.9) for name in names]

    def schedule(self, values: Floats) -> GaitSchedule:
        """The schedule of the codes."""
        return GaitSchedule.from_codes(values[:ROWS], values[ROWS:], self.columns, self.repeats).emptied(self._absent)


class BitwiseGait(GaitEncoding):
    """Every bit of the schedule, ``bladder1_1`` to ``foot2_8``, row by row."""

    def variables(self) -> list[Variable]:
        """One binary variable for each bit of the schedule."""
        names = [f"{row}_{column + 1}" for row in GaitSchedule.row_names for column in range(self.columns)]
        return [Variable(name, 0, 1, "binary", step=BIT_STEP) for name in names]

    def schedule(self, values: Floats) -> GaitSchedule:
        """The bits as they are."""
        return GaitSchedule((self._matrix(values) == 1).astype(float), self.repeats).emptied(self._absent)

    def relaxed(self, values: Floats, sharpness: float) -> GaitSchedule:
        """Bits between 0 and 1, sharpened."""
        return self._levels(values).sharpened(sharpness)

    def slopes(self, values: Floats, sharpness: float, slopes: Floats, **others: Floats) -> Floats:
        """Derivatives by the genes: those by the levels through the sharpening."""
        return (slopes * self._levels(values).sharpening_slope(sharpness)).ravel()

    @staticmethod
    def genome(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> Floats:
        """Genes of a schedule.

        Raises:
            ValueError: for levels between 0 and 1, and times.
        """
        if schedule.has_own_times or not schedule.is_on_off:
            raise ValueError("start: bits cannot say levels between 0 and 1, nor times; choose encoding graded")
        return schedule.levels.ravel()

    def _matrix(self, values: Floats) -> Floats:
        return np.asarray(values, float).reshape(ROWS, self.columns)

    def _levels(self, values: Floats) -> GaitSchedule:
        return GaitSchedule(self._matrix(values), self.repeats, skip_idle=False).emptied(self._absent)


class PatternGait(GaitEncoding):
    """Weights and functions of a network that says of every actuator at every time whether it is on (output > 0).

    It knows where the actuator is (``gait_pattern.ACTUATORS``), the phase of the column in the cycle, 2 pi t / T, by
    its sine and cosine, and the middle of the column in time, from -1 to 1. Source: Stanley 2007, see
    ``robots.control.pattern``.
    """

    def variables(self) -> list[Variable]:
        """The genome of the network; it is the same for any number of columns."""
        return GAIT_WIRING.variables()

    def schedule(self, values: Floats) -> GaitSchedule:
        """The sign of the network's output."""
        return GaitSchedule((pattern(values, self.columns) > 0).astype(float), self.repeats).emptied(self._absent)
