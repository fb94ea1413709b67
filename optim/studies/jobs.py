"""Parts of a study beside each other, each in a process of its own.

A part leaves its results in the study's folder, where the study finds them: whatever ends a process, the same command
goes on.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection as connections
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from optim.runs.workers.processes import how_it_ended, start_process
from optim.runs.workers.service import Raised, thread_environment
from optim.studies.results import Progress
from robots.checks import whole_number

Task = Callable[[Callable[[float], None]], object]  # called with what is told its progress
Message = float | Raised | None  # the fraction done; what a task raised; it is done


@dataclass(frozen=True, eq=False)
class _Job:
    """A task at work.

    Attributes:
        name: of the task.
        number: among all tasks.
        process: that does it.
    """

    name: str
    number: int
    process: SpawnProcess


def beside(
    tasks: Sequence[tuple[str, Callable[[Mapping[str, Any], Progress], object]]],
    jobs: int,
    where: Mapping[str, Any],
    progress: Progress,
) -> None:
    """Do parts of a study in several processes, before the study gathers what they leave; nothing for one job.

    Args:
        tasks: names, and what does each, see :func:`in_jobs`; they also take ``where``.
        jobs: how many at a time.
        where: options of simulations; without ``threads``, each process has its part of the machine's.
        progress: see there.

    Raises:
        ValueError: in one line, for no job.
    """
    whole_number("jobs", jobs, 1)
    if jobs > 1:
        shared = {"threads": _threads(jobs), **where}
        in_jobs([(name, partial(task, shared)) for name, task in tasks], jobs, progress)


def in_jobs(tasks: Sequence[tuple[str, Task]], count: int, progress: Progress = None) -> None:
    """Do tasks, so many at a time, in their order.

    Args:
        tasks: names, and what does each; it can be pickled, and its result is left where it writes it.
        count: of processes; they share the machine's cores evenly.
        progress: called with the fraction done of all.

    Raises:
        RuntimeError: in one line, if a process was killed.
        Exception: what a task raised. In either case, and after Ctrl-C, the other processes end at once.
    """
    environment = thread_environment(_threads(count))
    waiting, done = list(enumerate(tasks)), [0.0] * len(tasks)
    running: dict[Connection[None, Message], _Job] = {}
    try:
        while waiting or running:
            while waiting and len(running) < count:
                number, (name, task) = waiting.pop(0)
                process, pipe = start_process(partial(_work, task), environment)
                running[pipe] = _Job(name, number, process)
            for ready in connections.wait(list(running)):
                pipe = next(one for one in running if one is ready)
                message = _receive(pipe, running[pipe])
                done[running[pipe].number] = 1.0 if message is None else message
                if message is None:
                    _end(pipe, running.pop(pipe))
                if progress:
                    progress(sum(done) / len(done))
    finally:
        for pipe, job in running.items():
            job.process.kill()
            _end(pipe, job)


def _threads(count: int) -> int:
    """Of each of so many processes."""
    return max(1, (os.cpu_count() or 1) // count)


def _receive(pipe: "Connection[None, Message]", job: _Job) -> float | None:
    """What a job says next; raises what it raised."""
    try:
        message = pipe.recv()
    except (EOFError, ConnectionError):
        raise RuntimeError(f"{job.name}: its process ended ({how_it_ended(job.process)})") from None
    if isinstance(message, Raised):
        raise message.error
    return message


def _end(pipe: "Connection[None, Message]", job: _Job) -> None:
    """Leave no zombie."""
    job.process.join()
    pipe.close()


def _work(task: Task, pipe: "Connection[Message, None]") -> None:
    """The life of a process."""
    try:
        task(pipe.send)
    except Exception as error:
        pipe.send(Raised(error))
    else:
        pipe.send(None)
