"""The memory of a robot: one run of slots, each a real, in sections.

The sections of the state come first, so that a robot can be copied away and back in one go:

    VOXEL     14 a voxel   position 3, orientation 4, momentum 3, angular momentum 3, sticking to the floor
    LINK      7 a link     damping memory (offset and rotations of the last step) 6, regime
    STRAIN    6 a gauge    strain per axis of a gauged voxel, and with Poisson's effect
    PRINT     3 a voxel    where granular ground yields: how deep it has pressed it, momentum 2 along it after friction
    CHANNEL   4 a channel  base, rate, age, value of the 25 channels of every group
    LISTED    3 a surface voxel: its position when the neighbour list was built
    MONITOR   2            largest squared distance from there (stepped driver: 0, or FAR if too large); 1 once diverged
    CURRENT   9 a group    what follows from the channels in this step
    CONSTANT  9 a group    materials.voxel_constants
    BEAM      9 a pair of materials: materials.beam_constants
    REST      2 a pair of groups and axis: rest length and its inverse
    CONTACT   3 a surface voxel: contact force
    FORCE     12 a link; packed driver: 14 a link pack
    PRESSED   12 a square of a closed surface under pressure: forces on its corners

Groups are the regions of a body, split where a region mixes materials.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

(VOXEL, LINK, STRAIN, PRINT, CHANNEL, LISTED, MONITOR, CURRENT, CONSTANT, BEAM, REST, CONTACT, FORCE, PRESSED) = range(
    14
)
SECTION_COUNT = 14
MOST_SLOTS = 2**31 - 1  # of an array in a kernel, which counts them in 32 bits

VOXEL_WIDTH, LINK_WIDTH, STRAIN_WIDTH, PRINT_WIDTH, CHANNEL_WIDTH, CURRENT_WIDTH, REST_WIDTH = 14, 7, 6, 3, 4, 9, 2
PRESSED_WIDTH = 12
ORIENTATION, MOMENTUM, ANGULAR_MOMENTUM, STICKS = 3, 7, 10, 13  # places in a voxel
MOTION = {
    "positions": slice(0, ORIENTATION),
    "orientations": slice(ORIENTATION, MOMENTUM),
    "velocities": slice(MOMENTUM, ANGULAR_MOMENTUM),  # as momenta
    "angular_velocities": slice(ANGULAR_MOMENTUM, STICKS),
}  # parts of a voxel by the names in LatticeState
REGIME = 6  # place in a link
BASE, RATE, AGE, VALUE = range(4)  # places in a channel
MOVED, DIVERGED = 0, 1  # places in the monitor
SIZE, MEAN_SIZE, PUSH, DRAG, ANGULAR_DRAG = 0, 3, 4, 7, 8  # places in CURRENT: rest sizes, external force, damping

# The plan of a memory, an integer array that kernels read: section starts, then counts and switches.
VOXELS, LINKS, GROUPS, RESTS, SURFACE, PAIRS, STATE_SLOTS = range(SECTION_COUNT, SECTION_COUNT + 7)
FLOOR_ON, CONTACT_ON, POISSON_ON, FLUID_ON, SQUARES = range(SECTION_COUNT + 7, SECTION_COUNT + 12)
PLAN_LENGTH = SECTION_COUNT + 12


@dataclass(frozen=True)
class Memory:
    """Where the sections of a robot's memory lie.

    Attributes:
        rows: (items, width) of every section.
        starts: first slot of every section.
        slots: slots in all.
    """

    rows: tuple[tuple[int, int], ...]
    starts: tuple[int, ...]
    slots: int

    @classmethod
    def of(cls, rows: Iterable[tuple[int, int]]) -> "Memory":
        """Lay out a memory of so many items and widths; sections without items keep one, as none may be empty."""
        sections = tuple((max(count, 1), width) for count, width in rows)
        ends = np.cumsum([count * width for count, width in sections])
        return cls(sections, (0, *(int(e) for e in ends[:-1])), int(ends[-1]))

    def span(self, section: int) -> slice:
        """The slots of a section."""
        count, width = self.rows[section]
        return slice(self.starts[section], self.starts[section] + count * width)

    def section(self, memory: np.ndarray, section: int) -> np.ndarray:
        """A view of a section of a memory of shape (blocks, slots, lanes), shape (blocks, items, components, lanes)."""
        return memory[:, self.span(section)].reshape(len(memory), *self.rows[section], -1)

    @property
    def state_slots(self) -> int:
        """Slots of the state, which come first."""
        return self.starts[LISTED]
