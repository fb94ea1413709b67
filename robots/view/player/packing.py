"""Compress the poses of motions: rounded to integers, and stored as changes from frame to frame.

Any point of a solid is shown within 0.1 mm of its place: half of that is for the centre, the rest for rotation and
size together.
"""

import math
import zlib
from dataclasses import dataclass

import numpy as np

from robots.view.motion import Motion, diameter

TOLERANCE = 1e-4  # m
NUMBERS = 10  # of a node's pose: translation 3, rotation 4, scale 3
MOST_PLANES = 4  # bytes of a whole number
LEVEL = 6  # of compression; 9 saves 4 % and takes six times as long


@dataclass(frozen=True)
class Packed:
    """The compressed poses of a motion.

    Attributes:
        frames: F.
        nodes: N.
        steps: size of one unit of the whole numbers, for translation [m], rotation and scale.
        planes: bytes of each change.
        data: changes, compressed by zlib: first the lowest bytes of all changes, then the next bytes, and so on. The
            changes begin from zeros and are ordered by frame, number of the pose (ten) and node; the sign is the
            lowest bit.
    """

    frames: int
    nodes: int
    steps: tuple[float, float, float]
    planes: int
    data: bytes


def pack(motion: Motion) -> Packed:
    """Compress the poses of a motion.

    Raises:
        ValueError: if a value is too large for the range of the integers.
    """
    steps = _steps(motion)
    frames, nodes = motion.translation.shape[:2]
    whole = np.empty((frames, NUMBERS, nodes), np.int32)
    at = 0
    for step, values in zip(steps, (motion.translation, motion.rotation, motion.scale), strict=True):
        if np.abs(values).max() / step > 2**29:
            raise ValueError(f"motion: {np.abs(values).max():g} m is too far for steps of {step:g}; show less of it")
        width = values.shape[-1]
        whole[:, at : at + width] = np.rint(np.moveaxis(values, 2, 1) / step)
        at += width
    changes = np.diff(whole, axis=0, prepend=np.zeros((1, NUMBERS, nodes), np.int32)).ravel()
    unsigned = (changes << 1) ^ (changes >> 31)
    planes = max(1, -(-int(unsigned.max()).bit_length() // 8))
    split = unsigned.astype("<u4").view(np.uint8).reshape(-1, MOST_PLANES).T[:planes]
    return Packed(frames, nodes, steps, planes, zlib.compress(np.ascontiguousarray(split).tobytes(), LEVEL))


def _steps(motion: Motion) -> tuple[float, float, float]:
    """Step sizes of translation, rotation and scale that keep the tolerance.

    Errors of half a step in each number have these effects: they move a centre by sqrt(3)/2 steps; they rotate by at
    most 2 |dq|, two steps, which moves a point at distance r by 2 r steps; and at scale 1 they move a corner of a
    solid with half diagonal d by d/2 steps.
    """
    halves = np.array([diameter(node.solid) for node in motion.nodes]) / 2
    reach = float((halves * np.abs(motion.scale).max(axis=(0, 2))).max())
    return TOLERANCE / math.sqrt(3), 0.3 * TOLERANCE / (2 * reach), 0.2 * TOLERANCE / (float(halves.max()) / 2)
