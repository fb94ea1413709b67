"""The command ``morpholab``."""

import argparse
import contextlib
import errno
import io
import json
import os
import sys
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from optim.commands import (
    bench,
    calibrate,
    codesign,
    compare,
    export,
    gradient_check,
    interference,
    measure,
    pipeline,
    play,
    report,
    reproduce,
    simulate,
    simulate_all,
    status,
    sweep,
    tasks,
    track,
    train,
    view,
    work,
)
from optim.commands.robots import RobotOptions
from optim.exit_codes import BAD_INPUT, BUG, CLOSED_PIPE, FAILED
from optim.interrupts import EndedBySignals, stopped_by
from optim.notes import notes, plain, say
from taichi_sim.base.checks import nearest
from taichi_sim.base.disk_faults import unwritten
from taichi_sim.base.foreign import OWN_PACKAGES, blame, blame_package, blaming_package, lacks_memory, said_by

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

ROBOT_FLAGS = "--robot", "--gait"  # that name the robot, where commands have them
BARE_ROBOTS = "source", "sources"  # names of arguments without a flag that name robots
LONGEST_SUMMARY = 300  # characters of an unexpected exception in a message


class _Told(SystemExit):
    """What ends a command when a parser has told what was asked, or what is wrong; users' code raises others."""


class _Parser(RobotOptions):
    """A parser that says what is wrong in one line, without the usage."""

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        if message:
            self._print_message(message, sys.stderr)
        raise _Told(status)

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, plain(f"{self.prog}: error: {' '.join(message.split())}") + "\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and refuse what is unknown with what was likely meant."""
        self._check_bare_robot(args or ())
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(unknown)}")
        return found, unknown

    def _check_bare_robot(self, words: Sequence[str]) -> None:
        """Refuse a robot by an option, where a command takes it by itself."""
        if not any(action.dest in BARE_ROBOTS and not action.option_strings for action in self._actions):
            return
        for number, word in enumerate(words):
            flag, equals, value = word.partition("=")
            if flag in ROBOT_FLAGS:
                name = value if equals else next(iter(words[number + 1 :]), "")
                self.error(f"{flag}: is no option here; give the robot by itself: {self.prog} {name or 'ROBOT'}")

    def _meant(self, unknown: Sequence[str]) -> str:
        """What was likely meant by unknown words: an option that the help shows too, or the robot by itself."""
        shown = [a for a in self._actions if a.option_strings and a.help != argparse.SUPPRESS]
        known = [name for action in shown for name in action.option_strings]
        if unknown[0].startswith("-"):
            flag = next((word.partition("=")[0] for word in unknown if word.startswith("--")), "")
            whole = [name for name in known if len(flag) > len("--") and name.startswith(flag)]
            return f"; give {' or '.join(whole)}" if whole else nearest(flag, known)
        flags = [f"{flag} {unknown[0]}" for flag in ROBOT_FLAGS if flag in known]
        return f"; name a robot as {' or a gait as '.join(flags)}" if flags else ""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += nearest(value, map(str, action.choices or ()))
            raise

    def _get_value(self, action: argparse.Action, text: str) -> Any:
        try:
            return super()._get_value(action, text)
        except OSError as error:  # of a file that a value names, such as heights of ground
            raise argparse.ArgumentError(action, str(_unusable(error, text))) from None

    def _print_message(self, message: str, file: "SupportsWrite[str] | None" = None) -> None:
        (file or sys.stderr).write(message)  # argparse ignores a full disk


