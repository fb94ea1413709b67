"""Checks of what comes from outside: one line that names field, value and what is allowed, or what to install."""

import contextlib
import math
from collections.abc import Collection

import numpy as np

LONGEST_SHOWN = 100  # characters of a value in a message


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
    elif unit:
        allowed += " of"
    raise ValueError(f"{field}: {_shown(value)} is not allowed; give {allowed} {unit}".rstrip())


def whole_number(field: str, value: object, low: int, high: int = 2**63 - 1) -> int:
    """The value as an int from ``low`` to ``high``, both included; a float must be whole.

    Raises:
        ValueError: in one line, for anything else.
    """
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        found: int | None = int(value)  # as a float it would lose digits
    else:
        finite = _finite(value)
        found = int(finite) if finite is not None and finite.is_integer() else None
    if found is None or found < low:
        raise ValueError(f"{field}: {_shown(value)} is not allowed; give a whole number, at least {low}")
    if found > high:
        raise ValueError(f"{field}: {_shown(value)} is not allowed; give a whole number, at most {high}")
    return found


def choice(field: str, value: object, names: Collection[str]) -> str:
    """The value, which must be one of some names.

    Raises:
        ValueError: in one line, for anything else.
    """
    if isinstance(value, str) and value in names:
        return value
    raise ValueError(f"{field}: {_shown(value)} is unknown; choose one of {', '.join(names)}")


def install_extra(name: str) -> str:
    """What to do where something is missing that an extra of morpholab brings."""
    return f"install the extra {name} (pip install -e '.[{name}]' in a clone)"


def _finite(value: object) -> float | None:
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # of whole numbers that no float can be
            return float(value) if math.isfinite(value) else None
    return None


def _shown(value: object) -> str:
    """A value as messages show it: its beginning if it is long."""
    try:
        text = repr(value)
    except ValueError:  # Python writes out no number of that many digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
