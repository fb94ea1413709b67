"""A pool of workers, in processes or on a cluster, that evaluates the parts of a request."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from optim.problem import Evaluation
from optim.runs.requests import Request
from optim.runs.workers.batch import KILLER, Batch, Part
from optim.runs.workers.service import Answer, Raised
from taichi_sim.base.arrays import Floats

STARTS = 3  # deaths at start, one after the other, that are enough


class Died(Exception):
    """Raised if a worker has died; the message says how, as in "killed by SIGKILL"."""


class Worker(Protocol):
    """A worker: it answers None once it has started, then answers every request."""

    def submit(self, request: Request) -> None:
        """Send a request to a worker that has no answer pending; if it is dead, its answer tells."""

    def answer(self) -> Answer:
        """Receive the answer of a worker that :meth:`Backend.ready` named; raises ``Died`` if it has died."""

    def kill(self) -> None:
        """End the worker at once, whatever it does."""


W = TypeVar("W", bound=Worker)


class Backend(Protocol[W]):
    """Starts workers of one kind, such as processes, and waits for their answers."""

    @property
    def cores(self) -> int:
        """Number of CPU cores for workers."""

    def start(self) -> W:
        """Start a worker, without waiting until it is ready."""

    def ready(self, workers: Sequence[W], wait: bool) -> Sequence[W]:
        """List workers that have an answer or are dead; with ``wait``, wait for at least one."""


class Pool(Generic[W]):
    """A fixed number of workers of one backend; those that die are replaced.

    Args:
        backend: starts the workers.
        count: number of workers.
        size: most points that a worker evaluates at once.
        save_failed: saves designs that kill their workers, and returns where.
        note: told about every death.
        progress: told the fraction of a request's points that is done with.
    """

    def __init__(
        self,
        backend: Backend[W],
        count: int,
        size: int,
        save_failed: Callable[[Floats, str], Path],
        note: Callable[[str], None],
        progress: Callable[[float], None] | None,
    ) -> None:
        self._backend = backend
        self._count = count
        self._size = size
        self._save_failed = save_failed
        self._note = note
        self._progress = progress
        self._starting: list[W] = []
        self._idle: list[W] = []
        self._busy: dict[W, Part] = {}
        self._start_deaths = 0
        self._known: Evaluation | None = None  # the last evaluation of any part

    def fill(self) -> None:
        """Start workers until there are enough."""
        while len(self._starting) + len(self._idle) + len(self._busy) < self._count:
            self._starting.append(self._backend.start())

    def close(self) -> None:
        """End all workers at once."""
        for worker in (*self._starting, *self._idle, *self._busy):
            worker.kill()

    def evaluate(self, request: Request) -> Evaluation:
        """Evaluate a request, as :func:`optim.runs.workers.open_workers` describes."""
        size = max(1, min(self._size, -(-len(request.points) // self._count)))
        batch = Batch(request, size)
        try:
            while not batch.complete:
                self._bury_idle()
                self.fill()
                self._assign(batch)
                for worker in self._backend.ready([*self._starting, *self._busy], wait=True):
                    self._hear(worker, batch)
        except BaseException:
            for worker in self._busy:  # nobody waits for their answers any more
                worker.kill()
            self._busy.clear()
            raise
        return batch.joined(self._save(batch.killers, len(request.points)))

    def _bury_idle(self) -> None:
        for worker in self._backend.ready(self._idle, wait=False):  # they owe nothing, so they must be dead
            self._idle.remove(worker)
            worker.kill()
            self._note("note: a worker died while it was idle; it is replaced")

    def _assign(self, batch: Batch) -> None:
        while self._idle and (taken := batch.take()):
            worker = self._idle.pop(0)
            self._busy[worker] = taken[0]
            worker.submit(taken[1])

    def _hear(self, worker: W, batch: Batch) -> None:
        """Receive the answer of a worker.

        Raises:
            Exception: that the problem raised in the worker.
        """
        part = self._busy.pop(worker, None)
        if part is None:
            self._starting.remove(worker)
        try:
            answer = worker.answer()
        except Died as death:
            worker.kill()
            self._mourn(part, death, batch)
            return
        except BaseException:
            worker.kill()
            raise
        if isinstance(answer, Raised) and part is None:
            worker.kill()
        else:
            self._idle.append(worker)
        if isinstance(answer, Raised):
            raise answer.error
        if part is None:
            self._start_deaths = 0
        elif answer is not None:
            self._known = answer
            batch.put(part, answer)
            if self._progress:
                self._progress(batch.fraction)

    def _mourn(self, part: Part | None, death: Died, batch: Batch) -> None:
        if part is not None:
            self._note(f"note: a worker died ({death}) with {part} of a generation: {batch.bury(part)}")
            return
        self._start_deaths += 1
        if self._start_deaths == STARTS:
            self._start_deaths = 0
            raise RuntimeError(f"workers: {STARTS} died one after the other before they were ready ({death})")
        self._note(f"note: a worker died ({death}) before it was ready; another one is started")

    def _save(self, killers: Floats, count: int) -> Evaluation:
        """Save points that killed their workers; return any evaluation so far, for the form of its details.

        Raises:
            RuntimeError: if there has never been one.
        """
        path = self._save_failed(killers, KILLER) if len(killers) else None
        if self._known is None:
            raise RuntimeError(
                f"workers: every design killed its worker twice, so the fault is hardly theirs; see {path}"
            )
        if path:
            self._note(f"note: {len(killers)} of {count} designs killed their workers and failed; saved in {path}")
        return self._known
