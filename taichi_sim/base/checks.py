"""Checks of values from outside; each raises a ValueError that names field, value and what is allowed."""

import contextlib
import difflib
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields
from functools import partial
from inspect import Parameter, signature
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats

Made = TypeVar("Made")

LONGEST_SHOWN = 100  # characters of a value in a message
MOST_FRICTION = 1e6  # of coefficients, which f32 still squares
STEEPEST_GROUND = 80.0  # degrees; walls are what they are on the grid, no steeper
MOST_LISTED = 12  # names in a message


def number(field: str, value: object, low: float = -math.inf, high: float = math.inf, unit: str = "") -> float:
    """Check that a value is a finite number from ``low`` to ``high``, and return it as a float.

    Raises:
        ValueError: if it is anything else, such as a text, a truth value or NaN.
    """
    if (found := finite(value)) is not None and low <= found <= high:
        return found
    if -math.inf < low <= high < math.inf:
        allowed = f"a number from {low:g} to {high:g}"
    elif low > -math.inf:
        allowed = f"a finite number, at least {low:g}"
    elif high < math.inf:
        allowed = f"a finite number, at most {high:g}"
    else:
        allowed = "a finite number of" if unit else "a finite number"
    raise ValueError(f"{field}: {shown(value)} is not allowed; give {allowed} {unit}".rstrip())


def whole_number(field: str, value: object, low: int, high: int = 2**63 - 1) -> int:
    """Check that a value is a whole number from ``low`` to ``high``; floats such as 2.0 are allowed.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        found: int | None = int(value)  # as a float it would lose digits
    else:
        real = finite(value)
        found = int(real) if real is not None and real.is_integer() else None
    if found is None or found < low:
        raise ValueError(f"{field}: {shown(value)} is not allowed; give a whole number, at least {low}")
    if found > high:
        raise ValueError(f"{field}: {shown(value)} is not allowed; give a whole number, at most {high}")
    return found


def integer(field: str, value: object, low: int, high: int = 2**31 - 1) -> int:
    """Check that a value is an int from ``low`` to ``high``; floats are refused.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, float | np.floating):
        raise ValueError(f"{field}: {shown(value)} is not allowed; give a whole number, at least {low}")
    return whole_number(field, value, low, high)


def positive(field: str, value: object, high: float = math.inf) -> float:
    """Check that a value is a number above 0 and at most ``high``, and return it as a float.

    Raises:
        ValueError: if it is anything else.
    """
    if (found := finite(value)) is not None and 0 < found <= high:
        return found
    allowed = "a positive finite number" if high == math.inf else f"a positive number, at most {high:g}"
    raise ValueError(f"{field}: {shown(value)} is not allowed; give {allowed}")


def flag(field: str, value: object) -> bool:
    """Check that a value is true or false.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, bool):
        return value
    raise ValueError(f"{field}: {shown(value)} is not allowed; give true or false")


def instance(field: str, value: Any, kind: type, example: str) -> Any:
    """The value, if it is of a type.

    Raises:
        ValueError: naming the field, the value and an example otherwise.
    """
    if not isinstance(value, kind):
        raise ValueError(f"{field}: {shown(value)} is not allowed; give a {kind.__name__}, such as {example}")
    return value


def table(field: str, value: object) -> Mapping[Any, Any]:
    """Check that a value is a mapping, such as a table of TOML.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, Mapping):
        return value
    raise ValueError(f"{field}: {shown(value)} is not allowed; give values by name")


def known_names(record: Mapping[str, Any], *known: str) -> None:
    """Refuse names that a record should not have, as what is misspelt would silently count for nothing.

    Raises:
        ValueError: for the first such name.
    """
    for name in record:
        if name not in known:
            listed = ", ".join(known[:MOST_LISTED]) + ", ..." * (len(known) > MOST_LISTED)
            allowed = f"choose one of {listed}{nearest(name, known)}" if known else "leave it out"
            raise ValueError(f"{shown(name)[1:-1]}: it is unknown; {allowed}")


def built(make: Callable[..., Made], record: Mapping[str, Any]) -> Made:
    """What a class makes of a record with a value for each of its fields.

    Raises:
        ValueError: for a name that is no field, and for a field without default that is missing.
    """
    known = signature(make).parameters
    known_names(record, *known)
    for name, parameter in known.items():
        if parameter.default is Parameter.empty and name not in record:
            raise ValueError(f"{name}: it is missing")
    return make(**record)


