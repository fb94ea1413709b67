"""``morpholab report``: runs and studies as a page to read, print and share."""

import argparse
import sys
from pathlib import Path
from typing import Any

from optim.commands import Report, options
from optim.progress import shown_progress
from optim.wording import spoken_size

SUFFIXES = (".html", ".htm")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report",
        help="write a page about runs",
        description="Write a page about a run: settings, curves, the best design in motion, its gait and what the "
        "hardware's limits say of it, how to reproduce it. Several runs that are judged alike are compared. Also takes "
        "the folder of a sweep, of train or of interference. The page is one file, up to 15 MB, that needs no network.",
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="folder of a run, or a folder of such")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="page to write, such as report.html")
    parser.add_argument(
        "--no-player",
        action="store_true",
        help="without the motion of the best design: small, and nothing is simulated",
    )
    parser.add_argument(
        "--frames", type=options.whole(2), metavar="N", help="of the player, at most, of each motion (default: 400)"
    )
    parser.add_argument(
        "--rig", metavar="RIG", help="that shall play the gait: a preset or a TOML file (default: dissertation)"
    )
    parser.add_argument(
        "--by",
        choices=("evaluations", "generations", "seconds"),
        default="evaluations",
        help="what several runs are compared by (default: evaluations)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress and no notes")
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Build the page, and write it."""
    out: Path = args.out
    if out.suffix.lower() not in SUFFIXES:
        raise ValueError(f"out: {out} is not allowed; its name must end in {' or '.join(SUFFIXES)}")
    if args.no_player and args.frames is not None:
        raise ValueError("frames: there are none without a player; leave out --frames or --no-player")
    from optim.report import Settings, build
    from robots.hardware import PneumaticRig
    from taichi_sim.base.files import claimed_path, write_text

    args.held.enter_context(claimed_path("out", out))
    rig = PneumaticRig.load(args.rig) if args.rig else None
    settings = Settings(not args.no_player, args.frames or Settings.frames, rig, args.by)
    with shown_progress("report", 1.0, args.quiet) as update:
        built = build(args.runs, settings, update)
    if not args.quiet:
        for note in built.notes:
            print(f"note: {note}", file=sys.stderr)
    write_text(out, built.text)
    size = len(built.text.encode())
    document = {"out": str(out), "bytes": size, **built.document, "notes": built.notes}
    return Report(document, f"{out}: {spoken_size(size)}")
