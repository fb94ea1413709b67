"""Worker of a shared folder: claims parts of a search, evaluates them in a child process, and writes the answers."""

import os
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from optim.problem import Evaluation, Problem, Request
from optim.runs.workers import folder_files as protocol
from optim.runs.workers.folder_files import Gone, Offer, Told, Unread
from optim.runs.workers.pool import STARTS, Died
from optim.runs.workers.processes import Processes, ProcessWorker
from optim.runs.workers.service import Raised
from taichi_sim.base.files import LARGEST_UNPACKED, content_of, write_bytes

IDLE = 600.0  # s without a sign of a search after which a worker ends


class Ended(Exception):
    """Raised inside a worker when the search has ended while it works."""


class RequestEvaluator(Protocol):
    """Evaluates requests for a worker."""

    def evaluate(self, request: Request, beat: Callable[[], None]) -> Evaluation | Raised | Gone:
        """Evaluate a request; meanwhile call ``beat``, which may raise ``Ended``, at intervals."""

    def close(self) -> None:
        """End at once every process that was started."""


class ProcessEvaluator:
    """Evaluates in a child process, so that signs of life continue meanwhile and its death can be reported.

    Args:
        problem: problem that the process evaluates.
        threads: number of threads of its libraries.
        rest: time between two signs of life [s].
    """

    def __init__(self, problem: Problem, threads: int, rest: float) -> None:
        self._source, self._rest = Processes(problem, threads), rest
        self._process: ProcessWorker | None = None

    def evaluate(self, request: Request, beat: Callable[[], None]) -> Evaluation | Raised | Gone:
        """Evaluate a request in the process, which is started if there is none.

        Raises:
            RuntimeError: if it dies ``STARTS`` times before it is ready.
        """
        if self._process and self._process.connection.poll(0):  # no answer is pending, so it must be dead
            self.close()
        process = self._process or self._started(beat)
        if isinstance(process, Raised):
            return process
        process.submit(request)
        answer = self._answer(process, beat)
        return Gone("it gave no answer") if answer is None else answer

    def close(self) -> None:
        """Kill the process."""
        if self._process:
            self._process.kill()
            self._process = None

    def _started(self, beat: Callable[[], None]) -> ProcessWorker | Raised:
        for _ in range(STARTS):
            process = self._process = self._source.start()
            answer = self._answer(process, beat)
            if answer is None:
                return process
            if isinstance(answer, Raised):
                self.close()
                return answer
        raise RuntimeError(f"workers: {STARTS} processes died one after the other before they were ready ({answer})")

    def _answer(self, process: ProcessWorker, beat: Callable[[], None]) -> Evaluation | Raised | Gone | None:
        while not process.connection.poll(self._rest):
            beat()
        try:
            return process.answer()
        except Died as death:
            self.close()
            return Gone(str(death))


def worker_name() -> str:
    """Unique name of a worker of this process, made of host name, process id and time."""
    return f"{socket.gethostname()}-{os.getpid()}-{time.time_ns() % 10**9:09d}"


@dataclass(eq=False)
class FolderWorker:
    """Works on the parts in a folder until the search has ended or has been silent for long.

    Attributes:
        folder: the folder.
        build: makes the evaluator for an offer; raises ValueError if this machine cannot evaluate it.
        idle: time without a part, and without a sign of a search, after which the worker ends [s].
        name: name of the worker.
        parts: number of parts answered.
    """

    folder: Path
    build: Callable[[Offer], RequestEvaluator]
    idle: float = IDLE
    name: str = field(default_factory=worker_name)
    parts: int = 0
    _offer: Offer | None = None
    _evaluator: RequestEvaluator | None = None
    _sign: int = 0  # modification time of the offer, which is the search's sign of life [ns]
    _heard: float = field(default_factory=time.monotonic)

    def serve(self) -> str:
        """Work until the end; return the reason for ending.

        Raises:
            ValueError: if this machine cannot evaluate the search.
            RuntimeError: if the disk is full or broken, or no process can be started.
        """
        since = time.monotonic()
        try:
            while not self._ended():
                if self._listen():
                    return f"there was no sign of a search for {self.idle:g} s"
                if self._offer is None and self._sign:
                    self._load()
                if self._evaluator is not None and (claimed := protocol.claim_any(self.folder, self.name)):
                    self._work(*claimed)
                    since = self._heard = time.monotonic()
                else:
                    protocol.nap(time.monotonic() - since)
        except Ended:
            pass
        finally:
            self._close()
        return "the search has ended"

    def _work(self, part: str, claim: Path) -> None:
        """Answer a claimed part; on any error here it becomes open again for other workers."""
        try:
            told = self._evaluate(claim)
            try:
                content = protocol.packed_answer(part, self.name, told)
            except ValueError as error:
                content = protocol.packed_answer(part, self.name, Raised(error))
            write_bytes(protocol.part_path(self.folder, protocol.DONE, part), content)
        except BaseException:
            protocol.give_back(self.folder, claim)
            raise
        claim.unlink(missing_ok=True)
        self.parts += 1

    def _evaluate(self, claim: Path) -> Told:
        try:
            search, request = protocol.unpacked_request(content_of(claim, LARGEST_UNPACKED))
        except (OSError, ValueError) as error:
            return Unread(str(error))
        if self._offer is None or search != self._offer.digest:
            self._load()
        if self._evaluator is None or self._offer is None or search != self._offer.digest:
            return Unread("it is of another search")

        def beat() -> None:
            if self._ended():
                raise Ended
            protocol.touch(claim)  # if it was taken back, the first answer counts

        return self._evaluator.evaluate(request, beat)

    def _load(self) -> None:
        """Read the offer of the present search and make its evaluator."""
        self._close()
        self._offer = Offer.read(self.folder)
        self._evaluator = self.build(self._offer)

    def _close(self) -> None:
        if self._evaluator is not None:
            self._evaluator.close()
            self._evaluator = None

    def _ended(self) -> bool:
        return (self.folder / protocol.STOP).exists()

    def _listen(self) -> bool:
        """Check for signs of life of the search; return whether it has been silent for too long."""
        try:
            changed = (self.folder / protocol.SEARCH).stat().st_mtime_ns
        except FileNotFoundError:
            changed = 0
        now = time.monotonic()
        if changed != self._sign:
            self._sign, self._heard = changed, now
        return now - self._heard > self.idle
