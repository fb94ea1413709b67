"""What lattice robots do on a terrain, and how far that depends on what is free of them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.batches import in_groups, of_each, runs_of
from robots.control.cyclic import SEGMENTS
from robots.frames import Frames
from robots.lattice_robot.faults import settles_at_rest
from robots.lattice_robot.reflexes import Feeling
from robots.lattice_robot.rollout import Channels, Moved, Rollout
from robots.lattice_robot.scenes import Scenes, sharing
from robots.outcome import recorded
from robots.robot import Outcome, Progress, Trial, World, part_of
from robots.world import Terrain, terrain_of
from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import LatticeBody, Quantity
from taichi_sim.lattice.gradient import ROBOTS_PER_THREAD

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

BESIDE = 1e-4  # cycles: how far from a tie gradients are taken
MEMORY = 1e9  # of a differentiation's record [B]
LARGEST_BATCH = 256  # robots of a batch on a CPU, at most, where several worlds share it


@dataclass(frozen=True, eq=False, repr=False)
class LatticeRobotResult(ShortText):
    """Result of simulating a lattice robot at N points.

    Attributes:
        measures: by the names in ``robots.lattice_robot.measures``, shape (N,) each; NaN unless the status is "ok".
        status: "ok", "diverged" or "invalid", shape (N,).
        reason: why a point is no robot, shape (N,); empty if it is one.
        steps: time steps simulated, shape (N,).
        time_step: dt [s].
        bodies: lattice body of each point; None for a point that is no robot.
        frames: recorded poses of each, times from the start of the cycles; None where not asked for, or no robot.
        gradients: derivatives of measures by what is free, in the order of ``LatticeRobot.free``, by name, shape
            (N, P) each; NaN unless the status is "ok". Those that were not asked for are left out.
    """

    measures: Mapping[str, Floats]
    status: NDArray[np.str_]
    reason: NDArray[np.str_]
    steps: Ints
    time_step: float
    bodies: tuple[LatticeBody, ...]
    frames: tuple[Frames | None, ...]
    gradients: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def distance(self) -> Floats:
        """Distance that the centre of mass moved along the heading in the cycles that count [m], shape (N,)."""
        return self.measures["distance"]

    @property
    def speed(self) -> Floats:
        """Speed along the heading [body lengths per second], shape (N,)."""
        return self.measures["speed"]

    def rows(self, which: slice) -> "LatticeRobotResult":
        """Select the results of some of the points."""
        bodies, frames = self.bodies[which], self.frames[which]
        measures, gradients = ({n: v[which] for n, v in each.items()} for each in (self.measures, self.gradients))
        told = self.status[which], self.reason[which], self.steps[which]
        return LatticeRobotResult(measures, *told, self.time_step, bodies, frames, gradients)

    def split(self, parts: int) -> "Iterator[LatticeRobotResult]":
        """Split the results into ``parts`` of equally many successive points."""
        size = len(self.status) // parts
        return (self.rows(slice(first, first + size)) for first in range(0, len(self.status), size))

    @property
    def gradient(self) -> Floats | None:
        """Derivatives of the distance [m per unit], shape (N, P); None where not asked for."""
        return self.gradients.get("distance")


def simulate(
    robot: "LatticeRobot",
    points: ArrayLike | None = None,
    terrain: Terrain | None = None,
    *,
    record_every: int | None = None,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> LatticeRobotResult:
    """Simulate a lattice robot on a terrain, at many points as one batch.

    Args:
        robot: the robot.
        points: values of its P free parameters, shape (N, P); by default those that it starts with.
        terrain: flat ground by default; its friction, if any, replaces that of all materials.
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
    memory: float = MEMORY,
    progress: Progress | None = None,
    **compute: Unpack[ComputeOptions],
) -> LatticeRobotResult:
    """Simulate a robot at many points, with derivatives of the distances by its free parameters.

    Where nothing moves while the robot settles, see ``faults.settles_at_rest``, derivatives are those of waves
    that are ``BESIDE`` of a cycle later.

    Args:
        robot, points, terrain, progress: as in :func:`simulate`.
        memory: bound on the memory for recorded states [B]. On a CPU, points are differentiated in groups of
            ``ROBOTS_PER_THREAD`` a thread, one after the other.
        **compute: device, precision and threads, as of :class:`Compute`.

    Raises:
        ValueError: one line that names the argument, the value and what is allowed.
    """
    trial = Trial(terrain or Terrain(), Compute.given(compute), None, progress, gradients=("distance",))
    return try_points(robot, robot.start if points is None else points, trial, memory)


def try_points(robot: "LatticeRobot", points: ArrayLike, trial: Trial, memory: float = MEMORY) -> LatticeRobotResult:
    """What a robot does at N points, shape (N, P), in a trial; with gradients in groups, see :func:`differentiate`."""
    points = robot.points(points)
    scenes = Scenes.of([robot] * len(points), [terrain_of(trial.world)] * len(points))
    return _try_scenes(scenes, points, trial, memory)


