"""Build motions of voxel robots: the inflatable robot, lattice robots."""

from collections.abc import Sequence

import numpy as np

from robots.control.cyclic import SEGMENTS
from robots.frames import Frames
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import (
    BLADDER_COUNT,
    FIRST_BLADDER,
    FOOT_1,
    FOOT_SEAM,
    REGION_COUNT,
    SEAM,
    SKIN,
    cores_of,
    kinds_of,
)
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import GaitTimeline, gait_timeline
from robots.lattice_robot import LatticeRobot, LatticeRobotResult
from robots.lattice_robot.drive import UNITS
from robots.view.lattice_states import LatticeStates
from robots.view.motion import CUBE, Channel, Colour, Ground, Motion, Node, Skin, speed_channels, whole_frames
from robots.view.scene import BLADDERS, FEET, INK, SEAM_COLOUR, SKIN_COLOUR
from robots.view.shape import knots
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import mean_of_face_corners, rotate


def inflatable_motion(
    result: InflatableResult,
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
    frames = _recorded(result.frames, result.body, robot)
    regions = np.asarray(result.body.regions)
    cores = int(cores_of(regions).max()) + 1
    if regions.max() + 1 != REGION_COUNT + FIRST_BLADDER * (cores - 1):
        raise ValueError(f"frames: they are of a body with {regions.max() + 1} regions; give the inflatable robot's")
    gait, pressure = gait_timeline(design, actuation), np.broadcast_to(np.array(design.pressure), cores)
    return _voxels(
        name,
        frames,
        result.body,
        robot,
        [_inflatable_node(v, int(r)) for v, r in enumerate(kinds_of(regions))],
        _gait_channels(gait, result.time_step),
        _core_channels(gait, result.time_step),
        terrain,
        design.orientation,
        pressure[cores_of(regions)],
    )


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
    frames = _recorded(result.frames, result.body, robot)
    parts, starts = [gait_timeline(leg.design, actuation) for leg in legs], np.append(0, np.cumsum(result.steps))
    gait = GaitTimeline(
        edges=np.concatenate(
            [*(part.edges[:-1] + start for part, start in zip(parts, starts, strict=False)), starts[-1:]]
        ),
        settles=np.concatenate([part.settles + start for part, start in zip(parts, starts, strict=False)]),
        levels=np.concatenate([part.levels for part in parts], axis=1),
        pressures=np.concatenate([parts[0].pressures[:1], *(part.pressures[1:] for part in parts)]),
    )
    regions = np.asarray(result.body.regions)
    nodes = [_inflatable_node(v, int(r)) for v, r in enumerate(kinds_of(regions))]
    fluid = legs[0].terrain if legs[0].terrain.is_fluid else None
    leg = np.searchsorted(starts[1:-1] * result.time_step, frames.times, side="left")
    headings = np.array([each.design.orientation for each in legs])[leg]
    return _voxels(
        name,
        frames,
        result.body,
        robot,
        nodes,
        _gait_channels(gait, result.time_step),
        _core_channels(gait, result.time_step),
        fluid,
        headings,
        np.broadcast_to(np.array(legs[0].design.pressure), cores_of(regions).max() + 1)[cores_of(regions)],
    )


def lattice_robot_motion(
    result: LatticeRobotResult,
    robot: LatticeRobot,
    terrain: Terrain | None = None,
    *,
    place: int = 0,
    name: str = "robot",
) -> Motion:
    """Build the motion of a simulated lattice robot, with a node for each voxel.

    Channels: each drive, as in the first of its regions, then distance and speed along the heading.

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
    body = result.bodies[place]
    frames = _recorded(result.frames[place], body, 0)
    if body.voxel_count != robot.body.voxel_count:
        raise ValueError(
            f"frames: they have {body.voxel_count} voxels, the robot {robot.body.voxel_count}; give its own"
        )
    cycle, regions = robot.cycle, np.asarray(robot.body.regions)
    times: Floats = np.arange((cycle.cycles + 1) * SEGMENTS + 1, dtype=float) * (cycle.segment * cycle.time_step)
    driven, shown = [], np.full(body.voxel_count, -1)
    for number, (drive, values) in enumerate(robot.nodes(robot.start).items()):
        wave: Floats = np.tile(values[0], cycle.cycles + 2)[: len(times)]
        driven.append(
            Channel(
                f"{drive.name} {drive.quantity}",
                UNITS[drive.quantity],
                times,
                wave,
                _colour(BLADDERS[number % BLADDER_COUNT]),
            )
        )
        shown[np.isin(regions, drive.regions)] = number
    nodes = [
        Node(f"voxel {v}", CUBE, driven[c].colour if c >= 0 else _colour(SKIN_COLOUR), int(c) if c >= 0 else None)
        for v, c in enumerate(shown)
    ]
    return _voxels(name, frames, body, 0, nodes, driven, [], terrain, robot.heading)


def _recorded(frames: Frames | None, body: LatticeBody, robot: int) -> Frames:
    """Return the frames if they were recorded, fit this body and have this robot."""
    if frames is None or not len(frames.times):
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    _, batch, voxels, _ = frames.positions.shape
    if voxels != body.voxel_count:
        raise ValueError(f"frames: they have {voxels} voxels, the body {body.voxel_count}; give its own")
    if not 0 <= robot < batch:
        raise ValueError(f"robot: {robot} is not allowed; the batch has {batch}")
    return frames


def _voxels(
    name: str,
    frames: Frames,
    body: LatticeBody,
    robot: int,
    nodes: list[Node],
    driven: list[Channel],
    more: list[Channel],
    terrain: Terrain | None,
    direction: float | Floats = 0.0,
    pressure: float | Floats = 0.0,
) -> Motion:
    """Build a motion of cubes that have the size of the voxels and lie in the middle between their sides."""
    poses = [a[:, robot] for a in (frames.positions, frames.orientations, frames.extents, frames.sizes)]
    last = whole_frames(*poses)
    places, turns, extents, rest = (a[:last].astype(float) for a in poses)
    path, times = mean_of_face_corners(body, places, turns, extents), frames.times[:last]
    direction = np.broadcast_to(direction, len(frames.times))[:last]
    middles = places + rotate(turns, (extents[..., 1::2] - extents[..., 0::2]) / 2)
    channels = [*driven, *more, *speed_channels(times, _way(path, direction), _colour(INK))]
    sizes = extents[..., 1::2] + extents[..., 0::2]
    states = LatticeStates(body, places, turns, extents, rest, pressure)
    first = float(direction[0])
    ground = Ground(-0.5 * body.voxel_size, (terrain or Terrain()).slope, first)
    if terrain is not None and terrain.is_fluid:
        ground = Ground(float(middles[..., 2].min() - sizes.max()), 0.0, first, solid=False)
    return Motion(
        name,
        times,
        tuple(nodes),
        middles,
        turns,
        sizes,
        path,
        tuple(channels),
        ground=ground,
        skin=Skin(knots(body), body.topology.faces),
        lattice=states,
    )


def _way(path: Floats, direction: Floats) -> Floats:
    """Distance travelled along a path [m], shape (F, 3), in the direction of each frame [degrees], shape (F,)."""
    heading = np.deg2rad(direction[1:])
    along = (np.diff(path[:, :2], axis=0) * np.stack([np.cos(heading), np.sin(heading)], axis=1)).sum(axis=1)
    return np.append(0.0, np.cumsum(along))


def _gait_channels(gait: GaitTimeline, time_step: float) -> list[Channel]:
    """Timeline rows of the commands of all actuators, as played."""
    colours = [_colour(c) for c in (*BLADDERS, *FEET)]
    names = [row.replace("bladder", "bladder ").replace("foot", "foot ") for row in GaitSchedule.row_names]
    values, times = np.concatenate([gait.levels, gait.levels[:, -1:]], axis=1), gait.edges.astype(float) * time_step
    rows = zip(names, values, colours, strict=True)
    return [Channel(name, "", times, row, colour, switch=True) for name, row, colour in rows]


def _core_channels(gait: GaitTimeline, time_step: float) -> list[Channel]:
    """Timeline rows of the core pressures, which change until the motion of a column ends."""
    if gait.pressures.ndim == 1:
        return [_core_channel("core pressure", gait, gait.pressures, time_step)]
    several = enumerate(gait.pressures.T, start=1)
    return [_core_channel(f"core pressure {number}", gait, pressures, time_step) for number, pressures in several]


def _core_channel(name: str, gait: GaitTimeline, pressures: Floats, time_step: float) -> Channel:
    steps, pascals = gait.edges[[0, -1]], pressures[[0, -1]]
    if np.ptp(pressures) > 0:
        steps = np.append(0, np.column_stack([gait.settles, gait.edges[1:]]))
        pascals = np.append(pressures[0], np.repeat(pressures[1:], 2))
    return Channel(name, "kPa", steps.astype(float) * time_step, pascals / 1000, _colour(INK))


def _inflatable_node(voxel: int, region: int) -> Node:
    """Node for a voxel of the inflatable robot; bladders and feet show their commands."""
    if region >= FIRST_BLADDER:
        row = region - FIRST_BLADDER
        return Node(f"voxel {voxel}, bladder {row + 1}", CUBE, _colour(BLADDERS[row]), row)
    if region in (SKIN, SEAM, FOOT_SEAM):
        return Node(f"voxel {voxel}, skin", CUBE, _colour(SKIN_COLOUR if region == SKIN else SEAM_COLOUR))
    foot = region - FOOT_1
    return Node(f"voxel {voxel}, foot {foot + 1}", CUBE, _colour(FEET[foot]), BLADDER_COUNT + foot)


def _colour(values: Floats) -> Colour:
    red, green, blue = (float(v) for v in values)
    return red, green, blue
