"""What the bests of a search are worth: played in full, with noise, under both conditions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.problems.inflatable.problem import GaitProblem
from optim.runs.history import History
from robots.inflatable.gaits import GaitDesign
from robots.inflatable.robustness import LEAST_HARD_SPEED, NoisySpeeds, play_with_noise
from robots.world import Terrain


@dataclass(frozen=True, eq=False)
class Finalist(NoisySpeeds):
    """A design that a search found best at some time, played in full.

    Attributes:
        design: the gait.
        generation: in which it was found.
    """

    design: GaitDesign
    generation: int

    @property
    def stays(self) -> bool:
        """Whether enough remains under the harder conditions."""
        return bool(self.hard_speed >= LEAST_HARD_SPEED)


def columns_of(best: Finalist | None) -> dict[str, Any]:
    """What tables tell of the best finalist, by column; None of what is not known."""
    return {
        "generation": best.generation if best else None,
        "speed": best.speed if best else None,
        "hard_speed": best.hard_speed if best else None,
        "pressure": best.design.pressure if best else None,
        "orientation": best.design.orientation if best else None,
    }


def last_bests(history: History, problem: GaitProblem, count: int) -> list[tuple[GaitDesign, int]]:
    """The last few designs that a run found better than all before, and the generations that found them."""
    found: list[tuple[GaitDesign, int]] = []
    full, before = problem.in_full(), None
    for generation in history.generations:
        if generation.best_point is not None and generation.best_point != before:
            before = generation.best_point
            found.append((full.design(problem.space.from_dict(before)), generation.generation))
    return found[-count:]


def judge_finalists(
    found: Sequence[tuple[GaitDesign, int]],
    terrain: Terrain,
    runs: int,
    *,
    progress: Callable[[float], None] | None = None,
    **where: Any,
) -> list[Finalist]:
    """Play designs of one kind on a terrain, each ``runs`` times under either condition, as two batches."""
    if not found:
        return []
    rows = play_with_noise([design for design, _ in found], terrain, runs, progress=progress, **where)
    return [Finalist(usual, hard, *one) for usual, hard, one in zip(*rows, found, strict=True)]


def best_of(finalists: Sequence[Finalist]) -> Finalist | None:
    """The fastest of those that stay under the harder conditions; else the one that loses least there."""
    known = [f for f in finalists if np.isfinite([f.speed, f.hard_speed]).all()]
    staying = [f for f in known if f.stays]
    if staying:
        return max(staying, key=lambda f: f.speed)
    return max(known, key=lambda f: f.hard_speed) if known else None
