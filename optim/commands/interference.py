"""``morpholab interference``: the study of chapter 2, of any size."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, goes_on, options
from optim.commands.options import DEVICE, QUIET, THREADS, Command, Option, count, flag, path_to
from optim.progress import shown_progress
from taichi_sim.base.short_text import counted

COMMAND = Command(
    "interference",
    "train quadrupeds in several environments, and measure how these interfere",
    "Train controllers of legged, wheeled and whegged robots by parallel hill climbers to reach the light in two or "
    "four environments, and measure how much what helps in one harms in another. The same command goes on where an "
    "earlier one was, also with more robots, fitness functions, runs and generations.",
    (
        path_to("out", "DIR", "folder of the study", required=True),
        Option("robots", "(default: legged,wheeled,whegged)", options.names, "NAMES"),
        Option("fitness", "how environments make one fitness (default: sum,product,min)", options.names, "NAMES"),
        Option("trainers", "hill-climb, gradient or both (default: hill-climb)", options.names, "NAMES"),
        Option("environments", "places of the light, 2 or 4 (default: 2)", int, "N", (2, 4), default=2),
        count("runs", 1, "of each (default: 5)", default=5),
        count("generations", 0, "(default: 400)", default=400),
        count("population", 1, "climbers (default: 100)", default=100),
        Option(
            "variant",
            "the published experiment, or its text where that differs (default: as-run)",
            choices=("as-run", "text"),
            default="as-run",
        ),
        flag("alone", "also train each robot on each light alone"),
        flag("figures", "also draw mutations, curves and paths"),
        QUIET,
    ),
    {"simulation": (count("steps", 2, "(default: 1000)", default=1000), options.precision("f64"), DEVICE, THREADS)},
)


@goes_on
def run(args: argparse.Namespace) -> Report:
    """Train, then write tables of all that was asked for."""
    from optim.studies.chapter2.champions import train_alone
    from optim.studies.chapter2.settings import FITNESS, HILL_CLIMB, LIGHTS, ROBOTS, Interference, treatments
    from optim.studies.chapter2.study import files_of, train

    compute: Any = options.compute(args, "f64")
    lights = LIGHTS[args.environments]
    settings = Interference(lights, args.population, args.steps, args.variant, compute.precision, compute.device)
    robots = args.robots or tuple(ROBOTS)
    chosen = treatments(robots, args.fitness or tuple(FITNESS), args.trainers or (HILL_CLIMB,))
    alone = None
    with shown_progress(counted(len(chosen), "treatment"), 1.0, args.quiet) as update:
        summary = train(
            settings,
            chosen,
            args.runs,
            args.generations,
            args.out,
            figures=args.figures,
            threads=args.threads,
            progress=update,
        )
        if args.alone:
            update(0.0, "each light alone")
            effort = args.runs, args.generations
            alone = train_alone(settings, robots, *effort, args.out, args.threads, update)
    files = [*files_of(settings, args.figures), *(("alone.csv",) if args.alone else ())]
    return _report(summary, alone, args.out, files)


def _report(summary: dict[str, Any], alone: list[dict[str, Any]] | None, out: Path, files: list[str]) -> Report:
    part = summary["definitions"]["defined"]
    runs, generations = counted(summary["runs"], "run"), counted(summary["generations"], "generation")
    lines = [f"{runs} of {generations}, {counted(summary['population'], 'climber')} each"]
    for name in dict.fromkeys(row["measure"] for row in part["cells"]):
        rows = [row for row in part["cells"] if row["measure"] == name]
        told = (f"{row['robot']} {row['fitness']} {_text(row['mean'])}" for row in rows)
        lines.append(f"  {name}: {', '.join(told)}")
    for row in alone or ():
        x, y = row["light"]
        lines.append(
            f"  {row['robot']} on the light at ({x:g}, {y:g}) alone: ends {row['distance']:.2f} m from it, "
            f"near it for {row['time_near']:.1f} s"
        )
    lines.append(f"{out}: {', '.join(files)}")
    return Report({"folder": str(out), **summary, "alone": alone, "files": files}, "\n".join(lines))


def _text(mean: float | None) -> str:
    return "none" if mean is None else f"{mean:.2f}"
