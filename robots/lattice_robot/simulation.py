"""What lattice robots do on a terrain, and how far that depends on what is free of them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.control.cyclic import SEGMENTS, STARTS, build_cyclic_program, cycle_events, surroundings
from robots.frames import Frames
from robots.robot import Progress, part_of
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.autodiff.arrays import trace
from taichi_sim.autodiff.lanes import NATIVE_WIDTH
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeProgram, LatticeResult
from taichi_sim.lattice.faces import half_extents

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

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
        bodies: the lattice of each.
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
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    record_every: int | None = None,
    progress: Progress | None = None,
) -> LatticeRobotResult:
    """Let a robot move on a terrain, at many points as one batch.

    Args:
        robot: what moves.
        points: values of what is free, shape (N, P); by default those that it starts with.
        terrain: flat ground by default; its high friction, if any, replaces that of all materials.
        precision: "f32" or "f64".
        device: "cpu", "cuda", "vulkan" or "metal".
        threads: CPU threads that share a batch; all cores by default. Results do not depend on it.
        record_every: record the poses every so many time steps from the start of the cycles on.
        progress: called now and then with the fraction done.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    where = {"precision": precision, "device": device, "threads": threads}
    every = None if record_every is None else whole_number("record_every", record_every, 1)
    batch = _Batch(robot.on(terrain := terrain or Terrain()), _points(robot, points), terrain, every)
    if not len(batch.rows):
        return batch.result(None)
    return batch.result(batch.engine(where).run(batch.program, progress))


