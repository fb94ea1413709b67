"""``morpholab work``: evaluate for a search that shares a folder with this machine."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import Report
from optim.commands.evaluation import with_options
from optim.commands.options import QUIET, THREADS, Command, Option, number, path_to
from optim.notes import note
from optim.problem import FILE
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from optim.problem import Problem
    from optim.runs.workers.folder_files import Offer

COMMAND = Command(
    "work",
    "evaluate for a search elsewhere",
    "Evaluate parts of a search that was started with `codesign --workers-dir DIR`, on any machine that shares the "
    "folder, until the search ends. Any number of workers may come and go at any time; results are the same bits.",
    (
        path_to("folder", "DIR", "folder that the search was given", words="1"),
        path_to("problem", "FILE", "of a search of --problem FILE: the same file; its code is never in the folder"),
        Option(
            "idle",
            "end after so long without a sign of a search (default: 600)",
            number(0.0, unit="seconds"),
            "SECONDS",
        ),
        THREADS,
        QUIET,
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Work until the search ends."""
    from optim.runs.workers.folder_files import BEATS, make_folders
    from optim.runs.workers.folder_worker import IDLE, FolderWorker, ProcessEvaluator, RequestEvaluator
    from taichi_sim.base.compute import available_threads
    from taichi_sim.base.files import check_parent

    if args.folder.exists() and not args.folder.is_dir():
        raise ValueError(f"folder: {args.folder} is a file; give the folder of codesign --workers-dir")
    check_parent("folder", args.folder)
    if not args.folder.exists() and not args.quiet:
        note(f"{args.folder} is new; waiting for a search that is given it")
    make_folders(args.folder)
    threads = args.threads or available_threads()

    def build(offer: "Offer") -> RequestEvaluator:
        _check_machine(offer, args.quiet)
        problem = with_options(_problem_of(offer, args.problem, args.folder), threads=threads)
        return ProcessEvaluator(problem, threads, offer.silence / BEATS)

    worker = FolderWorker(args.folder, build, IDLE if args.idle is None else args.idle)
    why = worker.serve()
    document = {"folder": str(args.folder), "worker": worker.name, "parts": worker.parts, "ended": why}
    return Report(document, f"{counted(worker.parts, 'part')} evaluated; {why}")


def _check_machine(offer: "Offer", quiet: bool) -> None:
    """Refuse other versions than the search has, and tell of another processor.

    Raises:
        ValueError: for other versions.
    """
    from optim.runs.environment import cpu_model, other_version, versions
    from optim.runs.plug_ins import packages_of

    if other := other_version(versions(packages_of(offer.problem)), offer.versions):
        name, here, there = other
        raise ValueError(f"work: this machine has {name} {here}, the search {there}; install the same here")
    if offer.processor != cpu_model() and not quiet:
        note(
            f"this machine has another CPU ({cpu_model()}) than the search ({offer.processor}); results may differ in "
            "their last bits"
        )


def _problem_of(offer: "Offer", file: Path | None, folder: Path) -> "Problem":
    """The problem that a search has described, or that of its file.

    Raises:
        ValueError: if it is unknown here, or the file is not the one.
    """
    from optim.problems import problem_of_run
    from optim.problems.user_file import check_file, load_problem
    from optim.runs.config import GROUND_FILES, check_ground_files

    if offer.problem.get("kind") != FILE:
        if file is not None:
            raise ValueError("problem: the search is of no file; leave --problem out")
        config = {"problem": offer.problem, GROUND_FILES: offer.ground_files}
        problem = problem_of_run(folder, config)
        check_ground_files(config, getattr(problem, GROUND_FILES, {}), folder)
        return problem
    if file is None:
        raise ValueError(f"problem: the search needs its file here, too; give --problem {offer.problem.get('file')}")
    problem = load_problem(file)
    check_file(problem, offer.problem, folder)
    return problem
