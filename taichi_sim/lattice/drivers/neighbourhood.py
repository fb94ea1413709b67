"""How far apart voxels may be listed as neighbours: as far as the largest of a run may come to touch.

A list holds the pairs that were within a radius, and is made anew when a voxel has moved by
``contact.REBUILD_DISTANCE``. In between two of them come closer by twice that, so a list misses no contact if its
radius is as much larger than the largest reach. The usual radius does for voxels of up to 1.2 edges; where a program
lets voxels grow more, the radius grows with them.
"""

import numpy as np

from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.laws.group import grown_scales
from taichi_sim.lattice.materials import EXPANSION
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages.columns import SIZING
from taichi_sim.lattice.stages.memory import AGE, BASE, CHANNEL_WIDTH, RATE
from taichi_sim.lattice.stages.tables import PackedProgram

SIZES = np.sort(SIZING) // CHANNEL_WIDTH  # quantities that sizes follow: scale along x, y and z, and temperature
PLACES = np.full(QUANTITY_COUNT, -1)  # of each quantity among these
PLACES[SIZES] = np.arange(len(SIZES))


class Extremes:
    """The least and the most that the channels of sizes may hold in a run, group by group.

    Attributes:
        least, most: scale along x, y and z, and temperature, shape (B, G, 4).
        places: where the channel that a mark of the program sets is in them, made flat; -1 if in none.
        lasting: for how many steps it does, until the next mark of that channel or the end.
    """

    def __init__(self, channels: np.ndarray, program: PackedProgram) -> None:
        """Find the extremes over a program, with channels as they are at its beginning, shape (B, 25 G, 4)."""
        batch, groups = len(channels), channels.shape[1] // QUANTITY_COUNT
        start = channels.reshape(batch, groups, QUANTITY_COUNT, -1)[:, :, SIZES].astype(float)
        self.least = start[..., BASE] + start[..., RATE] * start[..., AGE]
        self.most = self.least.copy()
        robot = np.repeat(np.arange(batch), np.diff(program.first))
        step, target = program.marks[: len(robot)].T
        place, lasting = PLACES[target % QUANTITY_COUNT], np.zeros(len(robot))
        sets = (target >= 0) & (place >= 0)
        place = np.where(sets, (robot * groups + target // QUANTITY_COUNT) * len(SIZES) + place, -1)
        chosen = np.flatnonzero(sets)
        chosen = chosen[np.lexsort((step[chosen], place[chosen]))]
        rows, places = robot[chosen], place[chosen]
        follows = np.append(places[1:] == places[:-1], False)[: len(chosen)]
        ends = program.lengths[rows].astype(float)
        ends[follows] = step[chosen][1:][follows[:-1]]
        lasting[chosen] = np.maximum(ends - step[chosen], 0.0)
        self.places, self.lasting = place, lasting
        # A channel that goes on from the run before does so until its first event.
        until = np.tile(program.lengths[:, None, None].astype(float), (1, *start.shape[1:3]))
        first = np.flatnonzero(np.append(True, ~follows[:-1])) if len(chosen) else chosen
        until.reshape(-1)[places[first]] = step[chosen][first]
        onwards = self.least + start[..., RATE] * until
        self.least, self.most = np.fmin(self.least, onwards), np.fmax(self.most, onwards)
        self.include(places, program.values[chosen], self.lasting[chosen])

    def include(self, places: np.ndarray, values: np.ndarray, steps: np.ndarray | float) -> bool:
        """Take in events of some channels, by value and rate, shape (N, 2), and how many steps they hold at most.

        Returns:
            whether anything is less or more than what was known.
        """
        base = values[:, 0].astype(float)
        end = base + values[:, 1] * steps
        least, most = self.least.reshape(-1), self.most.reshape(-1)
        low, high = np.fmin(base, end), np.fmax(base, end)
        if not ((low < least[places]) | (high > most[places])).any():
            return False
        np.fmin.at(least, places, low)
        np.fmax.at(most, places, high)
        return True

    def largest(self, constants: np.ndarray) -> float:
        """The largest mean size [edges] of a voxel; ``constants`` are those of groups, shape (B, G, columns)."""
        scales = np.moveaxis(np.maximum(np.abs(self.least[..., :3]), np.abs(self.most[..., :3])), -1, 0)
        coldest, warmest = (each[..., 3] for each in (self.least, self.most))
        grown = [grown_scales(constants[..., EXPANSION], each, *scales) for each in (coldest, warmest)]
        sizes = np.abs(grown).mean(axis=1)
        return float(np.max(sizes, where=np.isfinite(sizes), initial=0.0))


def list_radius(largest: float) -> float:
    """Radius [edges] of lists that miss no contact of voxels up to a mean size [edges]."""
    return max(contact.NEIGHBOUR_RADIUS, contact.reach(largest, largest) + 2.0 * contact.REBUILD_DISTANCE)
