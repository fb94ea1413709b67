"""Names and patterns of names, such as ``thigh*``, by which users choose among what has a name."""

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TypeVar

Value = TypeVar("Value")


def matching(pattern: str, names: Sequence[str]) -> list[int]:
    """Return which names a pattern is of: the one that is spelled so, else all that match it as file names do."""
    exact = pattern in names
    return [n for n, name in enumerate(names) if name == pattern or (not exact and fnmatchcase(name, pattern))]


def joined(field: str, given: Iterable[Mapping[str, Value]]) -> dict[str, Value]:
    """Values by names or patterns that were given one by one.

    Raises:
        ValueError: for two of one name; it begins with the field.
    """
    found: dict[str, Value] = {}
    for each in given:
        if not isinstance(each, Mapping):
            raise ValueError(f"{field}: {each!r} is not allowed; give values by names")
        if twice := [name for name in each if name in found]:
            raise ValueError(f"{field}: {twice[0]!r} is given twice; give each name once")
        found |= each
    return found
