"""Reports of the user's own problems, from what run folders know of them: no code of theirs is run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from optim.problem import objectives_of, score_of
from optim.problems.user_file import RecordedProblem
from optim.report.kinds import Best, Progress, Replay
from optim.report.markup import Text, facts, number
from optim.runs.generation import Generation
from optim.wording import counted
from robots.hardware import PneumaticRig
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True)
class FileRun:
    """A run of a problem that is defined in a file."""

    problem: RecordedProblem

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> Self:
        """The run of a problem as described."""
        return cls(RecordedProblem(description))

    @property
    def task(self) -> str:
        """Which file."""
        return f"problem of {self.problem.file}"

    @property
    def score(self) -> tuple[str, str]:
        """Name and unit of the objective, or of the mean of several."""
        score = score_of(objectives_of(self.problem))
        return score.name, score.unit

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """The file and the objectives."""
        objectives = ", ".join(objective.label for objective in objectives_of(self.problem))
        return [
            ("Problem", f"{self.problem.file}, SHA-256 {self.problem.checksum[:12]}"),
            ("Objectives" if len(self.problem.objective_names) > 1 else "Objective", f"{objectives}, maximised"),
            ("Free", counted(self.problem.space.size, "variable")),
        ]

    @property
    def curves(self) -> Mapping[str, str]:
        """None beside the score."""
        return {}

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Nothing moves."""
        return Replay()

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """Values and details of the best point."""
        values, details = self.problem.space.to_dict(point), last.best_details or {}
        told: list[tuple[str, Text]] = [(name, f"{value:.6g}") for name, value in values.items()]
        shown = {name: value for name, value in details.items() if isinstance(value, int | float)}
        parts = [facts("The best point", told)]
        if shown:
            parts.append(facts("Its details", [(name, number(value, 4)) for name, value in shown.items()]))
        return Best(parts, [], {"values": values, "details": details})

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """The values."""
        return {name: [f"{value:.4g}" for value in points[:, n]] for n, name in enumerate(self.problem.space.names)}

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """None: only the file can evaluate."""
        return []
