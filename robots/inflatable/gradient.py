"""How far inflatable robots travel, and how that distance changes with their designs.

On the way back a program's events are written again, traced, and give the derivatives by the numbers of the designs.
Derivatives are those of the events' values and rates; their steps are whole and stay. So they are piecewise: where a
bladder arrives with a whole step, they are those of one side. Where it is told the same as before it moves by |change|
of a level, whose derivative is taken as 0, the mean of both sides. The published ramp of the core pressure takes longer
to a higher pressure; its derivative by pressure is that of the value it ends with.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.program import WHOLE, Counting, build_program, write_gait
from robots.inflatable.schedule import BLADDERS
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
from taichi_sim.autodiff.arrays import Array, trace
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import LatticeBody, LatticeResult, ProgramBuilder
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners
from taichi_sim.lattice.gradient import ROBOTS_PER_THREAD

RECORDING = 0.3  # part of a differentiation's time that goes before the way back


@dataclass(frozen=True, eq=False)
class InflatableGradient:
    """Derivatives of the distances [m] of a batch of designs; NaN where a status is not "ok".

    Attributes:
        pressure: by the core pressure [1/Pa], shape (B,); by that of each core, shape (B, N), where designs have
            several.
        orientation: by the heading [1/degree], shape (B,).
        levels: by the levels of bladders and feet, shape (B, 10, T).
        core_pressure: by the core pressure of the columns [1/Pa], shape (B, T); None where the gait has none.
        result: the distances themselves, speeds and status.
    """

    pressure: Floats
    orientation: Floats
    levels: Floats
    core_pressure: Floats | None
    result: InflatableResult

    @property
    def inflation(self) -> Floats:
        """By the levels of the bladders, shape (B, 8, T)."""
        return self.levels[:, :BLADDERS]

    @property
    def grip(self) -> Floats:
        """By the levels of the feet, shape (B, 2, T)."""
        return self.levels[:, BLADDERS:]


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
        memory: bound for what is kept of the way there [B]. On a CPU, robots are differentiated in groups of
            ``ROBOTS_PER_THREAD`` a thread, one after the other.
        progress: called now and then with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``simulate``.

    Raises:
        ValueError: if an argument is not allowed; names it, its value and what is allowed.
    """
    designs, report = checked_designs(designs, geometry, actuation), progress or (lambda fraction: None)
    terrains = one_each(Terrain() if terrain is None else terrain, len(designs))
    check_alike(designs)
    where = Compute.given(compute)
    running = runtime.start(where.device, where.precision, where.threads)
    size = len(designs) if where.device != "cpu" else ROBOTS_PER_THREAD * running.thread_count
    results, slopes = [], []
    for start in range(0, len(designs), size):
        group = slice(start, start + size)

        def tick(fraction: float, start: int = start) -> None:
            report(min((start + fraction * size) / len(designs), 1.0))

        result, found = _side_by_side(
            designs[group], terrains[group], geometry, actuation, counting, where, memory, tick
        )
        results.append(result)
        slopes.extend(found)
    joined: dict[str, Any] = {name: np.concatenate([getattr(result, name) for result in results]) for name in PER_ROBOT}
    pressure, orientation, levels, *core = (np.stack(parts) for parts in zip(*slopes, strict=True))
    return InflatableGradient(pressure, orientation, levels, core[0] if core else None, replace(results[0], **joined))


def _side_by_side(
    designs: list[InflatableDesign],
    terrains: list[Terrain],
    geometry: InflatableGeometry,
    actuation: InflatableActuation,
    counting: Counting,
    compute: Compute,
    memory: float,
    progress: Callable[[float], None],
) -> tuple[InflatableResult, list[list[Floats]]]:
    """Results of robots that run as one batch, and the derivatives of each one's distance by its numbers.

    These are the pressure, the orientation, the levels, shape (10, T), and the core pressures of columns, if any.
    """
    program = build_program(designs, terrains, actuation, None, geometry, counting)
    engine = engine_of(len(designs), geometry, terrains[0], compute)
    tape = engine.record(program, memory=memory, progress=lambda f: progress(RECORDING * f))
    result = summarise(tape.result, program, designs, geometry, actuation, counting)
    headings = np.array([design.orientation for design in designs])
    *seeds, by_headings = distance_cotangents(geometry.body, tape.result, headings, worst_stages(result))
    cotangents: dict[str, Any] = dict(zip(READ_OFF, seeds, strict=True))
    back = tape.pull_back(**cotangents, progress=lambda f: progress(RECORDING + (1 - RECORDING) * f))
    slopes = []
    for robot, (design, terrain) in enumerate(zip(designs, terrains, strict=True)):
        mine = program.events["robot"] == robot
        each = list(pull_back(design, terrain, actuation, geometry, back.values[mine], back.rates[mine]))
        each[1] = each[1] + by_headings[robot]
        slopes.append([part if result.status[robot] == "ok" else np.full_like(part, np.nan) for part in each])
    return result, slopes


