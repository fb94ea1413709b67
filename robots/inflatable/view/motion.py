"""Build motions of the inflatable robot from results of a gait, or of a journey over several terrains."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from robots.frames import Frames
from robots.inflatable import body as regions
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import GaitTimeline, gait_timeline
from robots.inflatable.view import colours
from robots.inflatable.view.colours import BLADDERS, FEET
from robots.view.motion import CUBE, Channel, Motion, Node, recorded
from robots.view.scene import INK
from robots.view.voxel_motion import voxel_motion
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """Recorded poses of inflatable robots without a simulation result.

    Attributes:
        frames: frames of the robots.
        body: lattice of each robot.
        time_step: time step dt [s].
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
        terrain: terrain of the simulation; flat ground by default.
        actuation: actuation of the simulation.
        robot: number of the robot in the batch.
        name: name of the motion.

    Raises:
        ValueError: if there are no frames, or they belong to another robot.
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
    leg = np.searchsorted(starts[1:-1] * result.time_step, recorded(result.frames).times, side="left")
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
        gait: timeline of commands and pressures.
        design: design whose pressures are shown.
        terrain: terrain of the simulation.
        heading: direction in which distance counts, one or one per frame [degrees].
        name: name of the motion.
    """
    body = result.body
    region = np.asarray(body.regions)
    core = regions.cores_of(region)
    cores = int(core.max()) + 1
    if region.max() + 1 > regions.REGION_COUNT + regions.FIRST_BLADDER * (cores - 1):
        raise ValueError(f"frames: they are of a body with {region.max() + 1} regions; give the inflatable robot's")
    nodes = [_inflatable_node(voxel, int(kind)) for voxel, kind in enumerate(regions.kinds_of(region))]
    pressure = np.broadcast_to(np.array(design.pressure), cores)[core]
    channels = _gait_channels(gait, result.time_step)
    return voxel_motion(name, result.frames, body, robot, nodes, channels, terrain, heading, pressure)


def _gait_channels(gait: GaitTimeline, time_step: float) -> list[Channel]:
    """Timeline rows of the commands of all actuators, as played, and of the core pressures.

    Pressures change until the motion of a column ends.
    """
    levels, times = np.concatenate([gait.levels, gait.levels[:, -1:]], axis=1), gait.edges.astype(float) * time_step
    rows = [(group, *each) for group, hues in (("bladder", BLADDERS), ("foot", FEET)) for each in enumerate(hues, 1)]
    found = [
        Channel(f"{group} {number}", "", times, row, colour, switch=True, group=group)
        for row, (group, number, colour) in zip(levels, rows, strict=True)
    ]
    several = gait.pressures.ndim > 1
    for number, pressures in enumerate(gait.pressures.reshape(len(times), -1).T, start=1):
        steps, pascals = gait.edges[[0, -1]], pressures[[0, -1]]
        if np.ptp(pressures) > 0:
            steps = np.append(0, np.column_stack([gait.settles, gait.edges[1:]]))
            pascals = np.append(pressures[0], np.repeat(pressures[1:], 2))
        name = f"core pressure {number}" if several else "core pressure"
        found.append(Channel(name, "kPa", steps.astype(float) * time_step, pascals / 1000, INK, read_out=True))
    return found


def _inflatable_node(voxel: int, region: int) -> Node:
    """Node for a voxel of the inflatable robot; bladders and feet show their commands."""
    if region >= regions.FIRST_BLADDER:
        row = region - regions.FIRST_BLADDER
        return Node(f"voxel {voxel}, bladder {row + 1}", CUBE, BLADDERS[row], row)
    if region in (regions.SKIN, regions.SEAM, regions.FOOT_SEAM):
        colour = colours.SKIN if region == regions.SKIN else colours.SEAM
        return Node(f"voxel {voxel}, skin", CUBE, colour)
    foot = region - regions.FOOT_1
    row = len(BLADDERS) + foot
    return Node(f"voxel {voxel}, foot {foot + 1}", CUBE, FEET[foot], row, row)
