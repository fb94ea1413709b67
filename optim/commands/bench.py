"""``morpholab bench``: how fast the simulator is on this machine."""

import argparse
import subprocess
from pathlib import Path
from typing import Any

from optim.commands import Report, options

# Of which robot options are.
WHOSE = {
    "precision": "inflatable",
    "prototype": "inflatable",
    "vehicle_prototype": "vehicle",
    "rigid_prototype": "rigid",
}


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
    from robots.bench.lattice import main

    for option, robot in WHOSE.items():
        name, given = option.replace("_", "-"), getattr(args, option)
        if given is not None and args.robot not in ("all", robot):
            raise ValueError(f"{name}: it is of the {robot} benchmark; leave it out with {args.robot}")
        if isinstance(given, Path) and not given.is_file():
            raise ValueError(f"{name}: {given} is no file")
    try:
        return Report(main(args), "")
    except subprocess.CalledProcessError as error:
        last = (error.stderr.strip().splitlines() or ["without a word"])[-1]
        raise RuntimeError(f"{error.cmd[1]} ended with code {error.returncode}: {last}") from None
