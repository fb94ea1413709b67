"""Journeys: one robot plays gaits and changes of shape on several terrains, one after the other.

A leg begins in the state in which the previous leg ended: position, pose and thickness of bladders. The ground changes
between legs. Headings and slopes refer to the world, not to the robot's present pose: a leg with heading 90 degrees
goes along the y axis, whatever the robot did before.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Unpack

import numpy as np

from robots.frames import Frames
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import BLADDER_COUNT, PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign, highest_pressure, kilopascals
from robots.inflatable.program import RobotEvents
from robots.inflatable.simulation import engine_of, read_poses, travel_directions
from robots.inflatable.timing import play
from robots.world import Terrain
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import LatticeBody, LatticeProgram, ProgramBuilder


@dataclass(frozen=True)
class Leg:
    """A part of a journey.

    Attributes:
        design: a gait, or a change of shape (``transition``); its pressure is that at the beginning of the leg.
        terrain: terrain of the leg.
        name: name in reports.
    """

    design: InflatableDesign
    terrain: Terrain
    name: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class JourneyResult(ShortText):
    """Result of R robots on a journey of L legs; NaN where a status is not "ok".

    Attributes:
        distances: distance along the heading of each leg, positive uphill [m], shape (R, L).
        steps: time steps of each leg, shape (L,).
        status: "ok" or "diverged", shape (R,).
        positions: positions of the voxels at the beginning and at the end of each leg [m], shape (R, L + 1, V, 3).
        orientations: orientations at these times, quaternions (w, x, y, z), shape (R, L + 1, V, 4).
        frames: recorded poses, or None.
        body: lattice of each robot.
        body_length: body length, the unit of speeds [m].
        time_step: time step dt [s].
    """

    distances: Floats
    steps: np.ndarray
    status: np.ndarray
    positions: Floats
    orientations: Floats
    frames: Frames | None
    body: LatticeBody
    body_length: float
    time_step: float

    @cached_property
    def speeds(self) -> Floats:
        """Speeds of the legs over their actual durations [body lengths/s], shape (R, L)."""
        return self.distances / (self.body_length * self.steps * self.time_step)


def simulate_journey(
    legs: Sequence[Leg],
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    runs: int = 1,
    record_every: int | None = None,
    perturbation: float = 0.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> JourneyResult:
    """Simulate a robot on several legs, one after the other.

    Args:
        legs: the legs; each must begin with the core pressure at the end of the previous one. The robot is
            initialised before the first.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates.
        runs: R, the number of equal robots, which differ only in the noise on their start positions.
        record_every: interval of recorded poses, from the end of the initialisation [time steps]; None for no poses.
        perturbation: standard deviation of the noise on start positions [m].
        seed: seed of the noise; robot i always has the same noise.
        progress: called at intervals with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``robots.inflatable.simulate``.

    Raises:
        ValueError: if an argument is not allowed.
    """
    _check(legs, geometry)
    runs = whole_number("runs", runs, 1)
    perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
    record_every = None if record_every is None else whole_number("record_every", record_every, 1)
    program, steps = build_journey(legs, runs, actuation, geometry, record_every)
    body = geometry.body
    starts = body.scattered(perturbation, whole_number("seed", seed, 0), range(runs)) if perturbation > 0 else None
    engine = engine_of(geometry, [legs[0].terrain] * runs, actuation, Compute.given(compute), (), starts)
    run = engine.run(program, progress)
    first = len(legs) + 1
    middle, frames = read_poses(run, geometry, first, record_every)
    headings = travel_directions(np.array([leg.design.orientation for leg in legs]))
    distances = (np.diff(middle[..., :2], axis=1) * headings).sum(axis=-1)
    return JourneyResult(
        np.where((run.status == "ok")[:, None], distances, np.nan),
        steps,
        run.status,
        run.positions[:, :first],
        run.orientations[:, :first],
        frames,
        body,
        geometry.body_length,
        geometry.time_step,
    )


def refusal_of_ground(terrain: Terrain) -> str:
    """Why a journey cannot lead over a terrain; empty if it can."""
    return f"uneven ground ({terrain.ground}) is not allowed in a journey; give planes" if terrain.ground else ""


def refusal_of_leg(design: InflatableDesign) -> str:
    """Why a gait cannot be a leg of any journey; empty if it can."""
    core = design.schedule.core_pressure
    refused = {
        "materials": design.materials is not None,
        "bladders of its own": design.bladders is not None,
        "core pressures of several cores": core is not None and core.ndim == 2,
    }
    what = next((what for what, has in refused.items() if has), "")
    return what and f"a gait with {what} is not allowed in a journey; all legs are of the robot as built"


def _check(legs: Sequence[Leg], geometry: InflatableGeometry) -> None:
    """Raise ValueError for legs that cannot be part of one journey or follow each other."""
    if not legs:
        raise ValueError("legs: none given; give at least one")
    if len({leg.terrain.is_fluid for leg in legs}) > 1:
        raise ValueError("legs: ground and a fluid are not allowed in one journey; give one for either")
    for leg in legs:
        if refusal := refusal_of_ground(leg.terrain) or refusal_of_leg(leg.design):
            raise ValueError(f"legs: {refusal}")
        leg.design.check_layout(geometry.bladders)
    for place, (before, leg) in enumerate(pairwise(legs), 2):
        if leg.design.pressure != before.design.last_pressure:
            raise ValueError(
                f"legs: leg {place} begins with {kilopascals(leg.design.pressure)}, but the one before ends with"
                f" {kilopascals(before.design.last_pressure)}; put a change of shape between them"
            )


def build_journey(
    legs: Sequence[Leg],
    runs: int,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
    record_every: int | None,
) -> tuple[LatticeProgram, np.ndarray]:
    """Build the program of ``runs`` robots; return it with the numbers of time steps of the legs, shape (L,).

    Snapshots are taken at the end of the initialisation and of every leg, then for the recorded poses.
    """
    builder, begin = ProgramBuilder(runs), actuation.initial_steps(highest_pressure(legs[0].design.pressure))
    edges, levels, inflation = [begin], np.full(BLADDER_COUNT, actuation.deflated), np.zeros(BLADDER_COUNT)
    for leg in legs:
        design, first, robots = leg.design, len(edges) == 1, np.arange(runs)
        events = RobotEvents.of(builder, robots, design.pressure, design.orientation, leg.terrain, actuation, geometry)
        if first:
            events.initialise(begin)
        else:
            events.stand_on(1.0 - inflation, edges[-1])
        # Bladders may still have to move from the levels of the previous leg in a column that would otherwise be idle.
        schedule, after = replace(design.schedule, skip_idle=False), design.schedule.core_pressure
        core = None if after is None else (highest_pressure(design.pressure), after)
        columns, steps = play(schedule, actuation, core=core, levels=levels)
        events.play(columns, edges[-1], first)
        levels, inflation = value_of(columns[-1].motion.ends), value_of(columns[-1].inflation)
        edges.append(edges[-1] + steps)
    recorded = range(begin, edges[-1] + 1, record_every) if record_every else ()
    marks = np.array([[*edges, *recorded]] * runs)
    return builder.build([edges[-1]] * runs, marks), np.diff(edges)
