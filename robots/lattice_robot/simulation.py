"""What lattice robots do on a terrain, and how far that depends on what is free of them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.control.cyclic import CyclicProgram, build_cyclic_program, recorded_frames, surroundings
from robots.frames import Frames
from robots.lattice_robot.robot import LatticeRobot
from robots.world import Terrain
from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.lattice import LatticeBody, LatticeEngine, LatticeResult

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
    robot: LatticeRobot,
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    record_every: int | None = None,
    progress: Callable[[float], None] | None = None,
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
    batch = _Batch(robot.on(terrain := terrain or Terrain()), robot.points(points), terrain, every)
    if not len(batch.rows):
        return batch.result(None)
    return batch.result(batch.engine(where).run(batch.program.program, progress))


def differentiate(
    robot: LatticeRobot,
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    precision: str = "f64",
    device: str = "cpu",
    threads: int | None = None,
    memory: float = 1e9,
    progress: Callable[[float], None] | None = None,
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
    points, robot, report = (
        robot.points(points),
        robot.on(terrain := terrain or Terrain()),
        progress or (lambda _: None),
    )
    size = len(points) if device != "cpu" else NATIVE_WIDTH[precision] * running.thread_count
    groups = [points[i : i + size] for i in range(0, len(points), size)]
    parts = []
    for place, group in enumerate(groups):

        def tick(fraction: float, place: int = place) -> None:
            report((place + fraction) / len(groups))

        parts.append(_differentiate(_Batch(robot, group, terrain, None), where, memory, tick))
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("distance", "speed", "status", "reason", "steps", "gradient")
    }
    bodies, frames = (sum((getattr(part, name) for part in parts), ()) for name in ("bodies", "frames"))
    return LatticeRobotResult(**joined, time_step=robot.cycle.time_step, bodies=bodies, frames=frames)


def _differentiate(
    batch: "_Batch", where: dict[str, Any], memory: float, progress: Callable[[float], None]
) -> LatticeRobotResult:
    if not len(batch.rows):
        return batch.result(None, np.zeros((0, batch.points.shape[1])))
    tape = batch.engine(where).record(batch.program.program, memory, lambda f: progress(RECORDING * f))
    ok = tape.result.status == "ok"
    seeds = np.zeros(tape.result.positions.shape)
    push = batch.shares[:, None] * batch.robot.direction
    seeds[ok, 0], seeds[ok, 1] = -push, push
    back = tape.pull_back(positions=seeds, progress=lambda f: progress(RECORDING + (1 - RECORDING) * f))
    nodes = batch.program.pull_back(back.values, back.rates)
    slopes, taken = [], 0
    for values in batch.drives:
        drive = values.drive
        count = len(drive.quantities) * len(drive.regions)
        of_drive = nodes[:, taken : taken + count].reshape(len(nodes), len(drive.quantities), len(drive.regions), -1)
        slopes.append(values.pull_back(of_drive.sum(axis=1)))
        taken += count
    slopes.append(back.materials["youngs_modulus"][:, list(batch.robot.free_moduli)])
    gradient = np.concatenate(slopes, axis=1)
    gradient[~ok] = np.nan
    return batch.result(tape.result, gradient)


class _Batch:
    """A robot at points on a terrain; ``rows`` are those points that are robots."""

    def __init__(self, robot: LatticeRobot, points: Floats, terrain: Terrain, record_every: int | None) -> None:
        self.robot, self.points, self.terrain, self.record_every = robot, points, terrain, record_every
        self.reason = np.array([robot.fault(point) for point in points])
        self.rows = np.flatnonzero(self.reason == "")
        self.drives = robot.given(points[self.rows])
        body = robot.body
        density = np.array([m.density for m in body.materials])[body.material_index]
        self.shares = density / density.sum()  # of the mass
        if len(self.rows):
            self.program = self._program(surroundings(terrain, robot.heading))

    def _program(self, around: dict[int, float]) -> CyclicProgram:
        regions: list[int] = []
        quantities: list[int] = []
        rest: list[float] = []
        swing: list[Floats] = []
        for values in self.drives:
            for quantity in values.drive.quantities:
                still = [self.robot.rest(region, quantity) for region in values.drive.regions]
                swing.append(self.robot.nodes_of(values, quantity) - np.array(still)[:, None])
                regions += values.drive.regions
                quantities += [quantity] * len(still)
                rest += still
        return build_cyclic_program(
            regions,
            quantities,
            rest,
            np.concatenate(swing, axis=1),
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
                    frames[i] = recorded_frames(bodies[i], run, row, interval)
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
