"""Where a search's points are evaluated: in this process, in worker processes, or on a Ray cluster."""

import argparse
import contextlib
import dataclasses
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeVar

from optim.commands.options import Option, whole

if TYPE_CHECKING:
    from optim.problem import Evaluate, Problem
    from optim.runs import RunFolder

AnyProblem = TypeVar("AnyProblem", bound="Problem")
MOST_WORKERS = 10_000
WORKERS = (
    Option(
        "workers",
        "processes that evaluate (default: this one, with all threads; on Ray as many as the cluster has cores)",
        whole(1, MOST_WORKERS),
        "N",
    ),
    Option(
        "ray", "evaluate on a Ray cluster: HOST:PORT, auto, or local for one that is started here", metavar="ADDRESS"
    ),
)
LANES = {"f32": 16, "f64": 8}  # robots that a CPU thread simulates side by side, see docs/architecture.md


@contextlib.contextmanager
def opened_workers(problem: "Problem", folder: "RunFolder", args: argparse.Namespace) -> Iterator["Evaluate | None"]:
    """What evaluates the points of a generation; None for this process itself."""
    if args.workers is None and args.ray is None:
        yield None
        return
    from optim.runs.products import save_failed
    from optim.runs.workers import open_workers

    cores = os.cpu_count() or 1
    count = args.workers
    threads = args.threads or (max(1, cores // count) if args.ray is None else 1)
    if args.ray in (None, "local") and count and count * threads > cores:
        _note(f"note: {count} workers need {count * threads} threads, of {cores} cores; fewer would be as fast")
    with open_workers(
        with_options(problem, threads=threads, progress=None),
        count=count,
        backend="processes" if args.ray is None else "ray",
        address=args.ray,
        threads=threads,
        part=LANES[getattr(problem, "precision", "f32")] * threads,
        save_failed=lambda points, reason: save_failed(folder, problem.space, points, reason),
        note=_note,
        progress=getattr(problem, "progress", None),
    ) as evaluate:
        yield evaluate


def with_options(problem: "AnyProblem", **options: object) -> "AnyProblem":
    """The problem with those of some options that it has, such as ``threads`` and ``progress``."""
    if not dataclasses.is_dataclass(problem):
        return problem
    known = {field.name for field in dataclasses.fields(problem)}
    return dataclasses.replace(problem, **{name: value for name, value in options.items() if name in known})


def _note(text: str) -> None:
    print(text, file=sys.stderr)
