"""``morpholab simulate-all``: many robots, such as a folder of files, as a table."""

import argparse
import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import Report, goes_on, options
from optim.commands.options import QUIET, Command, Option, count, path_to, whole
from optim.commands.robots import Named, kinds_of_words, loaded, named_source, world_and_own
from optim.exit_codes import FAILED
from optim.notes import note
from optim.progress import shown_progress
from optim.runs.config import has_run, run_of_any_seed
from robots.robot import OK, Robot, World
from taichi_sim.base.checks import finite
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from optim.many import RobotTrials
    from optim.problems.many_robots import ManyRobots

TABLE = "scores.csv"
TOLD = 10  # of the best robots, for people
DOUBTS_TOLD = 3  # of those of all robots
COMMAND = Command(
    "simulate-all",
    "simulate many robots, such as a folder of files, and rank them",
    "Simulate many robots, which may differ in all, each as it starts in a search or was designed, and tell the best; "
    "with --out also as a table. The same command goes on where an earlier one was interrupted.",
    (
        Option(
            "sources",
            "a file of a robot or a design, a folder of such files (but of Python, which is code), the folder of a "
            "run, or a robot by name",
            metavar="ROBOT",
            words="+",
        ),
        path_to("out", "DIR", f"folder for {TABLE}, and for what it is made of"),
        Option("measure", "that ranks them, the highest first (default: the first robot's first)", metavar="NAME"),
        Option("workers", "processes that share them (default: this one)", whole(1, 10_000), "N"),
        count("best", 0, f"how many to tell (default: {TOLD})", default=TOLD),
        QUIET,
    ),
    options.simulation("f64"),
    lambda words: kinds_of_words(_known_sources(words)),
    world_and_own("simulate"),
)


def run(args: argparse.Namespace) -> Report:
    """Simulate, rank, and write the table."""
    return goes_on(_run)(args) if args.out is not None else _run(args)


def _run(args: argparse.Namespace) -> Report:
    from optim.many import try_all

    many, doubts, left_out = _many(args)
    if args.measure is not None and args.measure not in (known := [measure.name for measure in many.measures]):
        raise ValueError(f"measure: {args.measure!r} is unknown; there are {', '.join(known)}")
    if not args.quiet:
        _tell(doubts, left_out)
    with shown_progress(counted(len(many.robots), "robot"), 1.0, args.quiet) as update:
        found = try_all(many, args.workers, args.out, update)
    report = _report(args, found)
    if args.out is not None:
        report = report.written_by(lambda: _write(args.out / TABLE, found))
    return report.but_for(left_out)


def _sources(words: Sequence[str]) -> list[str]:
    """What words of a command line name: folders but those of runs stand for their files."""
    from optim.many import files_of

    found = list[str]()
    for word in words:
        path = Path(word)
        folder = os.path.isdir(word) and not has_run(path) and run_of_any_seed(path) is None
        found += files_of(path) if folder else [word]
    return found


def _known_sources(words: Sequence[str]) -> list[str]:
    """What words name as far as it can be told, for the options; a folder that is refused is so when they are known."""
    found = list[str]()
    for word in words:
        with contextlib.suppress(ValueError, OSError):
            found += _sources([word])
    return found


def _many(args: argparse.Namespace) -> "tuple[ManyRobots, list[str], list[str]]":
    """The robots that are named, what is likely a mistake in them, and why files in folders are left out."""
    from optim.problems.many_robots import ManyRobots

    left_out, doubts = list[str](), dict[str, str]()
    named, made = dict[str, Named](), dict[str, tuple[Robot, World]]()
    sources = _sources(args.sources)
    for source in sources:
        with _left_out_if_unfit(source, args.sources, left_out):
            named[source] = named_source(source)
    kinds = {each.kind.name: each.kind for each in named.values()}
    values = {name: args.parser.values(args, kind, *kinds.values()) for name, kind in kinds.items()}
    for source, each in named.items():
        with _left_out_if_unfit(source, args.sources, left_out), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            robot, (world, *_) = loaded(each, values[each.kind.name])
            made[source] = robot, world
        for warning in caught:
            doubts.setdefault(str(warning.message), source)
    if not made:
        raise ValueError(f"sources: none of {counted(len(sources), 'file')} can be used; {left_out[0]}")
    robots, worlds = zip(*made.values(), strict=True)
    told = [f"{source}: {doubt}" for doubt, source in doubts.items()]
    return ManyRobots(list(made), robots, worlds, options.compute(args, "f64")), told, left_out


@contextlib.contextmanager
def _left_out_if_unfit(source: str, words: Sequence[str], left_out: list[str]) -> Iterator[None]:
    """Note that a file of a folder cannot be used, and why; one that was named itself is refused."""
    try:
        yield
    except ValueError as error:
        if source in words:
            raise
        left_out.append(str(error) if source in str(error) else f"{source}: {error}")


def _tell(doubts: Sequence[str], left_out: Sequence[str]) -> None:
    """Note what is likely a mistake in some of the robots, each once, and what is left out."""
    for lines, what in ((doubts, "doubts"), ([f"left out: {each}" for each in left_out], "files left out")):
        for line in lines[:DOUBTS_TOLD]:
            note(line)
        if len(lines) > DOUBTS_TOLD:
            note(f"and {len(lines) - DOUBTS_TOLD} more {what}")


def _report(args: argparse.Namespace, found: "RobotTrials") -> Report:
    """The best for people; all for machines, in the order in which they were named."""
    measure = next(each for each in found.measures if each.name == (args.measure or found.measures[0].name))
    order = found.ranking(measure.name)
    rows = {name: values.tolist() for name, values in found.columns().items()}
    robots = [
        {name: finite(v[n]) if isinstance(v[n], float) else v[n] for name, v in rows.items()} for n in range(len(found))
    ]
    document = {
        "folder": None if args.out is None else str(args.out),
        "measure": measure.name,
        "unit": measure.unit,
        "ranking": [found.sources[number] for number in order],
        "robots": robots,
    }
    others = len(found) - len(order) - found.failed
    lines = [
        counted(len(found), "robot")
        + (f", {found.failed} failed" if found.failed else "")
        + (f", {others} without {measure.name}" if others else "")
    ]
    values = found[measure.name]
    width = max((len(found.sources[number]) for number in order[: args.best]), default=0)
    lines += [f"  {found.sources[n]:<{width}}  {measure.value(values[n])}" for n in order[: args.best]]
    if failures := [n for n in range(len(found)) if found.status[n] != OK]:
        lines += [f"  {found.sources[n]}: {found.status[n]}" for n in failures[: args.best]]
    return Report(document, "\n".join(lines), 0 if order else FAILED)


def _write(path: Path, found: "RobotTrials") -> str:
    from optim.experiments.tables import write_columns

    write_columns(path, found.columns())
    return str(path)
