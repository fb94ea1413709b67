"""``morpholab codesign``: search for a body and a gait, in a run folder that can be continued."""

import argparse
import dataclasses
import functools
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import Report, options
from optim.commands.codesign_plan import SEARCH_BY_GRADIENTS, SEARCH_OPTIONS, Plan, check_said_once, named_kinds, plan
from optim.commands.codesign_seeds import check_single, note_new, search_each
from optim.commands.evaluation import WORKERS, opened_workers, settle_workers, with_options
from optim.commands.options import QUIET, Command, flag, path_to
from optim.commands.robots import TABLE_FILE
from optim.commands.task_file import TASK, take_task
from optim.doubts import constants_in, doubts_before
from optim.exit_codes import FAILED
from optim.interrupts import stopped_by
from optim.notes import note
from optim.problem import Objective, evaluate_request, objectives_of
from optim.problems.designer import options_of
from optim.progress import shown_progress
from optim.wording import spoken_duration
from robots.tasks import find_task
from taichi_sim.base.results_folder import BEST_DESIGN
from taichi_sim.base.short_text import counted, decimal

if TYPE_CHECKING:
    from optim.problem import Evaluate, Evaluation, Problem, Request
    from optim.runs import Generation, RunFolder
    from robots.robot import Robot

COMMAND = Command(
    "codesign",
    "design a robot",
    "Search for the body and behaviour with which a robot does best: by default, the pressure, orientation and gait "
    "with which the inflatable robot travels fastest.",
    (
        path_to("out", "DIR", "folder of the run", required=True),
        flag("resume", "continue the run in the folder, with its settings"),
        flag("evaluations", "also keep every design that is evaluated, with its scores, in evaluations.jsonl"),
        TASK,
        QUIET,
        options.robot("its options are those of the kind"),
        path_to(
            "problem",
            "FILE",
            "a problem of your own instead of a robot, see docs/searches.md: Python that sets problem, or bounds and a "
            "function evaluate; it takes no option of a robot or the simulation, and is given again with --resume",
        ),
    ),
    {
        "search": SEARCH_OPTIONS,
        "search by gradients (gradient, memetic and cma-gradient)": SEARCH_BY_GRADIENTS,
        **options.simulation("f32 of the inflatable robot, f64 of others"),
        "where it runs (the results are the same bits everywhere)": WORKERS,
    },
    named_kinds,
    options_of,
)


def run(args: argparse.Namespace) -> Report:
    """Search, with one seed or several."""
    check_said_once(args)  # a task may say the same again, and counts less
    take_task(args)
    settle_workers(args)
    if args.seeds:
        note_new(args)
        return search_each(args, _run_one)
    check_single(args)
    return _run_one(args)


def _run_one(args: argparse.Namespace) -> Report:
    """Search, then write what the best design needs."""
    from optim.problems.robot_designing import RobotDesigning
    from optim.problems.task import check_task
    from optim.runs import open_run
    from optim.runs.environment import environment
    from optim.runs.plug_ins import packages_of
    from optim.search import build_method
    from optim.search.method import check_fit

    planned = plan(args)
    if args.task is not None:
        check_task(find_task(args.task), planned.problem)
    method = build_method(planned.method, planned.problem.space, planned.settings)
    problem, seed = planned.problem, planned.settings["seed"]
    check_fit(method, problem)
    if not args.seeds:  # of several, it is told once
        note_new(args)
    if not (args.quiet or args.resume):
        for doubt in doubts_before(problem):
            note(doubt)
    where = {name: getattr(args, name) for name in ("threads", "workers", "ray") if getattr(args, name) is not None}
    numbers = {name: getattr(problem, name) for name in ("device", "precision") if hasattr(problem, name)}
    config = planned.config()
    about = environment(packages_of(config["problem"], planned.method), **numbers, seed=seed, **where)
    with open_run(args.out, config, resume=args.resume, environment=about) as folder:
        if planned.note and not args.quiet:
            note(planned.note)
        if isinstance(problem, RobotDesigning):
            with folder.writing():
                problem.prepare(folder.path)
        try:
            last = _search(planned, method, folder, args)
            written = _write_best(problem, last, folder)
        except KeyboardInterrupt as interrupt:
            folder.check()
            return _interrupted(planned, folder.path, stopped_by(interrupt))
    return _of_task(_report(last, folder.path, written, planned), args.task, problem, last)


