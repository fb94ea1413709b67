"""Camera and light: project faces in space to coloured polygons on paper. Does not need matplotlib."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import Relief

Colour = tuple[float, float, float]  # red, green, blue from 0 to 1


def _rgb(text: str) -> Colour:
    red, green, blue = (int(text[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return red, green, blue


PAPER, INK = _rgb("ffffff"), _rgb("33302b")
GROUND, GROUND_LINE, SHADOW = _rgb("f3f1ec"), _rgb("d9d5cc"), _rgb("dcd8cf")
SAND, STONE, CLAY = _rgb("cfc8bb"), _rgb("a39b8c"), _rgb("c9894b")
HUES = tuple(_rgb(c) for c in ("d55e00", "e69f00", "009e73", "0072b2"))  # Okabe & Ito; safe for colour blindness
PURPLES, SKY, YELLOW = (_rgb("7b3f8c"), _rgb("b0639f")), _rgb("56b4e9"), _rgb("e6d43a")
STEEL, SLATE, SUN = (0.72, 0.73, 0.75), (0.36, 0.41, 0.47), (0.95, 0.69, 0.12)
# Of charts: Okabe & Ito, Color Universal Design, 2008.
CHART_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#F0E442", "#000000")
# Direction to the light (along the heading, to its left, up); brightness of faces that it does not reach.
LIGHT = np.array([-0.3, -0.45, 0.84])
AMBIENT = 0.6
FALLS = 3  # iterations that find where a vertical line meets tilted uneven ground


@dataclass(frozen=True)
class Camera:
    """Oblique camera at the robot's right: the robot travels to the right of the picture, and uphill is up.

    The projection is oblique: vertical planes along the heading keep sizes and angles, so distances, heights and
    slopes can be measured on paper. The direction to the robot's left points up and to the right on paper.

    Attributes:
        heading: direction of travel [degrees] from x towards y.
        slope: slope of the ground [degrees]; the picture is level with gravity, not with the ground.
        shift_right: component to the right on paper of a unit length that points to the robot's left.
        shift_up: component upwards on paper of such a length.
    """

    heading: float = 0.0
    slope: float = 0.0
    shift_right: float = 0.42
    shift_up: float = 0.26

    @cached_property
    def frame(self) -> Floats:
        """Axes of the camera as rows, in the frame of the ground, shape (3, 3): along the heading, to its left, up."""
        h, s = np.deg2rad([self.heading, self.slope])
        turn = np.array([[np.cos(h), np.sin(h), 0], [-np.sin(h), np.cos(h), 0], [0, 0, 1]])
        tilt = np.array([[np.cos(s), 0, -np.sin(s)], [0, 1, 0], [np.sin(s), 0, np.cos(s)]])
        return tilt @ turn

    @cached_property
    def toward(self) -> Floats:
        """Unit vector towards the viewer, in the frame of the ground, shape (3,)."""
        ray = np.array([self.shift_right, -1.0, self.shift_up])
        return ray @ self.frame / np.linalg.norm(ray)

    def project(self, points: Floats) -> Floats:
        """Project points in space [m], shape (..., 3), on paper [m], shape (..., 2)."""
        level = points @ self.frame.T
        return level[..., [0, 2]] + level[..., 1:2] * np.array([self.shift_right, self.shift_up])

    def on_ground(self, travel: ArrayLike, across: ArrayLike, z: float) -> Floats:
        """Project points, given along the heading and to its left [m] at height ``z``, on paper [m], shape (..., 2)."""
        x, y = np.moveaxis(self.in_space(travel, across), -1, 0)
        return self.project(np.stack([x, y, np.full_like(x, z)], axis=-1))

    def in_space(self, travel: ArrayLike, across: ArrayLike) -> Floats:
        """Coordinates (x, y) [m], shape (..., 2), of points given along the heading and to its left [m]."""
        h = np.deg2rad(self.heading)
        x = np.cos(h) * np.asarray(travel) - np.sin(h) * np.asarray(across)
        y = np.sin(h) * np.asarray(travel) + np.cos(h) * np.asarray(across)
        return np.stack([x, y], axis=-1)

    def by_the_way(self, points: Floats) -> Floats:
        """Coordinates along the heading and to its left, shape (N, 2) [m], of points in space, shape (N, 3) [m]."""
        h = np.deg2rad(self.heading)
        return points[:, :2] @ np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])


@dataclass(frozen=True, eq=False)
class Polygons:
    """Coloured polygons of a robot on paper, and its shadow.

    Attributes:
        corners: corners of its faces, those at the back first [m], shape (N, 4, 2).
        colours: colours of the faces: red, green, blue from 0 to 1, shape (N, 3), or also opacity, shape (N, 4).
        shadow: shadow of the faces, on the ground straight below [m], shape (M, 4, 2).
        uneven: whether the ground is uneven.
    """

    corners: Floats
    colours: Floats
    shadow: Floats
    uneven: bool = False


def paint(
    quads: Floats,
    colours: Floats,
    camera: Camera,
    level: float | None,
    relief: Relief | None = None,
    opacity: Floats | None = None,
) -> Polygons:
    """Project and light faces in space, and project their shadow.

    Args:
        quads: corners of faces, counter-clockwise as seen from outside [m], shape (N, 4, 3); two may coincide.
        colours: colours of the faces, shape (N, 3).
        camera: camera that looks at them.
        level: z of the ground [m]; None if there is no ground for shadows.
        relief: heights of uneven ground over ``level``.
        opacity: of the faces, from 0 to 1, shape (N,); None if all are opaque.
    """
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30
    # Faces that point away are hidden by the rest of their solid; nearer faces are painted later.
    visible = np.flatnonzero(normals @ camera.toward > 0)
    visible = visible[np.argsort(quads[visible].mean(axis=1) @ camera.toward, kind="stable")]
    light = LIGHT @ camera.frame / np.linalg.norm(LIGHT)
    brightness = AMBIENT + (1.05 - AMBIENT) * np.clip(normals @ light, 0, None)
    shown = np.clip(colours * brightness[:, None], 0, 1)[visible]
    if opacity is not None:
        shown = np.column_stack([shown, opacity[visible]])
    lit = quads[normals @ camera.frame[2] > 0] if level is not None else quads[:0]
    return Polygons(
        camera.project(quads[visible]), shown, shadow(lit, camera, level or 0.0, relief), relief is not None
    )


def shadow(points: Floats, camera: Camera, level: float, relief: Relief | None = None) -> Floats:
    """Project the ground points vertically below points in space, shape (..., 3) [m], on paper, shape (..., 2)."""
    up = camera.frame[2]
    fallen = points - (points[..., 2:] - level) / up[2] * up
    if relief is not None:
        for _ in range(FALLS if up[2] < 1 else 1):
            height = relief.height(fallen[..., 0], fallen[..., 1])
            fallen = fallen + (level + height - fallen[..., 2])[..., None] / up[2] * up
    return camera.project(fallen)


def pale(colours: Floats) -> Floats:
    """Pale versions of colours, shape (..., 3), for parts that are off."""
    return 0.32 * colours + 0.68 * np.array([0.97, 0.96, 0.94])
