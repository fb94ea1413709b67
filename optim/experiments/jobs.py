"""Run parts of a study in parallel, each in a process of its own.

A part leaves its results in the study's folder, where the study finds them. If a process ends early, the same command
continues.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing import connection as connections
from multiprocessing.connection import Connection
from typing import Any

from optim.experiments.results import Progress
from optim.runs.workers.processes import ProcessWorker, how_it_ended, start_process
from optim.runs.workers.service import Raised, thread_environment
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import available_threads

Task = Callable[[Mapping[str, Any], Progress], object]  # called with options of simulations, and told its progress
LAST_WORK = 30.0  # s, for a process that is done: it keeps the kernels that it has compiled
Message = float | Raised | None  # the fraction done; what a task raised; it is done


def run_parallel(
    tasks: Sequence[tuple[str, Task]], jobs: int, compute: Mapping[str, Any], progress: Progress = None
) -> None:
    """Do parts of a study in several processes, before the study gathers their results; one job does nothing here.

    Args:
        tasks: names and functions that can be pickled, and leave their results where the study looks for them.
        compute: options of simulations; without ``threads``, each process has its part of the machine's.

    Raises:
        ValueError: for fewer than one job.
        RuntimeError: if a process ended before its task did.
        Exception: that a task raised, or KeyboardInterrupt. In any case the other processes end at once.
    """
    whole_number("jobs", jobs, 1)
    if jobs == 1:
        return
    threads = max(1, available_threads() // max(1, min(jobs, len(tasks))))
    environment, shared = thread_environment(threads), {"threads": threads, **compute}
    done = [0.0] * len(tasks)
    waiting, running = list(range(len(tasks))), dict[int, ProcessWorker]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                number = waiting.pop(0)
                task = partial(_work, tasks[number][1], shared)
                running[number] = ProcessWorker(*start_process(task, environment))
            ready = connections.wait([worker.connection for worker in running.values()])
            for number, worker in list(running.items()):
                if worker.connection in ready:
                    message = _receive(worker, tasks[number][0])
                    done[number] = 1.0 if message is None else message
                    if message is None:
                        worker.process.join(LAST_WORK)
                        running.pop(number).kill()
                    if progress:
                        progress(sum(done) / len(done))
    finally:
        for worker in running.values():
            worker.kill()


def _receive(worker: ProcessWorker, name: str) -> float | None:
    """Read the next message of a task; raises what the task raised."""
    try:
        message: Message = worker.connection.recv()
    except (EOFError, OSError):
        raise RuntimeError(f"{name}: its process ended ({how_it_ended(worker.process)})") from None
    if isinstance(message, Raised):
        raise message.error
    return message


def _work(task: Task, compute: Mapping[str, Any], pipe: "Connection[Message, None]") -> None:
    """Do a task in a process and report to the parent."""
    try:
        task(compute, pipe.send)
    except BaseException as raised:
        pipe.send(Raised.by_users_code(raised))
    else:
        pipe.send(None)