def try_variants(
    robots: Sequence["LatticeRobot"], points: Floats, worlds: Sequence[World], trial: Trial
) -> list[Outcome]:
    """What variants of a robot do at N points, shape (N, P), each in its world; those that can share a batch do."""
    terrains, count = [terrain_of(world) for world in worlds], len(points)
    on_cpu = trial.compute.device == "cpu"
    most = max(LARGEST_BATCH // count, 1) if on_cpu else len(worlds)
    alike = sharing(robots, terrains)
    groups = [group[first : first + most] for group in alike for first in range(0, len(group), most)]

    def run(group: Sequence[int], progress: Progress | None) -> Iterator[Outcome]:
        there = replace(trial, world=terrains[group[0]], progress=progress)
        rows = [number for number in group for _ in range(count)]
        scenes = Scenes.of([robots[row] for row in rows], [terrains[row] for row in rows])
        memory = MEMORY * (1 if on_cpu else len(group))  # a CPU takes a few robots at a time
        batch = _try_scenes(scenes, np.tile(points, (len(group), 1)), there, memory)
        return (outcome_of(part) for part in batch.split(len(group)))

    return in_groups(groups, trial.progress, run)


def _try_scenes(scenes: Scenes, points: Floats, trial: Trial, memory: float) -> LatticeRobotResult:
    """What the robots of scenes do at a point each, shape (N, P), in a trial whose world is that of the first."""
    compute, robot = trial.compute, scenes.first
    if trial.record_every is not None:
        trial = replace(trial, record_every=whole_number("record_every", trial.record_every, 1))
    reason = of_each(scenes.robots, lambda robot, own: np.array([robot.fault(point) for point in own]), points)
    size = len(points)
    if trial.gradients and compute.device == "cpu":
        size = ROBOTS_PER_THREAD * compute.thread_count
    groups = [np.arange(first, min(first + size, len(points))) for first in range(0, len(points), size)]
    parts = []
    for done, group in enumerate(groups):
        rows, tick = group[reason[group] == ""], part_of(trial.progress, done, len(groups))
        if len(rows):
            told = replace(trial, progress=tick)
            parts.append((rows, _try_group(scenes.rows(rows), points[rows], told, memory)))
    measures, slopes = robot.measures_in((trial.world,)), {name: points.shape[1] for name in trial.gradients}
    return assembled(parts, reason, robot.cycle.time_step, [m.name for m in measures], slopes)


def _try_group(scenes: Scenes, points: Floats, trial: Trial, memory: float) -> LatticeRobotResult:
    """What robots do at points that all are robots; gradients at points that settle to a tie come from beside it."""
    tied = of_each(scenes.robots, settles_at_rest, points)
    if not trial.gradients or not tied.any():
        return _moved(scenes, points, trial, memory)
    told = trial.progress or (lambda _: None)
    beside = replace(trial, progress=lambda fraction: told(0.9 * fraction))
    found = _moved(scenes, points, beside, memory, BESIDE * tied)
    plain = _moved(scenes, points, replace(trial, gradients=(), progress=None))
    failed = (plain.status != "ok")[:, None]
    return replace(plain, gradients={name: np.where(failed, np.nan, g) for name, g in found.gradients.items()})


def _moved(
    scenes: Scenes, points: Floats, trial: Trial, memory: float = MEMORY, later: ArrayLike = 0.0
) -> LatticeRobotResult:
    """What robots do in one batch, with waves that are later by parts of a cycle, shape (N,)."""
    delays, robot = np.broadcast_to(np.asarray(later, float), len(points)), scenes.first

    def swing(points: Any) -> Any:
        return of_each(scenes.robots, swing_of, points, delays)

    swung, pull_back = trace(swing, points) if trial.gradients else (swing(points), None)
    rollout = rollout_of(scenes, points, swung, trial)
    if pull_back is None:
        return result_of(rollout, rollout.run(trial.progress), {})
    moved = rollout.differentiate(trial.gradients, memory, trial.progress, trial.gradient_horizon)
    gradients = {}
    for name, slopes in moved.slopes.items():
        gradients[name] = np.array(pull_back(slopes.swing)[0])
        if count := slopes.weights.shape[1] * (robot.reflexes is not None and robot.reflexes.weights is None):
            end = points.shape[1] - len(robot.free_moduli)
            gradients[name][:, end - count : end] = slopes.weights
        if numbers := list(robot.free_moduli):
            gradients[name][:, -len(numbers) :] = slopes.materials["youngs_modulus"][:, numbers]
    return result_of(rollout, moved, gradients)


def rollout_of(scenes: Scenes, points: Floats, swung: Floats, trial: Trial) -> Rollout:
    """Robots at a point each, with what waves add to their channels, shape (N, C, 16), ready to move."""
    robot, channels = scenes.first, channels_of(scenes.first)
    rest = of_each(scenes.robots, lambda own, points: np.tile(channels_of(own).rest, (len(points), 1)), points)
    channels = replace(channels, rest=rest, feeling=_feeling(robot, points, channels, scenes.lights))
    aim = replace(robot.aim, target=scenes.lights, is_light=True) if scenes.aimed else robot.aim
    bodies = [body for own, rows in runs_of(scenes.robots) for body in own.bodies(points[rows])]
    every, where, starts = trial.record_every, scenes.terrains, scenes.starts
    return Rollout(bodies, channels, swung, robot.cycle, where, aim, trial.compute, every, starts)


def felt_over_time(robot: "LatticeRobot", points: Floats, terrain: Terrain, compute: Compute) -> Floats:
    """What a robot with reflexes feels at N points, shape (N, P), sixteen times a cycle, shape (N, S, T)."""
    scenes = Scenes.of([robot] * len(points), [terrain] * len(points))
    rollout = rollout_of(scenes, points, of_each(scenes.robots, swing_of, points), Trial(terrain, compute))
    rollout.run()
    return rollout.felt


def channels_of(robot: "LatticeRobot") -> Channels:
    """The channels that the drives of a robot have, without reflexes."""
    drives = robot.drives
    return Channels(
        np.concatenate([np.tile(drive.regions, len(drive.quantities)) for drive in drives]),
        np.concatenate([np.repeat(drive.quantities, len(drive.regions)) for drive in drives]),
        np.concatenate([robot.rest_of(drive).ravel() for drive in drives]),
    )


def swing_of(robot: "LatticeRobot", points: Any, later: ArrayLike = 0.0) -> Any:
    """What the cycle adds to all channels at its nodes, shape (N, C, 16), at points that may be traced."""
    pairs = zip(robot.drives, robot.nodes(points, later), strict=True)
    moved = [nodes - robot.rest_of(drive)[..., None] for drive, nodes in pairs]
    return np.concatenate([each.reshape(len(points), -1, SEGMENTS) for each in moved], axis=1)


def answers_in(robot: "LatticeRobot", channels: Channels) -> Ints:
    """Which of the regions that it feels answers in each channel, -1 for none, shape (C,)."""
    places = {region: place for place, region in enumerate(robot.felt_regions)}
    quantities, driven = np.asarray(channels.quantities), np.asarray(channels.regions)
    scales = (quantities >= Quantity.SCALE) & (quantities < Quantity.SCALE + 3)
    return np.array([places[r] if scale else -1 for r, scale in zip(driven.tolist(), scales.tolist(), strict=True)])


def shares_in(robot: "LatticeRobot") -> Floats:
    """How strongly each channel follows an answer of the reflexes, shape (C,)."""
    return np.concatenate([np.repeat(drive.shares, len(drive.regions)) for drive in robot.drives])


def _feeling(robot: "LatticeRobot", points: Floats, channels: Channels, lights: Floats | None) -> Feeling | None:
    """The reflexes of a robot at N points, shape (N, P), and which of them answers in each channel."""
    if robot.reflexes is None:
        return None
    answers = answers_in(robot, channels)
    shares = shares_in(robot)
    return Feeling(robot.reflexes, robot.weights_of(points), robot.felt_regions, answers, shares, lights, robot.seed)


def result_of(rollout: Rollout, moved: Moved, gradients: Mapping[str, Floats]) -> LatticeRobotResult:
    """The result of robots that moved, with the derivatives of measures by what is free of them."""
    reason, dt = np.full(len(rollout.bodies), ""), rollout.cycle.time_step
    found = moved.measures, moved.status, reason, moved.steps, dt, rollout.bodies, moved.frames
    return LatticeRobotResult(*found, gradients)


def outcome_of(found: LatticeRobotResult) -> Outcome:
    """A result as commands and searches see it."""
    return Outcome(
        found.measures, found.status, found.reason, found.steps, found.gradients, recorded(found.frames[0]), found
    )


def assembled(
    parts: Iterable[tuple[NDArray[Any], LatticeRobotResult]],
    reason: NDArray[np.str_],
    time_step: float,
    names: Sequence[str],
    slopes: Mapping[str, int],
) -> LatticeRobotResult:
    """The result of N points from the results of some of them each.

    Args:
        parts: which points they are, and their result.
        reason: why a point is no robot and in no part, shape (N,).
        time_step: dt [s].
        names: of the measures.
        slopes: names of the measures with gradients, with the number of free values P.
    """
    count = len(reason)
    measures = {name: np.full(count, np.nan) for name in names}
    gradients = {name: np.full((count, size), np.nan) for name, size in slopes.items()}
    status, steps = np.full(count, "invalid", object), np.zeros(count, np.int64)
    bodies, frames = np.full((2, count), None)
    for rows, part in parts:
        for whole, pieces in ((measures, part.measures), (gradients, part.gradients)):
            for name, values in whole.items():
                values[rows] = pieces[name]
        status[rows], steps[rows] = part.status, part.steps
        bodies[rows], frames[rows] = part.bodies, part.frames
    return LatticeRobotResult(
        measures, status.astype(str), reason, steps, time_step, tuple(bodies), tuple(frames), gradients
    )
