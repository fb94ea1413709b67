"""``morpholab play``: a table of pressures, sent to a rig's controller in real time."""

import argparse
import contextlib
import os
from typing import TYPE_CHECKING, Any

from optim.commands import Report
from optim.commands.options import Command, Option, count, file_text, flag, number, path_to
from optim.notes import note
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from robots.hardware.controller import Link
    from robots.hardware.stream import Stream

SECONDS = number(0.0, 3600.0, "s")  # the waits of the system fail for numbers that are far larger

COMMAND = Command(
    "play",
    "send a table of pressures to a rig's controller, in real time",
    "Send a table of pressures that export wrote to the controller of a rig, a line for each sample, in real time; "
    "at the end, on Ctrl-C and on errors the lines are vented.",
    (
        path_to("table", "TABLE", "a CSV file that export wrote", words="1"),
        Option("port", "serial device, such as /dev/ttyUSB0", metavar="DEVICE"),
        count("baud", 50, "speed of the serial device (default: 115200)"),
        Option("to", "new file, or named pipe, to write instead; - is standard output", file_text, "FILE"),
        Option("format", "JSON or comma-separated lines (default: jsonl)", choices=("jsonl", "csv"), default="jsonl"),
        count("loops", 0, "how often the main is played (default: as the table says)"),
        Option(
            "rate",
            "samples per second (default: of the table, or 20 if its rows are corners)",
            number(0.1, 1000.0, "Hz"),
            "HZ",
        ),
        Option(
            "rig",
            "whose limits hold: a preset, or a TOML file (default: the preset that the table is for)",
            file_text,
            "RIG",
        ),
        Option("ack", "wait so long for the answer 'ok N' to sample N", SECONDS, "SECONDS"),
        Option("late", "vent and stop if a sample is later than this (default: 0.5)", SECONDS, "SECONDS"),
        Option(
            "ready",
            "wait so long after the device was opened, as many controllers start anew then (default: 2)",
            SECONDS,
            "SECONDS",
        ),
        flag("no_wait", "write all samples at once; with --to a file"),
        flag("dry_run", "tell what would be sent, how long, and the pressures beside the limits; send nothing"),
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Play the table, or tell what would be sent."""
    from robots.hardware.controller import Pace, check_baud, play
    from robots.hardware.rig import PneumaticRig
    from robots.hardware.stream import FORMATS, read_any_table, stream_of

    _check_place(args)
    rig = None if args.rig is None else PneumaticRig.load(args.rig)
    stream = stream_of(read_any_table(args.table), rig, loops=args.loops, rate=args.rate)
    form = FORMATS[args.format]()
    if args.port is not None:
        check_baud(stream, form, args.baud or 115200)
    notes = stream.notes()
    for text in notes:  # before anything moves
        note(text)
    if args.dry_run:
        return _dry_run(args, stream, notes)
    pace = Pace(not args.no_wait, args.ack, 0.5 if args.late is None else args.late)
    with _link(args) as link:
        played = play(stream, form, link, pace)
    times = {"samples": played.samples, "seconds": played.seconds, "latest": played.latest}
    document: dict[str, Any] = {"table": str(args.table), **times, "notes": notes}
    if args.to == "-":  # standard output is the stream's
        return Report(document, "")
    text = f"{args.port or args.to}: {counted(played.samples, 'sample')} in {played.seconds:.1f} s, none left out"
    return Report(document, text + ("" if args.no_wait else f", at most {1e3 * played.latest:.1f} ms late"))


def _check_place(args: argparse.Namespace) -> None:
    """Refuse options that do not go together, and a file to write that would cost what is in it."""
    if args.port is not None and args.to is not None:
        raise ValueError("to: it is not allowed beside --port; give one of them")
    if args.port is None and args.to is None and not args.dry_run:
        raise ValueError("port: is missing; name a serial device, or --to FILE, or ask for --dry-run")
    if args.baud is not None and args.to is not None:
        raise ValueError("baud: it is of serial devices; leave it out with --to")
    if args.ready is not None and args.to is not None:
        raise ValueError("ready: it is of serial devices; leave it out with --to")
    if args.ack is not None and args.to is not None:
        raise ValueError("ack: nothing answers on --to; leave it out, or give --port")
    if args.no_wait and args.port is not None:
        raise ValueError("no-wait: a rig takes its time; leave it out with --port")
    if args.json and args.to == "-" and not args.dry_run:
        raise ValueError("to: - is not allowed with --json, as both are for standard output")
    if args.to is not None and args.to != "-" and not args.dry_run:
        _check_file(args)


def _check_file(args: argparse.Namespace) -> None:
    """Refuse a file to write that has content, such as what is read."""
    from robots.hardware.controller import check_takes_lines

    for name, given in (("table", args.table), ("rig", args.rig)):
        with contextlib.suppress(OSError):  # of those that do not exist; a rig may be a name
            if given and os.path.samefile(args.to, given):
                raise ValueError(f"to: {args.to} is the {name}, which is only read; name another file")
    check_takes_lines(args.to)


def _link(args: argparse.Namespace) -> contextlib.AbstractContextManager["Link"]:
    from robots.hardware.controller import file_link, serial_link

    if args.port is None:
        return file_link(args.to, live=not args.no_wait)
    return serial_link(args.port, args.baud or 115200, 2.0 if args.ready is None else args.ready)


def _dry_run(args: argparse.Namespace, stream: "Stream", notes: list[str]) -> Report:
    extremes = stream.extremes()
    channels: list[dict[str, Any]] = [
        dict(zip(("channel", "lowest", "highest", "allowed_lowest", "allowed_highest"), each, strict=True))
        for each in extremes
    ]
    lengths = stream.table.durations
    sections = ", ".join(f"{name} {length:g} s" for name, length in lengths.items())
    lines = [
        f"{counted(stream.samples, 'sample')} at {stream.rate:g} Hz, {stream.seconds:.1f} s; nothing is sent",
        f"{sections}; main played {counted(stream.loops, 'time')}",
        *(
            f"{name}: {low:.4g} to {high:.4g} {stream.unit}; {stream.rig.name} allows {least:.4g} to {most:.4g}"
            for name, low, high, least, most in extremes
        ),
    ]
    document = {"table": str(args.table), **stream.about(), "loops": stream.loops, "rig": stream.rig.name}
    return Report({**document, "durations_s": dict(lengths), "pressures": channels, "notes": notes}, "\n".join(lines))
