"""Build motions of lattice robots, whose voxels have the colours of their drives."""

import colorsys
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from robots.control.cyclic import SEGMENTS
from robots.lattice_robot.drive import UNITS
from robots.view.motion import CUBE, Channel, Motion, Node
from robots.view.scene import CLAY, HUES, PURPLES, SAND, SKY, YELLOW
from robots.view.voxel_motion import voxel_motion
from robots.world import Terrain
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot
    from robots.lattice_robot.simulation import LatticeRobotResult

DRIVES = (*HUES, *PURPLES, SKY, YELLOW)  # colours of drives, all different
UNDRIVEN, PROP = SAND, CLAY  # colours of other voxels


def lattice_robot_motion(
    result: "LatticeRobotResult",
    robot: "LatticeRobot",
    terrain: Terrain | None = None,
    *,
    place: int = 0,
    name: str = "robot",
) -> Motion:
    """Build the motion of a simulated lattice robot, with a node for each voxel.

    Channels: each drive, as in the first of its regions, then distance and speed along the heading. Voxels have the
    colour of their drive, or of their phase, where a drive has several.

    Args:
        result: result of ``simulate``, with frames.
        robot: as it was simulated, without anything free, or where it starts.
        terrain: where it was; flat ground by default.
        place: place of the point in the batch.
        name: name of the motion.

    Raises:
        ValueError: for results without frames, and points that are no robots.
    """
    if result.reason[place]:
        raise ValueError(f"frames: point {place} has none, as it is no robot: {result.reason[place]}")
    body, light = result.bodies[place], robot.light_in(terrain or Terrain())
    robot = robot.on(terrain or Terrain())
    if body.voxel_count != robot.body.voxel_count:
        raise ValueError(
            f"frames: they have {body.voxel_count} voxels, the robot {robot.body.voxel_count}; give its own"
        )
    cycle, region = robot.cycle, np.asarray(robot.body.regions)
    times: Floats = np.arange((cycle.cycles + 1) * SEGMENTS + 1, dtype=float) * (cycle.segment * cycle.time_step)
    driven, shown = list[Channel](), np.full(body.voxel_count, -1)
    for number, (drive, nodes) in enumerate(zip(robot.drives, robot.nodes(robot.start[None]), strict=True)):
        wave: Floats = np.tile(nodes[0, 0, 0], cycle.cycles + 2)[: len(times)]
        colour, label = DRIVES[number % len(DRIVES)], f"{drive.name} {drive.quantity}"
        driven.append(Channel(label, UNITS[drive.quantity], times, wave, colour))
        shown[np.isin(region, drive.regions)] = number
    colours = {number: channel.colour for number, channel in enumerate(driven)}
    by_phase = {
        (number, label): _phase_colour(phase)
        for number, drive in enumerate(robot.drives)
        if isinstance(drive.phase, tuple)
        for label, phase in zip(drive.regions, drive.phase, strict=True)
        if isinstance(phase, float)
    }
    own = robot.placed.robot if robot.placed is not None else body
    nodes = [
        Node(
            f"voxel {v}" if v < own.voxel_count else f"prop voxel {v}",
            CUBE,
            by_phase.get((n, label), colours.get(n, UNDRIVEN if v < own.voxel_count else PROP)),
            None if n < 0 else n,
        )
        for v, (n, label) in enumerate(zip(shown.tolist(), region.tolist(), strict=True))
    ]
    seen = voxel_motion(name, result.frames[place], body, 0, nodes, driven, terrain, robot.heading, travelling=own)
    if light is None:
        return seen
    x, y, z = body.start_positions.mean(axis=0).tolist()
    lamp: Floats = np.array([[x + light[0], y + light[1], z]])
    return dataclasses.replace(seen, lights=lamp, light_radius=0.5 * body.voxel_size)


def _phase_colour(phase: float) -> tuple[float, float, float]:
    """A colour of the wheel for a phase [cycles], so that equal phases look alike."""
    return colorsys.hls_to_rgb(phase % 1.0, 0.55, 0.55)
