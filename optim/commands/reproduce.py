"""``morpholab reproduce``: studies of the dissertation, and what goes beyond them."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, interrupted, options
from optim.progress import shown_progress


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "reproduce",
        help="repeat studies of the dissertation",
        description="Repeat a study of the dissertation, or one that goes beyond it: tables, numbers and figures. "
        "Without a name, list them. The same command goes on where an earlier one was.",
    )
    parser.add_argument("study", nargs="?", metavar="STUDY", help="its name")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results")
    parser.add_argument(
        "--budget",
        choices=("small", "medium", "full"),
        default="small",
        help="to see that it works (default); an hour to a few, of studies of the soft robot that take days; or all",
    )
    parser.add_argument(
        "--sweep", type=Path, metavar="DIR", help="folder of a sweep, of studies that read bodies from one"
    )
    parser.add_argument(
        "--jobs",
        type=options.whole(1),
        metavar="N",
        help="runs that go on at the same time, of studies of many runs (default: one after the other)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Do a study, or list all."""
    from optim.hints import nearest
    from optim.studies.catalogue import CATALOGUE

    if args.study is None:
        for name in ("out", "sweep", "jobs"):
            if getattr(args, name) is not None:
                raise ValueError(f"{name}: {getattr(args, name)} is not allowed without a study; name one first")
        items = {name: {"source": item.source, "title": item.title} for name, item in CATALOGUE.items()}
        return Report(items, "\n".join(f"{name}: {item.title} ({item.source})" for name, item in CATALOGUE.items()))
    if args.study not in CATALOGUE:
        known = ", ".join(CATALOGUE)
        raise ValueError(f"study: {args.study!r} is unknown; choose one of {known}{nearest(args.study, CATALOGUE)}")
    item = CATALOGUE[args.study]
    if args.out is None:
        raise ValueError("out: none given; name a folder for the results")
    if args.sweep is not None and not item.sweep:
        raise ValueError(f"sweep: study {args.study} reads none; leave it out")
    if args.jobs is not None and not item.jobs:
        able = ", ".join(name for name, one in CATALOGUE.items() if one.jobs)
        raise ValueError(f"jobs: {args.jobs} is not allowed with study {args.study}; {able} take them")
    given = {"sweep_folder": args.sweep} if args.sweep else {}
    given |= {"jobs": args.jobs} if args.jobs else {}
    try:
        with shown_progress(args.study, 1.0, args.quiet) as update:
            item.run(args.out, args.budget, update, **given)
    except KeyboardInterrupt as interrupt:
        return interrupted(args.out, interrupt)
    document = {"folder": str(args.out), "study": args.study, "budget": args.budget, "files": list(item.writes)}
    return Report(document, f"{args.out}: {', '.join(item.writes)}")
