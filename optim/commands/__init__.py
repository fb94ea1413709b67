"""The commands of ``morpholab``, one a file. They import what is heavy only when they run."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Report:
    """What a command has to say.

    Attributes:
        document: for machines, fits JSON.
        text: for people.
        failed: whether the work, not the input, was at fault.
    """

    document: dict[str, Any]
    text: str
    failed: bool = False
