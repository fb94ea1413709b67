"""Options that commands share, and the checks of their values."""

import argparse
from typing import Any

from taichi_sim.base import files
from taichi_sim.base.compute import DEVICES, PRECISIONS, Compute
from taichi_sim.base.options import checked as checked
from taichi_sim.base.options import number as number
from taichi_sim.base.options import whole as whole


def add_compute(parser: argparse.ArgumentParser, precision: str) -> None:
    """Options about the simulation; ``precision`` is what the help calls the default."""
    group = parser.add_argument_group("simulation")
    group.add_argument("--precision", choices=PRECISIONS, help=f"of the numbers (default: {precision})")
    group.add_argument("--device", choices=DEVICES, help="(default: cpu)")
    group.add_argument("--threads", type=whole(1), metavar="N", help="CPU threads (default: all)")


def compute(args: argparse.Namespace, precision: str) -> Compute:
    """What the options of :func:`add_compute` say, in this precision by default."""
    return Compute(args.device or "cpu", args.precision or precision, args.threads)


def add_robot(parser: Any, told: str) -> None:
    """The option that names the robot; ``told`` says what else to give."""
    parser.add_argument(
        "--robot",
        metavar="KIND|FILE",
        help="a kind of robot (inflatable, lattice, walker, vehicle, quadruped, rover, articulated, or of an installed "
        f"package) or the file of one (default: inflatable); {told}",
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option to speak to machines."""
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def claim_folder(args: argparse.Namespace) -> None:
    """Make the new folder ``--out``, if one is given, and keep other processes off it while the command runs.

    Raises:
        ValueError: if the folder holds anything, cannot be made, or another process fills it.
    """
    if args.out is not None:
        args.held.enter_context(files.claimed_folder("out", args.out))
