"""Sizes, durations and values of tables as text."""

from numbers import Integral, Real
from typing import Any


def spoken_size(size: int) -> str:
    """A number of bytes, such as ``34 kB`` or ``6.7 MB``."""
    return f"{size / 1e6:.1f} MB" if size >= 999_500 else f"{max(size / 1e3, 1):.0f} kB"


def spoken_duration(seconds: float) -> str:
    """A duration, such as ``3 min``, or ``0.022 s``."""
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 1.5 * length:
            amount = seconds / length
            return f"{amount:.1f} {unit}" if amount < 10 and unit != "min" else f"{amount:.0f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 1.5 else f"{seconds:.2g} s"


def cell_value(value: Any) -> str:
    """Text of a value in a table of a notebook."""
    decimal = isinstance(value, Real) and not isinstance(value, Integral)
    return f"{value:.5g}" if decimal else str(value)
