"""Records that are read back from files, checked against the types of a dataclass."""

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from taichi_sim.base.checks import LONGEST_SHOWN

Record = TypeVar("Record")
_WORDS = {int: "a whole number", float: "a finite number", str: "a text", bool: "true or false", type(None): "null"}


def checked(kind: type[Record], given: object) -> Record:
    """Build a dataclass of plain values from what was read from a file.

    Fields may be int, float, str, bool, None, Any, lists and dictionaries of these, and unions.

    Raises:
        ValueError: names the field that is missing, unknown, or of another type.
    """
    if not isinstance(given, Mapping):
        raise ValueError(f"{_shown(given)} is not allowed; it must be a record")
    hints = get_type_hints(kind)
    known = {each.name: each for each in fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name not in known:
            raise ValueError(f"{_shown(name)} is unknown; fields are {', '.join(known)}")
    for name, field in known.items():
        if name not in given:
            if field.default is MISSING and field.default_factory is MISSING:
                raise ValueError(f"{name} is missing")
        elif not _fits(given[name], hints[name]):
            raise ValueError(f"{name}: {_shown(given[name])} is not allowed; it must be {_spoken(hints[name])}")
    return kind(**given)


def _fits(value: object, hint: Any) -> bool:
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(_fits(value, each) for each in inner)
    if origin is list:
        return isinstance(value, list) and all(_fits(each, inner[0]) for each in value)
    if origin is dict:
        return isinstance(value, dict) and all(isinstance(n, str) and _fits(v, inner[1]) for n, v in value.items())
    if hint is float:  # JSON writes 1.0 as 1
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and abs(value) < 2**1023 and math.isfinite(value)  # type: ignore[arg-type]
    return isinstance(value, hint) and not (hint is int and isinstance(value, bool))


def _spoken(hint: Any) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(map(_spoken, inner))
    if origin is list:
        return f"a list, each {_spoken(inner[0])}"
    if origin is dict:
        return "a table" if inner[1] is Any else f"a table, each {_spoken(inner[1])}"
    return _WORDS.get(hint, str(hint))


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
