"""Descriptions of command-line options: names, how their text is parsed, and what they mean."""

import argparse
import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from taichi_sim.base import checks

T = TypeVar("T")

_SPELLED = (str, PathLike, Real)  # what a caller may give as the command line would spell it


@dataclass(frozen=True)
class Option:
    """One option ``--name`` of a command.

    Attributes:
        name: with underscores, as a field or an argument is called; the command line has hyphens instead.
        help: what it means and what the default is, for people.
        type: makes the value from a text and refuses others (see :func:`checked`); None is a flag without a value.
        metavar: what the help calls the value.
        choices: the values that are allowed, if these are few.
        several: whether it may be repeated, to give a list.
        once: whether a second value is refused, of an option without a default; else the last one counts.
        commands: names of the commands that have it; empty for all.
        default: the value if it is not given.
        required: whether it must be given.
        words: of an argument without a flag, how many there may be: ``"1"``, ``"?"`` or ``"+"``.
    """

    name: str
    help: str
    type: Callable[[str], Any] | None = str
    metavar: str | None = None
    choices: tuple[Any, ...] = ()
    several: bool = False
    once: bool = False
    commands: tuple[str, ...] = ()
    default: Any = None
    required: bool = False
    words: str = ""

    @property
    def flag(self) -> str:
        """The option as the command line spells it, such as ``--name``."""
        return flag_of(self.name)

    def read(self, given: Any) -> Any:
        """The value that the command line would make of what a file or a caller gives.

        Args:
            given: a text, a path, a number, true, or a list or array of them; all else, such as a description, is
                taken as it is.

        Raises:
            ValueError: that names the option, for what is not allowed.
        """
        if hasattr(given, "tolist"):  # of NumPy
            given = given.tolist()
        if self.type is None:
            if not isinstance(given, bool):
                raise ValueError(f"{self.name}: {given!r} is not allowed; give true or false")
            return given
        if self.several:
            return [self._read_one(each) for each in (given if isinstance(given, list | tuple) else [given])]
        is_row = isinstance(given, list | tuple) and all(isinstance(each, _SPELLED) for each in given)
        return self._read_one(",".join(map(str, given)) if is_row else given)

    def _read_one(self, given: Any) -> Any:
        value = converted(self.name, self.type, str(given)) if isinstance(given, _SPELLED) else given
        if self.choices and value not in self.choices:
            raise ValueError(f"{self.name}: {value!r} is unknown; choose one of {', '.join(map(str, self.choices))}")
        return value

    def add(self, parser: Any) -> None:
        """Declare the option to a parser or group."""
        settings: dict[str, Any] = {"help": self.help, "default": self.default}
        if self.type is None:
            parser.add_argument(self.flag, dest=self.name, action="store_true", **settings)
            return
        settings["type"] = self.type
        if self.choices:
            settings["choices"] = self.choices
        elif self.metavar:
            settings["metavar"] = self.metavar
        if self.words:
            parser.add_argument(self.name, nargs=None if self.words == "1" else self.words, **settings)
            return
        action: Any = "append" if self.several else _Once if self.once else "store"
        parser.add_argument(self.flag, dest=self.name, action=action, required=self.required, **settings)

    def add_hidden(self, parser: Any) -> None:
        """Declare the option to a parser that will refuse it: the help leaves it out, and any text is a value."""
        kind = {"action": "store_true", "default": None} if self.type is None else {}
        parser.add_argument(self.flag, dest=self.name, help=argparse.SUPPRESS, **kind)


