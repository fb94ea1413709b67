"""Records that are read back from files, checked against the types of a dataclass."""

import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache, partial
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from taichi_sim.base.checks import number, shown, whole_number

Record = TypeVar("Record")
# Types of fields of records, beside those of ``checks``.
Count = Annotated[int, partial(whole_number, low=0)]
Duration = Annotated[float, partial(number, low=0.0)]  # [s]
_WORDS = {int: "a whole number", float: "a finite number", str: "a text", bool: "true or false", type(None): "null"}


def checked(kind: type[Record], given: object, field: str = "") -> Record:
    """Build a dataclass of plain values from what was read from a file.

    Fields may be int, float, str, bool, None, Any, ``Literal``, lists and dictionaries of these, unions, and
    ``Annotated`` ones, see ``checks.check_fields``. A field may be a dataclass, a list or a dictionary of such.

    Args:
        kind: the dataclass.
        given: what was read.
        field: where in the file it is, for messages; empty if it is the whole.

    Raises:
        ValueError: names the field that is missing, unknown, of another type, or out of bounds.
    """
    place = f"{field}." if field else ""
    if not isinstance(given, Mapping):
        raise ValueError(f"{f'{field}: ' if field else ''}{shown(given)} is not allowed; it must be a record")
    hints = _hints(kind)  # type: ignore[arg-type]
    known = {each.name: each for each in fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            where = f"{field}: " if field else ""
            raise ValueError(f"{where}{shown(name)} is unknown; fields are {', '.join(known)}")
    for name, each in known.items():
        if name not in given and each.default is MISSING and each.default_factory is MISSING:
            raise ValueError(f"{place}{name} is missing")
    return kind(**{name: _value(hints[name], place + name, value) for name, value in given.items()})


def _value(hint: Any, name: str, value: Any) -> Any:
    """Check a value by its type, and make dataclasses of records in it."""
    origin, inner = get_origin(hint), get_args(hint)
    if is_dataclass(hint):
        return checked(hint, value, name)  # type: ignore[arg-type]
    if origin is list and is_dataclass(inner[0]) and isinstance(value, list):
        return [_value(inner[0], f"{name}[{place}]", each) for place, each in enumerate(value)]
    if origin is dict and is_dataclass(inner[1]) and isinstance(value, dict):
        return {key: _value(inner[1], f"{name}.{key}", each) for key, each in value.items()}
    if not _test_of(hint)(value):
        raise ValueError(f"{name}: {shown(value)} is not allowed; it must be {_spoken(hint)}")
    return value


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a dataclass, looked up once: a log has thousands of records of a kind."""
    return get_type_hints(kind, include_extras=True)


@cache
def _test_of(hint: Any) -> Callable[[Any], bool]:
    """A test whether a value is of a type, made once for each type."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any:
        return lambda value: True
    if origin is Annotated:
        plain, bounds = _test_of(inner[0]), inner[1:]
        return lambda value: plain(value) and all(_passes(bound, value) for bound in bounds)
    if origin is Literal:
        return lambda value: isinstance(value, str) and value in inner
    if is_dataclass(hint):
        return lambda value: False  # it is built, see _value; what reaches this is no list or table of records
    if origin in (Union, types.UnionType):
        tests = tuple(map(_test_of, inner))
        return lambda value: any(test(value) for test in tests)
    if origin is list:
        each = _test_of(inner[0])
        return lambda value: isinstance(value, list) and all(map(each, value))
    if origin is dict:
        of_value = _test_of(inner[1])
        return lambda value: (
            isinstance(value, dict) and all(isinstance(n, str) and of_value(v) for n, v in value.items())
        )
    if hint is float:
        return _is_number
    return lambda value: isinstance(value, hint) and not (hint is int and isinstance(value, bool))


def _passes(check: Callable[..., object], value: object) -> bool:
    try:
        check("", value)
    except ValueError:
        return False
    return True


def _is_number(value: object) -> bool:
    """Whether a value is finite as a float; JSON writes 1.0 as 1."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) < 2**1023


def _spoken(hint: Any) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _spoken(inner[0]) + "".join(map(_spoken_bounds, inner[1:]))
    if origin is Literal:
        return f"one of {', '.join(inner)}"
    if is_dataclass(hint):
        return "a record"
    if origin in (Union, types.UnionType):
        return " or ".join(map(_spoken, inner))
    if origin is list:
        return f"a list, each {_spoken(inner[0])}"
    if origin is dict:
        return "a table" if inner[1] is Any else f"a table, each {_spoken(inner[1])}"
    return _WORDS.get(hint, str(hint))


def _spoken_bounds(check: Any) -> str:
    """Bounds of a check in words, after the name of a type."""
    bounds = getattr(check, "keywords", {})
    low = f", at least {bounds['low']:g}" if "low" in bounds else ", above 0" if "positive" in str(check) else ""
    return low + (f", at most {bounds['high']:g}" if "high" in bounds else "")
