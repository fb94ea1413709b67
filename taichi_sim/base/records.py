"""Records that are read back from files, checked against the types of a dataclass."""

import math
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from taichi_sim.base.checks import shown

Record = TypeVar("Record")
_WORDS = {int: "a whole number", float: "a finite number", str: "a text", bool: "true or false", type(None): "null"}


def checked(kind: type[Record], given: object) -> Record:
    """Build a dataclass of plain values from what was read from a file.

    Fields may be int, float, str, bool, None, Any, lists and dictionaries of these, and unions.

    Raises:
        ValueError: names the field that is missing, unknown, or of another type.
    """
    if not isinstance(given, Mapping):
        raise ValueError(f"{shown(given)} is not allowed; it must be a record")
    hints = _hints(kind)  # type: ignore[arg-type]
    known = {each.name: each for each in fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            raise ValueError(f"{shown(name)} is unknown; fields are {', '.join(known)}")
    for name, field in known.items():
        if name not in given:
            if field.default is MISSING and field.default_factory is MISSING:
                raise ValueError(f"{name} is missing")
        elif not _test_of(hints[name])(given[name]):
            raise ValueError(f"{name}: {shown(given[name])} is not allowed; it must be {_spoken(hints[name])}")
    return kind(**given)


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a dataclass, looked up once: a log has thousands of records of a kind."""
    return get_type_hints(kind)


@cache
def _test_of(hint: Any) -> Callable[[Any], bool]:
    """A test whether a value is of a type, made once for each type."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any:
        return lambda value: True
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


def _is_number(value: object) -> bool:
    """Whether it is finite as a float; JSON writes 1.0 as 1."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 2**1023 and math.isfinite(value)


def _spoken(hint: Any) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(map(_spoken, inner))
    if origin is list:
        return f"a list, each {_spoken(inner[0])}"
    if origin is dict:
        return "a table" if inner[1] is Any else f"a table, each {_spoken(inner[1])}"
    return _WORDS.get(hint, str(hint))
