"""Build motions of lattice robots, whose voxels have the colours of their drives."""

import colorsys
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from robots.control.cyclic import SEGMENTS
from robots.lattice_robot.channels import places_alike, rests
from robots.lattice_robot.drive import UNITS, Drive
from robots.view.motion import CUBE, Channel, Motion, Node
from robots.view.scene import CLAY, HUES, PURPLES, SAND, SKY, YELLOW, Colour
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

    Channels: each drive, as in the first of its regions, or of friction each wave of it, then distance and speed along
    the heading. Voxels have the colour of their drive, or of their phase, where a drive has several.

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
    driven, of_region = _driven(robot)
    own = robot.placed.robot if robot.placed is not None else body
    undriven = [_Look(UNDRIVEN if v < own.voxel_count else PROP) for v in range(body.voxel_count)]
    regions = np.asarray(robot.body.regions).tolist()
    looks = [of_region.get(region, look) for region, look in zip(regions, undriven, strict=True)]
    nodes = [
        Node(f"{'' if v < own.voxel_count else 'prop '}voxel {v}", CUBE, look.colour, look.channel, look.foot)
        for v, look in enumerate(looks)
    ]
    frames = result.frames[place]
    pressure = 0.0 if frames is None else _pressure(robot, frames.times)
    seen = voxel_motion(name, frames, body, 0, nodes, driven, terrain, robot.heading, pressure, travelling=own)
    if driven:
        seen = dataclasses.replace(seen, period=1 / robot.frequency)
    if light is None:
        return seen
    x, y, z = body.start_positions.mean(axis=0).tolist()
    lamp: Floats = np.array([[x + light[0], y + light[1], z]])
    return dataclasses.replace(seen, lights=lamp, light_radius=0.5 * body.voxel_size)


@dataclasses.dataclass(frozen=True)
class _Look:
    """Colour of a region's voxels, the channel that they show, and the one by which they grip."""

    colour: Colour
    channel: int | None = None
    foot: int | None = None


def _driven(robot: "LatticeRobot") -> tuple[list[Channel], dict[int, _Look]]:
    """The channels of all drives, and how the regions look that they drive; the last drive of a region counts."""
    driven, looks = list[Channel](), dict[int, _Look]()
    if rests(robot):
        return driven, looks
    for number, (drive, nodes) in enumerate(zip(robot.drives, robot.nodes(robot.start[None]), strict=True)):
        phases = drive.phase if isinstance(drive.phase, tuple) else (None,) * len(drive.regions)
        for channel, places in _channels(robot, drive, np.asarray(nodes[0], float), DRIVES[number % len(DRIVES)]):
            grips = drive.quantity == "friction" and np.ptp(channel.values) > 0
            for place in places:
                region, phase = drive.regions[place], phases[place]
                colour = _phase_colour(phase) if isinstance(phase, float) else channel.colour
                foot = len(driven) if grips else looks[region].foot if region in looks else None
                looks[region] = _Look(colour, len(driven), foot)
            driven.append(channel)
    return driven, looks


def _pressure(robot: "LatticeRobot", times: Floats) -> float | Floats:
    """Pressure in each voxel at F times [Pa], shape (V,), or (F, V) where it changes; without what reflexes add."""
    pressed = [number for number, drive in enumerate(robot.drives) if drive.quantity == "pressure"]
    if rests(robot) or not pressed:
        return 0.0
    waves, regions = robot.nodes(robot.start[None]), np.asarray(robot.body.regions)
    at, found = times / (robot.cycle.segment * robot.cycle.time_step), np.zeros((len(times), len(regions)))
    for number in pressed:
        each = np.asarray(waves[number][0], float)[0]
        for region, wave in zip(robot.drives[number].regions, each, strict=True):
            now: Floats = np.interp(at, np.arange(SEGMENTS), wave, period=SEGMENTS)
            found[:, regions == region] = now[:, None]
    return found if np.ptp(found, axis=0).any() else found[0]


def _channels(robot: "LatticeRobot", drive: Drive, waves: Floats, colour: Colour) -> list[tuple[Channel, list[int]]]:
    """Timeline rows of a drive, each with the places of its regions: one row, or of friction one for each wave.

    Feet that take turns to grip so are told apart.

    Args:
        robot: that has it.
        drive: the drive.
        waves: its quantities in its regions in a cycle, shape (Q, G, 16).
        colour: of the rows.
    """
    cycle, alike = robot.cycle, [list(range(len(drive.regions)))]
    if drive.quantity == "friction":
        alike = places_alike(waves, robot.rest_of(drive))
    times: Floats = np.arange((cycle.cycles + 1) * SEGMENTS + 1, dtype=float) * (cycle.segment * cycle.time_step)
    found = []
    for number, places in enumerate(alike, 1):
        once = waves[0, places[0]]
        wave: Floats = np.tile(once, cycle.cycles + 2)[: len(times)]
        name = drive.name if len(alike) == 1 else f"{drive.name} {number}"
        told = drive.quantity == "pressure" and not np.ptp(once) > 0  # a flat line says less than its number
        label, unit = f"{name} {drive.quantity}", UNITS[drive.quantity]
        found.append((Channel(label, unit, times, wave, colour, read_out=told), places))
    return found


def _phase_colour(phase: float) -> Colour:
    """A colour of the wheel for a phase [cycles], so that equal phases look alike."""
    return colorsys.hls_to_rgb(phase % 1.0, 0.55, 0.55)
