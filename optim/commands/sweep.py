"""``morpholab sweep``: every controller on a grid, in bodies of Braitenberg vehicles."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import Report, interrupted, options
from optim.commands.vehicle_options import add_vehicle_task, design_numbers, task_settings
from optim.progress import shown_progress
from optim.wording import counted

if TYPE_CHECKING:
    from optim.studies.chapter3.sweep_table import SweepTable


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "sweep",
        help="sweep controllers of Braitenberg vehicles",
        description="Count the controllers that lead bodies of Braitenberg vehicles to the light in all of four "
        "environments, and in any. The same command goes on where an earlier one was, also with other bodies.",
    )
    parser.add_argument(
        "--designs",
        type=options.checked(design_numbers),
        required=True,
        metavar="NUMBERS",
        help="bodies of the published grid, from 1 to 6561: 162,6553 or 1-100, or all",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the sweep")
    parser.add_argument(
        "--weights", type=options.whole(2), default=121, metavar="N", help="values of each weight (default: 121)"
    )
    parser.add_argument("--figures", action="store_true", help="also draw metrics, success matrices and paths")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    add_vehicle_task(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Sweep, then write the table of all that is in the folder."""
    from optim.studies.chapter3.sweep_table import overlaps_of, read_sweep_table
    from robots.braitenberg import Sweep, VehicleBody

    settings = Sweep(weights=args.weights, precision=args.precision, **task_settings(args))
    bodies = [VehicleBody.published(design) for design in args.designs]
    try:
        with shown_progress(counted(len(bodies), "body", "bodies"), 1.0, args.quiet) as update:
            overlaps_of(bodies, settings, args.out, threads=args.threads, progress=update)
        table = read_sweep_table(args.out)
        table.write(args.out / "table.csv")
        files = ["table.csv"]
        if args.figures:
            from optim.studies.chapter3.sensor_placement_figures import save_figures

            files += save_figures(table, args.out, args.out)
    except KeyboardInterrupt as interrupt:
        return interrupted(args.out, interrupt)
    return _report(table.rows(args.designs), args.out, files)


def _report(table: "SweepTable", out: Path, files: list[str]) -> Report:
    rows = [
        {"design": int(table.designs[n]), "all": int(table.solving_all[n]), "any": int(table.solving_any[n])}
        | {name: float(values[n]) for name, values in table.metrics.items()}
        for n in range(len(table.designs))
    ]
    best = {name: max(rows, key=lambda row, name=name: row[name]) for name in table.metrics}  # type: ignore[misc]
    cells = table.settings.weights**2
    lines = [f"{counted(len(rows), 'body', 'bodies')}, {cells} controllers each"]
    for name, row in best.items():
        lines.append(
            f"  best {name}: design {row['design']}, M_L {row['M_L']:.4f}, M_CI {row['M_CI']:.4f} "
            f"({row['all']} solve all environments, {row['any']} any)"
        )
    lines.append(f"{out}: {', '.join(files)}")
    document = {"folder": str(out), "controllers": cells, "best": best, "bodies": rows, "files": files}
    return Report(document, "\n".join(lines))
