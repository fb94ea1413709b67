"""Derivatives of the distances that inflatable robots travel, by the numbers of their designs.

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

from robots.inflatable.actuation import ACTUATION, InflatableActuation, each_actuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.numbers import Numbers, numbers_of
from robots.inflatable.program import build_program, write_gait
from robots.inflatable.schedule import BLADDERS
from robots.inflatable.simulation import (
    PER_ROBOT,
    InflatableResult,
    Seeds,
    checked_designs,
    checked_seeds,
    engine_of,
    laid_out,
    stage_order,
    summarise,
    travel_directions,
)
from robots.inflatable.timing import WHOLE, Counting
from robots.inflatable.turning import by_turn_of_robots, rise_by_turn, turned_quaternions, turned_vectors
from robots.world import Terrain, medium_of, one_each
from taichi_sim import runtime
from taichi_sim.autodiff.arrays import Array, trace
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.ground.relief import Relief
from taichi_sim.lattice import LatticeBody, LatticeGradient, LatticeResult, LatticeState, ProgramBuilder
from taichi_sim.lattice.faces import half_extents, mean_of_face_corners
from taichi_sim.lattice.gradient import ROBOTS_PER_THREAD

DEGREE = np.pi / 180  # [rad]
RECORDING = 0.3  # part of a differentiation's time that goes before the way back


@dataclass(frozen=True, eq=False)
class InflatableGradient:
    """Derivatives of the distances [m] of B designs by the numbers of the designs; NaN where a status is not "ok".

    Derivatives by numbers that the designs do not have are None.

    Attributes:
        pressure: by the core pressure [m/Pa], shape (B,), or by that of each of N cores, shape (B, N), where designs
            have one for each.
        orientation: by the heading [m/degree], shape (B,). Uneven ground turns with it as a whole:
            the change of its sampled heights with the heading is not included.
        levels: by the levels of bladders and feet [m], shape (B, 10, T).
        core_pressure: by the core pressure of the columns [m/Pa], shape (B, T), or (B, N, T).
        result: the distances themselves, speeds and status.
        pace: by the pace of strokes [m], shape (B, 8, T), with the number of time steps of each column held fixed.
        friction: by the friction of feet that grip and slide [m], shape (B, 2, 2). Only kinetic friction counts, as
            static friction acts through switches.
        size: by the relative rest sizes of the regions [m], shape (B, 2, R).
        modulus: by the relative moduli of the regions [m], shape (B, R).
    """

    pressure: Floats
    orientation: Floats
    levels: Floats
    core_pressure: Floats | None
    result: InflatableResult
    pace: Floats | None = None
    friction: Floats | None = None
    size: Floats | None = None
    modulus: Floats | None = None

    @property
    def inflation(self) -> Floats:
        """Derivatives by the levels of the bladders [m], shape (B, 8, T)."""
        return self.levels[:, :BLADDERS]

    @property
    def grip(self) -> Floats:
        """Derivatives by the levels of the feet [m], shape (B, 2, T)."""
        return self.levels[:, BLADDERS:]


class GradientOptions(ComputeOptions, total=False):
    """Keyword arguments of :func:`differentiate`, for functions that pass them on."""

    geometry: InflatableGeometry
    actuation: InflatableActuation | Sequence[InflatableActuation]
    counting: Counting
    memory: float
    perturbation: float
    seed: int | Sequence[int]
    progress: Callable[[float], None] | None


def differentiate(
    designs: Sequence[InflatableDesign] | InflatableDesign,
    terrain: Terrain | Sequence[Terrain] | None = None,
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation | Sequence[InflatableActuation] = ACTUATION,
    counting: Counting = WHOLE,
    memory: float = 1e9,
    perturbation: float = 0.0,
    seed: int | Sequence[int] = 0,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> InflatableGradient:
    """Simulate a batch of designs on a terrain, and differentiate the distances by the designs.

    With stages, what is differentiated is the least distance of a stage, times their number. Levels of 0 and 1 have
    derivatives, too: those of the side that is allowed.

    With a window, the distance of so many cycles at the end is differentiated, as if those before, that count, went as
    far: the state in which they begin is held constant, as that of a gait that has found its stride. So a gradient
    costs less, and crosses fewer jumps. Stages have no effect on it then.

    Args:
        designs: gaits of one number of columns, with the same bladders and the same numbers that may change: all or
            none with core pressures of columns, a pace, friction and so on.
        terrain: one for all designs, flat ground by default; or one for each.
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates; one for all designs, or one for each.
        counting: which part of a gait counts, its stages, and the window.
        memory: bound on the memory for recorded states [B]. On a CPU, robots are differentiated in groups of
            ``ROBOTS_PER_THREAD`` a thread, one after the other.
        perturbation, seed: noise on the start positions [m], see ``simulate``.
        progress: called now and then with the fraction done.
        compute: ``precision``, ``device`` and ``threads``, see ``simulate``.

    Raises:
        ValueError: if an argument is not allowed; names it, its value and what is allowed.
    """
    perturbation = number("perturbation", perturbation, 0.0, geometry.voxel_size, "m")
    designs, report = checked_designs(designs, geometry, actuation), progress or (lambda fraction: None)
    geometry = laid_out(geometry, designs)
    way = _Way(counting, memory, perturbation, checked_seeds(seed, len(designs)))
    terrains = one_each(Terrain() if terrain is None else terrain, len(designs))
    drives = each_actuation(actuation, len(designs))
    check_alike(designs)
    where = Compute.given(compute)
    running = runtime.start(where.device, where.precision, where.threads)
    size = len(designs) if where.device != "cpu" else ROBOTS_PER_THREAD * running.thread_count
    results, slopes = [], list[dict[str, Floats]]()
    for start in range(0, len(designs), size):
        group = slice(start, start + size)

        def tick(fraction: float, start: int = start) -> None:
            report(min((start + fraction * size) / len(designs), 1.0))

        part = replace(way, first=start)
        result, found = _side_by_side(designs[group], terrains[group], geometry, drives[group], where, part, tick)
        results.append(result)
        slopes.extend(found)
    joined: dict[str, Any] = {name: np.concatenate([getattr(result, name) for result in results]) for name in PER_ROBOT}
    by: dict[str, Any] = {name: np.stack([each[name] for each in slopes]) for name in slopes[0]}
    whole = replace(results[0], **joined, terrains=np.array(terrains, dtype=object))
    return InflatableGradient(**{"core_pressure": None, **by}, result=whole)


@dataclass(frozen=True)
class _Way:
    """How distances are differentiated, see :func:`differentiate`; ``first`` is the place of a group's first robot."""

    counting: Counting
    memory: float
    perturbation: float
    seeds: Seeds
    first: int = 0


