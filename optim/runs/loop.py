"""Ask, evaluate, tell, log, checkpoint."""

import functools
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from optim.problem import Evaluation, Problem
from optim.runs.folder import RunFolder
from optim.runs.requests import Evaluate, Request, judge
from optim.search.method import Method, SearchResult


@dataclass(frozen=True)
class Generation:
    """One generation of a run as its line in ``log.jsonl``. None stands where every evaluation has failed.

    Attributes:
        generation: counted from 0, the starts.
        evaluations: made since the run began.
        failed: evaluations of this generation that failed.
        best: best score so far.
        mean: of the scores of what the search keeps: the climbers' best points, a population, a front.
        median: of the same.
        scores: those of independent climbers, shape (C,), for statistics; None of other methods.
        best_point: values of the best point by name.
        best_details: the problem's details of the best point by name.
        numbers: what else the method tells of itself.
    """

    generation: int
    evaluations: int
    failed: int
    best: float | None
    mean: float | None
    median: float | None
    scores: list[float | None] | None
    best_point: dict[str, float | int] | None
    best_details: dict[str, Any] | None
    numbers: dict[str, float | int | None]

    def to_json(self) -> str:
        """One line, the same for the same numbers."""
        return json.dumps(asdict(self), allow_nan=False)


class FolderSearch:
    """A search in a run folder, generation by generation, going on where the folder left off.

    A generation ends with its designs, then its log line, then a checkpoint. What a kill cuts off is done again from
    the last checkpoint, with the same result.

    Attributes:
        problem: what is searched; the mean of its objectives is the score.
        last: the last generation; None before the first.
    """

    def __init__(self, problem: Problem, method: Method, folder: RunFolder) -> None:
        """Restore what the folder holds.

        Args:
            problem: what to search.
            method: built with the settings of the run, not yet used.
            folder: open run folder; takes the log, the checkpoints and ``best.json``.

        Raises:
            ValueError: if the problem has several objectives and the method takes a single one.
        """
        if len(problem.objective_names) > 1 and not method.several_objectives:
            raise ValueError(f"method: it takes one objective; the problem has {', '.join(problem.objective_names)}")
        self.problem, self._method, self._folder = problem, method, folder
        self.last: Generation | None = None
        self._asked = 0.0
        if (known := folder.restore()) is not None:
            state, text = known
            method.restore(state)
            self.last = Generation(**json.loads(text))
            _write_designs(problem, method.result(), folder)

    @property
    def turns(self) -> int:
        """Generations completed, the starts among them."""
        return self.last.generation + 1 if self.last else 0

    def ask(self) -> Request:
        """What the method wants to know next."""
        self._asked = time.perf_counter()
        return Request(self._method.ask(), self._method.wants, self._method.sharpness)

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Complete a generation: tell the method, and write designs, log and checkpoint."""
        self._method.tell(request.points, evaluation)
        result = self._method.result()
        self.last = _next(self.last, self.problem, result, request.points, evaluation)
        _write_designs(self.problem, result, self._folder)
        self._folder.commit(self.last.to_json(), self._method.state(), time.perf_counter() - self._asked)


def run_search(
    problem: Problem,
    method: Method,
    folder: RunFolder,
    generations: int,
    progress: Callable[[Generation], None] | None = None,
    evaluate: Evaluate | None = None,
) -> Generation:
    """Run a search up to and including a generation, going on where the folder left off; see :class:`FolderSearch`.

    Args:
        problem: what to evaluate; the mean of its objectives is the score.
        method: built with the settings of the run, not yet used.
        folder: open run folder; takes the log, the checkpoints and ``best.json``.
        generations: number of the last generation; the starts are generation 0.
        progress: called after every generation, and at once with the last one known when continuing.
        evaluate: judges the points of a generation; here, by the problem, if None.

    Returns:
        The last generation.
    """
    judged = evaluate or functools.partial(judge, problem)
    search = FolderSearch(problem, method, folder)
    if search.last and progress:
        progress(search.last)
    while (last := search.last) is None or last.generation < generations:
        request = search.ask()
        search.tell(request, judged(request))
        if progress and search.last:
            progress(search.last)
    return last


def _write_designs(problem: Problem, result: SearchResult, folder: RunFolder) -> None:
    """The files of the best design, and of the front or the elites where the method keeps any."""
    if not np.isnan(result.score):
        folder.update("best.json", functools.partial(problem.save, result.point))
    if result.kind in ("front", "elites"):
        document = {
            "kind": result.kind,
            "objectives": problem.objective_names,
            "designs": [
                {"objectives": objectives.tolist(), "point": problem.space.to_dict(point)}
                for point, objectives in zip(result.points, result.objectives, strict=True)
            ],
        }
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        folder.update_text("front.json", text)


def _next(
    last: Generation | None,
    problem: Problem,
    result: SearchResult,
    points: np.ndarray,
    evaluation: Evaluation,
) -> Generation:
    """The record of a generation just told."""
    valid = result.scores[~np.isnan(result.scores)]
    best_details = last.best_details if last else None
    scores = evaluation.objectives.mean(axis=1)
    here = np.flatnonzero((points == result.point).all(axis=1) & (scores == result.score))
    if here.size:
        best_details = {name: values[here[0]].tolist() for name, values in evaluation.details.items()}
    return Generation(
        generation=last.generation + 1 if last else 0,
        evaluations=(last.evaluations if last else 0) + len(points),
        failed=int(evaluation.failed.sum()),
        best=None if np.isnan(result.score) else result.score,
        mean=float(valid.mean()) if valid.size else None,
        median=float(np.median(valid)) if valid.size else None,
        scores=[None if np.isnan(s) else s for s in result.scores.tolist()] if result.kind == "climbers" else None,
        best_point=None if np.isnan(result.score) else problem.space.to_dict(result.point),
        best_details=best_details,
        numbers=dict(result.numbers),
    )
