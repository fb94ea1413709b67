"""``morpholab codesign``: search for a body and a gait, in a run folder that can be continued."""

import argparse
import dataclasses
import functools
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import FAILED, Report, options, stopped_by
from optim.commands.codesign_plan import Plan, plan
from optim.commands.evaluation import add_workers, opened_workers, with_options
from optim.commands.task_file import add_task, take_task
from optim.problem import Objective
from optim.progress import shown_progress
from optim.search import METHODS
from optim.wording import counted, spoken_duration

if TYPE_CHECKING:
    from optim.problem import Problem
    from optim.runs import Generation, RunFolder


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "codesign",
        help="design a robot and its gait",
        description="Search for the orientation, shape and control with which the robot travels fastest.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument("--resume", action="store_true", help="continue the run in the folder, with its settings")
    add_task(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)
    _add_search(parser.add_argument_group("search"))
    _add_gradients(parser.add_argument_group("search by gradients (gradient, memetic and cma-gradient)"))
    _add_design(parser.add_argument_group("what is designed"))
    options.add_robot(
        parser,
        precision="f32, with --robot f64",
        schedule=("8, or all of the gait if control is not free", "2, or the gait's own if control is not free"),
    )
    add_workers(parser)
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
        "--start",
        metavar="GAIT",
        help="a gait, or the file of one, near which a search of bits, graded levels or waves starts (default: random)",
    )
    search.add_argument(
        "--start-orientation",
        type=options.number(0.0, 90.0, "degrees"),
        metavar="DEGREES",
        help="with which every climber starts (default: random)",
    )
    search.add_argument(
        "--start-pressure",
        type=options.pressure(12_000.0),
        metavar="PA",
        help="with which every climber starts; of several cores all, or such as 12000,0 (default: random)",
    )
    search.add_argument(
        "--set",
        action="append",
        metavar="NAME=VALUE",
        help="any other setting of the method; a wrong name lists them; may be repeated",
    )


def _add_design(design: Any) -> None:
    design.add_argument(
        "--problem",
        type=Path,
        metavar="FILE",
        help="a problem of your own instead, see docs/searches.md: Python that sets problem, or bounds and a function "
        "evaluate; it takes none of the other options of this group, and is given again with --resume",
    )
    design.add_argument(
        "--robot",
        type=Path,
        metavar="FILE",
        help="a robot of your own instead, see docs/own-robots.md: Python that "
        "sets robot, a .json design, .vxa or .vxd; of this group it takes one --terrain (default: flat)",
    )
    design.add_argument(
        "--terrain",
        type=options.terrain,
        action="append",
        metavar="TERRAIN",
        help="flat, hill:15 for 15 degrees, or water; repeat it for several",
    )
    design.add_argument(
        "--objective",
        choices=("mean", "terrains"),
        help="the mean speed over the terrains, or that on each of them (default: mean; terrains with methods for "
        "several objectives)",
    )
    design.add_argument("--free", metavar="PARTS", help="what may change (default: orientation,shape,control)")
    design.add_argument(
        "--encoding",
        choices=("codes", "bits", "pattern", "graded", "graded-pattern", "graded-wave"),
        help="of the control: frequency and offset of each actuator, every bit, a network that makes patterns, or "
        "how far bladders inflate and how long the robot settles, played as often as --steps allow, level by level, by "
        "a network, or as a wave around the robot (default: codes; bits with --method gradient)",
    )
    design.add_argument(
        "--steps",
        type=options.whole(1),
        metavar="N",
        help="time steps of a graded gait, by which its speed is counted (default: those of a published gait, 186719 "
        "of the published robot)",
    )
    design.add_argument(
        "--warm-up", type=options.whole(0), metavar="N", help="first time steps of a graded gait, which do not count"
    )
    design.add_argument(
        "--stages",
        type=options.whole(1),
        metavar="N",
        help="equally long parts of a graded gait, of which the slowest tells its speed (default: 1)",
    )
    design.add_argument(
        "--ladder",
        action="store_true",
        default=None,
        help="of several terrains, the easiest first, a gait is tried on the next if it is faster than --ahead on the "
        "one before, which counts no more than that in the mean",
    )
    design.add_argument(
        "--ahead",
        type=options.number(0.0),
        metavar="SPEED",
        help="speed that leads to the next terrain of the ladder, in body lengths a second (default: 0.02)",
    )
    design.add_argument(
        "--hard",
        action="store_true",
        default=None,
        help="judge gaits that get ahead also with friction 0.2 or more of sliding feet and bladders that keep their "
        "weight",
    )
    design.add_argument(
        "--effort",
        type=options.number(0.0),
        metavar="SPEED",
        help="what it costs to move every bladder in every column, in body lengths a second (default: 0)",
    )
    design.add_argument(
        "--gait",
        metavar="GAIT",
        help="inching, rolling or the file of a design: gives what is not free (default: rolling, with "
        "hills alone inching)",
    )
    design.add_argument(
        "--orientation",
        type=options.number(0.0, 90.0, "degrees"),
        metavar="DEGREES",
        help="if not free (default: the gait's own)",
    )
    design.add_argument(
        "--pressure",
        type=options.pressure(),
        metavar="PA",
        help="if shape is not free, of all cores or such as 12000,0 of each (default: the gait's own)",
    )
    options.add_calibration(design)


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
    from optim.problems.inflatable.problem import GaitProblem
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
        if isinstance(problem, GaitProblem):
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
    """Gait table and pictures of the best gait, unless they are up to date; the names of all files."""
    from optim.problems.inflatable.problem import GaitProblem
    from optim.runs.products import Products
    from robots.hardware import export_csv
    from robots.inflatable.cores import common_pressure
    from robots.view.picture import save_motion_picture

    if last.best_point is None:
        return []
    if not isinstance(problem, GaitProblem):
        return ["best.json"]
    design = problem.design(problem.space.from_dict(last.best_point))
    robot: dict[str, Any] = {
        "geometry": problem.body,
        "actuation": problem.actuation,
        "counted_steps": None if problem.steps is None else problem.counted_steps(design),
    }
    products = Products(folder)
    seed = folder.config["method"]["seed"]
    if on_rig := common_pressure(design.pressure) is not None:
        table = functools.partial(export_csv, design, on_violation="clip", seed=seed)  # its header tells
        products.make("gait.csv", table)
    pictures = {f"robot_{terrain.name.replace(':', '_')}.png": terrain for terrain in problem.terrains}
    for name, terrain in pictures.items():
        products.make(name, functools.partial(save_motion_picture, design, terrain, **robot))
    return ["best.json", *(["gait.csv"] if on_rig else []), *pictures]


def _report(last: "Generation", folder: Path, written: list[str], planned: Plan) -> Report:
    document = {"folder": str(folder), **dataclasses.asdict(last), "files": written}
    if last.best is None:
        return Report(document, f"{folder}: nothing succeeded in {counted(last.evaluations, 'evaluation')}", FAILED)
    numbers = {name: value for name, value in (last.best_details or {}).items() if isinstance(value, int | float)}
    details = ", ".join(f"{name.removeprefix('speed_')} {value:.4f}" for name, value in numbers.items())
    best = planned.score.value(last.best) + (f" ({details})" if details else "")
    text = (
        f"best {planned.what}: {best} after {counted(last.evaluations, 'evaluation')}\n{folder}: {', '.join(written)}"
    )
    return Report(document, text)


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
