"""Progress of long work, on stderr."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Update(Protocol):
    """Tells how far work is."""

    def __call__(self, done: float, text: str | None = None) -> None:
        """Show what is done of the total, and a new text if there is one."""


@contextmanager
def shown_progress(text: str, total: float, quiet: bool = False) -> Iterator[Update]:
    """Yields a function to call with what is done of the total, and a new text if there is one.

    On a terminal there is a bar with the time left; elsewhere every new text is a line.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True, quiet=quiet)
    left = (TextColumn("left"), TimeRemainingColumn())
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), *left)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=total)

        def update(done: float, text: str | None = None) -> None:
            bar.update(task, completed=done, description=text)
            if text is not None and not console.is_terminal:
                console.print(text, highlight=False, soft_wrap=True)

        yield update
