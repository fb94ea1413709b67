"""A motion made of numbers, for tests of what shows motions."""

from dataclasses import replace

import numpy as np

from robots.view.motion import BALL, CUBE, Motion, Node


def made(frames=4, count=3, **more) -> Motion:
    """A motion that turns, grows and goes, each node in its own way."""
    t, n = np.linspace(0, 1, frames)[:, None], np.arange(count)
    angle = (n + 1) * t
    zero = np.zeros_like(angle)
    rotation = np.stack([np.cos(angle), zero, np.sin(angle), zero], -1)
    translation = np.stack([angle, zero + 0.3 * n, zero + 0.2], -1)
    scale = 0.1 + np.stack([angle, zero, zero], -1)
    parts = tuple(Node(f"part {k}", (CUBE, BALL)[k % 2], (0.2, 0.4, 0.1 * k)) for k in range(count))
    return replace(Motion("made", t[:, 0], parts, translation, rotation, scale, translation[:, 0]), **more)
