"""How far a robot's speed can be trusted: what remains of it in trials that differ a little, or by their conditions."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.outcome import Judgement
from taichi_sim.base.arrays import Floats
from taichi_sim.base.short_text import decimal

FINER = "half the time step"
ENOUGH = 0.5  # part of the speed that shall remain in the median
FRICTIONS = (0.5, 0.625, 0.75, 0.875)  # parts of its friction with which a robot is tried


@dataclass(frozen=True, eq=False)
class Trust:
    """Speeds of a robot in trials that differ from each other; one that diverges does not move.

    Attributes:
        speeds: in trials that differ by next to nothing, shape (R,).
        changed: under changed conditions, by their names.
        recomputed: names of those that change how the robot is computed, not the robot.
        unit: of the speeds.
        alike: what the trials that differ by next to nothing are, for people.
    """

    speeds: Floats
    changed: dict[str, float]
    recomputed: tuple[str, ...] = ()
    unit: str = "BL/s"
    alike: str = "noisy starts"

    @property
    def speed(self) -> float:
        """Median of the trials that differ by next to nothing."""
        return float(np.median(self.speeds))

    @property
    def kept(self) -> float:
        """Part of the speed, which may be backwards, that remains in the median of the changed conditions.

        It is 0 for a robot that goes nowhere.
        """
        return float(np.median(list(self.changed.values()))) / self.speed if self.speed else 0.0

    @property
    def broken_by(self) -> tuple[str, ...]:
        """Conditions under which less than half of the speed remains; of one backwards, that much backwards."""
        way = np.copysign(1.0, self.speed)
        return tuple(name for name, speed in self.changed.items() if way * speed < ENOUGH * abs(self.speed))

    @property
    def unsettled_by(self) -> tuple[str, ...]:
        """Other ways to compute it that make it more than half as fast again, and faster than in all that are alike."""
        way, speeds = np.copysign(1.0, self.speed), self.changed.items()
        most = max((2 - ENOUGH) * abs(self.speed), (way * self.speeds).max())
        return tuple(name for name, speed in speeds if name in self.recomputed and way * speed > most)

    @property
    def judgement(self) -> Judgement:
        """The trust in words, and as a document."""
        low, high = self.speeds.min(), self.speeds.max()
        spread = (
            f"{decimal(self.speed)} {self.unit}, {decimal(low)} to {decimal(high)} from {len(self.speeds)} {self.alike}"
        )
        told = ", ".join(f"{name} {decimal(speed)}" for name, speed in self.changed.items())
        text = f"{spread}\nchanged: {told}\n{self.kept:.2f} of the speed remains in the median"
        if self.broken_by:
            text += f"; less than half with {', '.join(self.broken_by)}"
        if self.unsettled_by:
            text += f"; more than half as fast again with {' and '.join(self.unsettled_by)}, so the speed is a guess"
        document: dict[str, Any] = {
            "speeds": self.speeds.tolist(),
            "changed": self.changed,
            "kept": self.kept,
            "broken_by": list(self.broken_by),
            "unsettled_by": list(self.unsettled_by),
        }
        return Judgement(text, document, not self.kept >= ENOUGH)
