"""The loop of a run: search for one generation, then write its designs, its log line and a checkpoint."""

import functools
import json
import time
from collections.abc import Callable

import numpy as np

from optim.problem import Evaluate, Evaluation, Problem, Request, evaluate_request
from optim.runs.checkpoint import restore
from optim.runs.config import GROUND_FILES, check_ground_files, keep_ground_files
from optim.runs.evaluations import EVALUATIONS, EvaluationLog
from optim.runs.folder import RunFolder
from optim.runs.generation import Generation, record
from optim.runs.rehearsal import REHEARSED, Rehearsal
from optim.search.method import Method, SearchResult, next_request
from taichi_sim.base.foreign import blamed_package
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.results_folder import BEST_DESIGN


class FolderSearch:
    """A search in a run folder, generation by generation, which continues where the folder ends.

    At the end of a generation its designs, then its log line, then a checkpoint are written. A generation that a kill
    interrupts is repeated from the last checkpoint with the same result.

    Attributes:
        problem: the problem; the mean of its objectives is the score.
        last: the last generation; None before the first.
    """

    def __init__(self, problem: Problem, method: Method, folder: RunFolder, keep_evaluations: bool = False) -> None:
        """Restore the search from the folder, if it has begun.

        Args:
            problem: the problem to solve.
            method: search method, built with the settings of the run and not yet used.
            folder: open run folder, to which the log, the checkpoints and ``best.json`` are written.
            keep_evaluations: whether to keep every design that is evaluated; a run that does goes on with it.

        Raises:
            ValueError: if the problem has several objectives and the method takes a single one, or a file of the
                ground has changed.
        """
        if len(problem.objective_names) > 1 and not method.several_objectives:
            raise ValueError(f"method: it takes one objective; the problem has {', '.join(problem.objective_names)}")
        self.problem, self._method, self._folder = problem, method, folder
        if folder.config.get(GROUND_FILES):
            self._check_ground()
            keep_ground_files(problem, folder.path)
        self.last: Generation | None = None
        self._asked = 0.0
        if (known := folder.restore()) is not None:
            self.last = Generation(**parse_json(known[1]))
        name = folder.config["method"]["name"]
        self._rehearsal = Rehearsal(name, method) if self.turns < REHEARSED else None
        if known is not None:
            restore(folder.path, method, known[0])
            _write_designs(problem, method.result(), folder)
        self._evaluations: EvaluationLog | None = None
        if keep_evaluations or (folder.path / EVALUATIONS).exists():
            self._evaluations = EvaluationLog(folder.path, problem)
            with folder.writing():
                self._evaluations.keep(self.turns)

    @property
    def turns(self) -> int:
        """Number of complete generations, including the starts."""
        return self.last.generation + 1 if self.last else 0

    def ask(self) -> Request:
        """Points that the method wants evaluated next."""
        self._asked = time.perf_counter()
        with blamed_package():
            return next_request(self._method)

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Complete a generation: tell the method, and write designs, log and checkpoint.

        Raises:
            ValueError: if a file of the ground has changed, so that the generation may have used another ground; in
                the first generations also if the method cannot continue from its own checkpoint.
        """
        self._check_ground()
        with blamed_package():
            if self._rehearsal:
                self._rehearsal.keep(request.points, evaluation)
            self._method.tell(request.points, evaluation)
            result, state = self._method.result(), self._method.state()
            if self._rehearsal:
                self._rehearsal.check(self._method, state)
        self.last = record(self.last, self.problem, result, request, evaluation)
        if self.turns >= REHEARSED:
            self._rehearsal = None  # its copies take as much memory as the method
        _write_designs(self.problem, result, self._folder)
        if self._evaluations is not None:
            with self._folder.writing():
                self._evaluations.add(self.last.generation, request, evaluation)
        self._folder.commit(self.last.to_json(), state, time.perf_counter() - self._asked)

    def _check_ground(self) -> None:
        """Refuse files of the ground that have changed since the run began."""
        if self._folder.config.get(GROUND_FILES):
            check_ground_files(self._folder.config, getattr(self.problem, GROUND_FILES, {}), self._folder.path)


def run_search(
    problem: Problem,
    method: Method,
    folder: RunFolder,
    generations: int,
    progress: Callable[[Generation], None] | None = None,
    evaluate: Evaluate | None = None,
    keep_evaluations: bool = False,
) -> Generation:
    """Run a search up to and including a generation, or continue it from where its run folder ends.

    Args:
        problem: the problem to solve; the mean of its objectives is the score.
        method: search method, built with the settings of the run and not yet used.
        folder: open run folder, to which the log, the checkpoints and ``best.json`` are written.
        generations: number of the last generation; the starts are generation 0.
        progress: called after every generation; when continuing, first with the last complete one.
        evaluate: evaluates the points of a generation; if None, the problem does so in this process.
        keep_evaluations: whether to keep every design that is evaluated, for ``evaluations``.

    Returns:
        The last generation.
    """
    evaluated = evaluate or functools.partial(evaluate_request, problem)
    search = FolderSearch(problem, method, folder, keep_evaluations)
    if search.last and progress:
        progress(search.last)
    while (last := search.last) is None or last.generation < generations:
        request = search.ask()
        search.tell(request, evaluated(request))
        if progress and search.last:
            progress(search.last)
    return last


def _write_designs(problem: Problem, result: SearchResult, folder: RunFolder) -> None:
    """Write the files of the best design, and of the front or the elites if the method keeps any."""
    if not np.isnan(result.score):
        folder.update(BEST_DESIGN, functools.partial(problem.save, result.point))
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
