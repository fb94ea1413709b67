"""Simulation of inflatable robots on terrains.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from robots.frames import Frames, frames_of
from robots.inflatable.actuation import ACTUATION, InflatableActuation, each_actuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry, bodies_of
from robots.inflatable.design import InflatableDesign, each_pressure
from robots.inflatable.layout import told_layout
from robots.inflatable.program import build_program
from robots.inflatable.timing import WHOLE, Counting, counted_steps, gait_steps, predicted_steps
from robots.world import Medium, Terrain, medium_of, one_each, standing
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeProgram, LatticeResult
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners

PER_ROBOT = ("distance", "speed", "speed_simulated", "status", "stages", "steps", "displacement")  # of a result


@dataclass(frozen=True, eq=False, repr=False)
class InflatableResult(ShortText):
    """Result of simulating B designs of the inflatable robot.

    Attributes:
        distance: along the direction of travel, positive uphill [m], shape (B,); NaN unless the status is "ok".
        speed: body lengths per second by the published convention: the time is that of a gait in which every column
            moves (19.7968 s for the published robot), whatever the number of steps; of what counts after a warm-up,
            as large a share of that time as its steps have of the gait's; shape (B,).
        speed_simulated: body lengths per second of the time simulated, shape (B,).
        status: "ok" or "diverged", shape (B,).
        stages: distances of equally long parts of the gait [m], shape (B, N), N 1 unless more were asked for.
        steps: time steps after the initialisation; those before divergence for a robot that diverged, shape (B,).
        time_step: dt [s].
        frames: recorded poses, or None.
        body: lattice body of the robots.
        displacement: displacement in the plane of the ground, along x (rolling) and y (inching), whatever the heading
            [m], shape (B, 2); NaN unless the status is "ok". It includes drift.
        terrains: terrain of each robot, shape (B,); None if all are on flat ground.
    """

    distance: np.ndarray
    speed: np.ndarray
    speed_simulated: np.ndarray
    status: np.ndarray
    stages: np.ndarray
    steps: np.ndarray
    time_step: float
    frames: Frames | None
    body: LatticeBody
    displacement: np.ndarray
    terrains: np.ndarray | None = None


def simulate(
    designs: Sequence[InflatableDesign] | InflatableDesign,
    terrain: Terrain | Sequence[Terrain] | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation | Sequence[InflatableActuation] = ACTUATION,
    counting: Counting = WHOLE,
    record_every: int | None = None,
    perturbation: float = 0.0,
    seed: int | Sequence[int] = 0,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> InflatableResult:
    """Simulate a batch of designs of the inflatable robot on a terrain.

    Args:
        designs: one design or several, with the same bladders; one is a batch of one.
        terrain: one for all designs, flat ground by default; or one for each.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates; one for all designs, or one for each.
        counting: which part of a gait counts; all of it by default. The speeds divide by the time of that part.
        record_every: record the poses every so many time steps from the end of the initialisation on.
        perturbation: standard deviation of noise on the start positions [m]; contact makes long runs chaotic, so a
            few perturbed copies show how far a speed can be trusted.
        seed: of that noise; robot i of a batch always draws the same. Of several, one for each robot, it draws what
            the first robot of a batch does.
        progress: called now and then with the fraction done.
        compute: ``precision`` ("f64" or "f32"), ``device`` ("cpu", "cuda", "vulkan" or "metal") and ``threads`` (CPU
            threads, all cores by default), see ``taichi_sim.base.compute.Compute``.

    Raises:
        ValueError: if an argument is not allowed; names it, its value and what is allowed.
    """
    designs = checked_designs(designs, geometry, actuation)
    geometry = laid_out(geometry, designs)
    drives = each_actuation(actuation, len(designs))
    terrains = one_each(Terrain() if terrain is None else terrain, len(designs))
    perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
    seeds = checked_seeds(seed, len(designs))
    record_every = None if record_every is None else whole_number("record_every", record_every, 1)
    # Robots of a block wait for its slowest: put those of like length together.
    order = np.argsort([predicted_steps(*each) for each in zip(designs, drives, strict=True)], kind="stable")
    sorted_designs, grounds, drives = ([each[i] for i in order] for each in (designs, terrains, drives))
    program = build_program(sorted_designs, grounds, drives, record_every, geometry, counting)
    starts = geometry.body.scattered(perturbation, seeds, order) if perturbation > 0 else None
    engine = engine_of(geometry, grounds, drives, Compute.given(compute), sorted_designs, starts)
    run = engine.run(program, progress)
    found = summarise(run, program, sorted_designs, geometry, drives, counting, record_every, grounds)
    return reordered(found, np.argsort(order))


def checked_designs(
    designs: Sequence[InflatableDesign] | InflatableDesign, geometry: object, actuation: object
) -> list[InflatableDesign]:
    """The designs of a batch as a list, if a robot of this geometry and actuation can have them.

    Raises:
        ValueError: if an argument is not allowed; names it, its value and what is allowed.
    """
    listed = [designs] if isinstance(designs, InflatableDesign) else list(designs)
    if not listed or not all(isinstance(design, InflatableDesign) for design in listed):
        raise ValueError("designs: give at least one InflatableDesign")
    for name, value, kind, example in (
        ("geometry", geometry, InflatableGeometry, "NAMED_GEOMETRIES['small']"),
        *(("actuation", each, InflatableActuation, "ACTUATION") for each in _listed(actuation)),
    ):
        if not isinstance(value, kind):
            raise ValueError(f"{name}: {value!r} is not allowed; give an {kind.__name__}, such as {example}")
    for design in listed:
        check_body(design, geometry)  # type: ignore[arg-type]
    return listed


def _listed(given: object) -> list[object]:
    """What is given, one or several, as a list."""
    return list(given) if isinstance(given, list | tuple) else [given]


def check_body(design: InflatableDesign, geometry: InflatableGeometry) -> None:
    """Refuse a design that a robot of a geometry cannot have, for its cores, regions or bladders.

    Raises:
        ValueError: that names the value and what is allowed.
    """
    each_pressure(design.pressure, geometry)
    after = design.schedule.core_pressure
    if after is not None and after.ndim == 2 and len(after) != geometry.cores:
        allowed = f"give one row, or {geometry.cores}, one a core"
        raise ValueError(f"core_pressure: {len(after)} rows are not allowed; {allowed}")
    if design.materials is not None:
        geometry.check_materials(design.materials)
    if design.bladders is None:
        design.check_layout(geometry.bladders)


def laid_out(geometry: InflatableGeometry, designs: Sequence[InflatableDesign]) -> InflatableGeometry:
    """The geometry with the bladders of the designs of a batch, which all have the same.

    Raises:
        ValueError: if they differ, as bodies of one batch share their voxels.
    """
    layouts = {geometry.bladders if design.bladders is None else design.bladders for design in designs}
    if len(layouts) > 1:
        told = " and ".join(map(told_layout, sorted(layouts)[:2]))
        raise ValueError(f"bladders: {told} are not allowed in one batch; give one batch to each layout")
    (bladders,) = layouts
    return geometry if bladders == geometry.bladders else replace(geometry, bladders=bladders)


def engine_of(
    geometry: InflatableGeometry,
    terrains: Sequence[Terrain],
    actuation: InflatableActuation | Sequence[InflatableActuation],
    compute: Compute,
    designs: Sequence[InflatableDesign] = (),
    starts: Floats | None = None,
) -> LatticeEngine:
    """An engine of robots of a geometry, one on each terrain, at rest.

    Args:
        geometry: of all.
        terrains: B of them.
        actuation: tells how large bladders get, on which substeps in water depend; of all robots, or of each.
        compute: device, precision and threads.
        designs: B robots, whose moduli and headings they have; without, they have those of the geometry, and head
            along x.
        starts: voxel centres [m], shape (B, V, 3), as on a plane; None is at rest. On uneven ground robots are raised.

    Raises:
        ValueError: if the robots of a batch in water need different substeps.
    """
    moduli = [design.materials.modulus if design.materials else None for design in designs]
    headings = [design.orientation for design in designs] or [0.0] * len(terrains)
    medium, edge = medium_of(terrains, headings, geometry.voxel_size), geometry.voxel_size
    bodies, batch, steps = bodies_of(geometry, moduli), len(terrains), geometry.time_step
    drives, is_wet = {*each_actuation(actuation, batch)}, terrains[0].is_wet
    if len(parts := {geometry.substeps(is_wet, drive.largest_size) for drive in drives}) > 1:
        given = " and ".join(f"{size:g}" for size in sorted({drive.inflated for drive in drives}))
        raise ValueError(f"inflated: {given} are not allowed in one batch in water, where they take other time steps")
    engine = touching_as_published(bodies, batch, steps, parts.pop(), medium, compute)
    if starts is None and medium["floor"] not in (True, False):
        starts = np.tile(geometry.body.start_positions, (len(terrains), 1, 1))
    if starts is not None:
        engine.set_positions(standing(starts, medium, edge))
    return engine


def touching_as_published(
    bodies: Sequence[LatticeBody], batch: int, time_step: float, substeps: int, medium: Medium, compute: Compute
) -> LatticeEngine:
    """An engine of inflatable robots: their voxels touch as those of the published simulator do."""
    more: dict[str, Any] = {"time_step": time_step, "substeps": substeps, "self_contact": "published"}
    return LatticeEngine(bodies, batch, **more, **medium, compute=compute)


def reordered(result: InflatableResult, order: np.ndarray) -> InflatableResult:
    """The result of a batch with its robots in another order, shape (B,)."""
    frames = result.frames
    if frames is not None:
        per_frame = ("positions", "orientations", "extents", "sizes")
        frames = replace(frames, **{name: getattr(frames, name)[:, order] for name in per_frame})
    terrains = None if result.terrains is None else result.terrains[order]
    found: dict[str, Any] = {name: getattr(result, name)[order] for name in PER_ROBOT}
    return replace(result, **found, frames=frames, terrains=terrains)


Seeds = int | tuple[int, ...]


def checked_seeds(given: object, count: int) -> Seeds:
    """A seed for a batch, or one for each of so many robots as a tuple.

    Raises:
        ValueError: for anything else.
    """
    if not isinstance(given, Sequence):
        return whole_number("seed", given, 0)
    if len(given) != count:
        raise ValueError(f"seed: {len(given)} are not allowed for {count} robots; give one, or one each")
    return tuple(whole_number("seed", one, 0) for one in given)


def travel_directions(headings: np.ndarray) -> np.ndarray:
    """Unit vectors in the plane, shape (B, 2), of headings [degrees], shape (B,)."""
    angles = np.deg2rad(headings)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def sideways(displacement: ArrayLike, headings: ArrayLike) -> np.ndarray:
    """Compute how far robots drifted to the left of their headings [m], shape (B,).

    Args:
        displacement: of ``InflatableResult`` [m], shape (B, 2).
        headings: [degrees], shape (B,).
    """
    x, y = np.asarray(displacement, float).T
    ahead = travel_directions(np.asarray(headings, float)).T
    return np.asarray(y * ahead[0] - x * ahead[1])


def summarise(
    run: LatticeResult,
    program: LatticeProgram,
    designs: Sequence[InflatableDesign],
    geometry: InflatableGeometry,
    actuation: InflatableActuation | Sequence[InflatableActuation],
    counting: Counting = WHOLE,
    record_every: int | None = None,
    terrains: Sequence[Terrain] | None = None,
) -> InflatableResult:
    """Read distances, speeds and frames off the snapshots of a run of ``build_program``'s program."""
    dt, (begin, end) = geometry.time_step, program.snapshots[:, :2].T
    middle, frames = read_poses(run, geometry, counting.stages + 1 + (counting.window > 0), record_every)
    headings = travel_directions(np.array([d.orientation for d in designs]))
    drives = each_actuation(actuation, len(designs))
    nominal = _nominal_steps(designs, drives, end - begin, counting)
    way = (middle[..., :2] * headings[:, None]).sum(axis=-1)
    ok = run.status == "ok"
    parts = np.where(ok[:, None], np.diff(way[:, stage_order(counting.stages)], axis=1), np.nan)
    displacement = np.where(ok[:, None], middle[:, 1, :2] - middle[:, 0, :2], np.nan)
    distance = (displacement * headings).sum(axis=1)
    lengths = distance / geometry.body_length
    return InflatableResult(
        distance,
        lengths / (nominal * dt),
        lengths / ((end - begin) * dt),
        run.status,
        parts,
        np.where(ok, end - begin, np.maximum(run.steps - begin, 0)),
        dt,
        frames,
        geometry.body,
        displacement,
        None if terrains is None else np.array(terrains, dtype=object),
    )


