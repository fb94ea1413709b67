"""``morpholab gradient-check``: where the exact gradient of a robot can be trusted."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.commands import Report, options
from optim.commands.robot_options import horizons_of_robot
from optim.progress import shown_progress
from optim.wording import counted
from robots.inflatable.schedule import ROWS
from robots.world import Terrain

if TYPE_CHECKING:
    from optim.problem import RelaxableProblem
    from optim.problems.inflatable.problem import GaitProblem
    from robots.inflatable.schedule import GaitSchedule

HORIZONS = (1, 2, 4, 8)
INSIDE = 0.15  # of its range: how far the point keeps from every bound


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "gradient-check",
        help="compare gradients with differences",
        description="Compare the exact gradient of the speed, by pressure, orientation and levels of the gait, with "
        "central differences over step sizes and horizons, and with the gradient of the smoothed speed. Speeds of "
        "gaits with times of their own are counted by the time that they take.",
    )
    parser.add_argument("--gait", metavar="GAIT", help="inching, rolling, or the file of a design (default: inching)")
    parser.add_argument(
        "--robot",
        type=Path,
        metavar="FILE",
        help="a robot of your own instead, by all that is free of it, see docs/own-robots.md",
    )
    parser.add_argument(
        "--terrain",
        type=options.terrain,
        default=Terrain(),
        metavar="TERRAIN",
        help="flat, hill:15 or water (default: flat)",
    )
    parser.add_argument(
        "--horizons",
        metavar="COLUMNS",
        help="columns that are played: some of the gait, or all of it several times (default: 1,2,4,8); of a robot "
        "cycles (default: 1,2,4)",
    )
    parser.add_argument("--directions", type=options.whole(2), default=6, metavar="N", help="random ones (default: 6)")
    parser.add_argument(
        "--samples", type=options.whole(2), default=48, metavar="N", help="pairs of the smoothed gradient (default: 48)"
    )
    parser.add_argument(
        "--smoothing",
        type=options.number(1e-6, INSIDE / 3),
        default=0.05,
        metavar="S",
        help="its standard deviation in ranges of the variables, at most 0.05 (default: 0.05)",
    )
    parser.add_argument("--seed", type=options.whole(0), default=0, metavar="N", help="(default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for gradient.png and gradient.json")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    options.add_robot(parser, precision="f64", schedule=None)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Check every horizon."""
    from optim.measures.gradient_trust import check_gradient, save_plot
    from taichi_sim.base.files import write_text

    problems = _problems(args)
    options.claim_folder(args)
    with shown_progress("differences", 1.0, args.quiet) as update:
        report = check_gradient(
            problems,
            directions=args.directions,
            smoothing=args.smoothing,
            samples=args.samples,
            seed=args.seed,
            progress=update,
        )
    document, text = report.document(), report.text()
    if args.out:
        import json

        args.out.mkdir(parents=True, exist_ok=True)
        write_text(args.out / "gradient.json", json.dumps(document, allow_nan=False) + "\n")
        save_plot(report, args.out / "gradient.png")
        text += f"\n{args.out}: gradient.json, gradient.png"
    return Report(document, text)


def _problems(args: argparse.Namespace) -> "dict[str, tuple[RelaxableProblem, np.ndarray]]":
    """What to check, by name, each with a point that keeps away from the bounds."""
    found: dict[str, tuple[RelaxableProblem, np.ndarray]] = {}
    if args.robot is not None:
        for name, (robot, start) in horizons_of_robot(args).items():
            found[name] = robot, _inside(robot, start)
        return found
    from robots.inflatable.cores import each_pressure

    gait = options.load_gait(args.gait or "inching")
    for columns in _horizons(args.horizons, gait.schedule.columns):
        repeats = max(columns // gait.schedule.columns, 1)
        problem, genes = _problem(args, gait.schedule.cut(columns // repeats, repeats))
        point = np.concatenate([[gait.orientation], each_pressure(gait.pressure, problem.body), genes])
        found[counted(columns, "column")] = problem, _inside(problem, point)
    return found


def _horizons(text: str | None, columns: int) -> list[int]:
    """Numbers of columns, ascending; those of the gait that exist by default."""
    if text is None:
        return [n for n in HORIZONS if n <= columns] or [columns]
    try:
        wanted = sorted({int(part) for part in text.split(",")})
    except ValueError:
        raise ValueError(f"horizons: {text!r} is not allowed; give numbers of columns such as 1,2,4") from None
    wrong = [n for n in wanted if n < 1 or (n > columns and n % columns)]
    if wrong:
        raise ValueError(f"horizons: {wrong[0]} is not allowed; give 1 to {columns} columns, or multiples of {columns}")
    return wanted


def _problem(args: argparse.Namespace, schedule: "GaitSchedule") -> "tuple[GaitProblem, np.ndarray]":
    """A problem whose encoding says the schedule, and its genes of it, levels away from off and on."""
    from optim.problems.inflatable.encoding import GradedGait
    from optim.problems.inflatable.problem import GaitProblem

    given = {name: getattr(args, name) for name in ("geometry", "weight", "device", "threads")}
    given = {name: value for name, value in given.items() if value is not None}
    given |= {"columns": schedule.columns, "repeats": schedule.repeats, "encoding": "bits"}
    genes = schedule.levels.flatten()
    if schedule.has_own_times or schedule.core_pressure is not None:
        # All columns in a row, once, however long a difference makes them.
        given |= {"columns": schedule.columns * schedule.repeats, "repeats": 1, "encoding": "graded", "steps": 1}
        genes = GradedGait.genome(schedule)
    levels = slice(ROWS * given["columns"])
    genes[levels] = np.clip(genes[levels], INSIDE, 1 - INSIDE)
    return GaitProblem((args.terrain,), precision=args.precision or "f64", **given), genes


def _inside(problem: "RelaxableProblem", point: np.ndarray) -> np.ndarray:
    """The point, drawn away from the bounds so that differences reach both sides."""
    space = problem.space
    return np.clip(point, space.low + INSIDE * space.span, space.high - INSIDE * space.span)
