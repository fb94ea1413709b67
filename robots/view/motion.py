"""Motions: solids with poses over time, ready to be shown.

``voxel_motion`` builds motions of voxels, ``rigid_motion`` those of rigid bodies; the package of a kind of robot has a
``motion`` of its own that uses them. What shows motions: ``still``, ``film``, ``onlooker``, ``paraview``,
``rerun_file``, ``glb`` and ``player``.
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

CUBE, BALL = Box((1.0, 1.0, 1.0)), Sphere(0.5)  # solids of unit size, given their sizes by scale
LIGHT_COLOUR: Colour = (1.0, 0.8, 0.3)
Z_UP_TO_Y_UP = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
WINDOW = 1 / 40  # of a motion's time over which its speed is taken


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
        values: shape (K,); of a switch from 0, off, to 1, on, or truth values.
        colour: red, green, blue from 0 to 1.
        switch: whether a value holds until the next one; otherwise they are joined by lines.
        logarithmic: whether the values, all positive, are better seen by their logarithms.
        read_out: whether the value is told as a number beside the robot, too.
        group: how the names of switches that belong together begin, such as ``bladder`` of ``bladder 3``; empty for a
            row by itself.
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
        """Values at some times [s], scaled so that the smallest value of the channel is 0 and its largest is 1."""
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
        solid: centred, its axis along z, in the node's frame, before it is scaled.
        colour: red, green, blue from 0 to 1.
        channel: number of the channel that shows on it: pale at the channel's smallest value, in full colour at its
            largest; None: always in full colour.
        foot: number of the channel whose high half of values means that it grips the ground, and whose low half that it
            slides; None for what is no such foot.
    """

    name: str
    solid: Solid
    colour: Colour
    channel: int | None = None
    foot: int | None = None


@dataclass(frozen=True)
class Ground:
    """The ground below a motion: a plane z = level in the frame of the motion, or uneven ground above it.

    Attributes:
        level: its z [m].
        slope: [degrees], positive uphill.
        heading: the direction that is uphill [degrees] from x towards y.
        solid: whether something stands on it; else, in a fluid, it is only where things are seen against.
        relief: heights over the plane, and friction, in the frame of the motion; None is the plane itself.
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
        """Rotation (x, y, z, w) to a frame in which gravity points along -y, as browsers and glTF want it."""
        return np.roll(product(Z_UP_TO_Y_UP, self.upright), -1)


@dataclass(frozen=True, eq=False)
class Skin:
    """Outer surface of joined cubes, which closes the gaps between them.

    Attributes:
        knots: which corners of the cubes are one point, in the middle of them: a number for each, counted from 0,
            shape (N, 8); corner 4 i + 2 j + k is at the signs (i, j, k).
        faces: that are seen: cube, and its side -x, +x, -y, ..., shape (M, 2).
    """

    knots: Ints
    faces: Ints


@dataclass(frozen=True, eq=False, repr=False)
class Motion(ShortText):
    """A motion: poses of N solids (nodes) in F frames.

    Attributes:
        name: what it shows, in a few words.
        times: times of the frames [s], increasing, shape (F,).
        nodes: what moves.
        translation: translation of the nodes' centres [m], shape (F, N, 3).
        rotation: of the nodes, unit quaternions (w, x, y, z), shape (F, N, 4); of the two that are one rotation,
            what is kept is the one nearer to the frame before.
        scale: scale of the nodes along their own axes, shape (F, N, 3).
        path: where the whole is, for the camera to follow [m], shape (F, 3).
        channels: rows of the timeline.
        lights: places of lights [m], shape (L, 3).
        light_radius: radius of the balls that show the lights [m].
        ground: below everything.
        skin: skin of nodes that are all cubes, if they are joined.
        lattice: what the nodes feel, if they are the voxels of a lattice.

    Raises:
        ValueError: for shapes that do not fit, numbers that are not finite, no frames and no nodes.
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
    ground: Ground = Ground()
    skin: Skin | None = None
    lattice: LatticeStates | None = None

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
        arrays = {
            "times": times,
            "translation": numbers("translation", self.translation, frames, count, 3),
            "rotation": _continuous(numbers("rotation", self.rotation, frames, count, 4)),
            "scale": numbers("scale", self.scale, frames, count, 3),
            "path": numbers("path", self.path, frames, 3),
            "lights": lights,
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
        several = ("times", "translation", "rotation", "scale", "path")
        lattice = None if self.lattice is None else self.lattice.part(part)
        return replace(self, lattice=lattice, **{field: getattr(self, field)[part] for field in several})


def recorded(frames: AnyFrames | None) -> AnyFrames:
    """Return frames that were recorded.

    Raises:
        ValueError: if there are none.
    """
    if frames is None or not len(frames.times):
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    return frames


def whole_frames(*arrays: NDArray[np.floating]) -> int:
    """Number of frames before the first that has a number that is not finite, as after a robot diverged.

    Args:
        *arrays: shape (F, ...).

    Raises:
        ValueError: if there are none.
    """
    whole = np.logical_and.reduce([np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in arrays])
    count = len(whole) if whole.all() else int(np.argmin(whole))
    if not count:
        raise ValueError("frames: the robot has none; it diverged at once, or nothing was recorded")
    return count


def check_place(field: str, given: int, count: int, whose: str) -> None:
    """Raise a ValueError for a number that is not among the first ``count``; ``whose`` is such as "the batch has"."""
    if not 0 <= given < count:
        raise ValueError(f"{field}: {given} is not allowed; {whose} {count}")


def way_ahead(path: Floats, headings: Floats) -> Floats:
    """Distance travelled by each frame [m], shape (F,): what each step goes in its heading.

    Args:
        path: in each frame [m], shape (F, 2) or (F, 3).
        headings: of the steps between frames [rad], shape (F - 1,).
    """
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.append(0.0, np.cumsum((np.diff(path[:, :2], axis=0) * ahead).sum(axis=1)))


def speed_channels(times: Floats, way: Floats) -> tuple[Channel, Channel]:
    """Timeline rows of a robot's distance, from ``way`` [m] of shape (F,), and of its speed over a short while."""
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
    """Products of quaternions, shapes (..., 4)."""
    return np.stack(np.broadcast_arrays(*rotations.multiply(*np.moveaxis(a, -1, 0), *np.moveaxis(b, -1, 0))), -1)


def _continuous(rotation: Floats) -> Floats:
    """Normalise quaternions and choose their signs so that each is near to that of the frame before."""
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    if (np.abs(length - 1) > 1e-3).any():
        raise ValueError("rotation: quaternions of other lengths than 1 are not allowed")
    flips = np.einsum("fnk,fnk->fn", rotation[1:], rotation[:-1]) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return rotation / length * np.concatenate([np.ones((1, rotation.shape[1])), signs])[..., None]
