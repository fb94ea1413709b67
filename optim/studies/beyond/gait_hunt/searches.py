"""The searches that hunt for gaits, and what they spend: time steps of simulated robots, after which they end."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from optim.experiments.results import Progress
from optim.problem import Evaluation, Request, evaluate_request
from optim.problems.inflatable.problem import GaitProblem
from optim.runs import open_run
from optim.runs.folder import RunFolder
from optim.runs.history import History, read_history
from optim.runs.loop import FolderSearch
from optim.search import Method, build_method, default_settings
from robots.world import Terrain
from taichi_sim.base.files import read_text
from taichi_sim.base.parsing import parse_json

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
    problem: Mapping[str, Any] = field(default_factory=lambda: CYCLE)  # options, beside terrains and where it runs
    rungs: tuple[float, ...] = ()  # parts of the slope on which a gait has to get ahead before, perhaps flat ground (0)

    def problem_on(self, terrain: Terrain, **compute: Any) -> GaitProblem:
        """The problem that it searches on a terrain: orientation, shape and control."""
        easier = tuple(replace(terrain, slope=part * terrain.slope) for part in self.rungs)
        return GaitProblem((*easier, terrain), ladder=bool(easier), **self.problem, **compute)


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


# Simulations that a gradient counts as: what it took the driver of version 1.0 with 16 robots in the lanes of a vector.
# Newer drivers differ; the number stays, as the study's searches were paid by it.
GRADIENT_COST = 7.5
PUBLISHED_COST = 200_720  # robot-steps of a published evaluation at half of the largest pressure
ENDLESS = 1_000_000  # generations
SPENT = "spent.json"


class PaidSearch(FolderSearch):
    """A search in a run folder that knows what its generations have cost.

    Attributes:
        spent: what each generation has cost [robot-steps].
    """

    def __init__(self, problem: GaitProblem, method: Method, run: RunFolder) -> None:
        """Restore the search and what it has spent from an open run folder."""
        super().__init__(problem, method, run)
        self.gaits, self.path = problem, run.path / SPENT
        self.spent = read_spent(run.path)
        if (known := len(self.spent)) < self.turns:
            raise ValueError(f"{self.path}: tells the cost of {known} of {self.turns} generations; restore it")
        del self.spent[self.turns :]  # of a generation that was cut off

    def lasts(self, budget: float) -> bool:
        """Whether a budget may last for the next generation; it does for the first."""
        return not self.spent or sum(self.spent) + least_cost(self.gaits, self.ask()) <= budget

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Note what the generation has cost, then complete it."""
        self.spent.append(cost(self.gaits, request, evaluation))
        self._folder.update_text(SPENT, json.dumps(self.spent) + "\n")
        super().tell(request, evaluation)


def search_within(
    problem: GaitProblem,
    method: str,
    settings: Mapping[str, Any],
    folder: Path,
    budget: float,
    progress: Progress = None,
    generations: int = ENDLESS,
) -> History:
    """Run a search, or go on with the one in the folder, until it has spent its budget, or made its generations.

    A generation of which it is clear before that the budget [robot-steps], see :func:`cost`, does not last is not
    begun, but the first always is. One that turns out to cost more is completed; :func:`paid` leaves it away. The
    folder also has ``spent.json``, what every generation has cost. Raises ValueError if budget or folder are not
    allowed, or the folder lacks what has been spent.
    """
    if not budget > 0:
        raise ValueError(f"budget: {budget:g} robot-steps are not allowed; give more than 0")
    known = default_settings(method) | dict(settings)
    config = {"problem": problem.describe(), "method": {"name": method, **known}, "generations": ENDLESS}
    with open_run(folder, config, resume=True) as run:
        search = PaidSearch(problem, build_method(method, problem.space, known), run)
        while search.turns <= generations and search.lasts(budget):
            request = search.ask()
            search.tell(request, evaluate_request(problem, request))
            if progress:
                progress(min(sum(search.spent) / budget, 1.0))
    return read_history(folder)


def paid(history: History, spent: Sequence[float], budget: float) -> History:
    """The generations of a run that ended within a budget; the first counts in any case."""
    return first_of(history, max(1, int(np.searchsorted(np.cumsum(spent), budget, side="right"))))


def first_of(history: History, count: int) -> History:
    """The first few generations of a run."""
    return replace(history, generations=history.generations[:count], seconds=history.seconds[:count])


def read_spent(folder: Path) -> list[float]:
    """Read the cost of each generation of a run, perhaps with one cut off; raises ValueError for a damaged file."""
    path = folder / SPENT
    try:
        spent = parse_json(read_text(path)) if path.exists() else []
    except ValueError:
        spent = None
    if not isinstance(spent, list) or not all(isinstance(each, int | float) and each >= 0 for each in spent):
        raise ValueError(f"{path}: is damaged; it must be a list of robot-steps, one of each generation")
    return spent


def least_cost(problem: GaitProblem, request: Request) -> float:
    """The smallest cost of a request, see :func:`cost`: no gait gets ahead."""
    count = len(request.points)
    speeds = {condition.name: np.full(count, -np.inf) for condition in problem.conditions}
    return cost(problem, request, Evaluation(np.zeros(count), details=speeds))


def cost(problem: GaitProblem, request: Request, judged: Evaluation) -> float:
    """Time steps of all robots that judged a request; a gradient counts as ``GRADIENT_COST`` simulations."""
    relaxed = request.wants != "points"
    each = problem.robot_steps(request.points, judged, relaxed=relaxed, sharpness=request.sharpness)
    return float(each.sum()) * (GRADIENT_COST if request.wants == "gradients" else 1.0)
