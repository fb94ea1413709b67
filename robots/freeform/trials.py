"""How freeform robots are tried: designs that can be built, each as its own lattice, and mixtures between designs."""

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robots.control.cyclic import SEGMENTS
from robots.freeform.palette import MIXED
from robots.freeform.solid import Solid
from robots.lattice_robot.ground import material_friction
from robots.lattice_robot.rollout import Channels, Rollout
from robots.lattice_robot.simulation import LatticeRobotResult, assembled, result_of
from robots.robot import Progress, Trial, part_of
from robots.world import terrain_of, without_props
from taichi_sim.autodiff.arrays import trace, value_of
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody, Quantity

if TYPE_CHECKING:
    from robots.freeform.robot import FreeformRobot

MEMORY = 1e9  # of a differentiation's record [B]
AT_ONCE = 2  # robots a thread in a record: more share the memory, and so compute more again
REST = 1.0  # size of a cell that no muscle moves [edges]
ANGLES = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS  # of the nodes of a cycle [rad]
CHOICE = 4.0  # how sharply the heaviest tissue prevails, where nothing is sharpened yet


def try_designs(robot: "FreeformRobot", points: Floats, trial: Trial) -> LatticeRobotResult:
    """Try points, shape (N, P): as robots that can be built, or between designs if the trial's sharpness is finite.

    Of robots that can be built it also tells the numbers of ``cells`` and ``channels``.
    """
    if math.isfinite(trial.sharpness) and robot.relaxable:
        return _between(robot, points, trial)
    fields = robot.parametrisation(points)
    solids = [robot.solid_at(fields, row) for row in range(len(points))]
    alike: dict[tuple[bytes, ...], list[int]] = {}
    for row, solid in enumerate(solids):
        if not solid.fault:
            alike.setdefault((solid.cells.tobytes(), solid.tissues.tobytes(), solid.channels.tobytes()), []).append(row)
    size = AT_ONCE * trial.compute.thread_count if trial.gradients else len(points)
    groups = [rows[first : first + size] for rows in alike.values() for first in range(0, len(rows), size)]
    parts = []
    for done, rows in enumerate(groups):
        tick = part_of(trial.progress, done, len(groups))
        parts.append((np.array(rows), _built(robot, solids[rows[0]], points[rows], trial, tick)))
    found = _assembled(robot, parts, np.array([solid.fault for solid in solids]), points, trial)
    counts = {"cells": [len(solid.cells) for solid in solids], "channels": [solid.count for solid in solids]}
    told = {name: np.where(found.status == "ok", each, np.nan) for name, each in counts.items()}
    return dataclasses.replace(found, measures={**found.measures, **told})


def _assembled(
    robot: "FreeformRobot",
    parts: list[tuple[NDArray[Any], LatticeRobotResult]],
    reason: NDArray[np.str_],
    points: Floats,
    trial: Trial,
) -> LatticeRobotResult:
    names, slopes = [m.name for m in robot.measures], {name: points.shape[1] for name in trial.gradients}
    return assembled(parts, reason, robot.cycle.time_step, names, slopes)


def _built(
    robot: "FreeformRobot", solid: Solid, points: Floats, trial: Trial, progress: Progress | None
) -> LatticeRobotResult:
    """What robots with the same cells, tissues and channels do."""
    terrain, still = terrain_of(trial.world), np.zeros(solid.count)
    shell = robot.built(solid, still, still).on(terrain)
    regions, places = np.arange(solid.count), np.arange(SEGMENTS) / SEGMENTS

    def swing(points: Any) -> Any:
        """What the cycle adds to the sizes, shape (N, 3 count, 16); with the bits of a ``Drive``."""
        amplitude, phase = robot.waves(solid, points)
        wave = amplitude[..., None] * np.sin(2 * np.pi * (places + phase[..., None]))
        return np.tile((REST + wave) - REST, (1, 3, 1))

    swung, pull_back = trace(swing, points) if trial.gradients else (swing(points), None)
    bodies = [shell.body] * len(points)
    every, starts = trial.record_every, shell.starts(len(points))
    aim = dataclasses.replace(robot.aim, placed=shell.placed)
    rollout = Rollout(bodies, _sizes(regions), swung, robot.cycle, terrain, aim, trial.compute, every, starts)
    if pull_back is None:
        return result_of(rollout, rollout.run(progress), {})
    moved = rollout.differentiate(trial.gradients, MEMORY, progress)
    return result_of(rollout, moved, {name: pull_back(each.swing)[0] for name, each in moved.slopes.items()})


