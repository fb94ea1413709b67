"""The commands of ``morpholab``, one a file. They import what is heavy only when they run."""

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from optim.exit_codes import FAILED
from optim.interrupts import stopped_by


@dataclass(frozen=True)
class Report:
    """The outcome of a command, for machines and people.

    Attributes:
        document: for machines, fits JSON.
        text: for people.
        code: the exit code: 0, or ``FAILED`` if the work, not the input, was at fault, or that of an interruption.
        error: why files of what is reported could not be written; told after it, and decides the exit code.
    """

    document: dict[str, Any] | list[Any]
    text: str
    code: int = 0
    error: Exception | None = None

    def but_for(self, left_out: list[str]) -> "Report":
        """Add to the report what was left out and why; the exit code is ``FAILED`` if anything was."""
        assert isinstance(self.document, dict)
        return replace(self, document=self.document | {"left_out": left_out}, code=FAILED) if left_out else self

    def written_by(self, write: Callable[[], str]) -> "Report":
        """Write files of what is reported; if that fails, the report is told all the same.

        Args:
            write: writes them, and returns a line about them for people, or nothing.
        """
        try:
            names = write()
        except Exception as error:
            return replace(self, error=error)
        return replace(self, text=f"{self.text}\n{names}") if names else self


def goes_on(run: Callable[[Namespace], Report]) -> Callable[[Namespace], Report]:
    """Let a command that goes on in its folder, when it is given again, say so when it is interrupted."""

    def run_or_stop(args: Namespace) -> Report:
        try:
            return run(args)
        except KeyboardInterrupt as interrupt:
            text = f"interrupted; {args.out} keeps what is done, the same command goes on from there"
            return Report({"folder": str(args.out), "interrupted": True}, text, stopped_by(interrupt))

    return run_or_stop
