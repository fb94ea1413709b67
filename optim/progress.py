"""Progress of long work: a bar on a terminal or in a notebook, a line now and then elsewhere."""

import html
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from optim.notes import plain

if TYPE_CHECKING:
    from rich.console import Console

FIRST_LINE, LONGEST_PAUSE = 10.0, 60.0  # seconds to the first line in a pipe, and at most between two
COUNTING = 2.0  # seconds in which work that is resumed counts what it kept
PAUSE_GROWS = 1.5  # from line to line
REST = 0.25  # of the longest pause: time beside it that tells how fast work goes
PAUSE_OF_A_BAR = 0.2  # seconds between pictures of a bar in a notebook


class Update(Protocol):
    """Tells how far work is."""

    def __call__(self, done: float, text: str | None = None) -> None:
        """Show what is done of the total, and a new text if there is one."""


@contextmanager
def shown_progress(text: str, total: float, quiet: bool = False) -> Iterator[Update]:
    """Yields a function to call with what is done of the total, and a new text if there is one.

    On a terminal there is a bar with the time left, on stderr; in a notebook one below the cell, which goes away.
    Elsewhere every new text is a line, and in between one now and then says how far the work is.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True, quiet=quiet, force_jupyter=False)
    if not console.is_terminal:
        with _notebook_bar(text, total) if in_notebook() and not quiet else _lines(text, total, console) as update:
            yield update
        return
    left = (TextColumn("left"), TimeRemainingColumn())
    with Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), *left, console=console
    ) as bar:
        task = bar.add_task(plain(text), total=total)

        def show(done: float, text: str | None = None) -> None:
            bar.update(task, completed=done, description=None if text is None else plain(text))

        yield show


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this process."""
    return "ipykernel" in sys.modules and hasattr(sys.modules.get("IPython"), "get_ipython")


@contextmanager
def _lines(
    text: str, total: float, console: "Console", clock: Callable[[], float] = time.monotonic
) -> Iterator[Update]:
    """Progress as lines: every new text, and between them, ever more seldom, how far the work is."""
    begun = told_at = clock()
    pause, current = FIRST_LINE, text
    pace: _Pace | None = None  # since what was kept has been counted

    def say(line: str) -> None:
        console.print(plain(line), highlight=False, soft_wrap=True, markup=False)

    def show(done: float, text: str | None = None) -> None:
        nonlocal told_at, pause, current, pace
        now, share = clock(), min(done / total, 1.0) if total else 1.0
        if pace is None or now - begun < COUNTING:
            pace = _Pace(now, share)
        pace.went(now, share)
        if text is not None:
            current, told_at = text, now
            say(text)
        elif now - told_at >= pause and share < 1:
            told_at, pause = now, min(pause * PAUSE_GROWS, LONGEST_PAUSE)
            left = f", about {span((1 - share) / pace.speed)} left" if pace.speed else ""
            say(f"{current}: {share:.0%} after {span(now - begun)}{left}")

    yield show


class _Pace:
    """How fast work goes, but for its longest pause, in which kernels may have been compiled."""

    def __init__(self, time: float, share: float) -> None:
        """Begin to count at a time [s], when a share of the work is done."""
        self._begun = self._last = time, share
        self._pause = 0.0, 0.0  # its length, and what was done in it

    def went(self, time: float, share: float) -> None:
        """Count what is done by a time."""
        self._pause = max(self._pause, (time - self._last[0], share - self._last[1]))
        self._last = time, share

    @property
    def speed(self) -> float:
        """Share of the work that is done in a second; 0 until there is enough beside the longest pause to tell."""
        ends = zip(self._last, self._begun, self._pause, strict=True)
        time, share = (now - then - paused for now, then, paused in ends)
        return share / time if share > 1e-9 and time >= REST * self._pause[0] else 0.0


def span(seconds: float) -> str:
    """A span of time for people, such as ``42 s``, ``7 min`` or ``3.5 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


@contextmanager
def _notebook_bar(text: str, total: float) -> Iterator[Update]:
    """Progress as a bar below the cell, which goes away at the end."""
    import IPython.display

    display: Any = IPython.display.display

    begun = shown = time.monotonic()
    current = text
    handle = display({"text/html": ""}, raw=True, display_id=True)

    def show(done: float, text: str | None = None) -> None:
        nonlocal current, shown
        now, current = time.monotonic(), text if text is not None else current
        if now - shown >= PAUSE_OF_A_BAR:
            shown, share = now, min(done / total, 1.0) if total else 1.0
            bar = f'<progress style="width:40%" max="1" value="{share:.4f}"></progress>'
            told = f"{bar} {share:.0%}, {span(now - begun)}: {html.escape(current)}"
            handle.update({"text/html": told}, raw=True)

    try:
        yield show
    finally:
        handle.update({"text/html": ""}, raw=True)
