"""``morpholab interference``: the study of chapter 2, of any size."""

import argparse
from pathlib import Path
from typing import Any

from optim.commands import Report, interrupted, options
from optim.progress import shown_progress
from optim.wording import counted


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "interference",
        help="train quadrupeds in several environments, and measure how these interfere",
        description="Train controllers of legged, wheeled and whegged robots by parallel hill climbers to reach the "
        "light in two or four environments, and measure how much what helps in one harms in another. The same command "
        "goes on where an earlier one was, also with more robots, fitness functions, runs and generations.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the study")
    parser.add_argument("--robots", metavar="NAMES", help="(default: legged,wheeled,whegged)")
    parser.add_argument(
        "--fitness", metavar="NAMES", help="how environments make one fitness (default: sum,product,min)"
    )
    parser.add_argument("--trainers", metavar="NAMES", help="hill-climb, gradient or both (default: hill-climb)")
    parser.add_argument("--environments", type=int, choices=(2, 4), default=2, help="places of the light (default: 2)")
    parser.add_argument("--runs", type=options.whole(1), default=5, metavar="N", help="of each (default: 5)")
    parser.add_argument("--generations", type=options.whole(0), default=400, metavar="N", help="(default: 400)")
    parser.add_argument("--population", type=options.whole(1), default=100, metavar="N", help="climbers (default: 100)")
    parser.add_argument(
        "--variant",
        choices=("as-run", "text"),
        default="as-run",
        help="the published experiment, or its text where that differs (default: as-run)",
    )
    parser.add_argument("--alone", action="store_true", help="also train each robot on each light alone")
    parser.add_argument("--figures", action="store_true", help="also draw mutations, curves and paths")
    group = parser.add_argument_group("simulation")
    group.add_argument("--steps", type=options.whole(2), default=1000, metavar="N", help="(default: 1000)")
    group.add_argument("--precision", choices=("f32", "f64"), default="f64", help="of the numbers (default: f64)")
    group.add_argument("--device", choices=("cpu", "cuda", "vulkan", "metal"), default="cpu", help="(default: cpu)")
    group.add_argument("--threads", type=options.whole(1), metavar="N", help="CPU threads (default: all)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Train, then write tables of all that was asked for."""
    from optim.studies.chapter2.champions import train_alone
    from optim.studies.chapter2.settings import FITNESS, HILL_CLIMB, LIGHTS, ROBOTS, Interference, treatments
    from optim.studies.chapter2.study import files_of, train

    settings = Interference(
        LIGHTS[args.environments], args.population, args.steps, args.variant, args.precision, args.device
    )
    robots = _names(args.robots, ROBOTS)
    chosen = treatments(robots, _names(args.fitness, FITNESS), _names(args.trainers, (HILL_CLIMB,)))
    alone = None
    try:
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
    except KeyboardInterrupt as interrupt:
        return interrupted(args.out, interrupt)
    files = [*files_of(settings, args.figures), *(("alone.csv",) if args.alone else ())]
    return _report(summary, alone, args.out, files)


def _names(text: str | None, default: Any) -> list[str]:
    return list(default) if text is None else [name.strip() for name in text.split(",")]


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
