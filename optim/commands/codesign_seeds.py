"""Several searches that differ in their seed: which, and one after the other, each in a folder of its own."""

import argparse
from collections.abc import Callable
from typing import Any

from optim.commands import Report
from optim.commands.options import Option, checked, setting
from optim.exit_codes import STOPPED
from optim.notes import note
from optim.runs.config import folder_of_seed, folders_of_seeds, has_run, run_of_any_seed

MOST_SEEDS = 10_000


def seeds_of(text: str) -> tuple[int, ...]:
    """The seeds that a list such as ``0-5`` or ``0,2,7`` names, in its order.

    Raises:
        ValueError: if it names none, too many, or one twice.
    """
    seeds: list[int] = []
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        ends = (low, high) if dash else (low, low)
        if not all(end.isascii() and end.isdigit() for end in ends) or int(ends[0]) > int(ends[1]):
            raise ValueError(f"seeds: {text!r} is not allowed; give whole numbers and ranges, such as 0-5 or 0,2,7")
        if int(ends[1]) - int(ends[0]) >= MOST_SEEDS:
            raise ValueError(f"seeds: {text!r} is not allowed; give at most {MOST_SEEDS}")
        seeds += range(int(ends[0]), int(ends[1]) + 1)
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: {text!r} is not allowed; name each seed once")
    return tuple(seeds)


SEEDS = Option(
    "seeds",
    "search once with each seed, one after the other, in folders OUT/seed-0 and so on; --resume goes on",
    checked(seeds_of),
    "0-5|0,2,7",
)


def check_single(args: argparse.Namespace) -> None:
    """Refuse to continue one run in a folder that holds those of several seeds.

    Raises:
        ValueError: that says how to continue them.
    """
    if not args.resume or has_run(args.out):
        return
    names = [path.name.removeprefix("seed-") for path in folders_of_seeds(args.out) if has_run(path)]
    if seeds := _spelled(sorted(int(name) for name in names if name.isascii() and name.isdigit())):
        raise ValueError(f"out: {args.out} holds runs of seeds; give --seeds {seeds} to go on with them")


def note_new(args: argparse.Namespace) -> None:
    """Say that a search begins anew where one was to be continued, or has one seed where many may be meant.

    Neither is an error: the folder's name may be mistyped, but scripts on clusters give --resume always, as a kill may
    come before the folder exists; and each of their jobs has a seed.
    """
    begun = has_run(args.out) or (args.seeds and run_of_any_seed(args.out))
    if not begun and args.seeds and len(args.seeds) == 1 < (seed := args.seeds[0]) <= MOST_SEEDS:
        note(f"seeds: this is seed {seed} alone; for {seed} searches give --seeds 0-{seed - 1}")
    if args.resume and not begun:
        note(f"{args.out} holds no run to go on with; a new search begins there")


def _spelled(seeds: list[int]) -> str:
    """The list of seeds, ascending, as it is given: such as ``0-3,7``."""
    parts: list[list[int]] = []
    for seed in seeds:
        if parts and seed == parts[-1][-1] + 1:
            parts[-1].append(seed)
        else:
            parts.append([seed])
    return ",".join(f"{part[0]}-{part[-1]}" if part[1:] else f"{part[0]}" for part in parts)


def search_each(args: argparse.Namespace, search: Callable[[argparse.Namespace], Report]) -> Report:
    """Search with each seed; the report on all.

    Raises:
        ValueError: before any work, if the folder of one is taken, or a single seed is given as well.
    """
    from optim.runs.folder import check_free

    if args.seed is not None:
        raise ValueError(f"seed: {args.seed} is not allowed with --seeds; give one of them")
    for name, value in map(setting, args.set or ()):
        if name == "seed":  # it would be that of all searches
            raise ValueError(f"set: seed={value} is not allowed with --seeds; leave one out")
    if has_run(args.out):
        raise ValueError(f"out: {args.out} holds a single run; name another folder for --seeds")
    if not args.resume:
        for seed in args.seeds:
            check_free(folder_of_seed(args.out, seed))
    documents: list[Any] = []
    texts, code = list[str](), 0
    for number, seed in enumerate(args.seeds, 1):
        if not args.quiet:
            note(f"seed {seed}, {number} of {len(args.seeds)}")
        report = search(argparse.Namespace(**{**vars(args), "seed": seed, "out": folder_of_seed(args.out, seed)}))
        documents.append({"seed": seed, **(report.document if isinstance(report.document, dict) else {})})
        texts.append(report.text)
        code = max(code, report.code)
        if report.code in STOPPED:
            break
    return Report({"folder": str(args.out), "runs": documents}, "\n".join(texts), code)
