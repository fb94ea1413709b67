"""What a report asks of each kind of problem."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from optim.problem import FILE, GAIT, ROBOT, VEHICLE, WALKER, Problem
from optim.report.markup import Html, Section, Text
from optim.runs.config import problem_of
from optim.runs.generation import Generation
from robots.hardware import PneumaticRig
from robots.view.motion import Motion
from taichi_sim.base.arrays import Floats

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Replay:
    """The best design simulated once more, on each terrain or in each environment.

    Attributes:
        motions: to be played.
        numbers: what each of these came to: a speed, or the smallest distance from the light; None of a failure.
        pictures: of what happened.
    """

    motions: Sequence[Motion] = ()
    numbers: Sequence[float | None] = ()
    pictures: Sequence[Html] = ()


@dataclass(frozen=True)
class Best:
    """What there is to say of the best design.

    Attributes:
        content: markup.
        sections: more of the page.
        document: the same for machines.
    """

    content: Sequence[Html]
    sections: Sequence[Section] = ()
    document: dict[str, Any] = field(default_factory=dict)


class RunKind(Protocol):
    """A kind of problem, as reports see it."""

    @property
    def problem(self) -> Problem:
        """What was searched in."""

    @property
    def task(self) -> str:
        """What is designed and where, in a few words that follow a colon."""

    @property
    def score(self) -> tuple[str, str]:
        """What the score is, and its unit."""

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """What is designed, and how it is judged."""

    @property
    def curves(self) -> Mapping[str, str]:
        """Numbers in ``best_details`` that are worth a curve each, and what they are called."""

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Simulate a point, with about so many frames of each motion."""

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """The best design, of the last generation."""

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """What a table of several designs, shape (C, D), tells of each beside its objectives."""

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """What can be done with the run: words, and a command."""


def kind_of(folder: Path, config: Mapping[str, Any]) -> RunKind:
    """The kind of a run's problem.

    Raises:
        ValueError: in one line, for a problem that is unknown or cannot be read.
    """
    from optim.report.file_run import FileRun
    from optim.report.gait_run import GaitRun
    from optim.report.robot_run import RobotRun
    from optim.report.vehicle_run import VehicleRun
    from optim.report.walker_run import WalkerRun

    kinds: dict[str, Callable[[Mapping[str, Any]], RunKind]] = {
        GAIT: GaitRun.of,
        WALKER: WalkerRun.of,
        VEHICLE: VehicleRun.of,
        ROBOT: RobotRun.of,
        FILE: FileRun.of,
    }
    name = config["problem"].get("kind", GAIT)
    if name not in kinds:
        raise ValueError(f"run: {folder} designs a {name}, which has no report; {', '.join(kinds)} have one")
    return problem_of(folder, config, kinds[name])


def finite(value: float | None) -> float | None:
    """A number; None where there is none, or none that means anything."""
    return None if value is None or not math.isfinite(value) else value