def differentiate(
    robot: "LatticeRobot",
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    memory: float = 1e9,
    progress: Progress | None = None,
) -> LatticeRobotResult:
    """The same, with the derivatives of the distances by what is free.

    Args:
        robot: see :func:`simulate`, as all that is not named here.
        points: see there.
        terrain: see there.
        precision: see there.
        device: see there.
        threads: see there.
        memory: bound for what is kept of the way there [B]. On a CPU, points that could not run side by side are
            differentiated one group after the other.
        progress: see there.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    where = {"precision": precision, "device": device, "threads": threads}
    running = runtime.start(device, precision, threads)  # an unknown device or precision is refused before any work
    points, robot = _points(robot, points), robot.on(terrain := terrain or Terrain())
    size = len(points) if device != "cpu" else NATIVE_WIDTH[precision] * running.thread_count
    groups = [points[i : i + size] for i in range(0, len(points), size)]
    parts = []
    for place, group in enumerate(groups):
        tick = part_of(progress, place, len(groups)) or (lambda _: None)
        parts.append(_differentiate(_Batch(robot, group, terrain, None), where, memory, tick))
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("distance", "speed", "status", "reason", "steps", "gradient")
    }
    bodies, frames = (sum((getattr(part, name) for part in parts), ()) for name in ("bodies", "frames"))
    return LatticeRobotResult(**joined, time_step=robot.cycle.time_step, bodies=bodies, frames=frames)


def _points(robot: "LatticeRobot", given: ArrayLike | None) -> Floats:
    return robot.points(robot.start if given is None else given)


def _differentiate(batch: "_Batch", where: dict[str, Any], memory: float, progress: Progress) -> LatticeRobotResult:
    if not len(batch.rows):
        return batch.result(None, np.zeros((0, batch.points.shape[1])))
    tape = batch.engine(where).record(batch.program, memory, lambda f: progress(RECORDING * f))
    ok = tape.result.status == "ok"
    seeds = np.zeros(tape.result.positions.shape)
    push = batch.shares[:, None] * batch.robot.direction
    seeds[ok, 0], seeds[ok, 1] = -push, push
    back = tape.pull_back(positions=seeds, progress=lambda f: progress(RECORDING + (1 - RECORDING) * f))
    (values, _), pull_back = trace(batch.events, batch.points[batch.rows])
    gradient: Floats = pull_back(*(each[-values.size :].reshape(values.shape) for each in (back.values, back.rates)))[0]
    if numbers := list(batch.robot.free_moduli):
        gradient[:, -len(numbers) :] = back.materials["youngs_modulus"][:, numbers]
    gradient[~ok] = np.nan
    return batch.result(tape.result, gradient)


class _Batch:
    """A robot at points on a terrain; ``rows`` are those points that are robots."""

    def __init__(self, robot: "LatticeRobot", points: Floats, terrain: Terrain, record_every: int | None) -> None:
        self.robot, self.points, self.terrain, self.record_every = robot, points, terrain, record_every
        self.reason = np.array([robot.fault(point) for point in points])
        self.rows = np.flatnonzero(self.reason == "")
        body = robot.body
        density = np.array([m.density for m in body.materials])[body.material_index]
        self.shares = density / density.sum()  # of the mass
        if len(self.rows):
            self.program = self._program(surroundings(terrain, robot.heading))

    def swing(self, points: Any) -> Any:
        """What the cycle adds to all channels at its nodes, shape (N, C, 16), at points that may be traced."""
        pairs = zip(self.robot.drives, self.robot.nodes(points), strict=True)
        moved = [nodes - self.robot.rest_of(drive)[..., None] for drive, nodes in pairs]
        return np.concatenate([each.reshape(len(points), -1, SEGMENTS) for each in moved], axis=1)

    def events(self, points: Any) -> tuple[Any, Any]:
        """Values and rates of the events of the cycle, shape (events, N, C), at points that may be traced."""
        return cycle_events(self.robot.cycle, 0.0, self.swing(points))

    def _program(self, around: dict[int, float]) -> LatticeProgram:
        drives = self.robot.drives
        return build_cyclic_program(
            np.concatenate([np.tile(drive.regions, len(drive.quantities)) for drive in drives]),
            np.concatenate([np.repeat(drive.quantities, len(drive.regions)) for drive in drives]),
            np.concatenate([self.robot.rest_of(drive).ravel() for drive in drives]),
            self.swing(self.points[self.rows]),
            self.robot.cycle,
            around,
            self.robot.body.region_count,
            self.record_every,
        )

    def engine(self, where: dict[str, Any]) -> LatticeEngine:
        """For the points that are robots."""
        bodies: Any = self.robot.bodies(self.points[self.rows]) if self.robot.free_moduli else self.robot.body
        return LatticeEngine(
            bodies, len(self.rows), time_step=self.robot.cycle.time_step, **self.terrain.medium, **where
        )

    def result(self, run: LatticeResult | None, gradient: Floats | None = None) -> LatticeRobotResult:
        """What all points came to; no run if none is a robot."""
        robot, count, rows = self.robot, len(self.points), self.rows
        distance, status, steps = np.full(count, np.nan), np.full(count, "invalid", object), np.zeros(count, np.int64)
        frames: list[Frames | None] = [None] * count
        bodies = robot.bodies(self.points)
        if run is not None:
            way = (run.positions[:, :2] @ robot.direction) @ self.shares
            distance[rows] = np.where(run.status == "ok", way[:, 1] - way[:, 0], np.nan)
            status[rows], steps[rows] = run.status, run.steps
            for row, i in enumerate(rows.tolist()):
                if self.record_every:
                    interval = self.record_every * robot.cycle.time_step
                    frames[i] = _frames(bodies[i], run, row, interval)
        slopes = None
        if gradient is not None:
            slopes = np.full((count, self.points.shape[1]), np.nan)
            slopes[rows] = gradient
        speed = distance / robot.length / robot.cycle.duration
        return LatticeRobotResult(
            distance,
            speed,
            status.astype(str),
            self.reason,
            steps,
            robot.cycle.time_step,
            tuple(bodies),
            tuple(frames),
            slopes,
        )


def _frames(body: LatticeBody, run: LatticeResult, robot: int, interval: float) -> Frames:
    """The frames of one robot of a batch, as a batch of one; ``interval`` between them [s]."""
    positions, orientations, strains, sizes = (
        each[robot, STARTS:, None] for each in (run.positions, run.orientations, run.strains, run.sizes)
    )
    times = np.arange(len(positions)) * interval
    return Frames(positions, orientations, times, half_extents(body, strains, sizes), sizes)
