"""Rates of rows at which a table is hardly longer than its states, which last whole samples."""

import math
from collections.abc import Callable, Iterable

import numpy as np

from robots.hardware.rig_table import RigTable
from robots.hardware.timeline import FASTEST_RATE, SLOWEST_RATE

LONGER = 1.02  # times a table's own length: what whole samples make of it counts from there on
_ROUNDED = 1e-6  # of a state's length [s]


def fitting_rates(table: RigTable, rate: float, seconds_at: Callable[[float], float]) -> tuple[float, ...]:
    """The next rates below and above one at which whole samples make a table hardly longer; those that there are.

    They have whole samples in the shortest state of the main, and at most three digits.

    Args:
        table: with rows at corners, and made in this process: only such a table knows its states.
        rate: at which samples make it longer [Hz].
        seconds_at: how long the table is at a rate.
    """
    shortest = min(state.end_s - state.start_s for state in table.timing if state.section == "main")
    most = math.ceil(FASTEST_RATE * shortest)
    rates = [each for number in range(1, most + 1) for each in _of_few_digits(number / shortest)]
    below = sorted((each for each in rates if SLOWEST_RATE <= each < rate), reverse=True)
    above = sorted(each for each in rates if rate < each <= FASTEST_RATE)
    found = (_first_that_fits(table, side, seconds_at) for side in (below, above))
    return tuple(each for each in found if each is not None)


def _of_few_digits(rate: float) -> tuple[float, float]:
    """A rate with three digits, rounded and rounded down."""
    digit = 10.0 ** (math.floor(math.log10(rate)) - 2)
    return float(f"{rate:.3g}"), float(f"{math.floor(rate / digit) * digit:.3g}")


def _first_that_fits(table: RigTable, rates: Iterable[float], seconds_at: Callable[[float], float]) -> float | None:
    lengths = np.array([state.end_s - state.start_s for state in table.timing])
    loops = np.array([table.loops if state.section == "main" else 1 for state in table.timing])
    for rate in rates:
        least = loops @ np.ceil((lengths - _ROUNDED) * rate) / rate  # quick, and nearly always right
        if least <= LONGER * table.seconds and seconds_at(rate) <= LONGER * table.seconds:
            return rate
    return None
