"""Motions: solids with poses over time, which all views of robots show.

``voxel_motion`` builds motions of voxels and ``rigid_motion`` those of rigid bodies; kinds of robots have ``motion``
modules of their own that use them. ``still``, ``film``, ``onlooker``, ``paraview``, ``rerun_file``, ``glb`` and
``player`` show motions.
"""

from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robots.view.lattice_states import LatticeStates
from robots.view.scene import INK, Colour
from taichi_sim.autodiff import rotations
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import numbers, on_off, whole_number
from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import Relief
from taichi_sim.rigid import Box, Capsule, Sphere
from taichi_sim.rigid.model.shapes import Solid

CUBE, BALL = Box((1.0, 1.0, 1.0)), Sphere(0.5)  # solids of unit size; their scale gives their size
LIGHT_COLOUR: Colour = (1.0, 0.8, 0.3)
Z_UP_TO_Y_UP = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
WINDOW = 1 / 40  # fraction of a motion's duration over which its speed is averaged


class Timed(Protocol):
    """Frames of any engine."""

    @property
    def times(self) -> Floats:
        """Times of the frames [s], shape (F,)."""


AnyFrames = TypeVar("AnyFrames", bound=Timed)


@dataclass(frozen=True, eq=False)
class Channel:
    """A value that changes in time: one row of the timeline.

    Attributes:
        name: name of the row.
        unit: unit of the values; empty if there is none.
        times: times of the values, increasing [s], shape (K,).
        values: shape (K,); for a switch from 0 (off) to 1 (on), or truth values.
        colour: red, green, blue from 0 to 1.
        switch: whether a value holds until the next one; otherwise values are interpolated linearly.
        logarithmic: whether the values, all positive, are shown on a logarithmic scale.
        read_out: whether the value is also shown as a number beside the robot.
        group: common beginning of the names of switches that belong together, such as ``bladder`` for ``bladder 3``;
            empty for a single row.
    """

    name: str
    unit: str
    times: Floats
    values: Floats
    colour: Colour = (0.35, 0.35, 0.35)
    switch: bool = False
    logarithmic: bool = False
    read_out: bool = False
    group: str = ""

    def __post_init__(self) -> None:
        if not self.name.startswith(self.group):
            raise ValueError(f"{self.name}: group: {self.group!r} is not allowed; give how the name begins")
        times = numbers(f"{self.name}: times", self.times, "K")
        values = numbers(f"{self.name}: values", on_off(self.values), len(times))
        if (np.diff(times) < 0).any():
            raise ValueError(f"{self.name}: times that go back are not allowed; give them in order")
        if self.logarithmic and (values <= 0).any():
            raise ValueError(f"{self.name}: {values.min()} has no logarithm; give positive values")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    def levels(self, times: Floats) -> Floats:
        """Values at given times [s], shape (N,), scaled to 0 at the channel's smallest value and 1 at its largest.

        Values of switches are not scaled.
        """
        values = np.log(self.values) if self.logarithmic else self.values
        if self.switch:
            at = np.searchsorted(self.times, times, side="right") - 1
            return values[np.clip(at, 0, len(values) - 1)]
        low, high = values.min(), values.max()
        now = np.interp(times, self.times, values)
        return (now - low) / (high - low) if high > low else np.ones_like(now)


@dataclass(frozen=True)
class Node:
    """One solid of a motion.

    Attributes:
        name: name of the node.
        solid: centred solid, its axis along z, in the node's frame, before it is scaled.
        colour: red, green, blue from 0 to 1.
        channel: number of the channel that it shows: pale at the channel's smallest value, full colour at its
            largest; None for always full colour.
        foot: number of the channel of a foot, which grips the ground while the level is above 0.5 and slides
            otherwise; None if the node is not part of a foot.
    """

    name: str
    solid: Solid
    colour: Colour
    channel: int | None = None
    foot: int | None = None


