"""``morpholab export``: a designed gait for the hardware."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import Report, options
from optim.commands.kept_points import kept_point

if TYPE_CHECKING:
    from robots.inflatable import InflatableDesign


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "export",
        help="write a gait for the hardware",
        description="Write the pressures that play a gait on a pneumatic rig, within its limits, as CSV.",
    )
    parser.add_argument("source", type=Path, metavar="RUN", help="folder of a run, or the file of a design")
    parser.add_argument(
        "--csv", type=Path, required=True, metavar="FILE", help="to write; replaced if it exists"
    )
    parser.add_argument("--units", choices=("kpa", "psi"), default="kpa", help="(default: kpa)")
    parser.add_argument(
        "--rig", type=Path, metavar="FILE", help="JSON or TOML with a rig's channels and limits"
    )
    parser.add_argument(
        "--member",
        type=options.whole(1),
        metavar="N",
        help="the Nth design that the search keeps, as in front.json (default: the best design)",
    )
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Write the CSV file."""
    from robots.hardware import PneumaticRig, export_csv

    rig = PneumaticRig.load(args.rig) if args.rig else PneumaticRig()
    table = export_csv(_design(args.source, args.member), args.csv, rig, args.units)
    seconds = float(table.times[-1])
    document = {"source": str(args.source), "csv": str(args.csv), "units": args.units, "seconds": seconds}
    return Report(document, f"{args.csv}: {len(table.channels)} channels, {seconds:.1f} s, {args.units}")


def _design(source: Path, member: int | None) -> "InflatableDesign":
    """The best design of a run, as its checked log tells, or another that it keeps, or that of a file."""
    from robots.inflatable import load_design

    if source.is_file():
        if member is not None:
            raise ValueError(f"member: {member} is not allowed, as {source} is the file of one design; name a run")
        return load_design(source)
    if not source.is_dir():
        raise ValueError(f"source: {source} is neither a run nor the file of a design")
    from optim.gait_problem import GaitProblem

    problem, point = kept_point(source, GaitProblem, member)
    return problem.design(point)
