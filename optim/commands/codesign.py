"""``morpholab codesign``: search for a body and a gait, in a run folder that can be continued."""

import argparse
import dataclasses
import functools
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import FAILED, Report, options, stopped_by
from optim.commands.codesign_plan import Plan, named_kinds, plan
from optim.commands.evaluation import add_workers, opened_workers, with_options
from optim.commands.robots import RobotOptions
from optim.commands.task_file import add_task, take_task
from optim.problem import Objective
from optim.problems.designer import designer_of
from optim.progress import shown_progress
from optim.search import METHODS
from optim.wording import counted, spoken_duration

if TYPE_CHECKING:
    from optim.problem import Problem
    from optim.runs import Generation, RunFolder
    from robots.robot import Robot


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: RobotOptions = commands.add_parser(
        "codesign",
        help="design a robot",
        description="Search for the body and behaviour with which a robot does best: by default, the orientation, "
        "shape and control with which the inflatable robot travels fastest.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--resume", action="store_true", help="continue the run in the folder, with its settings")
    add_task(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    _add_search(parser.add_argument_group("search"))
    _add_gradients(parser.add_argument_group("search by gradients (gradient, memetic and cma-gradient)"))
    options.add_robot(parser, "its options are those of the kind")
    parser.add_argument(
        "--problem",
        type=Path,
        metavar="FILE",
        help="a problem of your own instead, see docs/searches.md: Python that sets problem, or bounds and a function "
        "evaluate; it takes none of the other options of this group, and is given again with --resume",
    )
    options.add_compute(parser, precision="f32 of the inflatable robot, f64 of others")
    add_workers(parser)
    parser.take_robots(named_kinds, lambda kind: designer_of(kind).options)
    parser.set_defaults(run=run, parser=parser)


def _add_search(search: Any) -> None:
    search.add_argument(
        "--method",
        type=options.checked(METHODS.check),
        metavar="METHOD",
        help=f"one of {', '.join(METHODS.builtin)}, or of an installed package (default: hill-climb)",
    )
    search.add_argument("--climbers", type=options.whole(1), metavar="N", help="independent searches (default: 60)")
    search.add_argument(
        "--population",
        type=options.whole(1),
        metavar="N",
        help="points of a method that moves one population (default: 60)",
    )
    search.add_argument(
        "--generations",
        type=options.whole(0),
        metavar="N",
        help="after the random starts (default: 200); may be raised when a run is continued",
    )
    search.add_argument("--seed", type=options.whole(0), metavar="N", help="of all random numbers (default: 0)")
    search.add_argument(
        "--set",
        action="append",
        metavar="NAME=VALUE",
        help="any other setting of the method; a wrong name lists them; may be repeated",
    )


def _add_gradients(group: Any) -> None:
    group.add_argument("--rule", choices=("adam", "l-bfgs"), help="of the steps (default: adam)")
    group.add_argument(
        "--learning-rate",
        type=options.number(0.0),
        metavar="RATE",
        help="typical step, in ranges of the variables (default: 0.05; of memetic 0.3)",
    )
    group.add_argument(
        "--gradient",
        choices=("exact", "smoothed"),
        help="of the simulation, or estimated from perturbed points (default: exact)",
    )
    group.add_argument(
        "--samples",
        type=options.whole(0),
        metavar="N",
        help="pairs of perturbed points a climber (default: 8), or around the mean of cma-gradient (default: 0)",
    )
    group.add_argument(
        "--smoothing",
        type=options.number(0.0),
        metavar="DEVIATION",
        help="of the perturbations, in ranges of the variables (default: 0.05)",
    )


def run(args: argparse.Namespace) -> Report:
    """Search, then write what the best design needs."""
    from optim.problems.robot import RobotDesigning
    from optim.runs import open_run
    from optim.runs.environment import environment
    from optim.search import build_method

    take_task(args)
    planned = plan(args)
    method = build_method(planned.method, planned.problem.space, planned.settings)
    problem, seed = planned.problem, planned.settings["seed"]
    where = {name: getattr(args, name) for name in ("threads", "workers", "ray") if getattr(args, name) is not None}
    numbers = {name: getattr(problem, name) for name in ("device", "precision") if hasattr(problem, name)}
    about = environment(**numbers, seed=seed, **where)
    with open_run(args.out, planned.config(), resume=args.resume, environment=about) as folder:
        if planned.note and not args.quiet:
            print(planned.note, file=sys.stderr)
        if isinstance(problem, RobotDesigning):
            with folder.writing():
                problem.prepare(folder.path)
        search = _Search(planned, folder, args)
        try:
            last = search.run(method)
            written = _write_best(problem, last, folder)
        except KeyboardInterrupt as interrupt:
            return _interrupted(search.last, planned, folder.path, stopped_by(interrupt))
    return _report(last, folder.path, written, planned)


class _Search:
    """A search with its progress on screen; ``last`` is the last complete generation."""

    def __init__(self, planned: Plan, folder: "RunFolder", args: argparse.Namespace) -> None:
        self._planned, self._folder, self._args = planned, folder, args
        self._begun = self._done_before = 0.0
        self.last: Generation | None = None

    def run(self, method: Any) -> "Generation":
        """Search up to the last generation planned."""
        from optim.runs import run_search

        generations = self._planned.generations
        with shown_progress("random starts", generations + 1, self._args.quiet) as update:

            def show(last: "Generation") -> None:
                self.last = last
                update(self._done, _text(last, self._planned) + self._left())

            self._begun = time.monotonic()
            report = lambda fraction: update(self._done + fraction)  # noqa: E731
            problem = with_options(self._planned.problem, progress=report)
            with opened_workers(problem, self._folder, self._args) as evaluate:
                return run_search(problem, method, self._folder, generations, show, evaluate)

    @property
    def _done(self) -> int:
        return self.last.generation + 1 if self.last else 0

    def _left(self) -> str:
        """The time that the rest will take, by the generations made since this process began."""
        if not self._done_before:  # the first one shown may be an old one
            self._begun, self._done_before = time.monotonic(), self._done
            return ""
        left = self._planned.generations + 1 - self._done
        pace = (time.monotonic() - self._begun) / (self._done - self._done_before)
        return f", {spoken_duration(left * pace)} left" if left else ""


def _write_best(problem: "Problem", last: "Generation", folder: "RunFolder") -> list[str]:
    """Gait table and pictures of the best design, unless they are up to date; the names of all files."""
    from optim.problems.robot import RobotDesigning
    from optim.runs.products import Products

    if last.best_point is None:
        return []
    if not isinstance(problem, RobotDesigning):
        return ["best.json"]
    robot = problem.robot_of(problem.space.from_dict(last.best_point))
    products, written = Products(folder), ["best.json"]
    if robot.exportable:
        products.make("gait.csv", functools.partial(_write_table, robot, folder.config["method"]["seed"]))
        written.append("gait.csv")
    for world in problem.tried_in if robot.pictured else ():
        name = f"robot_{world.name.replace(':', '_')}.png"
        products.make(name, functools.partial(robot.save_picture, world))
        written.append(name)
    return written


def _write_table(robot: "Robot", seed: int, path: Path) -> None:
    from robots.hardware import write_csv

    write_csv(robot.table(on_violation="clip", seed=seed), path)  # its header tells what was clipped


def _report(last: "Generation", folder: Path, written: list[str], planned: Plan) -> Report:
    document = {"folder": str(folder), **dataclasses.asdict(last), "files": written}
    if last.best is None:
        return Report(document, f"{folder}: nothing succeeded in {counted(last.evaluations, 'evaluation')}", FAILED)
    numbers = {name: value for name, value in (last.best_details or {}).items() if isinstance(value, int | float)}
    prefix = f"{planned.score.name}_"
    details = ", ".join(f"{name.removeprefix(prefix)} {value:.4f}" for name, value in numbers.items())
    best = planned.score.value(last.best) + (f" ({details})" if details else "")
    spent = counted(last.evaluations, "evaluation")
    return Report(document, f"best {planned.score.name}: {best} after {spent}\n{folder}: {', '.join(written)}")


def _interrupted(last: "Generation | None", planned: Plan, folder: Path, code: int) -> Report:
    document = {"folder": str(folder), "interrupted": True, **(dataclasses.asdict(last) if last else {})}
    if last is None:
        return Report(document, f"interrupted before the first generation was complete; {folder}: --resume", code)
    text = f"interrupted: {_text(last, planned)}\n{folder} keeps every complete generation, go on with --resume"
    return Report(document, text, code)


def _text(last: "Generation", planned: Plan) -> str:
    best, mean = Objective("best").value(last.best), planned.score.value(last.mean)
    spent = counted(last.evaluations, "evaluation")
    return f"generation {last.generation}/{planned.generations}: best {best}, mean {mean}, {spent}"
