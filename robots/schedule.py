"""Forwards to ``robots.inflatable.schedule``: the import path of version 1.0."""

from robots.inflatable.schedule import (
    BLADDERS,
    FEET,
    MOST_COLUMNS,
    MOST_REPEATS,
    ROWS,
    GaitSchedule,
)

__all__ = [
    "BLADDERS",
    "FEET",
    "MOST_COLUMNS",
    "MOST_REPEATS",
    "ROWS",
    "GaitSchedule",
]
