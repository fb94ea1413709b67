"""What bodies of the inflatable robot do to learning: pouches drawn by number, which feel and answer."""

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from optim.experiments.study import Count, Several
from optim.studies.beyond.body_and_learning.study import STUDY as WALKERS
from optim.studies.beyond.body_and_learning.study import BodyAndLearning, rewrite_as
from robots.inflatable import InflatableGeometry
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.pouch import GAIN, feeling_pouch
from robots.lattice_robot import LatticeRobot
from robots.lattice_robot.reflexes import Reflexes

FREQUENCY = 3.0  # Hz
REFLEXES = Reflexes(("touch", "tilt", "light", "clock"), gain=GAIN)
ACROSS, ROWS, FEET = (1, 2), (8, 14), (1, 3)  # least and most voxels across a bladder, rows, and rows of a foot


@cache
def pouch(number: int, cycles: int = 2) -> LatticeRobot:
    """The pouch of a number: as wide and long, with feet as long and a core as full as drawn; its controller is free.

    All pouches have as many bladders and weights, so that controllers of one fit all others.
    """
    rng = np.random.default_rng((number, 52))
    across, rows, feet = (int(rng.integers(low, high + 1)) for low, high in (ACROSS, ROWS, FEET))
    pressure = float(rng.uniform(0.0, ACTUATION.round_pressure))
    geometry = InflatableGeometry(bladder_columns=across, rows=rows, foot_rows=feet, closed=True)
    return feeling_pouch(geometry, pressure, REFLEXES, FREQUENCY, cycles, name=f"pouch {number}")


@dataclass(frozen=True)
class PouchesAndLearning(BodyAndLearning):
    """Pouches, how they are measured, and how controllers are learned in them; attributes as of walkers."""

    bodies: Several = 24
    controllers: Count = 128
    repetitions: Count = 5
    budget: Several = 64
    cycles: Count = 2

    name = "pouches-and-learning"

    def robot(self, number: int) -> LatticeRobot:
        """The pouch of a number."""
        return pouch(number, self.cycles)


STUDY = replace(
    WALKERS,
    title="whether metrics of an inflatable body tell how soon controllers are learned in it",
    scales={
        "small": PouchesAndLearning(bodies=3, controllers=8, repetitions=2, budget=8, cycles=1),
        "medium": PouchesAndLearning(),
        "full": PouchesAndLearning(bodies=128, controllers=1024, repetitions=10, budget=256),
    },
    rewrite=partial(rewrite_as, PouchesAndLearning),
    cost="about 60 hours of a core; medium takes two hours",
)
