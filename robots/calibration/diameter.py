"""Width or height of the pouch over the pressure of its core."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robots.calibration.laboratory import Laboratory, Trial
from robots.inflatable.body import FIRST_BLADDER, SKIN_REGIONS, kinds_of
from robots.inflatable.events import RobotEvents
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.lattice import LatticeBody, LatticeProgram, ProgramBuilder, Quantity
from taichi_sim.lattice.faces import corners, half_extents

SIDES = {"width": 0, "height": 2}  # axis of each
_RAMP, _HOLD = 10e3, 0.1  # [Pa/s], [s]: slow enough for the robot to follow
_DAMPING = 0.05  # ratio against the world, so that it is at rest when it is measured


@dataclass(frozen=True, eq=False)
class Diameter:
    """An idle robot on flat ground whose core is inflated step by step, bladders deflated.

    Attributes:
        at: core pressures [Pa], not below 0.
        values: extents of the skin [m].
        side: "width", across the pouch, or "height".
        deviations: standard deviations of the extents [m], or None.
    """

    at: Floats
    values: Floats
    side: str = "width"
    deviations: Floats | None = None

    axis = "core pressure [Pa]"
    informs = ("modulus", "friction", "low_friction")

    @property
    def title(self) -> str:
        """For tables and plots."""
        return f"{self.side} of the pouch"

    @property
    def quantity(self) -> str:
        """What is measured."""
        return f"{self.side} [m]"

    def predict(self, trials: Sequence[Trial], laboratory: Laboratory) -> Floats:
        """Extents of the skin at rest [m], shape (T, N)."""
        body, engine = laboratory.engine(trials, Terrain())
        levels, place = np.unique(self.at, return_inverse=True)
        program = self._program(trials, laboratory, levels)
        run = engine.run(program)
        extents = half_extents(body, run.strains, run.sizes)
        skin = corners(run.positions, run.orientations, extents)[:, :, _is_skin(body)]
        reach = skin[..., SIDES[self.side]]
        found = reach.max(axis=(2, 3)) - reach.min(axis=(2, 3))
        return np.where((run.status == "ok")[:, None], found[:, place], np.nan)

    def _program(self, trials: Sequence[Trial], laboratory: Laboratory, levels: Floats) -> LatticeProgram:
        """A ramp to every pressure and a hold, after which it is measured."""
        builder, rate = ProgramBuilder(len(trials)), _RAMP * laboratory.time_step
        hold = round(_HOLD / laboratory.time_step)
        before = np.concatenate([[0.0], levels[:-1]])
        ramps = np.rint((levels - before) / rate).astype(int)
        measured = np.cumsum(ramps + hold)
        for robot, trial in enumerate(trials):
            drive = replace(laboratory.drive(trial.properties), hold_steps=hold)
            events = RobotEvents.of(builder, robot, float(levels[-1]), 0.0, Terrain(), drive, laboratory.geometry)
            events.initialise(int(measured[-1]))
            cores = events.cores
            builder.set(Quantity.GLOBAL_DAMPING, _DAMPING, regions=cores.everywhere, robots=robot)
        for start, level, ramp, end in zip(before, levels, ramps, measured, strict=True):
            begin = int(end) - hold - int(ramp)
            builder.set(Quantity.PRESSURE, start, regions=cores.skin(SKIN_REGIONS), step=begin, rate=rate)
            builder.set(Quantity.PRESSURE, level, regions=cores.skin(SKIN_REGIONS), step=begin + int(ramp))
        return builder.build(int(measured[-1]), np.tile(measured, (len(trials), 1)))


def _is_skin(body: LatticeBody) -> Bools:
    """Which voxels are not of bladders, shape (V,)."""
    return kinds_of(np.asarray(body.regions)) < FIRST_BLADDER