def _side_by_side(
    designs: list[InflatableDesign],
    terrains: list[Terrain],
    geometry: InflatableGeometry,
    drives: list[InflatableActuation],
    compute: Compute,
    way: _Way,
    progress: Callable[[float], None],
) -> tuple[InflatableResult, list[dict[str, Floats]]]:
    """Results of robots that run as one batch, and the derivatives of each one's distance by its numbers, by name."""
    program = build_program(designs, terrains, drives, None, geometry, way.counting)
    robots = way.first + np.arange(len(designs))
    starts = geometry.body.scattered(way.perturbation, way.seeds, robots) if way.perturbation > 0 else None
    engine = engine_of(geometry, terrains, drives, compute, designs, starts)
    # A window begins at the last snapshot; without one the whole program is differentiated.
    begins = program.snapshots[:, -1] if way.counting.window else np.zeros(len(designs), int)
    before, rest = program.split(begins)
    early = engine.run(before) if begins.any() else None
    began, medium = engine.state(), medium_of(terrains, [one.orientation for one in designs], geometry.voxel_size)
    tape = engine.record(rest.program, memory=way.memory, progress=lambda f: progress(RECORDING * f))
    run = tape.result if early is None else _joined(early, tape.result, program.snapshots >= begins[:, None])
    result = summarise(run, program, designs, geometry, drives, way.counting)
    headings = np.array([design.orientation for design in designs])
    weights = _window_weights(program.snapshots) if way.counting.window else worst_stages(result)
    *seeds, by_headings = distance_cotangents(geometry.body, run, headings, weights)
    cotangents: dict[str, Any] = dict(zip(READ_OFF, seeds, strict=True))
    by_begin = _by_turn_of_window(run, cotangents) if way.counting.window else np.zeros(len(designs))
    if way.counting.window:  # where it begins is constant
        for seed in seeds:
            seed[:, -1] = 0.0
    back = tape.pull_back(**cotangents, progress=lambda f: progress(RECORDING + (1 - RECORDING) * f))
    values, rates = rest.gather(back.values, back.rates)
    by_turn = by_begin
    if not isinstance(reliefs := medium["floor"], bool):
        by_turn = by_turn + by_turn_of_robots(began, back)
        if not way.counting.window:
            by_turn = by_turn + _by_rise(began, back, reliefs, geometry.voxel_size)
    slopes = []
    for robot, (design, terrain, drive) in enumerate(zip(designs, terrains, drives, strict=True)):
        mine = program.events["robot"] == robot
        each = pull_back(design, terrain, drive, geometry, values[mine], rates[mine])
        # Ground that turns with the heading is as a robot that turns the other way, gravity and direction included.
        by_world = each["orientation"] + by_headings[robot]
        each["orientation"] = by_world if terrain.ground is None else np.asarray(-by_turn[robot] * DEGREE)
        if design.materials is not None and design.materials.modulus is not None:
            moduli = [material.youngs_modulus for material in engine.bodies[robot].materials]
            each["modulus"] = back.materials["youngs_modulus"][robot] * moduli / np.array(design.materials.modulus)
        ok = result.status[robot] == "ok"
        slopes.append({name: part if ok else np.full_like(part, np.nan) for name, part in each.items()})
    return result, slopes


