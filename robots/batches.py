"""Which robots in different worlds can share a batch, and how what belongs to each of them becomes one array."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import fields
from itertools import groupby
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from robots.robot import Progress, part_of
from robots.world import FRICTION_FIELDS, MATERIAL_FRICTION, Terrain

if TYPE_CHECKING:
    from taichi_sim.lattice import Material

Owner = TypeVar("Owner")
Found = TypeVar("Found")
_OF_EACH = ("slope", "ground", "light", "folder")  # what may differ between the terrains of a batch
_RUBBING = (*FRICTION_FIELDS, *MATERIAL_FRICTION)  # and this, too, where there are no props
_OF_ALL = tuple(each.name for each in fields(Terrain) if each.name not in (*_OF_EACH, *_RUBBING))


def runs_of(owners: Sequence[Owner]) -> Iterator[tuple[Owner, slice]]:
    """Each owner, with the slice of consecutive rows that belong to it."""
    begin = 0
    for _, rows in groupby(owners, key=id):
        alike = list(rows)
        yield alike[0], slice(begin, begin + len(alike))
        begin += len(alike)


def of_each(owners: Sequence[Owner], function: Callable[..., Any], *arrays: Any) -> Any:
    """Join what a function makes of each owner and of its rows of arrays, which may be traced, along the first axis.

    The function gives an array, or several as a tuple.
    """
    parts = [function(owner, *(each[rows] for each in arrays)) for owner, rows in runs_of(owners)]
    if len(parts) == 1:
        return parts[0]
    if isinstance(parts[0], tuple):
        return tuple(np.concatenate(each) for each in zip(*parts, strict=True))
    return np.concatenate(parts)


def grouped(keys: Iterable[Hashable]) -> list[list[int]]:
    """Numbers of the keys that are equal, group by group, in the order in which they come."""
    groups: dict[Hashable, list[int]] = {}
    for number, key in enumerate(keys):
        groups.setdefault(key, []).append(number)
    return list(groups.values())


def in_groups(
    groups: Sequence[Sequence[int]],
    progress: Progress | None,
    run: Callable[[Sequence[int], Progress | None], Iterable[Found]],
) -> list[Found]:
    """Run group after group, and give what is found of each member in the order of their numbers.

    Args:
        groups: numbers of the members, each of which is in one group.
        progress: of all of them.
        run: gives what is found of the members of a group, in their order; told how far the group is.
    """
    found, count = dict[int, Found](), sum(map(len, groups))
    for group in groups:
        found |= zip(group, run(group, part_of(progress, len(found), count, len(group))), strict=True)
    return [found[number] for number in range(count)]


def batch_key(terrain: Terrain, materials: "Iterable[Material]" = ()) -> Hashable:
    """A key that is equal for terrains on which robots of these materials can share a batch.

    It holds all but slope, ground, light and friction, and which laws what is on the ground has, such as water; among
    props, friction, too.
    """
    named = (*_OF_ALL, *_RUBBING) if terrain.props else _OF_ALL
    pairs = tuple((m.static_friction, m.kinetic_friction) for m in materials) if terrain.props else ()
    laws = frozenset(ground.laws) if (ground := terrain.uneven) else frozenset()
    return tuple(getattr(terrain, name) for name in named), pairs, laws
