"""Checks of values from outside; each raises a ValueError that names field, value and what is allowed."""

import contextlib
import difflib
import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

LONGEST_SHOWN = 100  # characters of a value in a message


def number(field: str, value: object, low: float = -math.inf, high: float = math.inf, unit: str = "") -> float:
    """Check that a value is a finite number from ``low`` to ``high``, and return it as a float.

    Raises:
        ValueError: if it is anything else, such as a text, a truth value or NaN.
    """
    if (finite := _finite(value)) is not None and low <= finite <= high:
        return finite
    if -math.inf < low <= high < math.inf:
        allowed = f"a number from {low:g} to {high:g}"
    elif low > -math.inf:
        allowed = f"a finite number, at least {low:g}"
    else:
        allowed = "a finite number of" if unit else "a finite number"
    raise ValueError(f"{field}: {_shown(value)} is not allowed; give {allowed} {unit}".rstrip())


def whole_number(field: str, value: object, low: int, high: int = 2**63 - 1) -> int:
    """Check that a value is a whole number from ``low`` to ``high``; floats such as 2.0 are allowed.

    Raises:
        ValueError: if it is anything else.
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


def integer(field: str, value: object, low: int, high: int = 2**31 - 1) -> int:
    """Check that a value is an int from ``low`` to ``high``; floats are refused.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, float | np.floating):
        raise ValueError(f"{field}: {_shown(value)} is not allowed; give a whole number, at least {low}")
    return whole_number(field, value, low, high)


def positive(field: str, value: object, high: float) -> float:
    """Check that a value is a number above 0 and at most ``high``, and return it as a float.

    Raises:
        ValueError: if it is anything else.
    """
    if (finite := _finite(value)) is not None and 0 < finite <= high:
        return finite
    raise ValueError(f"{field}: {_shown(value)} is not allowed; give a positive number, at most {high:g}")


def flag(field: str, value: object) -> bool:
    """Check that a value is true or false.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, bool):
        return value
    raise ValueError(f"{field}: {_shown(value)} is not allowed; give true or false")


def table(field: str, value: object) -> Mapping[Any, Any]:
    """Check that a value is a mapping, such as a table of TOML.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, Mapping):
        return value
    raise ValueError(f"{field}: {_shown(value)} is not allowed; give values by name")


def choice(field: str, value: object, names: Collection[str]) -> str:
    """Check that a value is one of the allowed names.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, str) and value in names:
        return value
    raise ValueError(f"{field}: {_shown(value)} is unknown; choose one of {', '.join(names)}")


def nearest(name: str, known: Iterable[str]) -> str:
    """End of a message about an unknown name: ``; did you mean ...?`` if a known name is close, else nothing."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def install_extra(name: str) -> str:
    """Text for messages: how to install an optional dependency group of morpholab."""
    return f"install the extra {name} (pip install -e '.[{name}]' in a clone)"


def _finite(value: object) -> float | None:
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # an int beyond the range of floats
            return float(value) if math.isfinite(value) else None
    return None


def _shown(value: object) -> str:
    """Text of a value, cut off if it is long."""
    try:
        text = repr(value)
    except ValueError:  # more digits than Python writes out
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