def _by_rise(began: LatticeState, back: LatticeGradient, reliefs: Sequence[Relief], edge: float) -> Floats:
    """Derivatives of distances by a turn of robots at the start, which changes how far they are raised there."""
    starts = zip(reliefs, began.positions, strict=True)
    rises = np.array([rise_by_turn(relief, centres, edge) for relief, centres in starts])
    return np.asarray(back.positions[..., 2].sum(axis=1) * rises)


def _by_turn_of_window(run: LatticeResult, cotangents: dict[str, Floats]) -> Floats:
    """Derivatives of distances by a turn of robots when their windows begin, as it moves the place they count from."""
    turned = {"positions": turned_vectors, "orientations": turned_quaternions}
    parts = [cotangents[name][:, -1] * turn(getattr(run, name)[:, -1]) for name, turn in turned.items()]
    return np.asarray(sum(part.sum(axis=(1, 2)) for part in parts))


def _joined(early: LatticeResult, late: LatticeResult, is_late: Bools) -> LatticeResult:
    """The result of a program that ran in two parts; snapshots of the second are marked, shape (B, S)."""
    recorded: dict[str, Any] = {}
    for name in READ_OFF:
        parts = getattr(late, name), getattr(early, name)
        recorded[name] = np.where(is_late.reshape(is_late.shape + (1,) * (parts[0].ndim - 2)), *parts)
    return replace(late, steps=early.steps + late.steps, **recorded)


def _window_weights(snapshots: Ints) -> Floats:
    """Weights of the snapshots in the distance of a window, as long as all that counts, shape (B, S)."""
    first, end, begin = snapshots[:, 0], snapshots[:, 1], snapshots[:, -1]
    weights = np.zeros(snapshots.shape)
    weights[:, 1] = (end - first) / (end - begin)
    weights[:, -1] = -weights[:, 1]
    return weights


def check_alike(designs: Sequence[InflatableDesign]) -> None:
    """Refuse designs whose derivatives have different shapes.

    Raises:
        ValueError: if designs differ in their numbers of columns or core pressures, or some have numbers that others
            have not, such as core pressures of columns, or a friction.
    """
    if len({np.size(design.pressure) for design in designs}) > 1:
        raise ValueError("designs: a mixture is not allowed; give all one core pressure, or all one a core")
    if len({(*map(np.shape, numbers_of(design).values()), *numbers_of(design)) for design in designs}) == 1:
        return
    if len({(design.schedule.columns, design.schedule.core_pressure is None) for design in designs}) > 1:
        raise ValueError(
            "designs: a mixture is not allowed; give gaits of one number of columns, all or none with pressures"
        )
    raise ValueError("designs: a mixture is not allowed; give all of them a pace, friction, moduli and sizes, or none")


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
        for kept, each in ((self.values, value), (self.rates, rate)):
            kept.append(np.broadcast_to(each, np.size(regions)))


def pull_back(
    design: InflatableDesign,
    terrain: Terrain,
    actuation: InflatableActuation,
    geometry: InflatableGeometry,
    values: Floats,
    rates: Floats,
) -> dict[str, Floats]:
    """Derivatives of a cost by the numbers of a design, from those by its events.

    Args:
        design: of one robot.
        terrain, actuation, geometry: of its program.
        values: derivatives of the cost by the values of the robot's events, in their order in the program, shape (E,).
        rates: likewise by their rates.

    Returns:
        Derivatives by what the design has of ``Numbers``, by name, each of its shape.
    """
    own = Numbers.of(design).given

    def events(*traced: Any) -> tuple[Array, Array]:
        kept, numbers = _Kept(), dict(zip(own, traced, strict=True))
        pressure = numbers["pressure"]
        numbers["pressure"] = tuple(pressure) if pressure.ndim else pressure
        write_gait(kept, 0, design, terrain, actuation, geometry, Numbers(**numbers))
        return np.concatenate(kept.values), np.concatenate(kept.rates)

    return dict(zip(own, trace(events, *own.values())[1](values, rates), strict=True))


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
