"""Points of a search for gaits: the variables that are free, the design of a point, and the point of a design."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from optim.problems.inflatable.encoding import FixedGait, GaitEncoding
from optim.problems.inflatable.encodings import ENCODINGS, SPEAKING
from optim.problems.inflatable.graded_encoding import GradedGait
from optim.problems.inflatable.settings import GaitSettings
from optim.space import Space
from robots.inflatable.design import InflatableDesign, Pressure, each_pressure
from robots.inflatable.layout import Layout, told_layout
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.schedule import GaitSchedule
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True, eq=False)
class GaitPoints(GaitSettings):
    """A search for gaits as a space: points say shape, materials, bladders, then the genes of the schedule."""

    @cached_property
    def space(self) -> Space:
        """The free variables; the steps of their mutation are the published ones."""
        return Space(
            (*self.shape.variables(), *self.made_of.variables(), *self.laid.variables(), *self._control.variables())
        )

    def design(self, point: ArrayLike) -> InflatableDesign:
        """The design of a point, shape (D,)."""
        schedule = self._control_of(point).schedule(self._genes(self.space.validate(point)))
        return self._design(point, schedule)

    def _design(self, point: ArrayLike, schedule: GaitSchedule) -> InflatableDesign:
        """The design of a point with its schedule."""
        return InflatableDesign(*self._shape_of(point), schedule, self._materials_of(point), self._bladders_of(point))

    def _shape_of(self, point: ArrayLike) -> tuple[Pressure, float]:
        """Pressure and orientation of a point; where columns have core pressures, one for each of several cores."""
        pressure, orientation = self.shape.values(point)
        several = "core" in self.more and self.body.cores > 1
        return (each_pressure(pressure, self.body) if several else pressure), orientation

    def _materials_of(self, point: ArrayLike) -> RegionMaterials | None:
        """What the robot of a point is made of; None is as built."""
        first = self.shape.size
        return self.made_of.materials(np.asarray(point, float)[first : first + self.made_of.size])

    def _bladders_of(self, point: ArrayLike) -> Layout | None:
        """Places that have a bladder in the robot of a point; None is as built."""
        first = self.shape.size + self.made_of.size
        return self.laid.layout(np.asarray(point, float)[first : first + self.laid.size])

    def relaxed_design(self, point: ArrayLike, sharpness: float) -> InflatableDesign:
        """The design of a point of the relaxed space, shape (D,); what is free of its schedule is sharpened."""
        return self._design(point, self._control_of(point).relaxed(self._genes(point), sharpness))

    def _genes(self, point: ArrayLike) -> Floats:
        """The genes of the schedule, the last values of a point, shape (D,)."""
        return np.asarray(point, float)[self.shape.size + self.made_of.size + self.laid.size :]

    def _control_of(self, point: ArrayLike) -> GaitEncoding:
        """How genes say the schedule of a point, of a body that may lack bladders."""
        bladders = self._bladders_of(point)
        return self._control if bladders is None else dataclasses.replace(self._control, bladders=bladders)

    @cached_property
    def _control(self) -> GaitEncoding:
        """How genes say the schedule."""
        if self.schedule is not None:
            return FixedGait(self.columns, self.repeats, self.schedule)
        encoding = ENCODINGS[self.encoding]
        if issubclass(encoding, GradedGait):
            given = self.columns, self.repeats, self.most_steps, self.warm_up, self.actuation
            return encoding(*given, self._core_rows, "pace" in self.more, self.most_full)
        return encoding(self.columns, self.repeats)

    def start_values(self, design: InflatableDesign) -> dict[str, float]:
        """The variables, by name, at which a search starts with a design; what is fixed is not among them.

        A core that is empty begins in the middle of the pressures that say so, see ``shape``.

        Raises:
            ValueError: for gaits that the encoding cannot say.
        """
        values = [design.orientation] if self.orientation is None else []
        if self.pressure is None:
            values += [p if p > 0 else self.shape.least / 2 for p in each_pressure(design.pressure, self.body)]
        values += self.made_of.genome(design.materials)
        values += self.laid.genome(design.bladders)
        if design.bladders is not None and not self.laid.free and design.bladders != self.laid.given:
            told = told_layout(design.bladders)
            raise ValueError(f"start: bladders {told} are not those of the search; free them, or give the same")
        if design.materials is not None and (fixed := sorted(set(design.materials.given) - set(self.more))):
            raise ValueError(f"start: {fixed[0]} of the regions is not free; free it, or start with another gait")
        if self.schedule is None:
            if self.encoding not in SPEAKING:
                able = "choose bits, graded or graded-wave"
                raise ValueError(f"start: encoding {self.encoding!r} cannot say a gait; {able}")
            columns = design.schedule.columns
            if columns != self.columns:
                raise ValueError(f"start: a gait of {columns} columns is not allowed; the search has {self.columns}")
            once = dataclasses.replace(design.schedule, repeats=1)
            values += self._genome(once, design.pressure).tolist()
        return dict(zip(self.space.names, values, strict=True))

    def _genome(self, schedule: GaitSchedule, pressure: Pressure) -> Floats:
        """Genes of a schedule, played once; where core pressures of columns are free, they are the given ones."""
        if self.encoding != "graded":
            return SPEAKING[self.encoding].genome(schedule, self.actuation)
        if "core" in self.more and schedule.core_pressure is None:
            rows = np.tile(np.reshape(each_pressure(pressure, self.body), (-1, 1)), schedule.columns)
            schedule = dataclasses.replace(schedule, core_pressure=rows)
        return GradedGait.genome_with(schedule, self.actuation, self._core_rows, "pace" in self.more)

    @property
    def _core_rows(self) -> int:
        """Rows of core pressures of columns that are free, one a core."""
        return self.body.cores if "core" in self.more else 0