class _Once(argparse.Action):
    """Stores a value, and refuses a second one."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        if getattr(namespace, self.dest) != self.default:
            raise argparse.ArgumentError(self, "it is given twice, and the command takes one; give it once")
        setattr(namespace, self.dest, values)


def flag_of(name: str) -> str:
    """How the command line spells the name of an option, such as ``--name``."""
    return "--" + name.replace("_", "-")


def converted(name: str, reads: Callable[[str], Any] | None, text: str) -> Any:
    """What a type of an option makes of a text.

    Raises:
        ValueError: that names the option, for what is not allowed.
    """
    try:
        return text if reads is None else reads(text)
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{name}: {error}") from None


def spelled(value: Any) -> str:
    """A value as the command line spells it: numbers in full, with commas between several."""
    return ",".join(map(spelled, value)) if isinstance(value, tuple) else str(value)


def flag(name: str, told: str) -> Option:
    """An option without a value."""
    return Option(name, told, None)


def count(name: str, low: int, told: str, default: int | None = None, metavar: str = "N") -> Option:
    """An option that takes a whole number, at least ``low``."""
    return Option(name, told, whole(low), metavar, default=default)


def path_to(name: str, metavar: str, told: str, required: bool = False, words: str = "") -> Option:
    """An option, or an argument of so many words, that takes a file or a folder."""
    return Option(name, told, file_path, metavar, required=required, words=words)


def file_path(text: str) -> Path:
    """The type of an option with a file or a folder: its path.

    Raises:
        argparse.ArgumentTypeError: for an empty text, of which a path would silently be the working directory.
    """
    if not text:
        raise argparse.ArgumentTypeError("'' is not allowed; give a path")
    return Path(text)


def file_text(text: str) -> str:
    """The type of an option with a file, or the name of something that is built in; see :func:`file_path`."""
    file_path(text)
    return text


def options_of(described: Any, **meanings: str) -> tuple[Option, ...]:
    """Make options from the numbers and texts among the fields of a dataclass.

    Args:
        described: the dataclass; its own checks refuse values that are not allowed.
        meanings: what to say of each field, by name; these fields become options. The default is added.
    """
    known = {field.name: field for field in fields(described)}
    found = []
    for name, meaning in meanings.items():
        default = known[name].default
        told = "" if default is MISSING or default is None or default == "" else f" (default: {default})"
        kind = str if isinstance(default, str) else whole(-(2**63)) if isinstance(default, int) else number()
        found.append(Option(name, meaning + told, kind, "TEXT" if kind is str else "N"))
    return tuple(found)


def checked(check: Callable[[str], T], name: str | None = None) -> Callable[[str], T]:
    """Make an argparse type from a check that raises ``field: why``.

    Args:
        check: of the text.
        name: of the option's own field, which is left out of messages, as argparse itself names the option; None for
            all fields.
    """

    def convert(text: str) -> T:
        try:
            return check(text)
        except ValueError as error:
            field, _, why = str(error).partition(": ")
            raise argparse.ArgumentTypeError(why if name in (None, field) else str(error)) from None

    return convert


def number(low: float = -math.inf, high: float = math.inf, unit: str = "") -> Callable[[str], float]:
    """Make the type of an option with a finite number between two bounds, both included."""
    return checked(lambda text: checks.number("", value_of(text), low, high, unit))


def numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    """Make the type of an option with ``count`` finite numbers, separated by commas."""
    example = ",".join(["1", "-0.5", "0", "0.5"][:count])

    def convert(text: str) -> tuple[float, ...]:
        parts = [value_of(part) for part in text.split(",")]
        if len(parts) != count or any(isinstance(part, str) for part in parts):
            raise ValueError(f": {text!r} is not allowed; give {count} numbers, such as {example}")
        return tuple(checks.number("", part) for part in parts)

    return checked(convert)


def whole(low: int, high: int = 2**63 - 1) -> Callable[[str], int]:
    """Make the type of an option with a whole number between two bounds, both included."""
    return checked(lambda text: checks.whole_number("", value_of(text), low, high))


def value_of(text: str) -> float | str:
    """Convert a text to a number if it is one; otherwise return the text."""
    for convert in (int, float):
        with contextlib.suppress(ValueError):
            return convert(text)
    return text


def given(options: Sequence[Option], values: Any) -> dict[str, Any]:
    """Values of the options that were given, by name; ``values`` is the result of a parser."""
    found = {option.name: getattr(values, option.name, None) for option in options}
    return {name: value for name, value in found.items() if value is not None}