def _search(planned: Plan, method: Any, folder: "RunFolder", args: argparse.Namespace) -> "Generation":
    """Search up to the last generation planned, with progress on screen.

    Args:
        planned: what to search.
        method: how.
        folder: of the run.
        args: where to evaluate, and whether to be quiet.
    """
    from optim.runs import run_search

    begun, count, complete = 0.0, 0, 0  # when a run continues, the first that is shown is the one that it had
    with shown_progress("random starts", planned.generations + 1, args.quiet) as update:

        def show(last: "Generation") -> None:
            nonlocal begun, count, complete
            begun = begun or time.monotonic()  # the first one may be old, so it tells nothing of the pace
            count, complete = count + 1, last.generation + 1
            left = (planned.generations - last.generation) * (time.monotonic() - begun) / max(count - 1, 1)
            told = f", {spoken_duration(left)} left" if left and count > 1 else ""
            update(complete, _text(last, planned) + told)

        def part_done(fraction: float) -> None:
            update(complete + fraction)

        problem = with_options(planned.problem, progress=part_done)
        with opened_workers(problem, folder, args) as evaluate:
            evaluated = evaluate or functools.partial(evaluate_request, problem)
            if folder.lines == 0 and not args.quiet:
                evaluated = _noting_constants(evaluated, objectives_of(problem))
            return run_search(problem, method, folder, planned.generations, show, evaluated, args.evaluations)


def _noting_constants(evaluate: "Evaluate", objectives: Sequence[Objective]) -> "Evaluate":
    """The function, with a note if one of several objectives is the same in all designs that it evaluates first."""
    looked = len(objectives) < 2

    def evaluate_and_note(request: "Request") -> "Evaluation":
        nonlocal looked
        found = evaluate(request)
        if not looked:
            looked = True
            for doubt in constants_in(objectives, found.objectives):
                note(doubt)
        return found

    return evaluate_and_note


def _write_best(problem: "Problem", last: "Generation", folder: "RunFolder") -> list[str]:
    """Gait table and pictures of the best design, unless they are up to date; the names of all files."""
    from optim.problems.robot_designing import RobotDesigning
    from optim.runs.products import make_product

    if last.best_point is None:
        return []
    if not isinstance(problem, RobotDesigning):
        return [BEST_DESIGN]
    robot = problem.robot_of(problem.space.from_dict(last.best_point))
    written = [BEST_DESIGN]
    if robot.has_table:
        make_product(folder, TABLE_FILE, functools.partial(_write_table, robot, folder.config["method"]["seed"]))
        written.append(TABLE_FILE)
    for name, write in problem.products(problem.space.from_dict(last.best_point)).items():
        make_product(folder, name, write)
        written.append(name)
    for world in problem.tried_in if robot.pictured else ():
        name = f"robot_{world.name.replace(':', '_').replace('/', '_')}.png"
        make_product(folder, name, functools.partial(robot.save_picture, world))
        written.append(name)
    return written


def _write_table(robot: "Robot", seed: int, path: Path) -> None:
    from robots.hardware import write_csv

    write_csv(robot.table(on_violation="clip", seed=seed), path)  # its header tells what was clipped


def _report(last: "Generation", folder: Path, written: list[str], planned: Plan) -> Report:
    from optim.problems.robot import RobotDesignProblem
    from optim.problems.uncertain import ROBUST_FILE
    from optim.runs.robust import lines_of, read_robust
    from robots.hardware.rig_table import clipped_in

    document = {"folder": str(folder), **dataclasses.asdict(last), "files": written}
    if last.best is None:
        return Report(document, f"{folder}: nothing succeeded in {counted(last.evaluations, 'evaluation')}", FAILED)
    numbers = {name: value for name, value in (last.best_details or {}).items() if isinstance(value, int | float)}
    worlds = [world.name for world in getattr(planned.problem, "tried_in", ())]
    details, *lines = _told_by_world(numbers, worlds, planned.score.name)
    best = planned.score.value(last.best) + (f" ({details})" if details else "")
    spent = counted(last.evaluations, "evaluation")
    told = [f"best {planned.score.name}: {best} after {spent}", *lines, f"{folder}: {', '.join(written)}"]
    problem = planned.problem
    if broken := problem.limits_broken(numbers) if isinstance(problem, RobotDesignProblem) else []:
        document["limits_broken"] = broken
        told[1:1] = [f"breaks {each}" for each in broken]
    if TABLE_FILE in written and (clipped := clipped_in(folder / TABLE_FILE)):
        told.append(f"{TABLE_FILE}: clipped {counted(len(clipped), 'time')} to a rig's limits, as its header tells")
    if ROBUST_FILE in written:
        document["robust"] = read_robust(folder)
        told[-1:-1] = lines_of(folder)
    if without := _why_no_table(problem, last):
        document["no_table"] = without
        told.append(f"no {TABLE_FILE}: {without}")
    told += _how_to_judge(problem, last, folder)
    return Report(document, "\n".join(told))


