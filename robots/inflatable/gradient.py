"""How far relaxed designs of the inflatable robot travel, and how that distance changes with them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.cores import highest_pressure
from robots.inflatable.relaxed_motion import gait_steps, nominal_gait_steps
from robots.inflatable.relaxed_program import DesignGradient, Parameters, RelaxedProgram, build_relaxed_program
from robots.inflatable.relaxed_schedule import RelaxedDesign
from robots.inflatable.robot import InflatableResult, reordered, scattered, stage_order, summarise, travel_directions
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH
from taichi_sim.base.arrays import Floats, Indices
from taichi_sim.base.checks import number, whole_number
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeResult
from taichi_sim.lattice.faces import (
    half_extents,
    mean_of_face_corners,
    pull_back_half_extents,
    pull_back_mean_of_face_corners,
)

RECORDING = 0.3  # part of a differentiation's time that goes before the way back


@dataclass(frozen=True, eq=False)
class InflatableGradient(DesignGradient):
    """Derivatives of the distances [m] of a batch of designs; NaN where a status is not "ok".

    Attributes:
        result: the distances themselves, speeds and status.
    """

    result: InflatableResult


def simulate_relaxed(
    designs: Sequence[RelaxedDesign] | RelaxedDesign,
    terrain: Terrain | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    ramp_steps: int | None = None,
    warm_up: int = 0,
    stages: int = 1,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    driver: str = "auto",
    record_every: int | None = None,
    perturbation: float = 0.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> InflatableResult:
    """Evaluate a batch of relaxed designs on a terrain, as ``simulate`` does designs.

    Args:
        designs: gaits of one number of columns, all or none with core pressures per column.
        terrain: flat ground by default.
        geometry: see ``simulate``; so are the others that are not named here.
        actuation: see there.
        ramp_steps: see ``build_relaxed_program``.
        warm_up: see there; the speeds divide by the same time as without.
        stages: see there.
        precision: see ``simulate``.
        device: see there.
        threads: see there.
        driver: see there.
        record_every: see there.
        perturbation: see there.
        seed: see there.
        progress: see there.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    designs = _listed(designs)
    perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
    seed = whole_number("seed", seed, 0)
    record_every = None if record_every is None else whole_number("record_every", record_every, 1)
    terrain = terrain or Terrain()
    Parameters.of(designs)  # refuses what goes not together
    # Robots of a block wait for its slowest: put those of like length together.
    lengths = [
        actuation.initial_steps(highest_pressure(d.pressure), ramp_steps) + gait_steps(d.schedule, actuation)
        for d in designs
    ]
    order = np.argsort(lengths, kind="stable")
    program = build_relaxed_program(
        [designs[i] for i in order], terrain, actuation, ramp_steps, warm_up, stages, record_every, geometry
    )
    engine = LatticeEngine(
        geometry.body,
        len(designs),
        time_step=geometry.time_step,
        **terrain.medium,
        device=device,
        precision=precision,
        threads=threads,
        driver=driver,
    )
    if perturbation > 0:
        engine.set_positions(scattered(geometry.body, perturbation, seed, order))
    run = engine.run(program.program, progress)
    return _summary(designs, program, run, geometry, actuation, stages, record_every, np.argsort(order))


