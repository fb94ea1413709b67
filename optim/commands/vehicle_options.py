"""Options of commands about Braitenberg vehicles."""

import argparse
from typing import Any

from optim.commands import options
from optim.commands.options import Option, count

# Without them the environments and their simulation are the published ones.
TASK = (
    Option("radius", "of success (default: 0.075)", options.number(unit="m"), "M"),
    Option("time_step", "of Euler's method (default: 0.05)", options.number(unit="s"), "S"),
    count("steps", 1, "of a rollout (default: 10000)"),
)
SIMULATION = {"task and simulation": (*TASK, options.precision("f64", "f64"), options.THREADS)}


def task_settings(args: argparse.Namespace) -> dict[str, Any]:
    """The settings of radius, time step and steps that were given, by name."""
    return options.given(TASK, args)


def design_numbers(text: str) -> list[int]:
    """Numbers of bodies of the published grid, ascending: ``162,6553``, ``1-100`` or ``all``.

    Raises:
        ValueError: for anything else, as types of arguments do.
    """
    from robots.braitenberg import DESIGNS  # slow to import

    if text == "all":
        return list(range(1, DESIGNS + 1))
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ValueError(f"designs: {text!r} is not allowed; give numbers such as 162,6553 or 1-100, or all")
        low, high = int(first), int(last or first)
        if not 1 <= low <= high <= DESIGNS:
            raise ValueError(f"designs: {part.strip()} is not allowed; give numbers from 1 to {DESIGNS}")
        found.update(range(low, high + 1))
    return sorted(found)


def designs_option(required: bool = False) -> Option:
    """The option that names bodies of the published grid."""
    told = "bodies of the published grid, from 1 to 6561: 162,6553 or 1-100, or all"
    return Option("designs", told, options.checked(design_numbers), "NUMBERS", required=required)
