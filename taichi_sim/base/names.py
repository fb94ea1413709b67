"""Names and patterns of names, such as ``thigh*``, by which users choose among what has a name."""

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TypeVar

Value = TypeVar("Value")


def matching(pattern: str, names: Sequence[str]) -> list[int]:
    """Return which names a pattern is of: the one that is spelled so, else all that match it as file names do."""
    exact = pattern in names
    return [n for n, name in enumerate(names) if name == pattern or (not exact and fnmatchcase(name, pattern))]


def choices_of(field: str, noun: str, names: Sequence[str], patterns: Iterable[str]) -> list[int]:
    """Return which of some patterns each name has, -1 for none; what has an empty name is not to be chosen.

    Raises:
        ValueError: for a pattern that no name has, and two of one name; it begins with the field.
    """
    given, which = list(patterns), [-1] * len(names)
    for number, pattern in enumerate(given):
        found = [n for n in matching(pattern, names) if names[n]]
        if not found:
            known = ", ".join(filter(None, names))
            told = f"give one of {known}, or a pattern of them" if known else "the robot has none"
            raise ValueError(f"{field}: {pattern!r} is no {noun}; {told}")
        for n in found:
            if which[n] >= 0:
                both = f"{given[which[n]]!r} and {pattern!r} are both {names[n]}"
                raise ValueError(f"{field}: {both}; give each {noun} once")
            which[n] = number
    return which


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
