"""Messages of commands: one line each on stderr."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import Any


def say(name: str, message: str) -> None:
    """Print a message of a command on one line of stderr; nowhere if that is full or closed."""
    with contextlib.suppress(OSError):
        print(f"{' '.join(('morpholab', name)).strip()}: {' '.join(message.split())}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def notes(name: str) -> Iterator[None]:
    """Print warnings to users as notes of a command, without their place in the code."""

    def show(message: Warning | str, category: type[Warning], *place: Any, **other: Any) -> None:
        if issubclass(category, UserWarning):
            say(name, f"note: {message}")
        else:
            usual(message, category, *place, **other)

    with warnings.catch_warnings():
        # They are for the user of the command, whatever Python's own filter says: `-W error` would end a good command.
        warnings.simplefilter("default", UserWarning)
        usual, warnings.showwarning = warnings.showwarning, show
        yield