def differentiate(
    designs: Sequence[RelaxedDesign] | RelaxedDesign,
    terrain: Terrain | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    ramp_steps: int | None = None,
    warm_up: int = 0,
    stages: int = 1,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    memory: float = 1e9,
    driver: str = "auto",
    progress: Callable[[float], None] | None = None,
) -> InflatableGradient:
    """Evaluate a batch of relaxed designs on a terrain, and differentiate the distances by the designs.

    With stages, what is differentiated is the least distance of a stage, times their number.

    Args:
        designs: gaits of one number of columns, all or none with core pressures per column.
        terrain: flat ground by default.
        geometry: see ``simulate``; so are the others that are not named here.
        actuation: see there.
        ramp_steps: see ``build_relaxed_program``.
        warm_up: see ``simulate_relaxed``.
        stages: see there.
        precision: see ``simulate``.
        device: see there.
        threads: see there.
        memory: bound for what is kept of the way there [B]. On a CPU, robots that could not run side by side are
            differentiated one group after the other.
        driver: see ``simulate``.
        progress: see there.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    designs, report = _listed(designs), progress or (lambda fraction: None)
    running = runtime.start(device, precision, threads)  # an unknown device or precision is refused before any work
    size = len(designs) if device != "cpu" else NATIVE_WIDTH[precision] * running.thread_count
    groups = [designs[i : i + size] for i in range(0, len(designs), size)] or [[]]
    where = {"device": device, "precision": precision, "threads": threads, "driver": driver}
    found = []
    for place, group in enumerate(groups):

        def tick(fraction: float, place: int = place) -> None:
            report((place + fraction) / len(groups))

        build = {
            "terrain": terrain or Terrain(),
            "actuation": actuation,
            "ramp_steps": ramp_steps,
            "warm_up": warm_up,
            "stages": stages,
        }
        found.append(_differentiate(group, geometry, build, memory, where, tick))
    return found[0] if len(found) == 1 else _joined(found)


def _differentiate(
    designs: list[RelaxedDesign],
    geometry: InflatableGeometry,
    build: dict[str, Any],
    memory: float,
    options: dict[str, Any],
    progress: Callable[[float], None],
) -> InflatableGradient:
    """The same for robots that run side by side, with arguments of ``build_relaxed_program``."""
    program, medium = build_relaxed_program(designs, **build, geometry=geometry), build["terrain"].medium
    engine = LatticeEngine(geometry.body, len(designs), time_step=geometry.time_step, **medium, **options)
    tape = engine.record(program.program, memory=memory, progress=lambda f: progress(RECORDING * f))
    headings, stages = np.array([d.orientation for d in designs]), build["stages"]
    result = _summary(designs, program, tape.result, geometry, build["actuation"], stages)
    seeds = distance_cotangents(geometry.body, tape.result, headings, worst_stages(result))
    back = tape.pull_back(
        positions=seeds.positions,
        orientations=seeds.orientations,
        strains=seeds.strains,
        sizes=seeds.sizes,
        progress=lambda f: progress(RECORDING + (1 - RECORDING) * f),
    )
    gradient = program.pull_back(back.values, back.rates)
    return _judged(result, gradient, seeds.headings)


def _joined(parts: list[InflatableGradient]) -> InflatableGradient:
    """One gradient of all groups."""

    def join(owners: list[Any], names: list[str]) -> dict[str, Any]:
        columns = {name: [getattr(owner, name) for owner in owners] for name in names}
        return {name: None if column[0] is None else np.concatenate(column) for name, column in columns.items()}

    per_robot = ["distance", "speed", "speed_simulated", "status", "stages", "steps", "displacement"]
    result = replace(parts[0].result, **join([part.result for part in parts], per_robot))
    names = [field.name for field in fields(DesignGradient)]
    return InflatableGradient(**join(list(parts), names), result=result)


def _listed(designs: Sequence[RelaxedDesign] | RelaxedDesign) -> list[RelaxedDesign]:
    return list(designs) if isinstance(designs, Sequence) else [designs]


def _summary(
    designs: list[RelaxedDesign],
    program: RelaxedProgram,
    run: LatticeResult,
    geometry: InflatableGeometry,
    actuation: InflatableActuation,
    stages: int,
    record_every: int | None = None,
    back: Indices | None = None,
) -> InflatableResult:
    """What a run says of designs; ``back`` says where they are in it."""
    if back is None:
        back = np.arange(len(designs))
    headings = np.array([d.orientation for d in designs])
    nominal = [nominal_gait_steps(d.schedule, gait_steps(d.schedule, actuation), actuation) for d in designs]
    marks = program.program.snapshots[back]
    return summarise(reordered(run, back), marks, headings, np.array(nominal), geometry, record_every, stages)


def _judged(result: InflatableResult, gradient: DesignGradient, headings: Floats) -> InflatableGradient:
    """The gradient with what the heading does to the distance of a given path, and NaN for robots that failed."""
    failed = np.where(result.status == "ok", 0.0, np.nan)
    return InflatableGradient(
        (gradient.pressure.T + failed).T,  # by one pressure, or by several
        gradient.orientation + headings + failed,
        gradient.inflation + failed[:, None, None],
        gradient.grip + failed[:, None, None],
        None if gradient.core_pressure is None else gradient.core_pressure + failed[:, None],
        result,
    )


@dataclass(frozen=True, eq=False)
class DistanceCotangents:
    """Derivatives of every robot's distance by what a run recorded; zeros for robots that diverged.

    Attributes:
        positions: of the voxels, shape (B, S, V, 3).
        orientations: of the voxels [m], shape (B, S, V, 4).
        strains: of the links [m], shape (B, S, L).
        sizes: of the rest sizes of voxels, shape (B, S, V, 3).
        headings: of the robots, on the path they went [m/degree], shape (B,).
    """

    positions: Floats
    orientations: Floats
    strains: Floats
    sizes: Floats
    headings: Floats


def worst_stages(result: InflatableResult) -> Floats:
    """Weights of the snapshots in the least distance of a stage, times the number of stages, shape (B, N + 1)."""
    count = result.stages.shape[1]
    order = np.array(stage_order(count))
    worst = np.argmin(np.nan_to_num(result.stages), axis=1)
    rows, weights = np.arange(len(worst)), np.zeros((len(worst), count + 1))
    weights[rows, order[worst]], weights[rows, order[worst + 1]] = -count, count
    return weights


def distance_cotangents(body: LatticeBody, run: LatticeResult, headings: Floats, weights: Floats) -> DistanceCotangents:
    """Differentiate the distances that ``summarise`` reads off the snapshots of a run.

    Args:
        body: of the robots.
        run: with S snapshots.
        headings: of the robots [degrees], shape (B,).
        weights: with which the robot's places at the snapshots make the distance, shape (B, S): -1 for the first and 1
            for the last, see :func:`worst_stages`.
    """
    ok = run.status == "ok"
    travel = travel_directions(headings)
    by_middle = np.zeros((*weights.shape, 3))
    by_middle[..., :2] = weights[..., None] * travel[:, None]
    by_middle = by_middle[ok]
    extents = half_extents(body, run.strains[ok], run.sizes[ok])
    middle = mean_of_face_corners(body, run.positions[ok], run.orientations[ok], extents)
    by_positions, by_orientations, by_extents = pull_back_mean_of_face_corners(
        body, run.orientations[ok], extents, by_middle
    )
    by_strains, by_sizes = pull_back_half_extents(body, run.strains[ok], run.sizes[ok], by_extents)

    def spread(part: Floats) -> Floats:
        whole = np.zeros((len(ok), *part.shape[1:]))
        whole[ok] = part
        return whole

    x, y = travel[ok].T
    turned = np.stack([-y, x], axis=1) * (np.pi / 180)
    by_headings = ((weights[ok, :, None] * middle[..., :2]).sum(axis=1) * turned).sum(axis=1)
    return DistanceCotangents(
        spread(by_positions), spread(by_orientations), spread(by_strains), spread(by_sizes), spread(by_headings)
    )
