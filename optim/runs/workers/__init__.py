"""Workers that evaluate the requests of a search: processes of this machine, on a Ray cluster, or around a folder."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, get_args

from optim.problem import Evaluate, Problem
from optim.runs.workers.pool import Backend, Pool
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

__all__ = ["open_workers"]

BackendName = Literal["processes", "ray", "folder"]
SILENCE = 120.0  # s; a network's disk may show a sign of life a minute late


@contextlib.contextmanager
def open_workers(
    problem: Problem,
    *,
    count: int | None,
    backend: BackendName = "processes",
    address: str | None = None,
    threads: int = 1,
    part: int = 16,
    silence: float = SILENCE,
    save_failed: Callable[[Floats, str], Path],
    note: Callable[[str], None],
    progress: Callable[[float], None] | None = None,
) -> Iterator[Evaluate]:
    """Start workers, and give a function that evaluates requests with them.

    Results have the same bits as those of this process, for any number and place of workers.

    A request is cut into parts, which go to idle workers. A worker that dies is replaced, and its part evaluated
    again; a part that kills two workers is bisected, down to single designs, which fail. An exception of the
    problem is raised here as itself. On leaving, whatever the reason, all workers end at once.

    Args:
        problem: sent to every worker once, by pickle; through a folder, as its description alone.
        count: number of workers; None for as many as this machine, or the cluster, has cores for. Of a folder, how
            many to expect: a request is cut for so many.
        backend: ``"processes"`` of this machine, spawned, ``"ray"``, actors on a cluster, or ``"folder"``, whoever runs
            ``morpholab work`` on it.
        address: address of the Ray cluster, ``"host:port"``, ``"ray://host:port"`` or ``"auto"``; None or ``"local"``
            starts one on this machine for as long as the workers are open. Or the folder.
        threads: CPU threads of one worker.
        part: most points that a worker evaluates at once.
        silence: time without a sign of life after which the part of a worker of a folder is given to others [s].
        save_failed: saves points, shape (F, D), that killed their workers, with the reason; returns the file.
        note: told about every death, and of whatever else the user should know.
        progress: called with the fraction of a request that is done.

    Yields:
        A function that evaluates a request. It raises RuntimeError if no worker can be started, or if
        every design of a request kills its worker and none was ever evaluated: then the designs are not to blame.

    Raises:
        ValueError: for settings that are not allowed, a problem that cannot be pickled, a cluster
            that does not answer, or one with other versions of what results depend on.
    """
    for name, value in {"count": 1 if count is None else count, "threads": threads, "part": part}.items():
        checks.integer(name, value, 1)
    checks.choice("backend", backend, get_args(BackendName))
    if address is not None and backend == "processes":
        raise ValueError(f"address: {address!r} is not allowed with {backend}; it belongs to ray or folder")
    if address is None and backend == "folder":
        raise ValueError("address: None is not allowed with folder; give the folder")
    checks.number("silence", silence, 0.0)
    with contextlib.ExitStack() as stack:
        source: Backend[Any]
        if backend == "processes":
            from optim.runs.workers.processes import Processes

            source = Processes(problem, threads)
        elif backend == "folder":
            from optim.runs.workers.shared_folder import open_shared_folder

            source = stack.enter_context(open_shared_folder(Path(str(address)), problem, silence, note))
        else:
            from optim.runs.workers.ray_cluster import open_cluster

            source = stack.enter_context(open_cluster(problem, count, threads, address, note))
        pool = Pool(source, count or max(1, source.cores // threads), part, save_failed, note, progress)
        stack.callback(pool.close)
        pool.fill()
        yield pool.evaluate
