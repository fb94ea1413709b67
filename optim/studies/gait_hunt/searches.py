"""The searches that hunt for gaits, and what each of them searches."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from optim.gait_problem import GaitProblem
from robots.terrain import Terrain

# Time steps of a cheap judgement, a third of a gait; its first quarter does not count, and of the others the worst
# does: a gait that lurches once, or rolls down later, shows there.
SHORT, WARM_UP, STAGES = 62_240, 15_560, 3
# Two columns say a cycle: what moves there and back. All else is free: levels, times, shape, orientation.
CYCLE: Mapping[str, Any] = MappingProxyType(
    {"encoding": "graded", "columns": 2, "steps": SHORT, "warm_up": WARM_UP, "stages": STAGES, "hard": True}
)


@dataclass(frozen=True)
class HuntSearch:
    """A search.

    Attributes:
        label: what it is, in a few words.
        method: its name in ``METHODS``.
        settings: of the method, but for the seed.
        problem: options of the problem, beside terrains and where it runs.
    """

    label: str
    method: str
    settings: Mapping[str, Any]
    problem: Mapping[str, Any] = field(default_factory=lambda: CYCLE)

    def problem_on(self, terrains: tuple[Terrain, ...], **where: Any) -> GaitProblem:
        """What it searches on some terrains: orientation, shape and control."""
        return GaitProblem(terrains, **self.problem, **where)


SEARCHES: Mapping[str, HuntSearch] = MappingProxyType(
    {
        # As published: codes of eight columns, played as published, judged by the speed alone.
        "hill-climb": HuntSearch("hill climbers, as published", "hill-climb", {"climbers": 60}, {}),
        "genetic": HuntSearch("genetic search on cycles", "genetic", {"population": 32}),
        "gradient": HuntSearch(
            "gradient ascent on cycles", "gradient", {"climbers": 8, "candidates": 4, "learning_rate": 0.1}
        ),
        "memetic": HuntSearch(
            "evolution with gradients on cycles", "memetic", {"population": 32, "every": 4, "refine": 8}
        ),
    }
)
