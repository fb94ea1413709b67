"""Build motions of voxels, from recorded frames of any lattice."""

import numpy as np

from robots.frames import Frames
from robots.view.lattice_states import LatticeStates
from robots.view.mesh import knots
from robots.view.motion import (
    Channel,
    GroundPlane,
    Motion,
    Node,
    Skin,
    check_place,
    recorded,
    speed_channels,
    way_ahead,
    whole_frames,
)
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import mean_of_face_corners, rotate
from taichi_sim.lattice.materials import voxel_mass


def voxel_motion(
    name: str,
    frames: Frames | None,
    body: LatticeBody,
    robot: int,
    nodes: list[Node],
    channels: list[Channel],
    terrain: Terrain | None = None,
    heading: float | Floats = 0.0,
    pressure: float | Floats = 0.0,
    travelling: LatticeBody | None = None,
) -> Motion:
    """Build the motion of a lattice robot from cuboids with the size of its voxels, centred between their sides.

    Channels: those given, then distance and speed along the heading.

    Args:
        name: name of the motion.
        frames: recorded frames of a batch of robots.
        body: lattice of each robot.
        robot: number of the robot in the batch.
        nodes: one for each voxel.
        channels: rows of the timeline before distance and speed.
        terrain: terrain of the robot; flat ground by default.
        heading: direction in which distance counts, one or one per frame [degrees].
        pressure: pressure on the body's pressurised faces [Pa], one or one per voxel, or shape (F, V).
        travelling: body whose path is followed, made of the first voxels of ``body``; by default the whole body.

    Raises:
        ValueError: if no frames were recorded, or they belong to another robot.
    """
    frames = _checked(frames, body, robot)
    poses = [a[:, robot] for a in (frames.positions, frames.orientations, frames.extents, frames.sizes)]
    last = whole_frames(*poses)
    places, turns, extents, rest = (a[:last].astype(float) for a in poses)
    own = travelling or body
    path = mean_of_face_corners(own, *(each[:, : own.voxel_count] for each in (places, turns, extents)))
    times = frames.times[:last]
    headings = np.broadcast_to(heading, len(frames.times))[:last]
    pressed = np.asarray(pressure)[:last] if np.ndim(pressure) == 2 else pressure
    middles = places + rotate(turns, (extents[..., 1::2] - extents[..., 0::2]) / 2)
    sizes = extents[..., 1::2] + extents[..., 0::2]
    if terrain is not None and terrain.is_fluid:
        ground = GroundPlane(float(middles[..., 2].min() - sizes.max()), 0.0, float(headings[0]), solid=False)
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
        (*channels, *speed_channels(times, way_ahead(path, np.deg2rad(headings[1:])))),
        ground=ground,
        skin=Skin(knots(body), body.topology.faces),
        lattice=LatticeStates(body, places, turns, extents, rest, pressed, ground.relief),
        centre_of_mass=np.average(places[:, : own.voxel_count], axis=1, weights=_masses(own)),
    )


def _masses(body: LatticeBody) -> Floats:
    """Masses of the voxels of a body [kg], shape (V,)."""
    return np.array([voxel_mass(each, body.voxel_size) for each in body.materials])[body.material_index]


def _checked(frames: Frames | None, body: LatticeBody, robot: int) -> Frames:
    """Return the frames if they were recorded, fit the body and include the robot."""
    frames = recorded(frames)
    _, batch, voxels, _ = frames.positions.shape
    if voxels != body.voxel_count:
        raise ValueError(f"frames: they have {voxels} voxels, the body {body.voxel_count}; give its own")
    check_place("robot", robot, batch, "the batch has")
    return frames


def _ground(terrain: Terrain, heading: float, edge: float) -> GroundPlane:
    """Ground of a terrain for a robot with voxels of a given edge [m] and a heading [degrees]."""
    relief = terrain.uneven.relief(heading, edge) if terrain.uneven else None
    return GroundPlane(-0.5 * edge, terrain.slope, heading, relief=relief)
