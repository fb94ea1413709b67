"""The list of cases, and how one is added to it."""

import fnmatch
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """Something to compute in either tree.

    Attributes:
        name: its group, a slash, and what it is.
        compute: gives arrays by name.
        quick: whether ``--quick`` runs it.
    """

    name: str
    compute: Callable[[], Mapping[str, Any]]
    quick: bool


CASES: dict[str, Case] = {}


def case(name: str, *arguments: Any, quick: bool = False) -> Callable[[Callable], Callable]:
    """Add a case: the function below, called with these arguments."""

    def add(compute: Callable) -> Callable:
        if name in CASES:
            raise ValueError(f"case {name} is there twice")
        CASES[name] = Case(name, lambda: compute(*arguments), quick)
        return compute

    return add


def chosen(only: Iterable[str], quick: bool) -> list[str]:
    """Names of the cases to run: all, the quick ones, or those that a name, group or pattern of ``only`` means.

    Raises:
        ValueError: in one line, for a name of no case.
    """
    only = list(only)
    for pattern in only:
        if not any(matches(name, pattern) for name in CASES):
            raise ValueError(f"only: {pattern!r} is no case, group or pattern; --list names them")
    return [
        name
        for name, one in CASES.items()
        if (any(matches(name, pattern) for pattern in only) if only else one.quick or not quick)
    ]


def matches(name: str, pattern: str) -> bool:
    """Whether a case is meant by its name, its group or a pattern."""
    return name == pattern or name.split("/")[0] == pattern or fnmatch.fnmatchcase(name, pattern)


def arrays_of(thing: Any, *names: str, prefix: str = "") -> Arrays:
    """Attributes by name as arrays; nested ones by dots, and those that are None left out."""
    found: Arrays = {}
    for name in names:
        value = thing
        for part in name.split("."):
            value = None if value is None else getattr(value, part)
        if value is not None:
            found[prefix + name] = plain(value)
    return found


def plain(value: Any) -> np.ndarray:
    """A value as an array that a file takes without pickling: text for objects."""
    array = np.asarray(value)
    return array.astype(str) if array.dtype == object else array


def as_bytes(content: bytes) -> np.ndarray:
    """A file's content as an array."""
    return np.frombuffer(content, np.uint8)