class _Version(argparse.Action):
    """The option that prints versions; it looks for them only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from optim.runs.environment import versions
        from taichi_sim.base.compiler import COMPILERS

        found = versions()
        names = [
            "morpholab",
            *(name for name in found if name != "morpholab" and (found[name] or name not in COMPILERS)),
        ]
        print(", ".join(f"{name} {found[name] or 'not installed'}" for name in names))
        parser.exit()


def build_parser(asked: str = "") -> argparse.ArgumentParser:
    """The parser of all commands; each sets ``run`` to the function that does the work.

    With the name of a command, the others have their names and one line each alone: all options take 12 ms.
    """
    parser = _Parser(prog="morpholab", description="Simulate soft and rigid robots, and design bodies and behaviours.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show versions, also of what results depend on")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for command in (
        simulate,
        simulate_all,
        view,
        codesign,
        work,
        tasks,
        status,
        compare,
        report,
        track,
        gradient_check,
        export,
        play,
        sweep,
        train,
        interference,
        measure,
        reproduce,
        pipeline,
        calibrate,
        bench,
    ):
        command.COMMAND.declare(commands, command.run, asked in ("", command.COMMAND.name))
    return parser


def main(arguments: Sequence[str | os.PathLike[str]] | None = None) -> int:
    """Run a command.

    Returns:
        The exit code: 0; 2 for bad input; 1 for work that failed; 70 for what nobody foresaw; 129 when the terminal was
        closed; 130 when interrupted; 143 when asked to end; 141 when nobody reads the output any more.
    """
    closed = _open_streams()
    try:
        os.getcwd()
    except OSError:
        return _fail("", "failed: the working directory was deleted; change to another one", FAILED)
    try:
        words = sys.argv[1:] if arguments is None else [os.fspath(word) for word in arguments]
        asked = next(iter(words), "")
        args = build_parser("" if asked.startswith("-") else asked).parse_args(words)
    except _Told as stop:  # after help, versions, or a wrong option
        raise SystemExit(_print("", None, int(stop.code or 0))) from None
    except (OSError, ValueError) as error:
        return _unprinted("", error)
    needing = "--json" if args.json else "--to -" if getattr(args, "to", None) == "-" else ""
    if needing and "stdout" in closed:  # before work of hours whose document nobody would get
        why = f"standard output is closed, which {needing} needs; open it, or leave out {needing}"
        return _fail(args.command, f"failed: {why}", FAILED)
    stdout = _stdout_to_stderr() if args.json else contextlib.nullcontext()
    try:
        with EndedBySignals(), notes(args.command), stdout, contextlib.ExitStack() as args.held:
            report = args.run(args)
        text = json.dumps(report.document, allow_nan=False) if args.json else plain(report.text)
    except KeyboardInterrupt as interrupt:
        return _fail(args.command, "interrupted", stopped_by(interrupt))
    except _Told:  # of what a file of options says
        raise
    except BaseException as raised:
        return _refuse(args.command, blaming_package(raised))
    code = _print(args.command, text, int(report.code))
    return code if report.error is None else _refuse(args.command, report.error)


def _print(command: str, text: str | None, code: int) -> int:
    """Print a result; the exit code, which is another one if standard output does not take it."""
    try:
        if text is not None:
            print(text)
        sys.stdout.flush()
    except (OSError, ValueError) as error:  # ValueError: a caller has closed its own stream
        return _unprinted(command, error)
    return code


def _unprinted(command: str, error: OSError | ValueError) -> int:
    """The exit code after standard output has failed; it is silent if nobody reads it."""
    if not isinstance(error, BrokenPipeError):
        why = error.strerror if isinstance(error, OSError) else error
        say(command, f"failed: standard output cannot be written ({why})")
    with contextlib.suppress(OSError, ValueError):  # a stream of a caller's own may have no descriptor, or be closed
        number = sys.stdout.fileno()
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), number)  # so that Python does not fail again when it ends
    return CLOSED_PIPE if isinstance(error, BrokenPipeError) else FAILED


def _refuse(command: str, error: Exception) -> int:
    """Tell in one line why a command could not do its work."""
    if os.environ.get("MORPHOLAB_DEBUG") == "1":
        traceback.print_exception(error)
    if lacks_memory(error):
        advice = "give it more, or ask for less: fewer points or draws at a time, frames or threads"
        return _fail(command, f"failed: there is not enough memory for this ({_reason(error)}); {advice}", FAILED)
    if told := blame(error) or blame_package(error):
        return _fail(command, f"failed: {told}", FAILED)
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        return _fail(
            command, f"error: a name of {len(str(error.filename))} characters is too long for a file", BAD_INPUT
        )
    if isinstance(error, OSError) and error.filename is not None:
        error = _unusable(error)
    if isinstance(error, ValueError):
        return _fail(command, f"error: {error}", BAD_INPUT)
    # A RecursionError is a RuntimeError of Python's own, which says nothing to a user.
    if isinstance(error, OSError | RuntimeError) and not isinstance(error, RecursionError):
        return _fail(command, f"failed: {error}", FAILED)
    if isinstance(error, ModuleNotFoundError) and str(error.name).partition(".")[0] not in OWN_PACKAGES:
        return _fail(command, f"failed: the module {error.name} is missing; install morpholab's dependencies", FAILED)
    story = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile("w", prefix="morpholab-", suffix=".log", delete=False) as file:
            file.write(story)
        place = f"please report it with {file.name}"
    except OSError:
        place = "set MORPHOLAB_DEBUG=1 to see where"
    summary = "".join(traceback.format_exception_only(error))[:LONGEST_SUMMARY]
    return _fail(command, f"this is a bug in morpholab ({summary.strip()}); {place}", BUG)


def _unusable(error: OSError, name: str = "") -> ValueError | RuntimeError:
    """What to tell of a file, by default that of the error, that no part of a command has named in words of its own."""
    return unwritten(f"{error.filename or name}: cannot be used", error)


def _reason(error: Exception) -> str:
    """What an error says, short."""
    return (said_by(error) or type(error).__name__)[:LONGEST_SUMMARY]


def _open_streams() -> list[str]:
    """Let each stream that was closed before the start take everything and keep nothing; return their names.

    Characters that the encoding of standard output lacks are written as escapes, as those of standard error are.
    """
    if isinstance(sys.stdout, io.TextIOWrapper) and not sys.stdout.closed:
        sys.stdout.reconfigure(errors="backslashreplace")
    closed = []
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_WRONLY)
            if descriptor != number and not _is_open(number):  # of a program that has no stream, it may be in use
                os.dup2(descriptor, number)
                os.close(descriptor)
                descriptor = number
            setattr(sys, name, os.fdopen(descriptor, "w", closefd=False))
            closed.append(name)
    return closed


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


@contextlib.contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Keep standard output for the document; what libraries print goes to stderr, also from outside Python."""
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
