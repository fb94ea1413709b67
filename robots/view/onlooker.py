"""Pictures of a robot as arrays of one size, from a camera that moves only when the robot would leave the view."""

from dataclasses import replace

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robots.view.mesh import faces
from robots.view.motion import Motion
from robots.view.scene import INK, Camera
from robots.view.still import SEEN_FROM_ABOVE, Setting, default_camera, draw_motion, limits, setting
from taichi_sim.base.arrays import Bytes, Floats

WIDTH, HEIGHT, CAPTION = 640, 360, 22  # size of a picture, height of the line of text at its top [pixels]
DOTS_PER_INCH = 100
MARGIN, AHEAD = 0.3, 1.5  # ground around everything, and ahead of the robot, in lengths of the robot
BREADTH = 0.5  # least ratio of the ground's width to its length
BELOW = 0.35  # fraction of spare height that is put below
FARTHEST = 14.0  # in lengths of the robot; it would look too small beside lights farther away


class Onlooker:
    """Camera that looks at a robot from its right.

    The first view shows the robot where the first motion ends, the ground ahead of it and the lights. When the robot
    would leave that view, the view moves by as much as is needed. A picture therefore depends only on where the robot
    began and where it is.
    """

    def __init__(self, begun: Motion) -> None:
        """Set up the view from a motion that ends where the robot begins."""
        self._camera = camera = _camera(begun)
        self._length = float(np.ptp(_places(begun, camera), axis=0).max())
        self._area = self._seen_at_first(begun)
        self._where = camera.by_the_way(begun.path[-1:])[0]
        last = len(begun.times) - 1
        across, up = limits(replace(setting(begun, [last], camera=camera), area=self._area), [last])
        self._limits = _filling(across, up)

    def picture(self, motion: Motion) -> Bytes:
        """Draw the robot at the end of a motion: red, green, blue, shape (``HEIGHT``, ``WIDTH``, 3)."""
        camera, frame = self._camera, len(motion.times) - 1
        moved = self._moved(camera.by_the_way(motion.path[-1:])[0])
        seen = setting(motion, [frame], camera=camera)
        seen = Setting(motion, camera, self._area + moved[:, None], seen.colouring)
        shift = camera.on_ground(moved[0], moved[1], 0.0) - camera.on_ground(0.0, 0.0, 0.0)
        figure = Figure(figsize=(WIDTH / DOTS_PER_INCH, HEIGHT / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1 - CAPTION / HEIGHT))
        draw_motion(axes, seen, frame, outlined=False)
        across, up = self._limits + shift[:, None]
        axes.set(xlim=across, ylim=up)
        caption = f"{motion.name}, {motion.times[frame]:.2f} s"
        figure.text(0.012, 1 - 0.5 * CAPTION / HEIGHT, caption, va="center", fontsize=8, color=INK)
        canvas.draw()  # type: ignore[no-untyped-call]
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]

    def _seen_at_first(self, motion: Motion) -> Floats:
        """Ground in the first view, as ``Setting.area``."""
        camera = self._camera
        robot = _places(motion, camera)
        lights = camera.by_the_way(motion.lights)
        near = lights[np.hypot(*(lights - robot.mean(axis=0)).T) < FARTHEST * self._length]
        ahead = robot.max(axis=0) + np.array([AHEAD * self._length, 0.0])
        seen = np.concatenate([robot, ahead[None], near])
        area = np.stack([seen.min(axis=0), seen.max(axis=0)], axis=1) + MARGIN * self._length * np.array([-1, 1])
        more = max(BREADTH * np.ptp(area[0]) - np.ptp(area[1]), 0.0)
        return area + 0.5 * more * np.array([[0, 0], [-1, 1]])

    def _moved(self, place: Floats) -> Floats:
        """Shift of the view that keeps a robot at ``place`` in it, along the heading and to its left [m]."""
        room = (0.5 + 0.5 * MARGIN) * self._length
        low, high = self._area.T + np.array([[room], [-room]])
        low, high = np.minimum(low, self._where), np.maximum(high, self._where)
        return place - np.clip(place, low, high)


def _camera(motion: Motion) -> Camera:
    """Camera with the motion's heading; for rigid robots with lights, with the direction to the first light."""
    if motion.lattice is not None or not len(motion.lights):
        return default_camera(motion)
    x, y = (motion.lights[0] - motion.path[-1])[:2]
    return Camera(float(np.rad2deg(np.arctan2(y, x))), 0.0, shift_up=SEEN_FROM_ABOVE)


def _places(motion: Motion, camera: Camera) -> Floats:
    """Corners of a robot at the end of its motion, along the heading and to its left [m], shape (N, 2)."""
    return camera.by_the_way(faces(motion, len(motion.times) - 1)[0].reshape(-1, 3))


def _filling(across: tuple[float, float], up: tuple[float, float]) -> Floats:
    """Extend limits to the aspect ratio of the picture, so that their content fills it, shape (2, 2) [m]."""
    found = np.array([across, up])
    pixels = np.array([WIDTH, HEIGHT - CAPTION])
    scale = float((np.ptp(found, axis=1) / pixels).max())
    spare = scale * pixels - np.ptp(found, axis=1)
    # Robots rise but never sink, so most of the spare height is above them.
    return found + spare[:, None] * np.array([[-0.5, 0.5], [-BELOW, 1 - BELOW]])
