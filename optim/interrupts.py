"""Ctrl-C, SIGTERM and SIGHUP: exceptions that end a command, also where something swallows them at first."""

import signal
import sys
import threading
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager
from types import FrameType, TracebackType
from typing import Any

from optim.exit_codes import HUNG_UP, INTERRUPTED, TERMINATED

REPEATED_AFTER = 0.5  # s, of an interrupt that something has swallowed


class Interrupted(KeyboardInterrupt):
    """The user wants the process to end (SIGINT, Ctrl-C)."""

    code = INTERRUPTED
    heeded = False  # whether something ends the work because of it


class Terminated(Interrupted):
    """The process was asked to end (SIGTERM), as clusters do before they kill; work ends as by Ctrl-C."""

    code = TERMINATED


class HungUp(Interrupted):
    """The terminal was closed, or its connection lost (SIGHUP); work ends as by Ctrl-C."""

    code = HUNG_UP


KINDS: Mapping[int, type[Interrupted]] = {signal.SIGINT: Interrupted, signal.SIGTERM: Terminated, signal.SIGHUP: HungUp}


CTRL_C = (signal.SIGINT,)


def stopped_by(interrupt: KeyboardInterrupt) -> int:
    """Heed an interrupt, so that it is not raised again; the exit code of the command that it ends."""
    if not isinstance(interrupt, Interrupted):
        return INTERRUPTED
    interrupt.heeded = True
    return interrupt.code


class EndedBySignals(AbstractContextManager[None]):
    """Let signals end what is done inside by an exception, but for those that the process ignores, as under ``nohup``.

    Python raises it wherever the main thread is. Some code there swallows any exception, such as that which reads the
    sources of kernels, or makes another one of it, such as the import of an extension. So it is raised again until
    something heeds it (:func:`stopped_by`) or it leaves; not while it is on its way, when ``finally`` clauses run. What
    fails there leaves in its place, as it may be what the user has to know.
    """

    def __init__(self, numbers: Collection[int] = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)) -> None:
        """Change nothing before it is entered; ``numbers`` are the signals that count."""
        self._numbers = numbers
        self._raised: Interrupted | None = None
        self._leaving = False
        self._before: dict[int, Any] = {}  # handlers, by the signal
        self._timer = 0.0, 0.0  # that was running when the first signal came

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
            return
        for number in self._numbers:
            handler = signal.getsignal(number)
            replaced = number == signal.SIGINT and handler is not signal.default_int_handler
            if handler != signal.SIG_IGN and not replaced:
                self._before[number] = signal.signal(number, self._end)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._leaving = True
        if signal.SIGALRM in self._before:
            signal.setitimer(signal.ITIMER_REAL, *self._timer)
        for number, handler in reversed(self._before.items()):  # Ctrl-C last, which then raises again
            signal.signal(number, handler)
        if self._raised is None or self._raised.heeded:
            return
        if error is None or isinstance(error, ImportError | SystemError):  # swallowed, or made another one
            raise self._raised from error

    def _end(self, number: int, _: FrameType | None) -> None:
        self._raised = KINDS[number]()
        if self._leaving:
            return
        if number == signal.SIGHUP:
            # Shell and kernel may both send one; the second must not cut short what ends the work.
            signal.signal(number, signal.SIG_IGN)
        if signal.SIGALRM not in self._before:
            self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._again)
            self._timer = signal.setitimer(signal.ITIMER_REAL, REPEATED_AFTER, REPEATED_AFTER)
        raise self._raised

    def _again(self, *_: object) -> None:
        if self._raised is None or self._leaving or self._raised.heeded or _on_its_way(self._raised):
            return
        raise self._raised


def _on_its_way(raised: Interrupted) -> bool:
    """Whether an exception, or one that it led to, is being handled now, or a generator closes that it may leave."""
    error = sys.exception()
    while error is not None:
        if error is raised or isinstance(error, GeneratorExit):
            return True
        error = error.__cause__ or error.__context__
    return False
