"""``morpholab gradient-check``: where the exact gradient of a robot can be trusted."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.commands import Report, options
from optim.commands.robots import RobotOptions, early, named_by, refuse_foreign, world_and_own
from optim.progress import shown_progress

if TYPE_CHECKING:
    from optim.problem import RelaxableProblem

INSIDE = 0.15  # of its range: how far the point keeps from every bound


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: RobotOptions = commands.add_parser(
        "gradient-check",
        help="compare gradients with differences",
        description="Compare the exact gradient of the speed, by pressure, orientation and levels of the gait, with "
        "central differences over step sizes and horizons, and with the gradient of the smoothed speed. Speeds of "
        "gaits with times of their own are counted by the time that they take.",
    )
    options.add_robot(parser, "checked by all that is free of it")
    parser.add_argument("--gait", metavar="GAIT", help="inching, rolling, or the file of a design (default: inching)")
    parser.add_argument(
        "--horizons",
        metavar="LENGTHS",
        help="of trials: of a gait columns that are played, some of it, or all of it several times (default: 1,2,4,8); "
        "of a lattice robot cycles (default: 1,2,4); of other robots a unit of their own",
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
    options.add_compute(parser, precision="f64")
    find = lambda words: [named_by(*vars(early(words, "--robot", "--gait")).values()).kind]  # noqa: E731
    parser.take_robots(find, world_and_own("gradient-check"))
    parser.set_defaults(run=run, parser=parser)


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
    from optim.problems.designer import COMPUTE, designer_of

    named = named_by(args.robot, args.gait)
    refuse_foreign(args)
    own = [option.name for option in world_and_own("gradient-check")(named.kind)]
    values = {name: getattr(args, name, None) for name in (*own, *COMPUTE)}
    asked = {name: value for name, value in values.items() if value is not None}
    found = designer_of(named.kind).horizons(named.source, asked, _horizons(args.horizons))
    return {name: (problem, _inside(problem, point)) for name, (problem, point) in found.items()}


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


def _inside(problem: "RelaxableProblem", point: np.ndarray) -> np.ndarray:
    """The point, drawn away from the bounds so that differences reach both sides."""
    space = problem.space
    return np.clip(point, space.low + INSIDE * space.span, space.high - INSIDE * space.span)
