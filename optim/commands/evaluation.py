"""Where a search's points are evaluated: here, in worker processes, on a Ray cluster, or by workers around a folder."""

import argparse
import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from optim.commands.options import Option, flag, number, path_to, whole
from optim.notes import note
from taichi_sim.base.compute import available_threads

if TYPE_CHECKING:
    from optim.problem import Evaluate, Evaluation, Problem, Request
    from optim.runs import RunFolder

AnyProblem = TypeVar("AnyProblem", bound="Problem")
MOST_WORKERS = 10_000
WORKERS = (
    Option(
        "workers",
        "processes that evaluate (default: this one, with all threads; on Ray as many as the cluster has cores; of "
        "--workers-dir and --slurm 16 are expected)",
        whole(1, MOST_WORKERS),
        "N",
    ),
    Option(
        "ray", "evaluate on a Ray cluster: HOST:PORT, auto, or local for one that is started here", metavar="ADDRESS"
    ),
    path_to(
        "workers_dir",
        "DIR",
        "evaluate by any workers that run `morpholab work DIR` on this or other machines that share the folder",
    ),
    Option(
        "silent_after",
        "give the part of a worker of --workers-dir to others after so long without a sign of life (default: 120)",
        number(0.1, unit="seconds"),
        "SECONDS",
    ),
    flag("slurm", "submit an array job of such workers with sbatch (default of --workers-dir: OUT.workers)"),
    Option(
        "slurm_option", 'of sbatch, as in --slurm-option="--partition=x"; may be repeated', str, "OPTION", several=True
    ),
)
# Points of a worker's part, for each of its threads: as many vehicles or rigid robots as fill a vector on a CPU. A
# lattice robot fills vectors with its own voxels; for those it is just few points, so that no worker waits long.
POINTS_PER_THREAD = {"f32": 16, "f64": 8}


@contextlib.contextmanager
def opened_workers(problem: "Problem", folder: "RunFolder", args: argparse.Namespace) -> Iterator["Evaluate | None"]:
    """What evaluates the points of a generation; None for this process itself."""
    if args.workers is None and args.ray is None and args.workers_dir is None:
        yield None
        return
    from optim.runs.products import save_failed
    from optim.runs.workers import SILENCE, BackendName, open_workers

    cores = available_threads()
    count = args.workers
    backend: BackendName = "ray" if args.ray is not None else "folder" if args.workers_dir is not None else "processes"
    threads = args.threads or (max(1, cores // count) if backend == "processes" else 1)
    if backend != "folder" and args.ray in (None, "local") and count and count * threads > cores:
        note(f"{count} workers need {count * threads} threads, of {cores} cores; fewer would be as fast")
    with open_workers(
        with_options(problem, threads=threads, progress=None),
        count=count,
        backend=backend,
        address=args.ray if args.workers_dir is None else str(args.workers_dir),
        threads=threads,
        part=POINTS_PER_THREAD[getattr(problem, "precision", "f32")] * threads,
        silence=SILENCE if args.silent_after is None else args.silent_after,
        save_failed=lambda points, reason: save_failed(folder, problem.space, points, reason),
        note=note,
        progress=getattr(problem, "progress", None),
    ) as evaluate:
        if args.workers_dir is not None:
            args.held.enter_context(_ending(args.workers_dir))  # as the command ends, which may search several times
        yield evaluate if args.summon is None else _once_summoned(evaluate, args.summon)


def settle_workers(args: argparse.Namespace) -> None:
    """Check what the options say of a folder of workers; make ``args.summon`` what submits a job when first needed.

    Raises:
        ValueError: for options that do not fit each other.
    """
    from optim.runs.workers.folder_files import EXPECTED
    from optim.runs.workers.slurm import check_options, submit_workers

    args.summon = None
    if args.slurm and args.workers_dir is None:
        args.workers_dir = args.out.with_name(f"{args.out.name}.workers")
    if args.workers_dir is None:
        for name in ("silent_after", "slurm_option"):
            if getattr(args, name) is not None:
                needed = "--slurm" if name == "slurm_option" else "--workers-dir"
                raise ValueError(f"{name.replace('_', '-')}: it belongs to {needed}; give that, too, or leave it out")
        return
    if args.ray is not None:
        raise ValueError("ray: it is not allowed with a folder of workers; give one of them")
    if args.workers_dir.exists() and not args.workers_dir.is_dir():
        raise ValueError(f"workers-dir: {args.workers_dir} is a file; name a folder")
    shared, out = args.workers_dir.resolve(), args.out.resolve()
    if shared.is_relative_to(out):
        raise ValueError(f"workers-dir: {args.workers_dir} is not allowed with --out {args.out}; name one beside it")
    given = tuple(args.slurm_option or ())
    check_options(given)
    if given and not args.slurm:
        raise ValueError("slurm-option: it belongs to --slurm; give that, too, or leave it out")
    if args.slurm:
        tasks = args.workers or EXPECTED
        args.summon = functools.cache(lambda: note(submit_workers(args.workers_dir, tasks, given, args.problem)))


def _once_summoned(evaluate: "Evaluate", summon: Callable[[], None]) -> "Evaluate":
    """The function, with workers summoned before its first call: a run that is complete needs none."""

    def summoned(request: "Request") -> "Evaluation":
        summon()
        return evaluate(request)

    return summoned


@contextlib.contextmanager
def _ending(folder: Path) -> Iterator[None]:
    """Tell the workers of a folder, at the end, that it has come.

    If that fails, it is only noted: the search has its result, or a failure of its own.
    """
    from optim.runs.workers.folder_files import end_workers

    try:
        yield
    finally:
        try:
            end_workers(folder)
        except (ValueError, RuntimeError) as error:
            note(f"workers-dir: {error}; the workers wait on, end them yourself")


def with_options(problem: "AnyProblem", **options: object) -> "AnyProblem":
    """The problem with those of some options that it has, such as ``threads`` and ``progress``."""
    if not dataclasses.is_dataclass(problem):
        return problem
    known = {field.name for field in dataclasses.fields(problem)}
    return dataclasses.replace(problem, **{name: value for name, value in options.items() if name in known})
