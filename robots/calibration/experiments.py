"""Experiments on a rig: what was measured, and what the simulator says of it.

All have ``at``, where they were measured, in the quantity and unit that ``axis`` names; ``values``, in those of
``quantity``; and ``deviations``, the standard deviations of the values, or None where they are not known: shape (N,)
each. ``title`` is for tables and plots. ``informs`` names the properties that the values may depend on, the one that
they tell best first. ``predict`` returns what T trials say of the points, shape (T, N); NaN where a simulation
diverges.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from robots.calibration.laboratory import Laboratory, Replica
from robots.inflatable.body import FIRST_BLADDER, SKIN_REGIONS, kinds_of
from robots.inflatable.design import InflatableDesign
from robots.inflatable.program import RobotEvents, write_gait
from robots.inflatable.simulation import travel_directions
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeProgram, ProgramBuilder, Quantity
from taichi_sim.lattice.faces import corners, half_extents, mean_of_face_corners

LENGTH, WIDTH = 6, 3  # of the strip of skin that is dragged, in voxels
SIDES = {"width": 0, "height": 2}  # axis of each
_RAMP, _HOLD = 10e3, 0.1  # of the core [Pa/s], [s]: slow enough for the robot to follow
_IDLE_DAMPING = 0.05  # ratio against the world, so that an idle robot is at rest when it is measured


@dataclass(frozen=True, eq=False)
class Drag:
    """A foot that is dragged over the ground, slowly: a strip of skin under a load, held at one end.

    The force rises while the strip stretches and sticks, and is the friction once all of it slides.

    Source: Powers 2021 dissertation, ch. 5, "Methods": feet dragged over materials by a testing machine.

    Attributes:
        at: displacements of the held end [m], not below 0.
        values: forces on it [N].
        load: on the foot, its own weight included [N].
        grips: whether the foot is told to grip or to slide.
        deviations: standard deviations of the forces [N], or None.
    """

    at: Floats
    values: Floats
    load: float
    grips: bool = True
    deviations: Floats | None = None

    axis, quantity = "displacement [m]", "force [N]"

    @property
    def title(self) -> str:
        """What the foot does, under which load."""
        return f"drag, foot {'grips' if self.grips else 'slides'}, {self.load:g} N"

    @property
    def informs(self) -> tuple[str, ...]:
        """Friction by the plateau, the modulus by the rise."""
        return ("friction" if self.grips else "low_friction", "modulus")

    def predict(self, trials: Sequence[Replica], laboratory: Laboratory) -> Floats:
        """Forces on the held end [N], shape (T, N), in closed form: pulled slowly, the strip is at rest at all times.

        It is a chain of ``LENGTH`` columns. From the held end on one after the other begins to slide, when what pulls
        at it exceeds its friction F; a column that slides takes F off the pull on the next one. So s columns slide
        from a pull of s F on, at which the links of stiffness k are stretched by F/k (1 + 2 + ... + s) in all.
        """
        edge, sliding = laboratory.geometry.voxel_size, np.arange(LENGTH + 1)
        forces = np.empty((len(trials), len(self.at)))
        for row, trial in enumerate(trials):
            coefficient = trial.properties.friction if self.grips else trial.properties.low_friction
            friction, stiffness = coefficient * self.load / LENGTH, WIDTH * trial.properties.modulus * edge
            stretched = friction / stiffness * sliding * (sliding + 1) / 2
            forces[row] = np.interp(self.at, stretched, friction * sliding)
        return forces


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
        """Which side is measured."""
        return f"{self.side} of the pouch"

    @property
    def quantity(self) -> str:
        """Which side is measured, and its unit."""
        return f"{self.side} [m]"

    def predict(self, trials: Sequence[Replica], laboratory: Laboratory) -> Floats:
        """Extents of the skin at rest [m], shape (T, N)."""
        body, engine = laboratory.engine(trials, Terrain())
        levels, place = np.unique(self.at, return_inverse=True)
        run = engine.run(_steps_of_pressure(trials, laboratory, levels))
        extents = half_extents(body, run.strains, run.sizes)
        skin = kinds_of(np.asarray(body.regions)) < FIRST_BLADDER
        reach = corners(run.positions, run.orientations, extents)[:, :, skin][..., SIDES[self.side]]
        found = reach.max(axis=(2, 3)) - reach.min(axis=(2, 3))
        return np.where((run.status == "ok")[:, None], found[:, place], np.nan)


def _steps_of_pressure(trials: Sequence[Replica], laboratory: Laboratory, levels: Floats) -> LatticeProgram:
    """A ramp to every pressure [Pa] and a hold, after which robots are measured."""
    builder, rate = ProgramBuilder(len(trials)), _RAMP * laboratory.time_step
    hold = round(_HOLD / laboratory.time_step)
    before = np.concatenate([[0.0], levels[:-1]])
    ramps = np.rint((levels - before) / rate).astype(int)
    measured = np.cumsum(ramps + hold)
    for robot, trial in enumerate(trials):
        drive = replace(laboratory.drive(trial.properties), hold_steps=hold)
        events = RobotEvents.of(builder, robot, float(levels[-1]), 0.0, Terrain(), drive, laboratory.geometry)
        events.initialise(int(measured[-1]))
        builder.set(Quantity.GLOBAL_DAMPING, _IDLE_DAMPING, regions=events.everywhere, robots=robot)
    skin = events.skin(SKIN_REGIONS)
    for start, level, ramp, end in zip(before, levels, ramps, measured, strict=True):
        begin = int(end) - hold - int(ramp)
        builder.set(Quantity.PRESSURE, start, regions=skin, step=begin, rate=rate)
        builder.set(Quantity.PRESSURE, level, regions=skin, step=begin + int(ramp))
    return builder.build(int(measured[-1]), np.tile(measured, (len(trials), 1)))


@dataclass(frozen=True, eq=False)
class Gait:
    """A robot that plays a gait on a terrain.

    Attributes:
        at: times since the gait began [s]; infinity is its end, whenever that is.
        values: distances along the direction of travel [m]; with ``mean_speed`` those by the time [m/s].
        design: pressure, orientation and gait.
        name: of the gait, for people; in files of measurements a known gait, or the file of one.
        terrain: that it is on; friction is that of the properties where it gives none.
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
        """The rate by when it moves; friction where it is not known of the terrain, and none in a fluid."""
        known = {"friction": self.terrain.high_friction, "low_friction": self.terrain.low_friction}
        rubs = [] if self.terrain.is_fluid else [name for name, value in known.items() if value is None]
        return ("inflation_rate", *rubs, "modulus")

    @property
    def title(self) -> str:
        """Which gait, and where."""
        return f"{self.name} {self.terrain.where}"

    @property
    def quantity(self) -> str:
        """What is measured, and its unit."""
        return "mean speed [m/s]" if self.mean_speed else "distance [m]"

    def predict(self, trials: Sequence[Replica], laboratory: Laboratory) -> Floats:
        """Displacements of the middle of the robot [m], or mean speeds [m/s], shape (T, N)."""
        body, engine = laboratory.engine(trials, self.terrain)
        times, place = np.unique(self.at, return_inverse=True)
        builder, marks, played = ProgramBuilder(len(trials)), [], laboratory.played(self.design)
        for robot, trial in enumerate(trials):
            drive = laboratory.drive(trial.properties)
            begin, _, steps = write_gait(builder, robot, played, self.terrain, drive, laboratory.geometry)
            after = np.minimum(np.rint(np.minimum(times / laboratory.time_step, steps)), steps).astype(int)
            marks.append([begin, *(begin + after)])
        snapshots = np.array(marks)
        run = engine.run(builder.build(snapshots[:, -1], snapshots))
        extents = half_extents(body, run.strains, run.sizes)
        middle = mean_of_face_corners(body, run.positions, run.orientations, extents)[..., :2]
        heading = travel_directions(np.array([self.design.orientation]))[0]
        found = (middle[:, 1:] - middle[:, :1]) @ heading
        if self.mean_speed:
            played_for = (snapshots[:, 1:] - snapshots[:, :1]) * laboratory.time_step
            late = np.isfinite(times) & (times > played_for + laboratory.time_step)  # the robot rests after its gait
            found = found / np.where(late, times, played_for)
        return np.where((run.status == "ok")[:, None], found[:, place], np.nan)


def spoken_reading(experiment: "Experiment", number: int) -> str:
    """One reading of an experiment in words, by its number: its experiment, its value, and where it was measured."""
    at, value = experiment.at[number], experiment.values[number]
    where = "" if np.isinf(at) else f" at {experiment.axis} {at:.4g}"
    return f"{experiment.title}: {experiment.quantity} {value:.4g}{where}"


Experiment = Drag | Diameter | Gait
KINDS = (Drag, Diameter, Gait)  # in the order of files, and in which a fit looks at them
