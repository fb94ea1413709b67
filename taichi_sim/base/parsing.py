"""Parses texts of JSON and TOML; what is nested too deep for functions that recurse is refused, like other damage."""

import json
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from taichi_sim.base.checks import shown

DEEPEST = 200  # levels of lists and tables, or of elements; functions that walk along them recurse


class RepeatedNameError(ValueError):
    """A JSON object gives a name twice, so its value is ambiguous."""


def parse_json(text: str | bytes, constant: Callable[[str], Any] | None = None) -> Any:
    """Parse a text of JSON.

    Args:
        text: the content of a file, or a part of one.
        constant: makes values of ``NaN`` and the infinities, which are no JSON; floats if none is given.

    Raises:
        RepeatedNameError: for a record that gives a name twice.
        ValueError: if it is no JSON, or nested too deep.
    """
    return _parsed(lambda: json.loads(text, parse_constant=constant, object_pairs_hook=_record))


def parse_toml(content: str | bytes) -> dict[str, Any]:
    """Parse TOML: a text, or the content of a file, before which editors may have put a mark of byte order.

    Raises:
        ValueError: if it is no text, no TOML, or nested too deep.
    """
    text = content if isinstance(content, str) else content.decode("utf-8-sig")
    found: dict[str, Any] = _parsed(lambda: tomllib.loads(text))
    return found


def _record(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise RepeatedNameError(f"{shown(twice)} is given twice, which is not allowed; give it once")
    return record


def _parsed(parse: Callable[[], Any]) -> Any:
    """What a parser makes of its text, unless lists and tables are nested too deep in it."""
    too_deep = f"more than {DEEPEST} lists and tables in each other are not allowed"
    try:
        found = parse()
    except RecursionError:
        raise ValueError(too_deep) from None
    level: list[dict[str, Any] | list[Any]] = [[found]]
    for _ in range(DEEPEST + 1):
        level = [inner for each in level for inner in _inside(each) if isinstance(inner, dict | list)]
        if not level:
            return found
    raise ValueError(too_deep)


def _inside(nest: dict[str, Any] | list[Any]) -> Iterable[Any]:
    return nest.values() if isinstance(nest, dict) else nest


def json_text(described: Any) -> str:
    """Write a description as JSON: arrays as lists, and what JSON does not know as its text."""
    return json.dumps(described, default=lambda value: getattr(value, "tolist", lambda: str(value))())
