"""Which of the eight places of the inflatable robot have a bladder, and which such layouts are one body.

Bladders 1 to 4 lie on top of the pouch, in order of x; 8 to 5 lie underneath in the same columns. A place without a
bladder keeps its number: rows of schedules, columns of tables and lines of rigs stay eight, and nothing fills it.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from robots.hardware.lines import BLADDERS
from taichi_sim.base.arrays import Bools
from taichi_sim.base.checks import shown, whole_number

Layout = tuple[int, ...]  # places that have a bladder, of 1 to 8, ascending
EVERY_BLADDER: Layout = tuple(range(1, BLADDERS + 1))
TOP_BLADDERS = BLADDERS // 2  # places on top; the others are underneath
# Where the bladder of each place is when the robot is laid in another way, in the order 1 to 8: as it is, turned round
# (left and right change), upside down along its length (top and bottom change), and both.
WAYS_TO_LIE: dict[str, Layout] = {
    "as built": EVERY_BLADDER,
    "turned round": (4, 3, 2, 1, 8, 7, 6, 5),
    "upside down": (8, 7, 6, 5, 4, 3, 2, 1),
    "both": (5, 6, 7, 8, 1, 2, 3, 4),
}


def checked_layout(field: str, given: object) -> Layout:
    """Places that have a bladder as ascending numbers; none at all is allowed.

    Raises:
        ValueError: for anything else than a sequence of places, each named once.
    """
    allowed = f"give places from 1 to {BLADDERS}, none twice"
    if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray):
        raise ValueError(f"{field}: {shown(given)} is not allowed; {allowed}")
    places = [whole_number(field, one, 1, BLADDERS) for one in given]
    if len(set(places)) < len(places):
        raise ValueError(f"{field}: {told_layout(places)} is not allowed; {allowed}")
    return tuple(sorted(places))


def check_every_bladder(layout: Layout, where: str) -> None:
    """Refuse a body that lacks a bladder, for what drives all of them.

    Raises:
        ValueError: that says which bladders there are, and where all are needed.
    """
    if layout != EVERY_BLADDER:
        raise ValueError(f"bladders: {told_layout(layout)} is not allowed {where}; give a geometry with all eight")


def told_layout(layout: Iterable[int]) -> str:
    """A layout in words, such as ``"1,4,6"``, as commands take it; ``"none"`` of a body without bladders."""
    return ",".join(map(str, layout)) or "none"


def layout_of(text: str) -> Layout:
    """The layout of such words.

    Raises:
        ValueError: if they are anything else.
    """
    return () if text.strip() == "none" else checked_layout("bladders", [_place(part) for part in text.split(",")])


def _place(text: str) -> object:
    return int(text) if text.strip().isdecimal() else text


def layout_mask(layout: Layout) -> Bools:
    """Which of the eight places have a bladder, shape (8,)."""
    return np.isin(EVERY_BLADDER, layout)


def layout_from_mask(has_bladder: ArrayLike) -> Layout:
    """The layout of such a mask."""
    return tuple(place for place, has in zip(EVERY_BLADDER, np.asarray(has_bladder, bool), strict=True) if has)


def laid(layout: Layout, way: str) -> Layout:
    """The layout after the body is turned over or round, in one of ``WAYS_TO_LIE``."""
    return tuple(sorted(WAYS_TO_LIE[way][place - 1] for place in layout))


def different_layouts() -> list[Layout]:
    """One layout of each body that differs from all others however it is laid, by the number of bladders; 76 of 256.

    Of the layouts of a body it is the first in order.
    """
    every = (layout for count in range(BLADDERS + 1) for layout in combinations(EVERY_BLADDER, count))
    return [layout for layout in every if layout == min(laid(layout, way) for way in WAYS_TO_LIE)]
