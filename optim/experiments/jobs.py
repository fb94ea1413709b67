"""Run parts of a study in parallel, each in a process of its own.

A part leaves its results in the study's folder, where the study finds them. If a process ends early, the same command
continues.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection as connections
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from optim.experiments.results import Progress
from optim.runs.workers.processes import how_it_ended, start_process
from optim.runs.workers.service import Raised, portable, thread_environment
from taichi_sim.base import compute
from taichi_sim.base.checks import whole_number

Task = Callable[[Mapping[str, Any], Progress], object]  # called with options of simulations, and told its progress
LAST_WORK = 30.0  # s, for a process that is done: it keeps the kernels that it has compiled
Message = float | Raised | None  # the fraction done; what a task raised; it is done


@dataclass(frozen=True, eq=False)
class _Job:
    """A task that is running.

    Attributes:
        name: name of the task.
        number: place among all tasks.
        process: the process that does it.
    """

    name: str
    number: int
    process: SpawnProcess


def run_parallel(
    tasks: Sequence[tuple[str, Task]], jobs: int, where: Mapping[str, Any], progress: Progress = None
) -> None:
    """Do parts of a study in several processes, before the study gathers their results; one job does nothing here.

    Args:
        tasks: names and functions; each can be pickled, and leaves its result where the study looks for it.
        jobs: number of tasks at a time; they start in order.
        where: options of simulations; without ``threads``, each process has its part of the machine's.
        progress: called with the fraction done of all.

    Raises:
        ValueError: for fewer than one job.
        RuntimeError: if a process ended before its task did.
        Exception: that a task raised. In any case, and after Ctrl-C, the other processes end at once.
    """
    whole_number("jobs", jobs, 1)
    if jobs == 1:
        return
    threads = max(1, compute.available_threads() // max(1, min(jobs, len(tasks))))
    environment, shared = thread_environment(threads), {"threads": threads, **where}
    waiting, done = list(enumerate(tasks)), [0.0] * len(tasks)
    running: dict[Connection[None, Message], _Job] = {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                number, (name, task) = waiting.pop(0)
                process, pipe = start_process(partial(_work, task, shared), environment)
                running[pipe] = _Job(name, number, process)
            for pipe in (ready for ready in connections.wait(list(running)) if isinstance(ready, Connection)):
                message = _receive(pipe, running[pipe])
                done[running[pipe].number] = 1.0 if message is None else message
                if message is None:
                    running[pipe].process.join(LAST_WORK)
                    _end(pipe, running.pop(pipe))
                if progress:
                    progress(sum(done) / len(done))
    finally:
        for pipe, job in running.items():
            _end(pipe, job)


def _receive(pipe: "Connection[None, Message]", job: _Job) -> float | None:
    """Read the next message of a job; raises what the job raised."""
    try:
        message = pipe.recv()
    except (EOFError, OSError):
        raise RuntimeError(f"{job.name}: its process ended ({how_it_ended(job.process)})") from None
    if isinstance(message, Raised):
        raise message.error
    return message


def _end(pipe: "Connection[None, Message]", job: _Job) -> None:
    """Kill a process if it still runs, and wait for its end so that no zombie is left."""
    job.process.kill()
    job.process.join()
    pipe.close()


def _work(task: Task, where: Mapping[str, Any], pipe: "Connection[Message, None]") -> None:
    """Do a task in a process and report to the parent."""
    try:
        task(where, pipe.send)
    except Exception as error:
        pipe.send(Raised(portable(error)))
    else:
        pipe.send(None)
