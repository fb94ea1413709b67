"""Channels of a lattice robot: groups of its regions that follow one wave, so that one line can drive them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichi_sim.base.arrays import Bools, Floats

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

ALIKE = 1e-9  # of the largest value: waves that differ by less are one


@dataclass(frozen=True, eq=False)
class Channel:
    """Regions that one drive moves alike.

    Attributes:
        name: that of the drive, and a number from 1 if the drive has several channels.
        drive: name of the drive.
        quantity: of the drive.
        axes: of the drive.
        regions: labels of the body's regions.
        rest: what the quantity is before anything drives it.
        relative: whether the wave swings about the rest of each axis, and not about a mean of its own.
        values: of the quantity at the 16 nodes of a cycle, which straight lines join, shape (16,).
    """

    name: str
    drive: str
    quantity: str
    axes: str
    regions: tuple[int, ...]
    rest: float
    relative: bool
    values: Floats

    def voxels(self, robot: "LatticeRobot") -> Bools:
        """Which voxels of a robot the channel drives, shape (V,)."""
        return np.isin(np.asarray(robot.body.regions), self.regions)


def rests(robot: "LatticeRobot") -> bool:
    """Whether nothing moves a robot: its drives leave their regions at rest, and no reflexes answer."""
    return robot.reflexes is None and all(drive.is_idle for drive in robot.drives)


def channels_of(robot: "LatticeRobot") -> list[Channel]:
    """The channels of a robot of which nothing is free, drive by drive, in the order of their first regions."""
    found: list[Channel] = []
    for drive, nodes in zip(robot.drives, robot.nodes(np.zeros((1, 0))), strict=True):
        waves, rest = np.asarray(nodes[0], float), robot.rest_of(drive)
        alike = places_alike(waves, rest)
        for number, places in enumerate(alike, 1):
            found.append(
                Channel(
                    drive.name if len(alike) == 1 else f"{drive.name} {number}",
                    drive.name,
                    drive.quantity,
                    drive.axes,
                    tuple(drive.regions[place] for place in places),
                    float(rest[0, places[0]]),
                    drive.mean is None,
                    waves[0, places[0]],
                )
            )
    return found


def places_alike(waves: Floats, rest: Floats) -> list[list[int]]:
    """Which regions of a drive follow one wave, in the order of the first of each, by their places among its regions.

    Waves are one where they differ by rounding only, as those do whose phases are whole cycles apart.

    Args:
        waves: of the regions, shape (Q, G, 16).
        rest: what they hold before anything drives them, shape (Q, G).
    """
    held = np.concatenate([waves, rest[..., None]], axis=2).swapaxes(0, 1).reshape(waves.shape[1], -1)
    apart = ALIKE * np.abs(held).max(initial=0.0)
    alike: list[list[int]] = []
    for place, each in enumerate(held):
        firsts = held[[others[0] for others in alike]]
        (same,) = np.nonzero(np.abs(firsts - each).max(axis=1, initial=0.0) <= apart)
        if len(same):
            alike[same[0]].append(place)
        else:
            alike.append([place])
    return alike
