"""A network that says of every actuator of the inflatable robot at every time how far it is on."""

import numpy as np

from robots.control.pattern import PatternWiring
from robots.inflatable.schedule import ROWS
from taichi_sim.base.arrays import Floats

# Places of the actuators on the robot, from -1 to 1: across (x), along (y), below or above (z), bladder or foot.
# Bladders 1 to 4 lie on top in order of x, 5 to 8 underneath in the opposite order; feet are the two ends.
ACROSS = (-0.75, -0.25, 0.25, 0.75)
ACTUATORS = np.array(
    [(x, 0.0, 1.0, -1.0) for x in ACROSS]
    + [(x, 0.0, -1.0, -1.0) for x in reversed(ACROSS)]
    + [(0.0, y, 0.0, 1.0) for y in (-1.0, 1.0)]
)
GAIT_WIRING = PatternWiring(inputs=("x", "y", "z", "foot", "sine", "cosine", "time"), outputs=("on",))


def pattern(values: Floats, columns: int) -> Floats:
    """Output of a network of such genes for all actuators and columns, shape (10, T)."""
    column = np.arange(columns)
    phase = 2 * np.pi * column / columns
    times = np.stack([np.sin(phase), np.cos(phase), (2 * column + 1) / columns - 1], axis=1)
    coordinates = np.hstack([np.repeat(ACTUATORS, columns, axis=0), np.tile(times, (ROWS, 1))])
    return np.asarray(GAIT_WIRING.network(values)(coordinates)).reshape(ROWS, columns)
