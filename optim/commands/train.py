"""``morpholab train``: how many evaluations search methods need in bodies of Braitenberg vehicles."""

import argparse
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from optim.commands import Report, goes_on, options
from optim.commands.options import QUIET, Command, Option, count, flag, path_to
from optim.commands.vehicle_options import SIMULATION, designs_option, task_settings
from optim.progress import shown_progress
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from optim.measures.statistics import Correlation
    from optim.studies.chapter3.sweep_table import SweepTable
    from optim.studies.chapter4.training import Training, TrainingTable

COMMAND = Command(
    "train",
    "train controllers of Braitenberg vehicles",
    "Count the evaluations that search methods need to find a controller that solves all four environments, in each of "
    "many bodies, and how these go with what a sweep says of the bodies. The same command goes on where an earlier one "
    "was, also with other bodies and methods.",
    (
        designs_option(),
        count("sample", 1, "of them, at random (default: 500)"),
        path_to("out", "DIR", "folder of the study", required=True),
        Option("methods", "(default: random,generating-set,nes,de)", options.names, "NAMES"),
        count("repetitions", 1, "of each method, a body (default: 5)", default=5, metavar="R"),
        count("budget_evaluations", 1, "of a run (default: 500)", default=500),
        count("seed", 0, "of runs and sample (default: 1)", default=1),
        path_to("sweep", "PATH", "its folder or table, with these bodies, to compare with"),
        flag("figures", "also draw evaluations against metrics; needs --sweep"),
        QUIET,
    ),
    SIMULATION,
)


@goes_on
def run(args: argparse.Namespace) -> Report:
    """Train, then write the table of these runs."""
    from optim.studies.chapter3.sweep_table import sample_designs
    from optim.studies.chapter4.training import TRAINERS, Training, train
    from robots.braitenberg import PUBLISHED

    if args.designs and args.sample:
        raise ValueError("argument --sample: not allowed with argument --designs")
    task = dataclasses.replace(PUBLISHED, **task_settings(args))
    settings = Training(args.repetitions, args.budget_evaluations, args.seed, task, args.precision)
    designs = args.designs or sample_designs(args.sample or 500, args.seed)
    methods = args.methods or TRAINERS
    sweep = _sweep(args, settings, designs)
    text = f"{counted(len(designs), 'body', 'bodies')}, {counted(len(methods), 'method')}"
    with shown_progress(text, 1.0, args.quiet) as update:
        table = train(designs, methods, settings, threads=args.threads, out=args.out, progress=update)
    table.write(args.out / "runs.csv")
    files = ["runs.csv"]
    if sweep and args.figures:
        from optim.studies.chapter4.training import save_training

        save_training(table, sweep, args.out / "training.png")
        files += ["training.png"]
    return _report(table, sweep, args.out, files)


def _sweep(args: argparse.Namespace, settings: "Training", designs: list[int]) -> "SweepTable | None":
    """The rows of these bodies in the table of a sweep; what is wrong with it is said before any work."""
    from optim.studies.chapter3.sweep_table import read_sweep_table

    if args.sweep is None:
        if args.figures:
            raise ValueError("figures: they need metrics; give --sweep")
        return None
    table = read_sweep_table(args.sweep)
    table.check_published(args.sweep)
    for name in ("radius", "time_step", "steps"):
        swept, trained = getattr(table.settings, name), getattr(settings.task, name)
        if swept != trained:
            raise ValueError(f"sweep: {args.sweep} has {name.replace('_', ' ')} {swept:g}, not {trained:g}")
    return table.rows(designs)


def _report(table: "TrainingTable", sweep: "SweepTable | None", out: Path, files: list[str]) -> Report:
    from optim.studies.chapter3.sensor_placement import correlation_of_metrics
    from optim.studies.chapter4.training import metric_correlations

    methods = [
        {"method": method, "runs": solved.size, "solved": int(solved.sum()), "mean_evaluations": float(spent.mean())}
        for method, spent, solved in zip(table.methods, table.evaluations, table.solved, strict=True)
    ]
    found = metric_correlations(table, sweep) if sweep else []
    metrics = correlation_of_metrics(sweep) if sweep else None
    lines = [counted(len(table.designs), "body", "bodies")]
    for row in methods:
        lines.append(
            f"  {row['method']}: {row['solved']} of {counted(row['runs'], 'run')} solved all environments, "
            f"on average {row['mean_evaluations']:.1f} evaluations"
            f"{', failures with all that they used up' if row['solved'] < row['runs'] else ''}"
        )
    if metrics:
        lines.append("Pearson's r with its 95 % interval, of evaluations and metrics (of runs; of bodies, their means)")
        lines += [f"  {one.method}, {one.metric}, {one.over}: {_text(one.found)}" for one in found]
        lines.append(f"  M_L and M_CI, bodies: {_text(metrics)}")
    document = {
        "folder": str(out),
        "bodies": len(table.designs),
        "methods": methods,
        "correlations": [dataclasses.asdict(one) for one in found],
        "metrics": dataclasses.asdict(metrics) if metrics else None,
        "files": files,
    }
    return Report(document, "\n".join([*lines, f"{out}: {', '.join(files)}"]))


def _text(found: "Correlation") -> str:
    if found.r is None:
        return f"none, as nothing varies (n {found.n})"
    p = f"p {found.p:.2g}" if found.p > 1e-300 else "p < 1e-300"
    return f"{found.r:+.3f} [{found.low:+.3f}, {found.high:+.3f}], {p}, n {found.n}"
