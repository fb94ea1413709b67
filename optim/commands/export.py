"""``morpholab export``: a designed gait for the hardware."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, options


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
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Write the CSV file."""
    from robots.hardware import PneumaticRig, export_csv
    from robots.inflatable import load_design

    best = args.source / "best.json" if args.source.is_dir() else args.source
    if not best.is_file():
        raise ValueError(f"source: {args.source} is neither a run with a best design nor the file of one")
    rig = PneumaticRig.load(args.rig) if args.rig else PneumaticRig()
    table = export_csv(load_design(best), args.csv, rig, args.units)
    seconds = float(table.times[-1])
    document = {"source": str(best), "csv": str(args.csv), "units": args.units, "seconds": seconds}
    return Report(document, f"{args.csv}: {len(table.channels)} channels, {seconds:.1f} s, {args.units}")