def _between(robot: "FreeformRobot", points: Floats, trial: Trial) -> LatticeRobotResult:
    """What mixtures of all tissues and of nothing do, in groups."""
    size = AT_ONCE * trial.compute.thread_count if trial.gradients else len(points)
    groups = [np.arange(first, min(first + size, len(points))) for first in range(0, len(points), size)]
    parts = []
    for done, rows in enumerate(groups):
        part = dataclasses.replace(trial, progress=part_of(trial.progress, done, len(groups)))
        parts.append((rows, _mixed(robot, points[rows], part)))
    return _assembled(robot, parts, np.full(len(points), ""), points, trial)


def _mixed(robot: "FreeformRobot", points: Floats, trial: Trial) -> LatticeRobotResult:
    grid, palette, terrain = robot.grid, robot.palette, terrain_of(trial.world)
    without_props(terrain)  # which mixtures do not meet
    wave = np.stack([np.sin(ANGLES), np.cos(ANGLES)], axis=1)  # of the components of a swing

    def mixture(points: Any) -> tuple[Any, ...]:
        """Swing of the sizes, how much each cell is driven, and the numbers of the materials."""
        fields = robot.parametrisation(points)
        weights = chosen(fields.tissue, CHOICE * (1.0 + trial.sharpness))
        muscle = (weights * palette.muscles).sum(axis=2)
        swing = fields.swing * (muscle * robot.actuation.amplitude)[..., None]
        if robot.gains:
            swing = swing * np.array(robot.gains)[:, None]
        moved = (swing[..., None, :] * wave).sum(axis=3)
        numbers = palette.mixtures(projected(fields.presence, trial.sharpness), weights)
        return np.tile(moved, (1, 3, 1)), muscle, *(numbers[name] for name in MIXED)

    (swung, driven, *values), pull_back = trace(mixture, points)
    numbers = dict(zip(MIXED, values, strict=True))
    ground = material_friction(terrain)
    numbers |= {name: np.full_like(driven, friction) for name, friction in ground.items()}
    each = np.arange(grid.count)
    plain = LatticeBody(grid.places, palette.materials[:1] * grid.count, each, grid.voxel_size, each)
    bodies = [palette.body(plain, {name: found[row] for name, found in numbers.items()}) for row in range(len(points))]
    rollout = Rollout(
        bodies, _sizes(each), swung, robot.cycle, terrain, robot.aim, trial.compute, trial.record_every, None, driven
    )
    if not trial.gradients:
        return result_of(rollout, rollout.run(trial.progress), {})
    moved, gradients = rollout.differentiate(trial.gradients, MEMORY, trial.progress), {}
    for name, slopes in moved.slopes.items():
        by = {field: slopes.materials[field] for field in MIXED}
        by |= {field: np.zeros_like(driven) for field in ground}
        gradients[name] = pull_back(slopes.swing, slopes.driven, *by.values())[0]
    return result_of(rollout, moved, gradients)


def _sizes(regions: NDArray[Any]) -> Channels:
    """The channels of regions whose voxels swell alike along all axes."""
    axes = [Quantity.SCALE + axis for axis in range(3)]
    return Channels(np.tile(regions, 3), np.repeat(axes, len(regions)), np.full(3 * len(regions), REST))


def projected(presence: Any, sharpness: float) -> Any:
    """Presence pushed towards 0 and 1, the more the sharper; a half stays one.

    Source: Wang, Lazarov & Sigmund, Struct. Multidisc. Optim. 43, 2011, eq. 9.
    """
    if sharpness == 0:
        return presence
    scale = 2 * math.tanh(sharpness / 2)
    return 0.5 + np.tanh(sharpness * (presence - 0.5)) / scale


def chosen(weights: Any, sharpness: float) -> Any:
    """Parts of tissues, which add up to 1, of their weights, shape (..., T): all of the heaviest, if sharp enough."""
    raised = np.exp(sharpness * (weights - value_of(weights).max(axis=-1, keepdims=True)))
    return raised / raised.sum(axis=-1, keepdims=True)
