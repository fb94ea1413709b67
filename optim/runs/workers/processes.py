"""Workers that are processes of this machine.

Each process has its own pipe, as ``ProcessPoolExecutor`` waits forever for the rest of an answer whose writer was
killed halfway and cannot end workers before they finish. A pipe with one writer ends with its process.
"""

import contextlib
import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import connection as connections
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from optim.notes import notes
from optim.problem import Problem, Request
from optim.runs.workers.pool import Died
from optim.runs.workers.service import Answer, Service, environment_set, pickled, thread_environment
from taichi_sim.base.compute import available_threads

_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of <linux/prctl.h>
_LAST_BREATH = 1.0  # seconds in which a process that has closed its pipe should end


@dataclass(frozen=True, eq=False)
class ProcessWorker:
    """A worker process, with this side's end of the pipe to it."""

    process: SpawnProcess
    connection: "Connection[Any, Any]"

    def submit(self, request: Request) -> None:
        """Write the request to the pipe."""
        with contextlib.suppress(ConnectionError):
            self.connection.send(request)

    def answer(self) -> Answer:
        """Read from the pipe."""
        try:
            return self.connection.recv()
        except (EOFError, ConnectionError):
            raise Died(how_it_ended(self.process)) from None

    def kill(self) -> None:
        """Kill the process (SIGKILL), and wait for its end so that no zombie is left."""
        self.process.kill()
        self.process.join()
        self.connection.close()


class Processes:
    """Starts worker processes, which end with this process at the latest.

    Args:
        problem: problem that they evaluate.
        threads: number of threads that a worker's libraries may use.
    """

    def __init__(self, problem: Problem, threads: int) -> None:
        self._pickled = pickled(problem, pickle.dumps)
        self._environment = thread_environment(threads)

    @property
    def cores(self) -> int:
        """CPU cores that this process may use."""
        return available_threads()

    def start(self) -> ProcessWorker:
        """Start a process and send it the problem."""
        process, ours = start_process(_serve, self._environment)
        with contextlib.suppress(ConnectionError):  # it died, which its answer will report
            ours.send_bytes(self._pickled)
        return ProcessWorker(process, ours)

    def ready(self, workers: Sequence[ProcessWorker], wait: bool) -> list[ProcessWorker]:
        """List the workers whose pipe has something to read, or has ended."""
        by_connection = {worker.connection: worker for worker in workers}
        found = connections.wait(list(by_connection), None if wait else 0.0)
        return [worker for connection, worker in by_connection.items() if connection in found]


def start_process(
    life: "Callable[[Connection[Any, Any]], None]", environment: Mapping[str, str]
) -> "tuple[SpawnProcess, Connection[Any, Any]]":
    """Start a process that ends with this one, ignores Ctrl-C, and writes to stderr only.

    Call it from a thread that outlives the process: Linux treats the end of the thread that started a process as the
    death of its parent.

    Args:
        life: function that the process runs, called with its end of the pipe; must be picklable.
        environment: variables that are set before it loads anything.

    Returns:
        The process, and this end of the pipe.
    """
    context = multiprocessing.get_context("spawn")
    resource_tracker.ensure_running()  # otherwise the first process starts it, which would unblock interrupts
    ours, theirs = context.Pipe()
    process = context.Process(target=_live, args=(life, theirs, os.getpid()), daemon=True)
    try:
        with environment_set(environment), _interrupts_held_back():
            process.start()
    except BaseException:  # Ctrl-C came meanwhile
        if process.pid is not None:
            process.kill()
            process.join()
        raise
    theirs.close()
    return process, ours


def how_it_ended(process: SpawnProcess) -> str:
    """Describe how a process that has closed its pipe ended."""
    process.join(_LAST_BREATH)
    if process.exitcode is not None and process.exitcode < 0:
        number = -process.exitcode
        named = number in {int(known) for known in signal.Signals}  # most real-time signals have no name
        return f"killed by {signal.Signals(number).name if named else f'signal {number}'}"
    return f"exit code {process.exitcode}"


def _live(life: "Callable[[Connection[Any, Any]], None]", connection: "Connection[Any, Any]", parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    _die_with(parent)
    os.dup2(2, 1)  # stdout is for the output of the parent
    with notes("worker"):
        life(connection)


def _serve(connection: "Connection[Answer, Request]") -> None:
    """Serve as a worker: receive the problem, then answer requests until the pipe ends."""
    service = Service()
    with contextlib.suppress(EOFError, ConnectionError):
        connection.send(service.load(connection.recv_bytes()))
        while True:
            connection.send(service.evaluate(connection.recv()))


def _die_with(parent: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:  # the parent had already ended
        os._exit(1)


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Delay Ctrl-C inside the context; a process started inside never receives it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
