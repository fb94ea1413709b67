"""``morpholab report``: runs and studies as a page to read, print and share."""

import argparse
from pathlib import Path

from optim.commands import Report, options
from optim.commands.options import Command, Option, count, file_text, flag, path_to
from optim.interrupts import stopped_by
from optim.notes import note
from optim.progress import shown_progress
from optim.wording import spoken_size
from taichi_sim.base.options import whole
from taichi_sim.base.short_text import counted

SUFFIXES = (".html", ".htm")
COMMAND = Command(
    "report",
    "write a page about runs",
    "Write a page about a run: settings, curves, the best design in motion, its gait and what the hardware's limits "
    "say of it, how to reproduce it. Several runs that are judged alike are compared. Also takes the folder of a "
    "sweep, of train, of interference or of measure. The page is one file, up to 15 MB, that needs no network.",
    (
        options.RUNS,
        path_to("out", "FILE", "page to write, such as report.html"),
        flag("watch", "in place of --out: show runs in a browser on this machine while they go on, until Ctrl-C"),
        Option("port", "of that page (default: one that is free)", whole(0, 65535), "N"),
        flag("no_player", "without the motion of the best design: small, and nothing is simulated"),
        count("frames", 2, "of the player, at most, of each motion (default: 400)"),
        Option("rig", "that shall play the gait: a preset or a TOML file (default: dissertation)", file_text, "RIG"),
        options.by("what several runs are compared by (default: evaluations)"),
        flag("quiet", "no progress"),
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Build the page, and write it; or serve one."""
    if args.watch:
        return _watch(args)
    if args.port is not None:
        raise ValueError("port: nothing is served without --watch; leave it out")
    out: Path | None = args.out
    if out is None:
        raise ValueError("out: name the page to write, such as --out report.html, or watch runs by --watch")
    if out.suffix.lower() not in SUFFIXES:
        raise ValueError(f"out: {out} is not allowed; its name must end in {' or '.join(SUFFIXES)}")
    if args.no_player and args.frames is not None:
        raise ValueError("frames: there are none without a player; leave out --frames or --no-player")
    from optim.report import ReportSettings, build
    from robots.hardware import PneumaticRig
    from taichi_sim.base.claims import claimed_path, undone_if_it_fails
    from taichi_sim.base.files import write_text

    args.held.enter_context(claimed_path("out", out))
    rig = PneumaticRig.load(args.rig) if args.rig else None
    settings = ReportSettings(not args.no_player, args.frames or ReportSettings.frames, rig, args.by)
    with shown_progress("report", 1.0, args.quiet) as update:
        built = build(args.runs, settings, update)
    if not args.quiet:
        for text in built.notes:
            note(text)
    with undone_if_it_fails() as made:  # also where the page is written, but not that its folder has it
        made.append(out)
        write_text(out, built.text)
    size = len(built.text.encode())
    document = {"out": str(out), "bytes": size, **built.document, "notes": built.notes}
    return Report(document, f"{out}: {spoken_size(size)}").but_for(built.left_out)


def _watch(args: argparse.Namespace) -> Report:
    """Serve the page of runs that go on, until Ctrl-C."""
    for name in ("out", "no_player", "frames", "rig"):
        if getattr(args, name):
            raise ValueError(f"watch: it does not go with --{name.replace('_', '-')}; leave one out")
    if args.by != options.AXES[0]:
        raise ValueError("watch: it does not go with --by; leave one out")
    from optim.report.live import LiveRuns, LiveServer

    runs = LiveRuns(args.runs)
    followed = len(runs.state())
    with LiveServer(runs, args.port or 0) as server:
        told = f"{counted(followed, 'run')}: {server.url} (on this machine alone; Ctrl-C ends it)"
        note(told)
        try:
            server.serve_forever()
        except KeyboardInterrupt as interrupt:
            stopped_by(interrupt)
    return Report({"runs": followed, "url": server.url}, "")
