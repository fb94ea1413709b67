"""Freeform robots: grids of cells, each of which may be there or not, of any tissue, with a muscle of its own."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.control.cyclic import LEAST_FREQUENCY, MOST_FREQUENCY, Cycle, Cyclic
from robots.freeform.fields import PARAMETRISATIONS, RESOLUTION, Fields, Parametrisation
from robots.freeform.grid import Grid
from robots.freeform.palette import Palette, palette_of
from robots.freeform.solid import Solid, drives_of, solid_of
from robots.freeform.trials import counts_of, try_variants
from robots.lattice_robot.gains import Gains
from robots.lattice_robot.links import facts_of_links
from robots.lattice_robot.measures import checked_target, measures_among, measures_of
from robots.lattice_robot.props import time_step_among
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.rollout import Aim
from robots.lattice_robot.simulation import outcome_of
from robots.lattice_robot.soft_motion import TOLD_ANYWAY
from robots.own_measures import OwnMeasure, checked_own_measures, records_of
from robots.robot import FRAMES, HERE, Facts, Measure, Outcome, Parameter, Progress, Replay, Robot, Trial, World
from robots.uncertainty import Perturbation
from robots.world import Terrain, terrain_of
from taichi_sim.autodiff.arrays import mapped
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import built, choice, number, whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import counted
from taichi_sim.lattice.body import BALANCED, LINK_LAWS, USUAL_LINKS
from taichi_sim.lattice.time_steps import HALF, afloat

LARGEST_AMPLITUDE = 0.5
DETAILS = {"filtered": "radius", "blobs": "balls", "network": "hidden", "pattern": "hidden"}


@dataclass(frozen=True)
class FreeformActuation:
    """Actuation of a freeform robot: muscles whose edges are 1 + amplitude sin(2 pi (f t + phase)), and timing.

    Attributes:
        amplitude: largest amplitude of the edges, as a part of their length, up to 0.5.
        frequency: frequency f [Hz].
        cycles: number of whole cycles that count; another one comes before them.
        settling: time on the ground, or afloat, before anything moves [s].
        channels: number K of different waves that a robot may have, such as a rig can drive; None for one per muscle.
        time_step_safety: the largest stable time step is divided by this.
    """

    amplitude: float = 0.2
    frequency: float = 4.0
    cycles: int = 2
    settling: float = 0.1
    channels: int | None = None
    time_step_safety: float = 1.3

    def __post_init__(self) -> None:
        number("amplitude", self.amplitude, 1e-6, LARGEST_AMPLITUDE)
        number("frequency", self.frequency, LEAST_FREQUENCY, MOST_FREQUENCY, "Hz")
        whole_number("cycles", self.cycles, 1)
        number("settling", self.settling, 0.0, 1000.0, "s")
        number("time_step_safety", self.time_step_safety, 1e-3)
        if self.channels is not None:
            whole_number("channels", self.channels, 1)


@dataclass(frozen=True, eq=False, repr=False)
class FreeformRobot(Cyclic, Robot):
    """A freeform robot: a search chooses presence, tissue and muscle of each cell of a grid; it travels along x.

    A point is judged as the robot that can be built of it: see :mod:`robots.freeform.solid`. Between such robots, with
    a finite sharpness of the trial, cells are mixtures of tissues and nothing, which have gradients.

    Attributes:
        grid: grid of the cells.
        palette: tissues that cells may be made of.
        actuation: actuation of the muscles.
        fields: name in ``PARAMETRISATIONS``, for how a point sets presence, tissue and muscle of the cells.
        detail: radius, number of balls or of hidden nodes of the parametrisation; None for the usual.
        full: whether all cells are there, so that muscles and tissues alone are free.
        feature: least thickness of a robot [cells].
        target: point (x, y) that it should come near, from where its centre of mass starts [m]; None for none.
        perturbation: standard deviation of noise on the start positions of robots that can be built [m].
        seed: seed of the noise.
        links: law of the links between cells, see ``LatticeBody``.
        gains: factors of the amplitudes of its muscles, up to half an edge, where these are uncertain; no part of a
            description.
        own_measures: of the user, see ``robots.own_measures``; installed ones may be given by name.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """

    grid: Grid = field(default_factory=Grid)
    palette: Palette = field(default_factory=Palette)
    actuation: FreeformActuation = field(default_factory=FreeformActuation)
    fields: str = "cells"
    detail: float | None = None
    full: bool = False
    feature: int = 1
    target: tuple[float, float] | None = None
    perturbation: float = 1e-5
    seed: int = 0
    links: str = USUAL_LINKS
    gains: Gains | None = None
    own_measures: tuple[OwnMeasure, ...] = ()

    kind = "freeform"
    uncertain_in = ("friction", "slope", "levels", "timing")
    worlds = (Terrain(),)
    horizons = (1, 2, 4)
    changeable = ("links",)

    def __post_init__(self) -> None:
        choice("fields", self.fields, PARAMETRISATIONS)
        if self.detail is not None and self.fields not in DETAILS:
            raise ValueError(f"detail: {self.detail} is not allowed with {self.fields}, which have none; leave it out")
        whole_number("feature", self.feature, 1)
        if self.feature > min(self.grid.shape):
            thinnest = min(self.grid.shape)
            raise ValueError(
                f"feature: {self.feature} cells are not allowed; the grid is {counted(thinnest, 'cell')} thin"
            )
        number("perturbation", self.perturbation, 0.0, self.grid.voxel_size, "m")
        whole_number("seed", self.seed, 0)
        choice("links", self.links, LINK_LAWS)
        if self.target is not None:
            object.__setattr__(self, "target", checked_target(self.target))
        object.__setattr__(self, "own_measures", checked_own_measures(self.own_measures, TOLD_ANYWAY))
        _ = self.parametrisation

    @cached_property
    def parametrisation(self) -> Parametrisation:
        """Parametrisation by which a point sets the fields of the cells."""
        detail: dict[str, Any] = {}
        if self.detail is not None:
            name = DETAILS[self.fields]
            detail[name] = self.detail if name == "radius" else whole_number("detail", self.detail, 1)
        basics = self.grid, len(self.palette), self.full, self.actuation.amplitude
        return PARAMETRISATIONS[self.fields](*basics, **detail)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Free parameters of the robot: the variables of the parametrisation."""
        return tuple(self.parametrisation.variables())

    @property
    def measures(self) -> tuple[Measure, ...]:  # type: ignore[override]
        """Measures of the robot: those of lattice robots, with speeds in lengths of the grid."""
        return *measures_of(self.target is not None), *self.own_measures

    def measures_in(self, worlds: Sequence[World]) -> tuple[Measure, ...]:
        """Return the measures in all of some worlds, for lights the distance that remains, and for the first prop."""
        terrains = [terrain_of(world) for world in worlds]
        targeted = self.target is not None or all(each.light for each in terrains)
        return *measures_among(terrains, targeted), *self.own_measures

    @property
    def descriptors(self) -> dict[str, tuple[float, float]]:  # type: ignore[override]
        """Ranges of mass, payload mass and number of channels, for those in which designs may differ."""
        heaviest = self.grid.count * self.grid.voxel_size**3 * max(m.density for m in self.palette.materials)
        found = {} if self.full and len(self.palette) == 1 else {"mass": (0.0, heaviest)}
        if not self.palette.muscles.all():
            found["payload"] = (0.0, heaviest)
        if self.actuation.channels is not None:
            found["channels"] = (0.5, self.actuation.channels + 0.5)
        return found

    @property
    def differentiable(self) -> bool:  # type: ignore[override]
        """Whether the robot has gradients, as its parametrisation does."""
        return self.fields != "pattern"

    @property
    def relaxable(self) -> bool:  # type: ignore[override]
        """Whether there are mixtures between robots that can be built, through which gradients lead."""
        return self.differentiable and not (self.full and len(self.palette) == 1)

    @cached_property
    def _stable_step(self) -> float:
        """Largest time step that is stable for all designs [s]."""
        return self.palette.time_step(self.grid.voxel_size)

    @cached_property
    def cycle(self) -> Cycle:
        """Timing of the cycles; all designs have the same time step."""
        return self.cycle_on(Terrain())

    @property
    def largest_size(self) -> float:
        """Largest rest size that a cell of a design can reach [edges]."""
        materials = self.palette.materials
        heated = max(1 + m.thermal_expansion * m.temperature for m in materials)
        amplitude = self.actuation.amplitude
        amplitude = float(self.gains.reached(amplitude)) if self.gains else amplitude
        driven = 1 + amplitude * math.hypot(1.0, RESOLUTION)
        return max(driven, *(max(m.scale) for m in materials)) * max(heated, 1.0)

    def cycle_on(self, terrain: Terrain) -> Cycle:
        """Return the :attr:`cycle` on a terrain, whose water and props may take shorter time steps.

        Raises:
            ValueError: for props too light or too heavy for their contact with the tissues.
        """
        stable, balanced = self._stable_step, terrain.is_wet or self.links == BALANCED
        share = afloat(self.largest_size) if balanced else 1.0
        if terrain.props:
            stable = min(stable, time_step_among(self.palette.materials, terrain.props, self.grid.voxel_size))
        return self._cycle(stable / share)

    def _cycle(self, stable: float) -> Cycle:
        drive = self.actuation
        step = Cycle.fit(drive.frequency, stable / drive.time_step_safety)
        return Cycle(drive.frequency, drive.settling, drive.cycles, step)

    @property
    def length(self) -> float:
        """Length of the grid along x [m]."""
        return self.grid.shape[0] * self.grid.voxel_size

    @property
    def footprint(self) -> tuple[float, float]:
        """Positions of the rear and front of the grid along the heading [m]; its first cells are centred at 0."""
        return -self.grid.voxel_size / 2, self.length - self.grid.voxel_size / 2

    @property
    def aim(self) -> Aim:
        """Settings of the measures: heading, length and target."""
        return Aim(0.0, self.length, self.target, own_measures=self.own_measures)

    @property
    def table_option(self) -> str:  # type: ignore[override]
        """Option that lets a rig have a line for each wave of the designs; empty if it has."""
        from robots.hardware.rig import PneumaticRig

        channels, lines = self.actuation.channels, len(PneumaticRig().channel_lines)
        return "" if channels is not None and channels <= lines else f"--channels {lines}"

    @property
    def actuators(self) -> int:  # type: ignore[override]
        """Largest number of muscles that a design can have: the number of cells."""
        return self.grid.count

    def perturbed(self, drawn: Perturbation) -> "FreeformRobot":
        """Return this robot with tissue friction, muscle amplitudes and period multiplied by drawn factors."""
        drive = self.actuation
        frequency = min(max(drive.frequency / drawn.timing, LEAST_FREQUENCY), MOST_FREQUENCY)
        tissues = (replace(t, material=drawn.rubbed(t.material)) for t in self.palette.tissues)
        return replace(
            self,
            palette=Palette(tuple(tissues)),
            actuation=replace(drive, frequency=frequency),
            gains=Gains(drawn.levels, drawn.largest_level, LARGEST_AMPLITUDE) if drawn.levels else None,
        )

    def solid_at(self, fields: Fields, row: int) -> Solid:
        """Return the buildable robot of one row of fields."""
        return solid_of(self.grid, self.palette, fields, row, self.feature, self.actuation.channels)

    def waves(self, solid: Solid, points: Any) -> tuple[Any, Any]:
        """Compute amplitude and phase [cycles] of a solid's channels, shape (N, count), at points that may be traced.

        A channel has the mean of the waves of its cells, times its gain, if any, as far as ``LARGEST_AMPLITUDE``.
        """
        cells = np.moveaxis(self.parametrisation(points).swing[:, solid.cells], 1, -1)
        cosine, sine = np.moveaxis(mapped(solid.members, cells), 1, 0)
        length = np.sqrt(cosine * cosine + sine * sine + RESOLUTION**2)
        amplitude = self.actuation.amplitude * length
        if self.gains:
            amplitude = self.gains.limited(amplitude * np.array(self.gains.factors[: solid.count]))
        return amplitude, np.arctan2(sine, cosine + RESOLUTION) / (2 * np.pi)

    def built(self, solid: Solid, amplitude: Floats, phase: Floats) -> LatticeRobot:
        """Build the lattice robot of a solid, with amplitudes and phases [cycles] of its channels, shape (count,)."""
        drive, body = self.actuation, replace(solid.body(self.grid, self.palette), links=self.links)
        return LatticeRobot(
            body,
            drives_of(solid, amplitude, phase, drive.channels is not None),
            frequency=drive.frequency,
            cycles=drive.cycles,
            settling=drive.settling,
            time_step_safety=drive.time_step_safety * body.recommended_time_step / self._stable_step,
            name="freeform robot",
            target=self.target,
            reference_length=self.length,
            perturbation=self.perturbation,
            seed=self.seed,
            highest_size=self.largest_size,
            lowest_size=HALF,  # its muscles shrink by half an edge at most
            largest_amplitude=LARGEST_AMPLITUDE,
            own_measures=self.own_measures,
        )

    def design(self, point: ArrayLike) -> LatticeRobot:
        """Return the buildable lattice robot of one point, shape (P,).

        Raises:
            ValueError: if it is no robot.
        """
        points = self.points(point)
        solid = self.solid_at(self.parametrisation(points), 0)
        if solid.fault:
            raise ValueError(f"point: it is no robot: {solid.fault}")
        amplitude, phase = self.waves(solid, points)
        return self.built(solid, amplitude[0], phase[0])

    def replay(
        self,
        point: ArrayLike,
        world: World,
        *,
        frames: int = FRAMES,
        name: str = "",
        compute: Compute = HERE,
        progress: Progress | None = None,
    ) -> Replay:
        """Simulate one design and build its motion, see :meth:`Robot.replay`, with its cells and channels in words."""
        found = super().replay(point, world, frames=frames, name=name, compute=compute, progress=progress)
        solid = self.solid_at(self.parametrisation(self.points(point)), 0)
        measures = {**found.outcome.measures, **counts_of([solid], found.outcome.status)}
        return replace(found, outcome=replace(found.outcome, measures=measures))

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Simulate the robots of N points."""
        return self.run_in(points, (trial.world,), trial)[0]

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: "Sequence[FreeformRobot]" = ()
    ) -> list[Outcome]:
        """Simulate the robots of N points in several worlds; those with the same cells share a batch."""
        found = try_variants(variants or [self] * len(worlds), points, worlds, trial)
        return [outcome_of(each) for each in found]

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the buildable robot of one point to a file, as a lattice robot."""
        self.design(point).save((), path)

    def describe(self) -> dict[str, Any]:
        """Describe everything that results depend on, as JSON values."""
        palette = [{**dataclasses.asdict(t.material), "muscle": t.muscle} for t in self.palette.tissues]
        own = {name: value for name, value in dataclasses.asdict(self).items() if name not in ("gains", "own_measures")}
        if self.links == USUAL_LINKS:  # as before there were others
            del own["links"]
        measures = {"own_measures": records_of(self.own_measures)} if self.own_measures else {}
        return {**own, **measures, "palette": palette}

    def facts(self) -> Facts:
        """Rows for a report: grid, palette, parametrisation and cycle."""
        drive, sides = self.actuation, " x ".join(map(str, self.grid.shape))
        names = [t.material.name or f"tissue {n}" for n, t in enumerate(self.palette.tissues, 1)]
        each = "a wave for each muscle" if drive.channels is None else counted(drive.channels, "channel")
        return [
            ("Robot", f"{self.name}: {sides} cells of {1000 * self.grid.voxel_size:g} mm"),
            ("Tissues", ", ".join(names)),
            *facts_of_links(self.links),
            ("Fields", f"{self.fields}, {counted(len(self.parameters), 'variable')}"),
            ("Muscles", f"{each}, up to {drive.amplitude:g} of an edge"),
            ("Cycle", f"{drive.frequency:g} Hz; the speed is that of {counted(drive.cycles, 'cycle')}"),
        ]

    def columns(self, points: ArrayLike) -> dict[str, list[str]]:
        """Columns of a table of several designs: their cells and channels."""
        fields = self.parametrisation(self.points(points))
        solids = [self.solid_at(fields, row) for row in range(len(fields.presence))]
        return {
            "Cells": [str(len(solid.cells)) for solid in solids],
            "Channels": [str(solid.waves) for solid in solids],
        }

    def at_horizon(self, length: int) -> tuple[str, "FreeformRobot"]:
        """Return a label and the robot with ``length`` cycles."""
        drive = replace(self.actuation, cycles=length)
        return counted(length, "cycle"), replace(self, actuation=drive)


def freeform_of(description: Mapping[str, Any]) -> FreeformRobot:
    """The robot that :meth:`FreeformRobot.describe` described.

    Raises:
        ValueError, KeyError, TypeError: for a damaged one.
    """
    grid, actuation = description["grid"], description["actuation"]
    return built(
        FreeformRobot,
        {
            **description,
            "grid": built(Grid, {**grid, "shape": tuple(grid["shape"])}),
            "palette": palette_of(description["palette"]),
            "actuation": built(FreeformActuation, actuation),
        },
    )
