"""``morpholab sweep``: every controller on a grid, in bodies of Braitenberg vehicles."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import Report, goes_on
from optim.commands.options import QUIET, Command, count, flag, path_to
from optim.commands.vehicle_options import SIMULATION, designs_option, task_settings
from optim.progress import shown_progress
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from optim.studies.chapter3.sweep_table import SweepTable

COMMAND = Command(
    "sweep",
    "sweep controllers of Braitenberg vehicles",
    "Count the controllers that lead bodies of Braitenberg vehicles to the light in all of four environments, and in "
    "any. The same command goes on where an earlier one was, also with other bodies.",
    (
        designs_option(required=True),
        path_to("out", "DIR", "folder of the sweep", required=True),
        count("weights", 2, "values of each weight (default: 121)", default=121),
        flag("figures", "also draw metrics, success matrices and paths"),
        QUIET,
    ),
    SIMULATION,
)


@goes_on
def run(args: argparse.Namespace) -> Report:
    """Sweep, then write the table of all that is in the folder."""
    from optim.studies.chapter3.sweep_table import overlaps_of, read_sweep_table
    from robots.braitenberg import Sweep, VehicleBody

    settings = Sweep(weights=args.weights, precision=args.precision, **task_settings(args))
    bodies = [VehicleBody.published(design) for design in args.designs]
    with shown_progress(counted(len(bodies), "body", "bodies"), 1.0, args.quiet) as update:
        overlaps_of(bodies, settings, args.out, threads=args.threads, progress=update)
    table = read_sweep_table(args.out)
    table.write(args.out / "table.csv")
    files = ["table.csv"]
    if args.figures:
        from optim.studies.chapter3.sweep_study import save_figures

        files += save_figures(table, args.out, args.out)
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