@dataclass(frozen=True)
class GroundPlane:
    """The ground below a motion: a plane z = level in the frame of the motion, or uneven ground above it.

    Attributes:
        level: z of the plane [m].
        slope: slope along the heading [degrees], positive uphill.
        heading: uphill direction [degrees] from x towards y.
        solid: whether robots stand on it; in a fluid it is False and the ground is only a background.
        relief: heights over the plane, and friction, in the frame of the motion; None for the plane itself.
    """

    level: float = 0.0
    slope: float = 0.0
    heading: float = 0.0
    solid: bool = True
    relief: Relief | None = None

    @property
    def upright(self) -> Floats:
        """Rotation (w, x, y, z) from the frame of the motion to a frame in which gravity points along -z."""
        half, heading = np.deg2rad([self.slope / 2, self.heading])
        return np.array([np.cos(half), np.sin(half) * np.sin(heading), -np.sin(half) * np.cos(heading), 0.0])

    @property
    def y_up(self) -> Floats:
        """Rotation (x, y, z, w) to a frame in which gravity points along -y, as in three.js and glTF."""
        return np.roll(product(Z_UP_TO_Y_UP, self.upright), -1)


Ground = GroundPlane  # its name up to 2.0


@dataclass(frozen=True, eq=False)
class Skin:
    """Outer surface of joined cubes, without gaps between them.

    Attributes:
        knots: for each corner of each cube the number, from 0, of the point that it shares with joined corners; the
            point is the mean of these corners; shape (N, 8). Corner 4 i + 2 j + k is at the signs (i, j, k).
        faces: visible faces: cube and side (-x, +x, -y, ...), shape (M, 2).
    """

    knots: Ints
    faces: Ints


