"""Workers that evaluate the requests of a search: processes of this machine, Ray actors, or through a shared folder."""

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
SILENCE = 120.0  # s; a network disk may show a sign of life a minute late


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
    """Start workers, and yield a function that evaluates requests with them.

    Results are bit-identical to those of this process for any number and location of workers.

    A request is cut into parts, which go to idle workers. A worker that dies is replaced, and its part is evaluated
    again; a part that kills two workers is bisected, down to single designs, which fail. An exception raised by the
    problem is raised here unchanged. When the context ends, for whatever reason, all workers end at once.

    Args:
        problem: sent to every worker once, pickled; through a folder, only its description.
        count: number of workers; None for as many as the cores of this machine or the cluster allow. For a folder,
            the number of workers to expect, for which requests are cut.
        backend: ``"processes"``: spawned on this machine; ``"ray"``: actors on a cluster; ``"folder"``: any process
            that runs ``morpholab work`` on the folder.
        address: address of the Ray cluster, ``"host:port"``, ``"ray://host:port"`` or ``"auto"``; None or ``"local"``
            starts one on this machine while the context lasts. For ``"folder"``, the path of the folder.
        threads: CPU threads of one worker.
        part: maximum number of points that a worker evaluates at once.
        silence: time without a sign of life after which the part of a folder's worker is given to others [s].
        save_failed: saves points, shape (F, D), that killed their workers, with the reason; returns the file.
        note: called with a line about every death and anything else that the user should know.
        progress: called with the fraction of a request that is complete.

    Yields:
        A function that evaluates a request. It raises RuntimeError if no worker can be started, or if every design
        of a request kills its worker and none was ever evaluated, so that the designs are hardly the cause.

    Raises:
        ValueError: if a setting is not allowed, the problem cannot be pickled, or the cluster does not answer or has
            other versions of packages on which results depend.
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