def _how_to_judge(problem: "Problem", last: "Generation", folder: Path) -> list[str]:
    """The command that tells how far the best design can be trusted, of robots that have such a check."""
    from optim.problems.robot_designing import RobotDesigning

    if last.best_point is None or not isinstance(problem, RobotDesigning):
        return []
    robot = problem.robot_of(problem.space.from_dict(last.best_point))
    command = f"morpholab simulate --robot {shlex.quote(str(folder))} --judge"
    return [f"how far to trust it: {command}"] if robot.can_be_judged else []


def _why_no_table(problem: "Problem", last: "Generation") -> str:
    """Why the best design has no table, where others of its kind have one, and what helps; empty otherwise."""
    from optim.problems.robot import RobotDesignProblem

    if last.best_point is None or not isinstance(problem, RobotDesignProblem):
        return ""
    why = problem.robot_of(problem.space.from_dict(last.best_point)).no_table_reason
    option = problem.offered.table_option
    return f"{why}; search with {option}" if why and option else why


def _told_by_world(numbers: Mapping[str, float], worlds: Sequence[str], score: str) -> list[str]:
    """Lines about the numbers of a design: those of no single world, then a line for each of several worlds.

    Where there is one world, the score in it goes by the name of the world: what it is is told before.
    """
    parts: dict[str, list[str]] = {name: [] for name in ("", *worlds)}
    for name, value in numbers.items():
        fitting = [w for w in worlds if name.endswith(f"_{w}")] if len(worlds) > 1 else []
        world = max(fitting, key=len, default="")  # the name of a world may end as another one does
        parts[world].append(
            f"{name.removesuffix(f'_{world}') if world else name.removeprefix(f'{score}_')} {decimal(value)}"
        )
    return [", ".join(parts.pop("")), *(f"  {world}: {', '.join(found)}" for world, found in parts.items() if found)]


def _of_task(report: Report, given: str | None, problem: "Problem", last: "Generation") -> Report:
    """The report with whether the best design has succeeded, where a task says what that is."""
    from optim.problems.robot import RobotProblem

    if given is None or last.best_point is None or not isinstance(problem, RobotProblem):
        return report
    task = find_task(given)
    if not task.success:
        return report
    best = problem.robot_of(problem.space.from_dict(last.best_point))
    missed = task.missed(best, problem.tried_in, problem.compute)
    asked = " and ".join(one.text for one in task.success)
    told = f"not succeeded, {'; '.join(missed)}" if missed else f"succeeded, {asked} was asked"
    document = {**report.document, "task": task.name, "succeeded": not missed}  # type: ignore[dict-item]
    return dataclasses.replace(report, document=document, text=f"{report.text}\ntask {task.name}: {told}")


def _interrupted(planned: Plan, folder: Path, code: int) -> Report:
    """The report of an interrupted search: its last complete generation, which may not have been shown."""
    from optim.runs.history import read_progress

    last = read_progress(folder).last
    document = {"folder": str(folder), "interrupted": True, **(dataclasses.asdict(last) if last else {})}
    if last is None:
        return Report(document, f"interrupted before the first generation was complete; {folder}: --resume", code)
    text = f"interrupted: {_text(last, planned)}\n{folder} keeps every complete generation, go on with --resume"
    return Report(document, text, code)


def _text(last: "Generation", planned: Plan) -> str:
    best, mean = Objective(planned.best_name).value(last.best), planned.score.value(last.mean)
    spent = counted(last.evaluations, "evaluation")
    return f"generation {last.generation}/{planned.generations}: {planned.best_name} {best}, mean {mean}, {spent}"
