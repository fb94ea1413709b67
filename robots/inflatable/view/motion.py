"""Build motions of voxel robots: the inflatable robot, lattice robots."""

import colorsys
import dataclasses
from collections.abc import Sequence

import numpy as np

from robots.control.cyclic import SEGMENTS
from robots.frames import Frames
from robots.ground import Ground as UnevenGround
from robots.inflatable import body as regions
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import GaitTimeline, gait_timeline
from robots.lattice_robot import LatticeRobot, LatticeRobotResult
from robots.lattice_robot.drive import UNITS
from robots.view import motion
from robots.view.lattice_states import LatticeStates
from robots.view.mesh import knots
from robots.view.motion import Channel, Ground, Motion, Node, Skin
from robots.view.scene import BLADDERS, DRIVES, FEET, INK, PROP_COLOUR, SEAM_COLOUR, SKIN_COLOUR
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import mean_of_face_corners, rotate


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """Poses of inflatable robots apart from any result.

    Attributes:
        frames: of the robots.
        body: the lattice of each.
        time_step: dt [s].
    """

    frames: Frames
    body: LatticeBody
    time_step: float


def inflatable_motion(
    result: InflatableResult | Recording,
    design: InflatableDesign,
    terrain: Terrain | None = None,
    *,
    actuation: InflatableActuation = ACTUATION,
    robot: int = 0,
    name: str = "inflatable robot",
) -> Motion:
    """Build the motion of a simulated gait of the inflatable robot, with a node for each voxel.

    Channels: commands of bladders 1 to 8 and feet 1 and 2, pressures of the cores, distance and speed along the
    heading.

    Args:
        result: result of ``simulate``, with frames.
        design: the robot's design.
        terrain: where it was; flat ground by default.
        actuation: how it was driven.
        robot: number of the robot in the batch.
        name: name of the motion.

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    gait = gait_timeline(design, actuation)
    return _gait_motion(result, robot, gait, design, terrain, design.orientation, name)


def journey_motion(
    result: JourneyResult,
    legs: Sequence[Leg],
    *,
    actuation: InflatableActuation = ACTUATION,
    robot: int = 0,
    name: str = "journey",
) -> Motion:
    """Build the motion of the inflatable robot over several terrains; it is drawn on level ground.

    Channels are those of :func:`inflatable_motion`, with distance and speed along the heading of each leg.

    Args:
        result: result of ``simulate_journey``, with frames.
        legs: legs of the journey.
        actuation: how it was driven.
        robot: number of the robot in the batch.
        name: name of the motion.

    Raises:
        ValueError: for results without frames.
    """
    parts, starts = [gait_timeline(leg.design, actuation) for leg in legs], np.append(0, np.cumsum(result.steps))
    begun = list(zip(parts, starts, strict=False))
    gait = GaitTimeline(
        edges=np.concatenate([*(part.edges[:-1] + start for part, start in begun), starts[-1:]]),
        settles=np.concatenate([part.settles + start for part, start in begun]),
        levels=np.concatenate([part.levels for part in parts], axis=1),
        pressures=np.concatenate([parts[0].pressures[:1], *(part.pressures[1:] for part in parts)]),
    )
    first = legs[0]
    frames = _recorded(result.frames, result.body, robot)
    leg = np.searchsorted(starts[1:-1] * result.time_step, frames.times, side="left")
    headings = np.array([each.design.orientation for each in legs])[leg]
    return _gait_motion(
        result, robot, gait, first.design, first.terrain if first.terrain.is_fluid else None, headings, name
    )


def _gait_motion(
    result: InflatableResult | JourneyResult | Recording,
    robot: int,
    gait: GaitTimeline,
    design: InflatableDesign,
    terrain: Terrain | None,
    heading: float | Floats,
    name: str,
) -> Motion:
    """Build the motion of the inflatable robot.

    Args:
        result: with frames.
        robot: number of the robot in the batch.
        gait: what it does when.
        design: its pressures are shown.
        terrain: where it was.
        heading: direction in which distance counts, one or in each frame [degrees].
        name: name of the motion.
    """
    body = result.body
    frames, region = _recorded(result.frames, body, robot), np.asarray(body.regions)
    core = regions.cores_of(region)
    cores = int(core.max()) + 1
    if region.max() + 1 != regions.REGION_COUNT + regions.FIRST_BLADDER * (cores - 1):
        raise ValueError(f"frames: they are of a body with {region.max() + 1} regions; give the inflatable robot's")
    nodes = [_inflatable_node(voxel, int(kind)) for voxel, kind in enumerate(regions.kinds_of(region))]
    pressure = np.broadcast_to(np.array(design.pressure), cores)[core]
    channels = _gait_channels(gait, result.time_step)
    return _voxels(name, frames, body, robot, nodes, channels, terrain, heading, pressure)


def lattice_robot_motion(
    result: LatticeRobotResult,
    robot: LatticeRobot,
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
    frames = _recorded(result.frames[place], body, 0)
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
            motion.CUBE,
            by_phase.get((n, label), colours.get(n, SKIN_COLOUR if v < own.voxel_count else PROP_COLOUR)),
            None if n < 0 else n,
        )
        for v, (n, label) in enumerate(zip(shown.tolist(), region.tolist(), strict=True))
    ]
    seen = _voxels(name, frames, body, 0, nodes, driven, terrain, robot.heading, travelling=own)
    if light is None:
        return seen
    x, y, z = body.start_positions.mean(axis=0).tolist()
    lamp: Floats = np.array([[x + light[0], y + light[1], z]])
    return dataclasses.replace(seen, lights=lamp, light_radius=0.5 * body.voxel_size)


def _phase_colour(phase: float) -> tuple[float, float, float]:
    """A colour of the wheel for a phase [cycles], so that equal phases look alike."""
    return colorsys.hls_to_rgb(phase % 1.0, 0.55, 0.55)


def _recorded(frames: Frames | None, body: LatticeBody, robot: int) -> Frames:
    """Return the frames if they were recorded, fit this body and have this robot."""
    if frames is None or not len(frames.times):
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    _, batch, voxels, _ = frames.positions.shape
    if voxels != body.voxel_count:
        raise ValueError(f"frames: they have {voxels} voxels, the body {body.voxel_count}; give its own")
    motion.check_place("robot", robot, batch, "the batch has")
    return frames


def _voxels(
    name: str,
    frames: Frames,
    body: LatticeBody,
    robot: int,
    nodes: list[Node],
    channels: list[Channel],
    terrain: Terrain | None,
    heading: float | Floats,
    pressure: float | Floats = 0.0,
    travelling: LatticeBody | None = None,
) -> Motion:
    """Build a motion of cubes that have the size of the voxels and lie in the middle between their sides.

    The path is that of the body, or of a travelling one, whose voxels come first.
    """
    poses = [a[:, robot] for a in (frames.positions, frames.orientations, frames.extents, frames.sizes)]
    last = motion.whole_frames(*poses)
    places, turns, extents, rest = (a[:last].astype(float) for a in poses)
    own = travelling or body
    path = mean_of_face_corners(own, *(each[:, : own.voxel_count] for each in (places, turns, extents)))
    times = frames.times[:last]
    headings = np.broadcast_to(heading, len(frames.times))[:last]
    middles = places + rotate(turns, (extents[..., 1::2] - extents[..., 0::2]) / 2)
    sizes = extents[..., 1::2] + extents[..., 0::2]
    if terrain is not None and terrain.is_fluid:
        ground = Ground(float(middles[..., 2].min() - sizes.max()), 0.0, float(headings[0]), solid=False)
    else:
        ground = _ground(terrain or Terrain(), float(headings[0]), body.voxel_size)
    return Motion(
        name,
        times,
        tuple(nodes),
        middles,
        turns,
        sizes,
        path,
        (*channels, *motion.speed_channels(times, _way(path, headings))),
        ground=ground,
        skin=Skin(knots(body), body.topology.faces),
        lattice=LatticeStates(body, places, turns, extents, rest, pressure, ground.relief),
    )


def _ground(terrain: Terrain, heading: float, edge: float) -> Ground:
    """The ground that a robot of voxels of an edge [m] stands on, heading somewhere [degrees]."""
    relief = UnevenGround(terrain.ground).relief(heading, edge) if terrain.ground else None
    return Ground(-0.5 * edge, terrain.slope, heading, relief=relief)


def _way(path: Floats, headings: Floats) -> Floats:
    """Distance travelled along a path [m], shape (F, 3), in the direction of each frame [degrees], shape (F,)."""
    heading = np.deg2rad(headings[1:])
    along = (np.diff(path[:, :2], axis=0) * np.stack([np.cos(heading), np.sin(heading)], axis=1)).sum(axis=1)
    return np.append(0.0, np.cumsum(along))


def _gait_channels(gait: GaitTimeline, time_step: float) -> list[Channel]:
    """Timeline rows of the commands of all actuators, as played, and of the core pressures.

    Pressures change until the motion of a column ends.
    """
    names = [row.replace("bladder", "bladder ").replace("foot", "foot ") for row in GaitSchedule.row_names]
    levels, times = np.concatenate([gait.levels, gait.levels[:, -1:]], axis=1), gait.edges.astype(float) * time_step
    rows = zip(names, levels, (*BLADDERS, *FEET), strict=True)
    found = [Channel(name, "", times, row, colour, switch=True) for name, row, colour in rows]
    several = gait.pressures.ndim > 1
    for number, pressures in enumerate(gait.pressures.reshape(len(times), -1).T, start=1):
        steps, pascals = gait.edges[[0, -1]], pressures[[0, -1]]
        if np.ptp(pressures) > 0:
            steps = np.append(0, np.column_stack([gait.settles, gait.edges[1:]]))
            pascals = np.append(pressures[0], np.repeat(pressures[1:], 2))
        name = f"core pressure {number}" if several else "core pressure"
        found.append(Channel(name, "kPa", steps.astype(float) * time_step, pascals / 1000, INK))
    return found


def _inflatable_node(voxel: int, region: int) -> Node:
    """Node for a voxel of the inflatable robot; bladders and feet show their commands."""
    if region >= regions.FIRST_BLADDER:
        row = region - regions.FIRST_BLADDER
        return Node(f"voxel {voxel}, bladder {row + 1}", motion.CUBE, BLADDERS[row], row)
    if region in (regions.SKIN, regions.SEAM, regions.FOOT_SEAM):
        colour = SKIN_COLOUR if region == regions.SKIN else SEAM_COLOUR
        return Node(f"voxel {voxel}, skin", motion.CUBE, colour)
    foot = region - regions.FOOT_1
    return Node(f"voxel {voxel}, foot {foot + 1}", motion.CUBE, FEET[foot], len(BLADDERS) + foot)
