"""Warnings to users: one line each, as errors are, without the place in the code."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import Any


def say(name: str, message: str) -> None:
    """Print a message of a command on one line of stderr."""
    print(f"morpholab {name}: {' '.join(message.split())}", file=sys.stderr)


@contextlib.contextmanager
def notes(name: str) -> Iterator[None]:
    """Prints warnings to users as notes of that name."""

    def show(message: Warning | str, category: type[Warning], *place: Any, **other: Any) -> None:
        if issubclass(category, UserWarning):
            say(name, f"note: {message}")
        else:
            usual(message, category, *place, **other)

    with warnings.catch_warnings():
        usual, warnings.showwarning = warnings.showwarning, show
        yield
