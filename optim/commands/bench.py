"""``morpholab bench``: how fast the simulator is on this machine."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, options


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "bench",
        help="measure the simulator",
        description="Measure how fast the simulator is on this machine.",
    )
    parser.add_argument(
        "robot",
        nargs="?",
        choices=("all", "inflatable", "vehicle", "rigid"),
        default="all",
        help="which (default: all)",
    )
    parser.add_argument("--quick", action="store_true", help="shorter, less exact")
    parser.add_argument("--precision", choices=("f32", "f64"), help="of the inflatable robot (default: both)")
    parser.add_argument(
        "--prototype", type=Path, metavar="PATH", help="a program to compare the inflatable robot with, in the same run"
    )
    parser.add_argument(
        "--vehicle-prototype", type=Path, metavar="PATH", help="a program to compare the vehicle with, in the same run"
    )
    parser.add_argument(
        "--rigid-prototype", type=Path, metavar="PATH", help="a program to compare quadrupeds with, in the same run"
    )
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Measure; the benchmark itself prints its table."""
    from robots.bench import main

    return Report(main(args), "")
