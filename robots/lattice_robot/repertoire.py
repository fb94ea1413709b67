"""Gaits of one lattice robot between which it changes while it moves: each a shape, and waves about it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.simulation import answers_in, channels_of, swing_of
from taichi_sim.base.arrays import Bools, Floats, Ints

EASE = 8  # looks in which one gait gives way to another
Pilot = Callable[[Floats, Floats], Ints]  # takes readings (B, S) and places along the way [m] (B,); gaits (B,)


@dataclass(frozen=True, eq=False)
class Repertoire:
    """G gaits of a robot, on one clock.

    Attributes:
        robot: without anything free; its muscles rest.
        nodes: by how much every muscle's scale differs from rest at the nodes of a cycle, shape (G, R, 16).
    """

    robot: LatticeRobot
    nodes: Floats

    @classmethod
    def of(cls, robot: LatticeRobot, points: Floats) -> Self:
        """The gaits of points, shape (G, P), of a robot whose drives change scales.

        Raises:
            ValueError: for a robot that drives anything else.
        """
        for drive in robot.drives:
            if drive.quantity != "scale":
                raise ValueError(f"drives: {drive.name} drives {drive.quantity}; gaits are of scales alone")
        swing, answers = swing_of(robot, robot.points(points)), answers_in(robot, channels_of(robot))
        first = [int(np.argmax(answers == region)) for region in range(len(robot.felt_regions))]
        resting = tuple(replace(drive, mean=None, amplitude=0.0, phase=0.0, knots=()) for drive in robot.drives)
        return cls(replace(robot.fixed, drives=resting), swing[:, first])

    def actions(self, shares: Floats, node: int) -> Floats:
        """Deviations of the regions' scales from rest at a node, shape (B, R), for gaits mixed by shares, (B, G)."""
        return shares @ self.nodes[:, :, node]


@dataclass(frozen=True, eq=False)
class Played:
    """What B robots did in an episode of L looks.

    Attributes:
        gaits: that each was told to play from a look on, shape (B, L).
        felt: at each look, shape (B, L, S).
        places: of its middle along its heading [m], shape (B, L); where it was last when it diverged.
        failed: which diverged, shape (B,).
    """

    gaits: Ints
    felt: Floats
    places: Floats
    failed: Bools


def play(episodes: Episodes, repertoire: Repertoire, pilot: Pilot) -> Played:
    """Let robots go through an episode; before every piece of a cycle a pilot says which gait each plays.

    Gaits give way to each other in ``EASE`` looks, and take as long to begin from rest.
    """
    felt, e = episodes.begin(), episodes
    shares = np.zeros((len(felt), len(repertoire.nodes)))
    failed, places = np.zeros(len(felt), bool), _places(e)
    told = list[tuple[Ints, Floats, Floats]]()
    for _ in range(e.steps):
        gaits = pilot(felt, places)
        told.append((gaits, felt, places))
        wanted = np.eye(shares.shape[1])[gaits]
        shares = shares + np.clip(wanted - shares, -1 / EASE, 1 / EASE)
        felt, _, lost = e.advance(repertoire.actions(shares, e.next_node))
        failed |= lost
        places, felt = _places(e), np.where(failed[:, None], 0.0, felt)
    gaits, felts, where = (np.stack(each, axis=1) for each in zip(*told, strict=True))
    return Played(gaits, felts, where, failed)


def _places(episodes: Episodes) -> Floats:
    """Place of the middle of each robot along its heading [m], shape (B,)."""
    now: Floats = episodes.positions[:, : episodes.own].mean(axis=1) @ episodes.robot.direction
    return now
