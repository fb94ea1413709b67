"""Options of commands about Braitenberg vehicles."""

import argparse
from typing import Any

from optim.commands import options


def add_vehicle_task(parser: argparse.ArgumentParser) -> None:
    """Options about the environments and their simulation; without them they are the published ones."""
    group = parser.add_argument_group("task and simulation")
    group.add_argument("--radius", type=options.number(unit="m"), metavar="M", help="of success (default: 0.075)")
    group.add_argument(
        "--time-step", type=options.number(unit="s"), metavar="S", help="of Euler's method (default: 0.05)"
    )
    group.add_argument("--steps", type=options.whole(1), metavar="N", help="of a rollout (default: 10000)")
    group.add_argument("--precision", choices=("f32", "f64"), default="f64", help="of the numbers (default: f64)")
    group.add_argument("--threads", type=options.whole(1), metavar="N", help="CPU threads (default: all)")


def task_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Those of radius, time step and steps that are given."""
    given = {name: getattr(args, name) for name in ("radius", "time_step", "steps")}
    return {name: value for name, value in given.items() if value is not None}


def design_numbers(text: str) -> list[int]:
    """Numbers of bodies of the published grid, ascending: ``162,6553``, ``1-100`` or ``all``.

    Raises:
        ValueError: in one line, for anything else, as types of arguments do.
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
