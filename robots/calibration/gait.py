"""How far a gait has brought the robot."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from robots.calibration.laboratory import Laboratory, Trial
from robots.inflatable.cores import highest_pressure
from robots.inflatable.design import InflatableDesign
from robots.inflatable.events import RobotEvents
from robots.inflatable.simulation import travel_directions
from robots.inflatable.timing import play
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeProgram, ProgramBuilder
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners


@dataclass(frozen=True, eq=False)
class Gait:
    """A robot that plays a gait on a terrain.

    Attributes:
        at: times since the gait began [s]; infinity is its end, whenever that is.
        values: distances along the direction of travel [m]; with ``mean_speed`` those by the time [m/s].
        design: pressure, orientation and gait.
        name: of the gait, for people.
        terrain: that it is on; friction is that of the properties.
        mean_speed: whether the values are mean speeds.
        deviations: standard deviations of the values, or None.
    """

    at: Floats
    values: Floats
    design: InflatableDesign
    name: str = "gait"
    terrain: Terrain = field(default_factory=Terrain)
    mean_speed: bool = False
    deviations: Floats | None = None

    axis = "time [s]"

    @property
    def informs(self) -> tuple[str, ...]:
        """The rate by when it moves; there is no friction in a fluid."""
        return ("inflation_rate", *(() if self.terrain.is_fluid else ("friction", "low_friction")), "modulus")

    @property
    def title(self) -> str:
        """For tables and plots."""
        return f"{self.name} {self.terrain.where}"

    @property
    def quantity(self) -> str:
        """What is measured."""
        return "mean speed [m/s]" if self.mean_speed else "distance [m]"

    def predict(self, trials: Sequence[Trial], laboratory: Laboratory) -> Floats:
        """Displacements of the middle of the robot [m], or mean speeds [m/s], shape (T, N)."""
        body, engine = laboratory.engine(trials, self.terrain)
        times, place = np.unique(self.at, return_inverse=True)
        program = self._program(trials, laboratory, times)
        run = engine.run(program)
        extents = half_extents(body, run.strains, run.sizes)
        middle = mean_of_face_corners(body, run.positions, run.orientations, extents)[..., :2]
        heading = travel_directions(np.array([self.design.orientation]))[0]
        found = (middle[:, 1:] - middle[:, :1]) @ heading
        if self.mean_speed:
            found = found / ((program.snapshots[:, 1:] - program.snapshots[:, :1]) * laboratory.time_step)
        return np.where((run.status == "ok")[:, None], found[:, place], np.nan)

    def _program(self, trials: Sequence[Trial], laboratory: Laboratory, times: Floats) -> LatticeProgram:
        """Robots of all properties; each ends with its gait, or with the last time."""
        builder, marks = ProgramBuilder(len(trials)), []
        pressure, orientation = self.design.pressure, self.design.orientation
        for robot, trial in enumerate(trials):
            drive = laboratory.drive(trial.properties).on(self.terrain)
            begin = drive.initial_steps(highest_pressure(pressure))
            columns, steps = play(self.design.schedule, drive, core=self.design.core_over_time)
            events = RobotEvents.of(builder, robot, pressure, orientation, self.terrain, drive, laboratory.geometry)
            events.initialise(begin)
            events.play(columns, begin)
            played = np.minimum(np.rint(np.minimum(times / laboratory.time_step, steps)), steps).astype(int)
            marks.append([begin, *(begin + played)])
        return builder.build([mark[-1] for mark in marks], np.array(marks))
