"""How far inflatable robots travel, and how that distance changes with their designs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Unpack

import numpy as np

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.program import WHOLE, Counting, DesignGradient, Parameters, build_differentiable_program
from robots.inflatable.simulation import (
    PER_ROBOT,
    InflatableResult,
    checked_designs,
    engine_of,
    stage_order,
    summarise,
    travel_directions,
)
from robots.world import Terrain, one_each
from taichi_sim import runtime
from taichi_sim.autodiff.arrays import trace
from taichi_sim.autodiff.lanes import NATIVE_WIDTH
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import LatticeBody, LatticeResult
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners

RECORDING = 0.3  # part of a differentiation's time that goes before the way back


@dataclass(frozen=True, eq=False)
class InflatableGradient(DesignGradient):
    """Derivatives of the distances [m] of a batch of designs; NaN where a status is not "ok".

    Attributes:
        result: the distances themselves, speeds and status.
    """

    result: InflatableResult


class GradientOptions(ComputeOptions, total=False):
    """Keyword arguments of :func:`differentiate`, for functions that pass them on."""

    geometry: InflatableGeometry
    actuation: InflatableActuation
    counting: Counting
    memory: float
    progress: Callable[[float], None] | None


def differentiate(
    designs: Sequence[InflatableDesign] | InflatableDesign,
    terrain: Terrain | Sequence[Terrain] | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    counting: Counting = WHOLE,
    memory: float = 1e9,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> InflatableGradient:
    """Simulate a batch of designs on a terrain, and differentiate the distances by the designs.

    With stages, what is differentiated is the least distance of a stage, times their number. Levels of 0 and 1 have
    derivatives, too: those of the side that is allowed.

    Args:
        designs: gaits of one number of columns, all or none with core pressures of columns.
        terrain: one for all designs, flat ground by default; or one for each.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates.
        counting: which part of a gait counts, and its stages.
        memory: bound for what is kept of the way there [B]. On a CPU, robots that could not run side by side are
            differentiated one group after the other.
        progress: called now and then with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``simulate``.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    designs, report = checked_designs(designs, geometry, actuation), progress or (lambda fraction: None)
    terrains = one_each(Terrain() if terrain is None else terrain, len(designs))
    Parameters.of(designs)  # refuses what goes not together
    where = Compute.given(compute)
    running = runtime.start(where.device, where.precision, where.threads)
    size = len(designs) if where.device != "cpu" else NATIVE_WIDTH[where.precision] * running.thread_count
    found = []
    for start in range(0, len(designs), size):
        group = slice(start, start + size)

        def tick(fraction: float, start: int = start) -> None:
            report(min((start + fraction * size) / len(designs), 1.0))

        work = _Group(designs[group], terrains[group], geometry, actuation, counting)
        found.append(work.differentiate(where, memory, tick))
    return found[0] if len(found) == 1 else _joined(found)


@dataclass(frozen=True, eq=False)
class _Group:
    """Robots that run side by side."""

    designs: list[InflatableDesign]
    terrains: list[Terrain]
    geometry: InflatableGeometry
    actuation: InflatableActuation
    counting: Counting

    def differentiate(self, compute: Compute, memory: float, progress: Callable[[float], None]) -> InflatableGradient:
        """Run forth and back."""
        designs, body = self.designs, self.geometry.body
        program = build_differentiable_program(designs, self.terrains, self.actuation, self.geometry, self.counting)
        engine = engine_of(len(designs), self.geometry, self.terrains[0], compute)
        tape = engine.record(program.program, memory=memory, progress=lambda f: progress(RECORDING * f))
        result = summarise(tape.result, program.program, designs, self.geometry, self.actuation, self.counting)
        headings = np.array([d.orientation for d in designs])
        seeds = distance_cotangents(body, tape.result, headings, worst_stages(result))
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

    def join(owners: list[Any], names: Sequence[str]) -> dict[str, Any]:
        columns = {name: [getattr(owner, name) for owner in owners] for name in names}
        return {name: None if column[0] is None else np.concatenate(column) for name, column in columns.items()}

    result = replace(parts[0].result, **join([part.result for part in parts], PER_ROBOT))
    names = [field.name for field in fields(DesignGradient)]
    return InflatableGradient(**join(list(parts), names), result=result)


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
    recorded = (run.positions[ok], run.orientations[ok], run.strains[ok], run.sizes[ok])
    middle, pull_back = trace(
        lambda places, turns, strains, sizes: mean_of_face_corners(
            body, places, turns, half_extents(body, strains, sizes)
        ),
        *recorded,
    )
    by_positions, by_orientations, by_strains, by_sizes = pull_back(by_middle)

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
