"""What lattice robots do on a terrain, and how far that depends on what is free of them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.control.cyclic import SEGMENTS, STARTS, build_cyclic_program, cycle_events, surroundings
from robots.frames import Frames
from robots.robot import Progress, Trial, part_of
from robots.world import Terrain, terrain_of
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeResult
from taichi_sim.lattice.faces import half_extents
from taichi_sim.lattice.gradient import ROBOTS_PER_THREAD

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

BESIDE = 1e-4  # cycles: how far from a tie gradients are taken
RECORDING = 0.3  # part of a differentiation's time that goes before the way back


@dataclass(frozen=True, eq=False)
class LatticeRobotResult:
    """What a robot did at N points.

    Attributes:
        distance: of the centre of mass along the heading in the cycles that count [m], shape (N,); NaN unless the
            status is "ok".
        speed: body lengths along the heading per second, shape (N,).
        status: "ok", "diverged" or "invalid", shape (N,).
        reason: why a point is no robot, shape (N,); empty if it is one.
        steps: time steps simulated, shape (N,).
        time_step: dt [s].
        bodies: the lattice of each; None of a point that is no robot.
        frames: recorded poses of each, times from the start of the cycles; None where not asked for, or no robot.
        gradient: derivatives of the distance by what is free, in the order of ``LatticeRobot.free`` [m per unit],
            shape (N, P); NaN unless the status is "ok"; None where not asked for.
    """

    distance: Floats
    speed: Floats
    status: NDArray[np.str_]
    reason: NDArray[np.str_]
    steps: Ints
    time_step: float
    bodies: tuple[LatticeBody, ...]
    frames: tuple[Frames | None, ...]
    gradient: Floats | None = None


def simulate(
    robot: "LatticeRobot",
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    record_every: int | None = None,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> LatticeRobotResult:
    """Let a robot move on a terrain, at many points as one batch.

    Args:
        robot: what moves.
        points: values of what is free, shape (N, P); by default those that it starts with.
        terrain: flat ground by default; its high friction, if any, replaces that of all materials.
        record_every: record the poses every so many time steps from the start of the cycles on.
        progress: called now and then with the fraction done.
        **compute: device, precision (``"f64"`` by default) and threads, as of :class:`Compute`.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    trial = Trial(terrain or Terrain(), Compute.given(compute), record_every, progress)
    return try_points(robot, robot.start if points is None else points, trial)


