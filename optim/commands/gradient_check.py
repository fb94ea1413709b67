"""``morpholab gradient-check``: where the exact gradient of a robot can be trusted."""

import argparse
import json
import warnings
from typing import TYPE_CHECKING

import numpy as np

from optim.commands import Report, options
from optim.commands.options import QUIET, Command, Option, count, path_to
from optim.commands.robots import kinds_of_robot, world_and_own
from optim.problems.designer import designer_of
from optim.problems.robot_designing import RobotDesigning
from optim.progress import shown_progress
from robots.robot import find_robot_doing

if TYPE_CHECKING:
    from optim.problem import RelaxableProblem

INSIDE = 0.15  # of its range: how far the point keeps from every bound
COMMAND = Command(
    "gradient-check",
    "compare gradients with differences",
    "Compare the exact gradient of what the robot is judged by, by all that is free of it, with central "
    "differences over step sizes and horizons, and with the gradient of the smoothed speed. Speeds of gaits with times "
    "of their own are counted by the time that they take.",
    (
        options.robot("checked by all that is free of it"),
        Option("gait", "inching, rolling, or the file of a design (default: inching)", metavar="GAIT"),
        Option(
            "horizons",
            "of trials: of a gait columns that are played, some of it, or all of it several times (default: 1,2); "
            "of a lattice robot cycles (default: 1,2,4); of other robots a unit of their own",
            metavar="LENGTHS",
        ),
        count("directions", 2, "random ones (default: 3)", default=3),
        count("samples", 2, "pairs of the smoothed gradient (default: 8)", default=8),
        Option(
            "smoothing",
            "its standard deviation in ranges of the variables, at most 0.05 (default: 0.05)",
            options.number(1e-6, INSIDE / 3),
            "S",
            default=0.05,
        ),
        count("seed", 0, "(default: 0)", default=0),
        path_to("out", "DIR", "folder for gradient.png and gradient.json"),
        QUIET,
    ),
    options.simulation("f64"),
    kinds_of_robot,
    world_and_own("gradient-check"),
)


def run(args: argparse.Namespace) -> Report:
    """Check every horizon."""
    from optim.measures.gradient_trust import check_gradient
    from optim.plots.gradient_trust import save_gradient_check
    from taichi_sim.base.claims import undone_if_it_fails
    from taichi_sim.base.files import write_text

    problems = _problems(args)
    cautions = [
        problem.offered.caution(point)
        for problem, point in problems.values()
        if isinstance(problem, RobotDesigning) and problem.offered is not None
    ]
    for words in dict.fromkeys(cautions):
        if words:
            warnings.warn(words, stacklevel=1)
    options.claim_folder(args, "gradient.json", "gradient.png")
    with shown_progress("differences", 1.0, args.quiet) as update:
        report = check_gradient(
            problems,
            directions=args.directions,
            smoothing=args.smoothing,
            samples=args.samples,
            seed=args.seed,
            progress=update,
        )
    document = report.document()

    def write() -> str:
        args.out.mkdir(parents=True, exist_ok=True)
        with undone_if_it_fails() as made:
            made += [args.out / "gradient.json", args.out / "gradient.png"]
            write_text(args.out / "gradient.json", json.dumps(document, allow_nan=False) + "\n")
            save_gradient_check(report, args.out / "gradient.png")
        return f"{args.out}: gradient.json, gradient.png"

    told = Report(document, report.text())
    return told.written_by(write) if args.out else told


def _problems(args: argparse.Namespace) -> "dict[str, tuple[RelaxableProblem, np.ndarray]]":
    """What to check, by name, each with a point that keeps away from the bounds."""
    kind, source = find_robot_doing(args.robot, args.gait)
    asked = {**args.parser.values(args, kind), **options.given_compute(args)}
    found = designer_of(kind).horizons(source, asked, _horizons(args.horizons))
    return {name: (problem, inside(problem, point)) for name, (problem, point) in found.items()}


def _horizons(text: str | None) -> list[int] | None:
    """Lengths of trials, ascending."""
    if text is None:
        return None
    try:
        wanted = sorted({int(part) for part in text.split(",")})
    except ValueError:
        wanted = [0]
    if wanted[0] < 1:
        raise ValueError(f"horizons: {text!r} is not allowed; give whole numbers such as 1,2,4")
    return wanted


def inside(problem: "RelaxableProblem", point: np.ndarray) -> np.ndarray:
    """The point, drawn away from the bounds so that differences reach both sides."""
    space = problem.space
    return np.clip(point, space.low + INSIDE * space.span, space.high - INSIDE * space.span)
