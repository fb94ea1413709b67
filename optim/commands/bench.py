"""``morpholab bench``: how fast the simulator is on this machine."""

import argparse
import subprocess
from pathlib import Path

from optim.commands import Report
from optim.commands.options import Command, Option, flag, path_to
from taichi_sim.base.compute import DEVICES, PRECISIONS

# Of which robot options are.
WHOSE = {
    "precision": "inflatable",
    "prototype": "inflatable",
    "against": "inflatable",
    "vehicle_prototype": "vehicle",
    "rigid_prototype": "rigid",
}
ROBOTS = ("all", "inflatable", "vehicle", "rigid")
PROTOTYPE = "a program to compare {} with, in the same run"
COMMAND = Command(
    "bench",
    "measure the simulator",
    "Measure how fast the simulator is on this machine.",
    (
        Option("robot", "which (default: all)", choices=ROBOTS, default="all", words="?"),
        flag("quick", "shorter, less exact"),
        Option("device", "compare batches of robots on this one with all CPU cores", choices=DEVICES[1:]),
        Option("precision", "of the inflatable robot, with --device of any (default: both)", choices=PRECISIONS),
        path_to("prototype", "PATH", PROTOTYPE.format("the inflatable robot")),
        path_to("against", "TREE", "source tree of another version, whose own benchmark then runs, too"),
        path_to("vehicle_prototype", "PATH", PROTOTYPE.format("the vehicle")),
        path_to("rigid_prototype", "PATH", PROTOTYPE.format("quadrupeds")),
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Measure; the benchmark itself prints its table."""
    from robots.bench import devices, lattice

    for option, robot in WHOSE.items():
        name, given = option.replace("_", "-"), getattr(args, option)
        if args.device and given is not None and option != "precision":
            raise ValueError(f"{name}: it is not of the benchmark of a device; leave it out with --device")
        if given is not None and args.robot not in ("all", robot) and not (args.device and option == "precision"):
            raise ValueError(f"{name}: it is of the {robot} benchmark; leave it out with {args.robot}")
        if isinstance(given, Path) and option == "against" and not (given / "optim" / "cli.py").is_file():
            raise ValueError(f"{name}: {given} is no source tree of this lab")
        if isinstance(given, Path) and option != "against" and not given.is_file():
            raise ValueError(f"{name}: {given} is no file")
    try:
        return Report((devices if args.device else lattice).main(args), "")
    except subprocess.CalledProcessError as error:
        last = (error.stderr.strip().splitlines() or ["without a word"])[-1]
        raise RuntimeError(f"{error.cmd[1]} ended with code {error.returncode}: {last}") from None