def check_alike(designs: Sequence[InflatableDesign]) -> None:
    """Refuse designs whose derivatives have different shapes.

    Raises:
        ValueError: if designs differ in their numbers of columns or core pressures, or some have core pressures of
            columns that others have not.
    """
    if len({np.size(design.pressure) for design in designs}) > 1:
        raise ValueError("designs: a mixture is not allowed; give all one core pressure, or all one a core")
    if len({(design.schedule.columns, design.schedule.core_pressure is None) for design in designs}) > 1:
        raise ValueError(
            "designs: a mixture is not allowed; give gaits of one number of columns, all or none with pressures"
        )


class _Kept(ProgramBuilder):
    """Keeps the values and rates of events, which may be traced, and nothing else of them."""

    def __init__(self) -> None:
        super().__init__(1)
        self.values: list[Any] = []
        self.rates: list[Any] = []

    def set(
        self,
        quantity: int,
        value: Any,
        *,
        regions: ArrayLike,
        step: ArrayLike = 0,
        rate: Any = 0.0,
        robots: ArrayLike | None = None,
    ) -> None:
        """Keep the numbers of an event in each region."""
        for numbers, number in ((self.values, value), (self.rates, rate)):
            numbers.append(np.broadcast_to(number, np.size(regions)))


def pull_back(
    design: InflatableDesign,
    terrain: Terrain,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
    values: Floats,
    rates: Floats,
) -> tuple[Floats, ...]:
    """Derivatives of a cost by the numbers of a design, from those by its events.

    Args:
        design: of one robot.
        terrain, actuation, geometry: of its program.
        values: derivatives of the cost by the values of the robot's events, in their order in the program, shape (E,).
        rates: likewise by their rates.

    Returns:
        Derivatives by the pressure, shape () or (cores,), the orientation, shape (), the levels, shape (10, T), and the
        core pressures of the columns, shape (T,), if there are some.
    """

    def events(pressure: Any, orientation: Any, levels: Any, after: Any = None) -> tuple[Array, Array]:
        kept, each = _Kept(), tuple(pressure) if pressure.ndim else pressure
        write_gait(kept, 0, design, terrain, actuation, geometry, (each, orientation, levels, after))
        return np.concatenate(kept.values), np.concatenate(kept.rates)

    core = design.schedule.core_pressure
    numbers = (design.pressure, design.orientation, design.schedule.levels, *(() if core is None else (core,)))
    return trace(events, *numbers)[1](values, rates)


def worst_stages(result: InflatableResult) -> Floats:
    """Weights of the snapshots in the least distance of a stage, times the number of stages, shape (B, N + 1)."""
    count = result.stages.shape[1]
    order = np.array(stage_order(count))
    worst = np.argmin(np.nan_to_num(result.stages), axis=1)
    rows, weights = np.arange(len(worst)), np.zeros((len(worst), count + 1))
    weights[rows, order[worst]], weights[rows, order[worst + 1]] = -count, count
    return weights


READ_OFF = ("positions", "orientations", "strains", "sizes")  # what distances are computed from, of a run


def distance_cotangents(body: LatticeBody, run: LatticeResult, headings: Floats, weights: Floats) -> list[Floats]:
    """Differentiate the distances that ``summarise`` reads off the snapshots of a run.

    Args:
        body: of the robots.
        run: with S snapshots.
        headings: of the robots [degrees], shape (B,).
        weights: with which the robot's places at the snapshots make the distance, shape (B, S): -1 for the first and 1
            for the last, see :func:`worst_stages`.

    Returns:
        Derivatives by what ``READ_OFF`` names, each of its shape, then by the headings on the path that robots went
        [m/degree]; zeros for robots that diverged.
    """
    ok = run.status == "ok"

    def distances(positions: Floats, orientations: Floats, strains: Floats, sizes: Floats, headings: Floats) -> Floats:
        middle = mean_of_face_corners(body, positions, orientations, half_extents(body, strains, sizes))
        ways: Floats = (middle[..., :2] * travel_directions(headings)[:, None]).sum(axis=-1)
        return (weights[ok] * ways).sum(axis=-1)

    _, back = trace(distances, *(getattr(run, name)[ok] for name in READ_OFF), headings[ok])
    found = []
    for part in back(np.ones(int(ok.sum()))):
        whole = np.zeros((len(ok), *part.shape[1:]))
        whole[ok] = part
        found.append(whole)
    return found
