"""``morpholab reproduce``: studies of the dissertation, and what goes beyond them."""

import argparse
from typing import TYPE_CHECKING, Any

from optim.commands import Report, goes_on
from optim.commands.options import QUIET, Command, Option, count, path_to, setting
from optim.progress import shown_progress
from taichi_sim.base.claims import claimed_folder, undone_if_it_fails
from taichi_sim.base.files import ASIDE
from taichi_sim.base.options import flag_of, numbers

if TYPE_CHECKING:
    from optim.experiments.study import Study

OF_RUNS = ("budget", "sweep", "jobs", "floor", "friction", "set")  # options that say how a study is run

COMMAND = Command(
    "reproduce",
    "repeat studies of the dissertation",
    "Repeat a study of the dissertation, or one that goes beyond it: tables, numbers and figures. Without a name, list "
    "them. The same command goes on where an earlier one was.",
    (
        Option("study", "its name", metavar="STUDY", words="?"),
        path_to("out", "DIR", "folder of the results"),
        Option(
            "budget",
            "to see that it works (default); an hour to a few, of some studies; or all that was published, which may "
            "take days: the list says how long",
            choices=("small", "medium", "full"),
        ),
        path_to(
            "from_data",
            "DIR",
            "run nothing: tables and figures again from data of the study, as docs/data of the source code has them",
        ),
        path_to("sweep", "DIR", "folder of a sweep, of studies that read bodies from one"),
        count("jobs", 1, "runs that go on at the same time, of studies of many runs (default: one after the other)"),
        Option(
            "floor",
            "of studies of gaits for real ground, such as robust-gaits: whose measured friction feet have",
            metavar="wood|acrylic",
        ),
        Option("friction", "of them, of sliding and of gripping feet", numbers(2), "SLIDING,GRIPPING"),
        Option(
            "set",
            "another setting of the study, as JSON or text, such as slopes=[0,9] or robot.copies=4; a wrong name lists "
            "all; repeatable",
            metavar="NAME=VALUE",
            several=True,
        ),
        QUIET,
    ),
)


@goes_on
def run(args: argparse.Namespace) -> Report:
    """Do a study, or list all."""
    from optim.studies.catalogue import STUDIES

    if args.study is None:
        for name in ("out", *OF_RUNS, "from_data"):
            if getattr(args, name) is not None:
                flag = flag_of(name).removeprefix("--")
                raise ValueError(f"{flag}: {getattr(args, name)} is not allowed without a study; name one first")
        studies = dict(STUDIES.usable())
        items = {name: {"source": s.source, "title": s.title, "cost": s.cost} for name, s in studies.items()}
        lines = [f"{name}: {s.title} ({s.source}{s.cost and f'; full: {s.cost}'})" for name, s in studies.items()]
        return Report(items, "\n".join(lines))
    study = STUDIES.find(args.study)
    if args.out is None:
        raise ValueError("out: none given; name a folder for the results")
    if args.from_data is not None:
        return _told_again(args, study)
    given = {"sweep_folder": args.sweep, "jobs": args.jobs}
    options = {name: value for name, value in given.items() if value is not None}
    for name in options.keys() - study.options:
        if name == "jobs":
            able = ", ".join(name for name, one in STUDIES.usable() if "jobs" in one.options)
            raise ValueError(f"jobs: {args.jobs} is not allowed with study {args.study}; {able} take them")
        raise ValueError(f"sweep: study {args.study} reads none; leave it out")
    if (friction := _friction(args)) is not None:
        if not study.has_ground:
            name = "friction" if args.floor is None else "floor"
            raise ValueError(f"{name}: study {args.study} has its own; leave it out")
        options["friction"] = friction
    if args.set:
        options["changes"] = _changes(args)
    budget = args.budget or "small"
    with shown_progress(args.study, 1.0, args.quiet) as update:
        study.reproduce(args.out, budget, update, **options)
    document = {"folder": str(args.out), "study": args.study, "budget": budget, "files": list(study.writes)}
    return Report(document, f"{args.out}: {', '.join(study.writes)}")


def _told_again(args: argparse.Namespace, study: "Study") -> Report:
    """Make what a study writes from data of it, in a new folder."""
    from optim.experiments.data import found
    from optim.studies.catalogue import STUDIES

    for name in OF_RUNS:
        if getattr(args, name) is not None:
            raise ValueError(f"{name}: {getattr(args, name)} is not allowed with --from-data, which runs nothing")
    if study.rewrite is None:
        able = ", ".join(name for name, one in STUDIES.usable() if one.rewrite is not None)
        raise ValueError(f"from-data: study {args.study} is not told from tables; {able} are")
    data = found(args.from_data, args.study)
    with claimed_folder("out", args.out), undone_if_it_fails() as made:
        try:
            study.rewrite(data, args.out)
        except BaseException:
            made += [path for path in args.out.iterdir() if not path.name.startswith(ASIDE)]
            raise
        there = (path for path in args.out.rglob("*") if path.is_file() and not path.name.startswith(ASIDE))
        files = sorted(path.relative_to(args.out).as_posix() for path in there)
    document = {"folder": str(args.out), "study": args.study, "data": str(data.folder), "files": files}
    return Report(document, f"{args.out}: {', '.join(files)}")


def _changes(args: argparse.Namespace) -> dict[str, Any]:
    """Other values of settings by name, each given once, and the floor in one way."""
    given = [setting(text) for text in args.set]
    for number, (name, _) in enumerate(given):
        if name in dict(given[:number]):
            raise ValueError(f"set: {name} is given twice; leave one out")
        if name in ("floor", "friction") and (args.floor is not None or args.friction is not None):
            raise ValueError(f"set: {name} is not allowed beside --floor and --friction; leave it out")
    return dict(given)


def _friction(args: argparse.Namespace) -> tuple[float, float] | None:
    """Friction of sliding and of gripping feet, from ``--floor`` or ``--friction``; None if neither is given."""
    from robots.inflatable.kind import friction_of_feet

    return friction_of_feet(vars(args))
