"""Designs of the inflatable shape-changing robot, and the two gaits that were made by hand.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from dataclasses import dataclass

import numpy as np

from robots.inflatable.cores import Pressure, checked_pressure
from robots.inflatable.schedule import GaitSchedule
from taichi_sim.base.checks import number


@dataclass(frozen=True)
class InflatableDesign:
    """Shape, orientation and control of the robot.

    Attributes:
        pressure: of the core [Pa], 0 (flat) to 15,000; 12,000 makes it round. In a body with several cores a number
            is that of all of them, and a tuple has one for each, from the end of foot 1 on. Where columns of the
            schedule have core pressures, this is one number, the pressure before the gait.
        orientation: heading [degrees] from the rolling direction (0, along x) to the inching direction (90, along y).
        schedule: when and how far bladders inflate and feet grip.
    """

    pressure: Pressure
    orientation: float
    schedule: GaitSchedule

    def __post_init__(self) -> None:
        object.__setattr__(self, "pressure", checked_pressure(self.pressure))
        object.__setattr__(self, "orientation", number("orientation", self.orientation, 0.0, 90.0, "degrees"))
        if not isinstance(self.schedule, GaitSchedule):
            raise ValueError(f"schedule: {type(self.schedule).__name__} is not allowed; give a GaitSchedule")
        if isinstance(self.pressure, tuple) and self.schedule.core_pressure is not None:
            raise ValueError(
                f"pressure: {len(self.pressure)} values are not allowed with a gait that has core pressures of its "
                "columns; give one"
            )


INCHING = InflatableDesign(
    pressure=0.0,
    orientation=90.0,
    schedule=GaitSchedule.from_text("/".join(["10101010"] * 4 + ["00000000"] * 4 + ["01010101", "10101010"])),
)
ROLLING = InflatableDesign(
    pressure=12e3,
    orientation=0.0,
    schedule=GaitSchedule(np.vstack([np.eye(8)[::-1], np.zeros((2, 8))])),
)
