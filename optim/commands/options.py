"""What a command line knows of a command, and the options that commands share."""

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from optim.commands.robots import OptionsOf, RobotOptions
from robots.robot import KINDS, RobotKind
from taichi_sim.base import claims
from taichi_sim.base.compute import DEVICES, PRECISIONS, Compute
from taichi_sim.base.options import Option as Option
from taichi_sim.base.options import checked as checked
from taichi_sim.base.options import count as count
from taichi_sim.base.options import file_text as file_text
from taichi_sim.base.options import flag as flag
from taichi_sim.base.options import given as given
from taichi_sim.base.options import number as number
from taichi_sim.base.options import path_to as path_to
from taichi_sim.base.options import whole as whole
from taichi_sim.base.parsing import parse_json

QUIET = flag("quiet", "no progress")
JSON = flag("json", "print one JSON document, and nothing else, on stdout")
THREADS = count("threads", 1, "CPU threads (default: all)")
DEVICE = Option("device", "(default: cpu)", choices=DEVICES)
RUNS = path_to("runs", "RUN", "folder of a run, or a folder of such", words="+")
ROBOT_HINT = "Options depend on the robot: add --robot FILE, or --robot KIND, to see those of yours."
AXES = ("evaluations", "generations", "seconds")  # by which searches are compared


@dataclass(frozen=True)
class Command:
    """A command; its module has a function ``run`` beside it, which takes the values of the options.

    Attributes:
        name: as it is typed.
        help: of the list of commands.
        description: of its own help.
        options: all but ``--json``, which every command has.
        groups: further options by the title that the help gives them.
        kinds: the kinds of robots that its words name; options of these kinds are added. None has none.
        options_of: the options of a kind that it has.
    """

    name: str
    help: str
    description: str
    options: Sequence[Option]
    groups: Mapping[str, Sequence[Option]] = field(default_factory=dict)
    kinds: Callable[[Sequence[str]], Iterable[RobotKind]] | None = None
    options_of: OptionsOf | None = None

    def declare(self, commands: Any, run: Callable[[argparse.Namespace], Any], whole: bool = True) -> None:
        """Add the parser of the command to those of a command line, ``whole`` or without what it takes."""
        hint = ROBOT_HINT if any(option.name == "robot" for option in self.options) else None
        parser: RobotOptions = commands.add_parser(self.name, help=self.help, description=self.description, epilog=hint)
        if not whole:
            return
        for option in (*self.options, JSON):
            option.add(parser)
        for title, options in self.groups.items():
            group = parser.add_argument_group(title)
            for option in options:
                option.add(group)
        if self.kinds is not None and self.options_of is not None:
            parser.take_robots(self.kinds, self.options_of)
        parser.set_defaults(run=run, parser=parser)


def precision(told: str, default: str | None = None) -> Option:
    """The option of the precision; ``told`` is what the help calls the default."""
    return Option("precision", f"of the numbers (default: {told})", choices=PRECISIONS, default=default)


def simulation(told: str) -> dict[str, Sequence[Option]]:
    """The group of options about where and how to simulate; ``told`` is what the help calls the default precision."""
    return {"simulation": (precision(told), DEVICE, THREADS)}


def compute(args: argparse.Namespace, precision: str) -> Compute:
    """What the options of :func:`simulation` say, in this precision by default."""
    return Compute(args.device or "cpu", args.precision or precision, args.threads)


def given_compute(args: argparse.Namespace) -> dict[str, Any]:
    """The options of precision, device and threads that were given, by name."""
    return given((precision(""), DEVICE, THREADS), args)


def robot(told: str, default: str = "(default: inflatable)") -> Option:
    """The option that names the robot; ``told`` says what else to give, ``default`` what it is unless it is given."""
    return Option(
        "robot",
        f"a kind of robot ({', '.join(KINDS.builtin)}, or of an installed package) or the file of one {default}; "
        f"{told}",
        metavar="KIND|FILE",
    )


def by(told: str) -> Option:
    """The option of the axis along which searches are compared."""
    return Option("by", told, choices=AXES, default=AXES[0])


def names(text: str) -> tuple[str, ...]:
    """The type of an option with several names, separated by commas."""
    return tuple(name.strip() for name in text.split(","))


def claim_folder(args: argparse.Namespace, *names: str) -> None:
    """Make the new folder ``--out``, if one is given, and keep other processes off it while the command runs.

    A kill may leave some of the files ``names`` that the command makes there; the same command then removes them.

    Raises:
        ValueError: if the folder holds anything, cannot be made, or another process fills it.
    """
    if args.out is not None:
        args.held.enter_context(claims.claimed_folder("out", args.out, names))


def setting(text: str) -> tuple[str, Any]:
    """``NAME=VALUE``, the value as JSON, or else as text."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise ValueError(f"set: {text!r} is not allowed; give NAME=VALUE")
    try:
        return name.replace("-", "_"), parse_json(value)
    except ValueError:
        return name.replace("-", "_"), value
