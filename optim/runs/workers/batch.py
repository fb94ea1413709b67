"""Split a request into parts, hand them out, repeat those that failed, and join their evaluations."""

import dataclasses
from collections import deque
from dataclasses import dataclass

import numpy as np

from optim.problem import Evaluation, Request
from optim.runs.requests import failures, join
from taichi_sim.base.arrays import Floats

KILLER = "killed its worker"  # status of a design that has done so twice
ATTEMPTS = 2


@dataclass(frozen=True)
class Part:
    """Part of a request: points ``begin`` to ``end`` (exclusive), which have killed ``deaths`` workers so far."""

    begin: int
    end: int
    deaths: int = 0

    def __len__(self) -> int:
        return self.end - self.begin

    def __str__(self) -> str:
        return f"design {self.begin}" if len(self) == 1 else f"designs {self.begin} to {self.end - 1}"


class Batch:
    """Hands out the parts of a request, takes their evaluations in any order, and joins them in the request's order.

    A part that kills two workers is bisected; only a single design that kills two workers by itself has failed. The
    result therefore depends on the points alone, not on the parts or the order of evaluation.

    Args:
        request: N points.
        size: maximum number of points of a part.
    """

    def __init__(self, request: Request, size: int) -> None:
        self._request = request
        count = len(request.points)
        starts = range(0, max(count, 1), size)  # a request without points is one part, too
        self._waiting = deque(Part(begin, min(begin + size, count)) for begin in starts)
        self._away = 0
        self._evaluated: dict[Part, Evaluation] = {}
        self._killers: list[Part] = []

    @property
    def complete(self) -> bool:
        """Whether every point has been evaluated or has killed its workers."""
        return not self._waiting and not self._away

    @property
    def fraction(self) -> float:
        """Fraction of the points that is finished."""
        finished = sum(len(part) for part in self._evaluated) + len(self._killers)
        return finished / max(1, len(self._request.points))

    @property
    def killers(self) -> Floats:
        """Points that killed their workers, shape (F, D), in order."""
        return self._request.points[sorted(part.begin for part in self._killers)]

    def take(self) -> tuple[Part, Request] | None:
        """Next part to evaluate, with its request, or None if no part is waiting."""
        if not self._waiting:
            return None
        part = self._waiting.popleft()
        self._away += 1
        return part, self._request.part(part.begin, part.end)

    def put(self, part: Part, evaluation: Evaluation) -> None:
        """Store the evaluation of a part."""
        self._away -= 1
        self._evaluated[part] = evaluation

    def bury(self, part: Part) -> str:
        """Record that a part killed its worker, and return a text that says what happens next."""
        self._away -= 1
        deaths = part.deaths + 1
        if deaths < ATTEMPTS:
            self._waiting.appendleft(Part(part.begin, part.end, deaths))
            return "judged again"
        if len(part) == 1:
            self._killers.append(part)
            return "failed, this was the second time"
        middle = (part.begin + part.end) // 2
        self._waiting.extendleft((Part(middle, part.end), Part(part.begin, middle)))
        return "judged in halves, this was the second time"

    def joined(self, like: Evaluation) -> Evaluation:
        """Join the evaluations of all points; points that killed workers have details in the form of ``like``."""
        wanted = self._request.wants == "gradients"
        slopes = np.full((1, self._request.points.shape[1]), np.nan) if wanted else None
        failed = dataclasses.replace(failures(like, 1, KILLER), gradients=slopes)
        parts = self._evaluated | dict.fromkeys(self._killers, failed)
        return join([parts[part] for part in sorted(parts, key=lambda part: part.begin)])