@dataclass(frozen=True, eq=False, repr=False)
class Motion(ShortText):
    """A motion: poses of N solids (nodes) in F frames.

    Attributes:
        name: short description of what it shows.
        times: times of the frames [s], increasing, shape (F,).
        nodes: what moves.
        translation: translation of the nodes' centres [m], shape (F, N, 3).
        rotation: rotation of the nodes, unit quaternions (w, x, y, z), shape (F, N, 4); signs are chosen so that each
            is near that of the frame before.
        scale: scale of the nodes along their own axes, shape (F, N, 3).
        path: position of the whole robot, which the camera follows [m], shape (F, 3).
        centre_of_mass: of the robot [m], shape (F, 3); empty where masses are not known.
        period: time after which the robot's drives repeat [s]; 0 where they do not, or it is not known.
        channels: rows of the timeline.
        lights: positions of lights [m], shape (L, 3).
        light_radius: radius of the balls that show the lights [m].
        ground: ground below everything.
        skin: surface of the nodes, if they are joined cubes.
        lattice: states of the lattice, if the nodes are its voxels.

    Raises:
        ValueError: if shapes do not fit, numbers are not finite, or there are no frames or no nodes.
    """

    name: str
    times: Floats
    nodes: tuple[Node, ...]
    translation: Floats
    rotation: Floats
    scale: Floats
    path: Floats
    channels: tuple[Channel, ...] = ()
    lights: Floats = ()  # type: ignore[assignment]
    light_radius: float = 0.05
    ground: GroundPlane = GroundPlane()
    skin: Skin | None = None
    lattice: LatticeStates | None = None
    centre_of_mass: Floats = ()  # type: ignore[assignment]
    period: float = 0.0

    def __post_init__(self) -> None:
        for field in ("nodes", "channels"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
        if not self.nodes:
            raise ValueError("nodes: there are none; give at least one")
        times, count = numbers("times", self.times, "F"), len(self.nodes)
        if (np.diff(times) <= 0).any():
            raise ValueError("times: those that go back or stay are not allowed; give increasing times")
        frames = len(times)
        lights = numbers("lights", self.lights, "L", 3) if len(self.lights) else np.empty((0, 3))
        centre = self.centre_of_mass
        arrays = {
            "times": times,
            "translation": numbers("translation", self.translation, frames, count, 3),
            "rotation": _continuous(numbers("rotation", self.rotation, frames, count, 4)),
            "scale": numbers("scale", self.scale, frames, count, 3),
            "path": numbers("path", self.path, frames, 3),
            "lights": lights,
            "centre_of_mass": numbers("centre_of_mass", centre, frames, 3) if len(centre) else np.empty((0, 3)),
        }
        for field, values in arrays.items():
            object.__setattr__(self, field, values)
        if self.skin is not None and self.skin.knots.shape != (count, 8):
            raise ValueError(f"skin: knots of shape {self.skin.knots.shape} are not allowed; give ({count}, 8)")
        if self.lattice is not None and self.lattice.positions.shape != (frames, count, 3):
            raise ValueError(
                f"lattice: poses of shape {self.lattice.positions.shape} are not allowed; give {(frames, count, 3)}"
            )
        named = {number for node in self.nodes for number in (node.channel, node.foot) if number is not None}
        wrong = sorted(number for number in named if not 0 <= number < len(self.channels))
        if wrong:
            raise ValueError(f"channel: {wrong[0]} of a node is not allowed; there are {len(self.channels)}")

    def every(self, step: int) -> Self:
        """Copy with only every ``step``-th frame, and the last one."""
        count = len(self.times)
        part = np.union1d(np.arange(0, count, whole_number("every", step, 1)), count - 1)
        several = ["times", "translation", "rotation", "scale", "path"]
        several += ["centre_of_mass"] if len(self.centre_of_mass) else []
        lattice = None if self.lattice is None else self.lattice.part(part)
        return replace(self, lattice=lattice, **{field: getattr(self, field)[part] for field in several})


def recorded(frames: AnyFrames | None) -> AnyFrames:
    """Return the frames if any were recorded.

    Raises:
        ValueError: if there are none.
    """
    if frames is None or not len(frames.times):
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    return frames


def whole_frames(*arrays: NDArray[np.floating]) -> int:
    """Number of frames before the first with a number that is not finite, as after a robot diverged.

    Args:
        *arrays: arrays of F frames, shape (F, ...).

    Raises:
        ValueError: if the first frame already has one, or there are no frames.
    """
    whole = np.logical_and.reduce([np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in arrays])
    count = len(whole) if whole.all() else int(np.argmin(whole))
    if not count:
        raise ValueError("frames: the robot has none; it diverged at once, or nothing was recorded")
    return count


def check_place(field: str, given: int, count: int, whose: str) -> None:
    """Raise ValueError unless 0 <= given < count; ``whose`` begins the explanation, such as "the batch has"."""
    if not 0 <= given < count:
        raise ValueError(f"{field}: {given} is not allowed; {whose} {count}")


def way_ahead(path: Floats, headings: Floats) -> Floats:
    """Distance travelled up to each frame [m], shape (F,): the sum of the components of steps along their headings.

    Args:
        path: position in each frame [m], shape (F, 2) or (F, 3).
        headings: headings of the steps between frames [rad], shape (F - 1,).
    """
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.append(0.0, np.cumsum((np.diff(path[:, :2], axis=0) * ahead).sum(axis=1)))


def speed_channels(times: Floats, way: Floats) -> tuple[Channel, Channel]:
    """Timeline rows of a robot's distance ``way`` [m], shape (F,), and of its speed averaged over a short time."""
    half = max((times[-1] - times[0]) * WINDOW / 2, 1e-9)
    before, after = np.maximum(times - half, times[0]), np.minimum(times + half, times[-1])
    gone = np.interp(after, times, way) - np.interp(before, times, way)
    speed = gone / np.maximum(after - before, 1e-9)
    return (
        Channel("distance", "m", times, way - way[0], INK, read_out=True),
        Channel("speed", "m/s", times, speed, INK, read_out=True),
    )


def diameter(solid: Solid) -> float:
    """Diameter of the smallest ball around a solid [m]."""
    if isinstance(solid, Box):
        return float(np.linalg.norm(np.asarray(solid.size, float)))
    return 2 * solid.radius + (solid.length if isinstance(solid, Capsule) else 0.0)


def unit_quaternion(from_z_to: ArrayLike) -> Floats:
    """Rotation (w, x, y, z) that turns the z axis into a direction, shape (3,)."""
    x, y, z = np.asarray(from_z_to, float) / np.linalg.norm(from_z_to)
    if z < -1 + 1e-12:
        return np.array([0.0, 1.0, 0.0, 0.0])
    found = np.array([1 + z, -y, x, 0.0])
    return found / np.linalg.norm(found)


def product(a: Floats, b: Floats) -> Floats:
    """Products of quaternions (w, x, y, z), shapes (..., 4)."""
    return np.stack(np.broadcast_arrays(*rotations.multiply(*np.moveaxis(a, -1, 0), *np.moveaxis(b, -1, 0))), -1)


def _continuous(rotation: Floats) -> Floats:
    """Normalise quaternions and choose their signs so that each is near that of the frame before."""
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    if (np.abs(length - 1) > 1e-3).any():
        raise ValueError("rotation: quaternions of other lengths than 1 are not allowed")
    flips = np.einsum("fnk,fnk->fn", rotation[1:], rotation[:-1]) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return rotation / length * np.concatenate([np.ones((1, rotation.shape[1])), signs])[..., None]
