"""Messages of commands: one line each on stderr."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import Any
from unicodedata import category

_running: list[str] = []  # names of commands, the one that was started last at the end


def plain(text: str) -> str:
    """A text without what terminals obey, such as colours and reversed writing: ``\\x1b`` in place of an escape."""
    obeyed = ("Cc", "Cf", "Cs")  # control, format and surrogate characters; lines and tabs stay
    shown = (c if c in "\n\t" or category(c) not in obeyed else c.encode("unicode_escape").decode() for c in text)
    return text if text.isprintable() else "".join(shown)


def say(name: str, message: str) -> None:
    """Print a message of a command on one line of stderr; nowhere if that is full or closed."""
    line = f"{' '.join(('morpholab', name)).strip()}: {' '.join(message.split())}"
    with contextlib.suppress(OSError, ValueError):
        print(plain(line), file=sys.stderr, flush=True)


def note(message: str) -> None:
    """Print a note of the command that is running; of morpholab itself where none is, as in a notebook."""
    say(_running[-1] if _running else "", f"note: {message}")


@contextlib.contextmanager
def notes(name: str) -> Iterator[None]:
    """Name a command as the one whose notes are printed, and make notes of warnings to users."""

    def show(message: Warning | str, category: type[Warning], *place: Any, **other: Any) -> None:
        if issubclass(category, UserWarning):
            note(str(message))
        else:
            usual(message, category, *place, **other)

    with warnings.catch_warnings():
        # They are for the user of the command, whatever Python's own filter says: `-W error` would end a good command.
        warnings.simplefilter("default", UserWarning)
        usual, warnings.showwarning = warnings.showwarning, show
        _running.append(name)
        try:
            yield
        finally:
            _running.pop()