def differentiate(
    robot: "LatticeRobot",
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    memory: float = 1e9,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> LatticeRobotResult:
    """Let a robot move, with the derivatives of the distances by what is free.

    Where nothing moves while the robot settles, see ``LatticeRobot.settles_at_rest``, derivatives are those of waves
    that are ``BESIDE`` of a cycle later.

    Args:
        robot, points, terrain, progress: as in :func:`simulate`.
        memory: bound for what is kept of the way there [B]. On a CPU, points are differentiated in groups of
            ``ROBOTS_PER_THREAD`` a thread, one after the other.
        **compute: device, precision and threads, as of :class:`Compute`.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    trial = Trial(terrain or Terrain(), Compute.given(compute), None, progress, gradients=True)
    return try_points(robot, robot.start if points is None else points, trial, memory)


def try_points(robot: "LatticeRobot", points: ArrayLike, trial: Trial, memory: float = 1e9) -> LatticeRobotResult:
    """What a robot does at N points, shape (N, P), in a trial; with gradients in groups, see :func:`differentiate`."""
    compute, terrain = trial.compute, terrain_of(trial.world)
    every = None if trial.record_every is None else whole_number("record_every", trial.record_every, 1)
    robot, points = robot.on(terrain), robot.points(points)
    reason = np.array([robot.fault(point) for point in points])
    size = len(points)
    if trial.gradients and compute.device == "cpu":
        size = ROBOTS_PER_THREAD * compute.thread_count
    groups = [np.arange(first, min(first + size, len(points))) for first in range(0, len(points), size)]
    parts = []
    for done, group in enumerate(groups):
        rows, tick = group[reason[group] == ""], part_of(trial.progress, done, len(groups))
        if not len(rows):
            continue
        batch = _Batch(robot, points[rows], terrain, compute, every)
        if trial.gradients:
            found = _differentiate_beside_ties(batch, memory, tick or (lambda _: None))
        else:
            found = batch.result(batch.engine.run(batch.program, tick))
        parts.append((rows, found))
    return assembled(parts, reason, robot.cycle.time_step, points.shape[1] if trial.gradients else None)


def assembled(
    parts: Iterable[tuple[NDArray[Any], LatticeRobotResult]],
    reason: NDArray[np.str_],
    time_step: float,
    free_count: int | None = None,
) -> LatticeRobotResult:
    """The result of N points from the results of some of them each.

    Args:
        parts: which points they are, and their result.
        reason: why a point is no robot and in no part, shape (N,).
        time_step: dt [s].
        free_count: P, if there are gradients.
    """
    count = len(reason)
    distance, speed = np.full((2, count), np.nan)
    status, steps = np.full(count, "invalid", object), np.zeros(count, np.int64)
    bodies, frames = np.full((2, count), None)
    gradient = None if free_count is None else np.full((count, free_count), np.nan)
    for rows, part in parts:
        distance[rows], speed[rows], status[rows], steps[rows] = part.distance, part.speed, part.status, part.steps
        bodies[rows], frames[rows] = part.bodies, part.frames
        if gradient is not None:
            gradient[rows] = part.gradient
    return LatticeRobotResult(
        distance, speed, status.astype(str), reason, steps, time_step, tuple(bodies), tuple(frames), gradient
    )


def _differentiate_beside_ties(batch: "_Batch", memory: float, progress: Progress) -> LatticeRobotResult:
    """Results of a batch with gradients; those of points that settle to a tie come from just beside it."""
    tied = batch.robot.settles_at_rest(batch.points)
    if not tied.any():
        return _differentiate(batch, memory, progress)
    found = _differentiate(batch.moved(BESIDE * tied), memory, lambda fraction: progress(0.9 * fraction))
    plain = batch.result(batch.engine.run(batch.program))
    assert found.gradient is not None
    failed = (plain.status != "ok")[:, None]
    return replace(plain, gradient=np.where(failed, np.nan, found.gradient))


def _differentiate(batch: "_Batch", memory: float, progress: Progress) -> LatticeRobotResult:
    tape = batch.engine.record(batch.program, memory, lambda f: progress(RECORDING * f))
    ok = tape.result.status == "ok"
    seeds = np.zeros(tape.result.positions.shape)
    push = batch.shares[:, None] * batch.robot.direction
    seeds[ok, 0], seeds[ok, 1] = -push, push
    back = tape.pull_back(positions=seeds, progress=lambda f: progress(RECORDING + (1 - RECORDING) * f))
    (values, _), pull_back = trace(batch.events, batch.points)
    gradient: Floats = pull_back(*(each[-values.size :].reshape(values.shape) for each in (back.values, back.rates)))[0]
    if numbers := list(batch.robot.free_moduli):
        gradient[:, -len(numbers) :] = back.materials["youngs_modulus"][:, numbers]
    gradient[~ok] = np.nan
    return batch.result(tape.result, gradient)


class _Batch:
    """A robot at points, all of which are robots, on a terrain: its program and its engine."""

    def __init__(
        self,
        robot: "LatticeRobot",
        points: Floats,
        terrain: Terrain,
        compute: Compute,
        record_every: int | None,
        later: ArrayLike = 0.0,
    ) -> None:
        self.robot, self.points, self.record_every, self.later = robot, points, record_every, later
        self.terrain, self.compute = terrain, compute
        self.bodies = robot.bodies(points)
        density = np.array([m.density for m in robot.body.materials])[robot.body.material_index]
        self.shares = density / density.sum()  # of the mass
        drives = robot.drives
        self.program = build_cyclic_program(
            np.concatenate([np.tile(drive.regions, len(drive.quantities)) for drive in drives]),
            np.concatenate([np.repeat(drive.quantities, len(drive.regions)) for drive in drives]),
            np.concatenate([robot.rest_of(drive).ravel() for drive in drives]),
            self.swing(points),
            robot.cycle,
            surroundings(terrain, robot.heading),
            robot.body.region_count,
            record_every,
        )
        self.engine = LatticeEngine(
            self.bodies if robot.free_moduli else robot.body,
            len(points),
            time_step=robot.cycle.time_step,
            **terrain.medium,
            compute=compute,
        )

    def moved(self, later: ArrayLike) -> "_Batch":
        """The batch with waves that are later by parts of a cycle, shape (N,)."""
        return _Batch(self.robot, self.points, self.terrain, self.compute, self.record_every, later)

    def swing(self, points: Any) -> Any:
        """What the cycle adds to all channels at its nodes, shape (N, C, 16), at points that may be traced."""
        pairs = zip(self.robot.drives, self.robot.nodes(points, self.later), strict=True)
        moved = [nodes - self.robot.rest_of(drive)[..., None] for drive, nodes in pairs]
        return np.concatenate([each.reshape(len(points), -1, SEGMENTS) for each in moved], axis=1)

    def events(self, points: Any) -> tuple[Any, Any]:
        """Values and rates of the events of the cycle, shape (events, N, C), at points that may be traced."""
        return cycle_events(self.robot.cycle, 0.0, self.swing(points))

    def result(self, run: LatticeResult, gradient: Floats | None = None) -> LatticeRobotResult:
        """What all points came to."""
        robot, dt = self.robot, self.robot.cycle.time_step
        way = (run.positions[:, :2] @ robot.direction) @ self.shares
        distance = np.where(run.status == "ok", way[:, 1] - way[:, 0], np.nan)
        speed = distance / robot.length / robot.cycle.duration
        frames: tuple[Frames | None, ...] = (None,) * len(self.points)
        if self.record_every:
            interval = self.record_every * dt
            frames = tuple(_frames(body, run, row, interval) for row, body in enumerate(self.bodies))
        reason = np.full(len(self.points), "")
        bodies = tuple(self.bodies)
        return LatticeRobotResult(distance, speed, run.status, reason, run.steps, dt, bodies, frames, gradient)


def _frames(body: LatticeBody, run: LatticeResult, robot: int, interval: float) -> Frames:
    """The frames of one robot of a batch, as a batch of one; ``interval`` between them [s]."""
    positions, orientations, strains, sizes = (
        each[robot, STARTS:, None] for each in (run.positions, run.orientations, run.strains, run.sizes)
    )
    times = np.arange(len(positions)) * interval
    return Frames(positions, orientations, times, half_extents(body, strains, sizes), sizes)
