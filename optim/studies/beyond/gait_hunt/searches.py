"""The searches that hunt for gaits, and what each of them searches."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from optim.problems.inflatable.problem import GaitProblem
from robots.world import Terrain

# Time steps of a cheap judgement, a third of a gait; its first quarter does not count, and of the others the worst
# does: a gait that lurches once, or rolls down later, shows there.
SHORT, WARM_UP, STAGES = 62_240, 15_560, 3
# Two columns say a cycle: what moves there and back. All else is free: levels, times, shape, orientation.
CYCLE: Mapping[str, Any] = MappingProxyType(
    {"encoding": "graded", "columns": 2, "steps": SHORT, "warm_up": WARM_UP, "stages": STAGES, "hard": True}
)
# Harder conditions are for the finalists: on the way up a ladder hardly any gait stands them.
STEPPED: Mapping[str, Any] = MappingProxyType({**CYCLE, "encoding": "graded-pattern", "hard": False})


@dataclass(frozen=True)
class HuntSearch:
    """A search."""

    label: str  # what it is, in a few words
    method: str  # its name in ``METHODS``
    settings: Mapping[str, Any]  # of the method, but for the seed
    # options of the problem, beside terrains and where it runs
    problem: Mapping[str, Any] = field(default_factory=lambda: CYCLE)
    # parts of the slope on which a gait has to get ahead before, flat ground (0) perhaps among them
    rungs: tuple[float, ...] = ()

    def problem_on(self, terrain: Terrain, **where: Any) -> GaitProblem:
        """The problem that it searches on a terrain: orientation, shape and control."""
        easier = tuple(replace(terrain, slope=part * terrain.slope) for part in self.rungs)
        return GaitProblem((*easier, terrain), ladder=bool(easier), **self.problem, **where)


SEARCHES: Mapping[str, HuntSearch] = MappingProxyType(
    {
        # As published: codes of eight columns, played as published, judged by the speed alone. Climbers know nothing of
        # each other; there are fewer, so that each gets somewhere.
        "hill-climb": HuntSearch("12 hill climbers, as published", "hill-climb", {"climbers": 12}, {}),
        "genetic": HuntSearch("genetic search on cycles", "genetic", {"population": 32}),
        "gradient": HuntSearch(
            "gradient ascent on cycles", "gradient", {"climbers": 16, "candidates": 2, "learning_rate": 0.1}
        ),
        "memetic": HuntSearch(
            "evolution with gradients on cycles", "memetic", {"population": 32, "every": 4, "refine": 16}
        ),
        "ladder": HuntSearch(
            "genetic search of networks, up a ladder",
            "genetic",
            {"population": 48, "starts": 96, "elites": 48, "crossover": 0.2, "mutation": 0.06},
            STEPPED,
            (0.0, 1 / 3, 2 / 3),
        ),
    }
)
