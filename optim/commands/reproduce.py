"""``morpholab reproduce``: studies of the dissertation, and what goes beyond them."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, interrupted
from optim.commands import options as arguments
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
        help="to see that it works (default); an hour to a few, of some studies; or all that was published, which may "
        "take days: the list says how long",
    )
    parser.add_argument(
        "--sweep", type=Path, metavar="DIR", help="folder of a sweep, of studies that read bodies from one"
    )
    parser.add_argument(
        "--jobs",
        type=arguments.whole(1),
        metavar="N",
        help="runs that go on at the same time, of studies of many runs (default: one after the other)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Do a study, or list all."""
    from optim.studies.catalogue import STUDIES

    if args.study is None:
        for name in ("out", "sweep", "jobs"):
            if getattr(args, name) is not None:
                raise ValueError(f"{name}: {getattr(args, name)} is not allowed without a study; name one first")
        studies = {name: STUDIES[name] for name in STUDIES}
        items = {name: {"source": s.source, "title": s.title, "cost": s.cost} for name, s in studies.items()}
        lines = [f"{name}: {s.title} ({s.source}{s.cost and f'; full: {s.cost}'})" for name, s in studies.items()]
        return Report(items, "\n".join(lines))
    study = STUDIES.find(args.study)
    if args.out is None:
        raise ValueError("out: none given; name a folder for the results")
    given = {"sweep_folder": args.sweep, "jobs": args.jobs}
    options = {name: value for name, value in given.items() if value is not None}
    for name in options.keys() - study.options:
        if name == "jobs":
            able = ", ".join(name for name in STUDIES if "jobs" in STUDIES[name].options)
            raise ValueError(f"jobs: {args.jobs} is not allowed with study {args.study}; {able} take them")
        raise ValueError(f"sweep: study {args.study} reads none; leave it out")
    try:
        with shown_progress(args.study, 1.0, args.quiet) as update:
            study.reproduce(args.out, args.budget, update, **options)
    except KeyboardInterrupt as interrupt:
        return interrupted(args.out, interrupt)
    document = {"folder": str(args.out), "study": args.study, "budget": args.budget, "files": list(study.writes)}
    return Report(document, f"{args.out}: {', '.join(study.writes)}")
