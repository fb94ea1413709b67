"""State and results of rigid robots: plain arrays over the batch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.short_text import ShortText


@dataclass(frozen=True, eq=False)
class State:
    """State of B articulated robots: poses and velocities. Arrays of one robot count for all robots.

    Attributes:
        position: of the base's centre, (B, 3) [m].
        orientation: of the base, unit quaternions (B, 4).
        angles: of the hinges, (B, H) [rad].
        velocity: angular velocity of the base and velocity of its centre, (B, 6) [rad/s, m/s].
        rates: of the hinges, (B, H) [rad/s].
    """

    position: Floats
    orientation: Floats
    angles: Floats
    velocity: Floats
    rates: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Frames(ShortText):
    """Recorded poses, sensor readings and neurons of B robots at F times, from the start on.

    Attributes:
        times: times of the frames, (F,) [s].
        position: of the base, (F, B, 3) [m].
        orientation: of the base, unit quaternions, (F, B, 4).
        angles: of the hinges, (F, B, H) [rad].
        readings: of the sensors, (F, B, S).
        neurons: of the motors, (F, B, M).
    """

    times: Floats
    position: Floats
    orientation: Floats
    angles: Floats
    readings: Floats
    neurons: Floats


@dataclass(frozen=True, eq=False, repr=False)
class RigidResult(ShortText):
    """Result of simulating B articulated robots; numbers of a robot that diverged are NaN.

    Attributes:
        position: of the base's centre, (B, 3) [m].
        orientation: of the base, (B, 4).
        angles: of the hinges, (B, H) [rad].
        velocities: of all bodies in the tree's order in the last step, angular, then that of the centre, (B, bodies, 6)
            [rad/s, m/s].
        readings: of the sensors, (B, S).
        closest: smallest distance of the base from the light, seen from above, at any step, (B,) [m]; of no meaning
            without lights.
        work: of all drives, as far as they push the way that they turn, (B,) [J]; NaN with the studies'
            integration, "velocity".
        status: ``"ok"`` or ``"diverged"``, (B,).
        steps: steps before divergence, else all, (B,).
        residual: largest violation of the conditions of contacts that a step was left with, 0 where all were solved
            (B,) [N s or m/s]; 1 where motors did not settle, 1e30 where impulses were no numbers.
        frames: what was recorded, or None.
    """

    position: Floats
    orientation: Floats
    angles: Floats
    velocities: Floats
    readings: Floats
    closest: Floats
    work: Floats
    status: NDArray[np.str_]
    steps: Ints
    residual: Floats
    frames: Frames | None