def _nominal_steps(
    designs: Sequence[InflatableDesign], drives: Sequence[InflatableActuation], steps: Ints, counting: Counting
) -> Floats | Ints:
    """Time steps by which speeds divide, shape (B,): of whole gaits, or of parts that count and last ``steps``."""
    pairs = list(zip([design.schedule for design in designs], drives, strict=True))
    nominal = np.array([counted_steps(*each) for each in pairs])
    if not counting.warm_up:
        return nominal
    return nominal * (steps / np.array([gait_steps(*each) for each in pairs]))


def read_poses(
    run: LatticeResult, geometry: InflatableGeometry, first: int, record_every: int | None = None
) -> tuple[np.ndarray, Frames | None]:
    """Read what a run recorded: where robots were at its first snapshots, and their poses at all others.

    Args:
        run: of B robots.
        geometry: of them.
        first: number of the snapshots that are no frames.
        record_every: time steps from frame to frame; None if there are none.

    Returns:
        Middles of the robots, the mean of the corners of all exposed faces [m], shape (B, first, 3); and the frames.
    """
    extents = half_extents(geometry.body, run.strains, run.sizes)
    places = (run.positions[:, :first], run.orientations[:, :first], extents[:, :first])
    middles = mean_of_face_corners(geometry.body, *places)
    if not record_every:
        return middles, None
    times = np.arange(run.positions.shape[1] - first) * record_every * geometry.time_step
    return middles, frames_of(run, extents, first, times)


def stage_order(stages: int) -> list[int]:
    """Numbers of the first snapshots of a program in order of time: the ends of stages come after the gait's end."""
    return [0, *range(2, stages + 1), 1]
