"""Pool of workers, of any backend, that evaluates the parts of a request."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from optim.problem import Evaluation, Request
from optim.runs.workers.batch import KILLER, Batch, Part
from optim.runs.workers.service import Answer, Raised
from taichi_sim.base.arrays import Floats

STARTS = 3  # consecutive deaths before workers are ready, after which the pool gives up


class Died(Exception):
    """Raised if a worker has died; the message says how, such as "killed by SIGKILL"."""


class Worker(Protocol):
    """A worker: it answers None once it has started, then answers every request."""

    def submit(self, request: Request) -> None:
        """Send a request to a worker that has no answer pending; if it is dead, :meth:`answer` raises ``Died``."""

    def answer(self) -> Answer:
        """Receive the answer of a worker that :meth:`Backend.ready` named; raises ``Died`` if it has died."""

    def kill(self) -> None:
        """End the worker at once."""


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


@dataclass(eq=False)
class Pool(Generic[W]):
    """A fixed number of workers of one backend; those that die are replaced.

    Attributes:
        backend: starts the workers.
        count: number of workers.
        size: maximum number of points that a worker evaluates at once.
        save_failed: saves designs that kill their workers, and returns the file.
        note: called with a line about every death.
        progress: called with the fraction of a request's points that is complete.
    """

    backend: Backend[W]
    count: int
    size: int
    save_failed: Callable[[Floats, str], Path]
    note: Callable[[str], None]
    progress: Callable[[float], None] | None

    def __post_init__(self) -> None:
        self._idle: list[W] = []
        self._busy: dict[W, Part | None] = {}  # with the part that it evaluates, or None while it starts
        self._start_deaths = 0
        self._known: Evaluation | None = None  # the last evaluation of any part

    def fill(self) -> None:
        """Start workers until there are enough."""
        while len(self._idle) + len(self._busy) < self.count:
            self._busy[self.backend.start()] = None

    def close(self) -> None:
        """End all workers at once."""
        for worker in (*self._idle, *self._busy):
            worker.kill()

    def evaluate(self, request: Request) -> Evaluation:
        """Evaluate a request, as :func:`optim.runs.workers.open_workers` describes."""
        batch = Batch(request, max(1, min(self.size, -(-len(request.points) // self.count))))
        try:
            while not batch.complete:
                self._bury_idle()
                self.fill()
                while self._idle and (taken := batch.take()):
                    worker = self._idle.pop(0)
                    self._busy[worker] = taken[0]
                    worker.submit(taken[1])
                for worker in self.backend.ready(list(self._busy), wait=True):
                    self._hear(worker, batch)
        except BaseException:
            for worker in [worker for worker, part in self._busy.items() if part is not None]:
                worker.kill()  # nobody waits for its answer any more
                del self._busy[worker]
            raise
        return batch.joined(self._save(batch.killers, len(request.points)))

    def _bury_idle(self) -> None:
        for worker in self.backend.ready(self._idle, wait=False):  # no answer is pending, so they must be dead
            self._idle.remove(worker)
            worker.kill()
            self.note("a worker died while it was idle; it is replaced")

    def _hear(self, worker: W, batch: Batch) -> None:
        """Receive the answer of a worker.

        Raises:
            Exception: that the problem raised in the worker; KeyboardInterrupt as well.
        """
        part = self._busy.pop(worker)
        try:
            answer = worker.answer()
            if part is None and isinstance(answer, Raised):
                raise answer.error
        except Died as death:
            worker.kill()
            self._mourn(part, death, batch)
            return
        except BaseException:
            worker.kill()
            raise
        self._idle.append(worker)
        if isinstance(answer, Raised):
            raise answer.error
        if part is None:
            self._start_deaths = 0
        elif answer is not None:
            self._known = answer
            batch.put(part, answer)
            if self.progress:
                self.progress(batch.fraction)

    def _mourn(self, part: Part | None, death: Died, batch: Batch) -> None:
        if part is not None:
            self.note(f"a worker died ({death}) with {part} of a generation: {batch.bury(part)}")
            return
        self._start_deaths += 1
        if self._start_deaths == STARTS:
            self._start_deaths = 0
            raise RuntimeError(f"workers: {STARTS} died one after the other before they were ready ({death})")
        self.note(f"a worker died ({death}) before it was ready; another one is started")

    def _save(self, killers: Floats, count: int) -> Evaluation:
        """Save points that killed their workers; return the last evaluation, as a pattern for details.

        Raises:
            RuntimeError: if nothing has ever been evaluated.
        """
        path = self.save_failed(killers, KILLER) if len(killers) else None
        if self._known is None:
            raise RuntimeError(
                f"workers: every design killed its worker twice, so the fault is hardly theirs; see {path}"
            )
        if path:
            self.note(f"{len(killers)} of {count} designs killed their workers and failed; saved in {path}")
        return self._known
