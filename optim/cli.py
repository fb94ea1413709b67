"""The command ``morpholab``."""

import argparse
import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import NoReturn

from optim.commands import (
    FAILED,
    Terminated,
    bench,
    calibrate,
    codesign,
    compare,
    export,
    gradient_check,
    interference,
    pipeline,
    report,
    reproduce,
    simulate,
    status,
    stopped_by,
    sweep,
    train,
    view,
)
from optim.notes import notes, say


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


class _Version(argparse.Action):
    """Prints versions and ends; looks for them only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from optim.runs.environment import versions

        found = versions()
        names = ["morpholab", *(name for name in found if name != "morpholab")]
        print(", ".join(f"{name} {found[name] or 'not installed'}" for name in names))
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each sets ``run`` to the function that does the work."""
    parser = _Parser(prog="morpholab", description="Simulate soft and rigid robots, and design bodies and behaviours.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show versions, also of what results depend on")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command in (
        simulate,
        view,
        codesign,
        status,
        compare,
        report,
        gradient_check,
        export,
        sweep,
        train,
        interference,
        reproduce,
        pipeline,
        calibrate,
        bench,
    ):
        command.add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns:
        The exit code: 0; 2 for bad input; 1 for work that failed; 130 when interrupted; 143 when asked to end.
    """
    args = build_parser().parse_args(arguments)
    try:
        with _ended_by_sigterm(), notes(args.command), _stdout_to_stderr() if args.json else contextlib.nullcontext():
            report = args.run(args)
    except ValueError as error:
        return _fail(args.command, f"error: {error}", 2)
    except (OSError, RuntimeError) as error:
        return _fail(args.command, f"failed: {error}", FAILED)
    except MemoryError as error:
        return _fail(args.command, f"failed: there is not enough memory for this ({error})", FAILED)
    except KeyboardInterrupt as interrupt:
        return _fail(args.command, "interrupted", stopped_by(interrupt))
    print(json.dumps(report.document, allow_nan=False) if args.json else report.text)
    return int(report.code)


@contextlib.contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """SIGTERM ends a command as Ctrl-C does, while it works."""

    def end(*_: object) -> NoReturn:
        raise Terminated

    if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Keeps stdout for the document, whatever else has something to say, be it below Python."""
    sys.stdout.flush()
    stdout = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(stdout, 1)
        os.close(stdout)


def _fail(command: str, message: str, code: int) -> int:
    say(command, message)
    return code


if __name__ == "__main__":
    raise SystemExit(main())
