"""Quick robots for tests of many robots, importable in workers: each tosses a ball."""

import os
import signal
from dataclasses import dataclass

import numpy as np

from robots.robot import Measure, Outcome, Parameter, Robot

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Tosser(Robot):
    """It tosses straight up, at its usual speed of 2 m/s if none is given; some cannot, some end their process."""

    speed: float | None = None
    breaks: bool = False
    kills: bool = False
    refuses: bool = False

    kind = "tosser"
    name = "tosser"
    measures = (Measure("height", "m"), Measure("flight", "s"))

    @property
    def parameters(self):
        return (Parameter("toss", 1.0, 3.0),) if self.speed is None else ()

    def run(self, points, trial):
        if self.kills:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.refuses:
            raise ValueError("floor: too soft to toss from")
        speed = points[:, 0] if self.speed is None else np.full(len(points), self.speed)
        status = np.full(len(points), "diverged" if self.breaks else "ok")
        nothing = np.where(status == "ok", 0.0, np.nan)
        return Outcome({"height": speed**2 / 2 / GRAVITY + nothing, "flight": 2 * speed / GRAVITY + nothing}, status)


@dataclass(frozen=True)
class Roller(Tosser):
    """It rolls, and has another measure."""

    measures = (Measure("distance", "m"),)

    def run(self, points, trial):
        return Outcome({"distance": np.full(len(points), 7.0)})


@dataclass(frozen=True)
class InFeet(Tosser):
    """It tosses as the others, and measures the height in feet."""

    measures = (Measure("height", "ft"), Measure("flight", "s"))

    def run(self, points, trial):
        found = super().run(points, trial)
        return Outcome({**found.measures, "height": found.measures["height"] / 0.3048}, found.status)


@dataclass(frozen=True)
class Namesake(Tosser):
    """Two of its measures are called as columns of a table are."""

    measures = (Measure("height", "m"), Measure("steps"), Measure("status", "s"))

    def run(self, points, trial):
        found = super().run(points, trial)
        one = np.ones(len(points))
        return Outcome({"height": found.measures["height"], "steps": 1.5 * one, "status": 3.5 * one}, found.status)
