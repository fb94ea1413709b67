"""A pool of workers, in processes or on a cluster, that judges the parts of a request."""

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
    """A worker is gone; the message says how, as in "killed by SIGKILL"."""


class Worker(Protocol):
    """Owes an answer from its start on: None once it is ready, then one for every request."""

    def submit(self, request: Request) -> None:
        """Hand over a request; the worker must owe nothing. That it is dead shows in its answer."""

    def answer(self) -> Answer:
        """What it has to say, if :meth:`Backend.ready` named it; raises ``Died``."""

    def kill(self) -> None:
        """End it at once, whatever it does."""


W = TypeVar("W", bound=Worker)


class Backend(Protocol[W]):
    """Where workers come from."""

    @property
    def cores(self) -> int:
        """CPU cores there."""

    def start(self) -> W:
        """Start a worker, without waiting until it is ready."""

    def ready(self, workers: Sequence[W], wait: bool) -> Sequence[W]:
        """Those of the workers that have an answer, or are dead; waits for at least one if told to."""


class Pool(Generic[W]):
    """Workers of one backend, replaced as they die.

    Args:
        backend: where they come from.
        count: how many.
        size: points that one judges at once, at most.
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
        self._known: Evaluation | None = None  # the last judgement of any part

    def fill(self) -> None:
        """Start workers where some are missing."""
        while len(self._starting) + len(self._idle) + len(self._busy) < self._count:
            self._starting.append(self._backend.start())

    def close(self) -> None:
        """End all workers at once."""
        for worker in (*self._starting, *self._idle, *self._busy):
            worker.kill()

    def evaluate(self, request: Request) -> Evaluation:
        """The judgement of a request; see :func:`optim.runs.workers.open_workers`."""
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
        """Take in what a worker has to say.

        Raises:
            Exception: what the problem raised there.
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
        """Save what killed its workers; a judgement of other points, of this request or one before.

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