def choice(field: str, value: object, names: Collection[str]) -> str:
    """Check that a value is one of the allowed names.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, str) and value in names:
        return value
    raise ValueError(f"{field}: {shown(value)} is unknown; choose one of {', '.join(names)}")


def numbers(field: str, value: object, *shape: int | str) -> Floats:
    """Check that a value is an array of finite numbers of this shape, and return a copy.

    Args:
        field: named in messages.
        value: an array, or sequences in each other.
        shape: the length of each axis; a name such as ``"B"`` allows any length of at least 1.

    Raises:
        ValueError: if it is anything else.
    """
    wanted = f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
    try:
        found = np.array(real_array(value), order="C")  # rounding depends on the order in which numbers lie
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field}: {shown(value)} is not allowed; give numbers of shape {wanted}") from None
    fits = found.ndim == len(shape) and all(
        length == size or (isinstance(length, str) and size > 0)
        for length, size in zip(shape, found.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{field}: shape {found.shape} is not allowed; give {wanted}")
    if not np.isfinite(found).all():
        raise ValueError(f"{field}: {found[~np.isfinite(found)][0]} is not allowed; give finite numbers")
    return found


def within(field: str, found: NDArray[Any], low: float, high: float) -> None:
    """Check that every number of an array is from ``low`` to ``high``, so none is NaN.

    Raises:
        ValueError: if one is not; the message shows the first such number.
    """
    outside = ~((found >= low) & (found <= high))
    if outside.any():
        allowed = f"whole numbers from {low:g} to {high:g}" if found.dtype.kind in "iu" else f"{low:g} to {high:g}"
        raise ValueError(f"{field}: {found[outside][0]} is not allowed; give {allowed}")


def real_array(value: object) -> Floats:
    """A value as an array of floats of any shape: an array, sequences in each other, or a number.

    Raises:
        TypeError, ValueError, OverflowError: for texts, truth values, complex numbers, and sequences that fit no array.
    """
    found = np.asarray(value)
    texts = found.dtype.kind == "O" and any(isinstance(each, str | bytes) for each in found.flat)
    if found.dtype.kind not in "iufO" or texts or _holds_truth(value):
        raise TypeError("texts, truth values and complex numbers are no numbers here")
    return np.asarray(value, float)


def on_off(value: object) -> object:
    """Truth values as the numbers 0.0 and 1.0, which :func:`numbers` takes; any other value as it is."""
    with contextlib.suppress(ValueError):  # of rows of several lengths
        if np.asarray(value).dtype == bool:
            return np.asarray(value, float)
    return value


# Types of fields for :func:`check_fields`.
Finite = Annotated[float, number]
Positive = Annotated[float, positive]
NotNegative = Annotated[float, partial(number, low=0.0)]
Friction = Annotated[float, partial(number, low=0.0, high=MOST_FRICTION)]  # a coefficient, or a factor of one


def check_fields(described: Any) -> None:
    """Check the fields of a dataclass by their types, and replace each value by what its check returns.

    An ``Annotated`` type names its check: a function of the field's name and its value, such as those of this module.
    A ``Literal`` type allows the texts that it lists. None is allowed where it is the default::

        @dataclass(frozen=True)
        class Disk:
            radius: Positive
            slope: Annotated[float, partial(number, low=-80.0, high=80.0, unit="degrees")] = 0.0
            corners: Annotated[int, partial(whole_number, low=3)] = 100
            surface: Literal["smooth", "rough"] | None = None

            def __post_init__(self) -> None:
                check_fields(self)

    Raises:
        ValueError: if a value is not allowed; the message is that of its check.
    """
    for each in fields(described):
        value = getattr(described, each.name)
        if value is None and each.default is None:
            continue
        for kind in (each.type, *get_args(each.type)):  # those of ``Positive | None``, too
            if get_origin(kind) is Literal:
                choice(each.name, value, get_args(kind))
            for check in getattr(kind, "__metadata__", ()):
                object.__setattr__(described, each.name, check(each.name, value))


def nearest(name: object, known: Iterable[str]) -> str:
    """End of a message about an unknown name: ``; did you mean ...?`` if a known name is close, else nothing."""
    close = difflib.get_close_matches(str(name), list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def shown(value: object) -> str:
    """Text of a value in one line, cut off if it is long."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # more digits than Python writes out
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def finite(value: object) -> float | None:
    """A value as a float if it is a finite number, else None; a truth value is none."""
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # an int beyond the range of floats
            return float(value) if math.isfinite(value) else None
    return None


def _holds_truth(value: object) -> bool:
    """Whether a truth value is anywhere in arrays and sequences in each other; NumPy makes a number of it."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind == "b" or (value.dtype.kind == "O" and any(map(_holds_truth, value.flat)))
    if isinstance(value, list | tuple):
        if set(map(type, value)) <= {int, float}:  # of long lists quickly
            return False
        return any(_holds_truth(each) for each in value)
    return isinstance(value, bool | np.bool_)
