"""Which fields of a terrain a kind of robot takes, and what is said of those that it does not."""

import dataclasses
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robots.world import Terrain

LEAVE_OUT = "; leave it out"
NOTHING: Mapping[str, str] = MappingProxyType({})


def about(refused: str = LEAVE_OUT, *, later: bool = False, shown: Callable[[Any], str] = str) -> dict[str, Any]:
    """What is known of a field of a terrain, as metadata of a dataclass.

    Args:
        refused: how a message ends, after "is not allowed", for robots that do not take it.
        later: whether the first versions did not have it, so that records have it only where it is given.
        shown: its value in a message.
    """
    return {"refused": refused, "later": later, "shown": shown}


def not_taken(terrain: "Terrain", taken: Collection[str]) -> list[str]:
    """The fields that a terrain gives, and that are not among those that are taken."""
    given = (
        each for each in dataclasses.fields(terrain) if each.compare and getattr(terrain, each.name) != each.default
    )
    return [each.name for each in given if each.name not in taken]


def check_taken(terrain: "Terrain", taken: Collection[str], refused: Mapping[str, str] = NOTHING) -> None:
    """Refuse a terrain that gives what robots do not take.

    Args:
        terrain: on which they are.
        taken: the fields that they take.
        refused: how the messages about some fields end, where a kind says more than :func:`about` does.

    Raises:
        ValueError: that names the first field that is not taken.
    """
    described = {each.name: each.metadata for each in dataclasses.fields(terrain)}
    for name in not_taken(terrain, taken):
        told = described[name].get("shown", str)(getattr(terrain, name))
        end = refused.get(name, described[name].get("refused", LEAVE_OUT))
        raise ValueError(f"{name}: {told} is not allowed{end}")
