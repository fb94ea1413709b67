"""Checks of what comes from outside: one line that names field, value and what is allowed, or what to install."""

import math

import numpy as np


def number(field: str, value: object, low: float = -math.inf, high: float = math.inf, unit: str = "") -> float:
    """The value as a finite float between ``low`` and ``high``, both included.

    Raises:
        ValueError: in one line, for anything else (text, truth values and NaN included).
    """
    if (finite := _finite(value)) is not None and low <= finite <= high:
        return finite
    allowed = "a finite number"
    if low > -math.inf:
        allowed += f", at least {low:g}" if high == math.inf else f" from {low:g} to {high:g}"
    raise ValueError(f"{field}: {value!r} is not allowed; give {allowed} {unit}".rstrip())


def whole_number(field: str, value: object, low: int) -> int:
    """The value as an int of at least ``low``; a float must be whole.

    Raises:
        ValueError: in one line, for anything else.
    """
    if (finite := _finite(value)) is not None and finite.is_integer() and finite >= low:
        return int(finite)
    raise ValueError(f"{field}: {value!r} is not allowed; give a whole number, at least {low}")


def install_extra(name: str) -> str:
    """What to do where something is missing that an extra of morpholab brings."""
    return f"install the extra {name} (pip install -e '.[{name}]' in a clone)"


def _finite(value: object) -> float | None:
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        return float(value) if math.isfinite(value) else None
    return None
