"""What ``morpholab codesign`` shall do: its options, put together with the run that it continues."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import options
from optim.commands.codesign_seeds import SEEDS
from optim.commands.options import Option, count
from optim.commands.robots import early, history_of, named_doing
from optim.problem import FILE, Objective, objectives_of, score_of
from optim.problems import kind_of_description, kind_of_run, problem_of_run
from optim.problems.designer import Design, DesignRequest, designer_of
from optim.runs.config import GROUND_FILES, check_ground_files, has_run, read_config, run_of_any_seed, settings_of
from optim.search import METHOD, METHODS, check_objectives, check_settings, default_settings, takes_several
from robots.robot import RobotKind
from robots.tasks import find_task
from taichi_sim.base.options import flag_of
from taichi_sim.base.results_folder import BEST_DESIGN

if TYPE_CHECKING:
    from optim.problem import Problem

GENERATIONS = 200
# Options that are settings of the method by the same name, where they are given.
SETTINGS = (
    count("climbers", 1, "independent searches (default: 60)"),
    count("population", 1, "points of a method that moves one population (default: 60)"),
    count("seed", 0, "of all random numbers (default: 0)"),
)
SEARCH_BY_GRADIENTS = (
    Option("rule", "of the steps (default: adam)", choices=("adam", "l-bfgs")),
    Option(
        "learning_rate",
        "typical step, in ranges of the variables (default: 0.05; of memetic 0.3)",
        options.number(0.0),
        "RATE",
    ),
    Option(
        "gradient",
        "of the simulation, or estimated from perturbed points (default: exact)",
        choices=("exact", "smoothed"),
    ),
    count(
        "samples",
        0,
        "pairs of perturbed points a climber (default: 8), or around the mean of cma-gradient (default: 0)",
    ),
    Option(
        "smoothing",
        "of the perturbations, in ranges of the variables (default: 0.05)",
        options.number(0.0),
        "DEVIATION",
    ),
)
SEARCH_OPTIONS = (
    Option(
        "method",
        f"one of {', '.join(METHODS.builtin)}, or of an installed package (default: {METHOD})",
        options.checked(METHODS.check),
        "METHOD",
    ),
    *SETTINGS,
    SEEDS,
    count("generations", 0, f"after the random starts (default: {GENERATIONS}); may be raised when a run is continued"),
    Option(
        "set",
        "any other setting of the method; a wrong name lists them; may be repeated",
        metavar="NAME=VALUE",
        several=True,
    ),
)


@dataclass(frozen=True)
class Plan:
    """A search to be done, new or continued.

    Attributes:
        problem: what is designed.
        method: name of the search method.
        settings: of the method, by name.
        generations: number of the last one.
        note: what was fixed by default, or nothing.
    """

    problem: "Problem"
    method: str
    settings: dict[str, Any]
    generations: int
    note: str

    @property
    def score(self) -> Objective:
        """Name and unit of the scores."""
        return score_of(objectives_of(self.problem))

    @property
    def best_name(self) -> str:
        """What progress calls the best score: by its name where objectives were named, as it may be negated."""
        named = isinstance(getattr(self.problem, "objective", ""), tuple)
        return f"best {self.score.name}" if named else "best"

    def config(self) -> dict[str, Any]:
        """The settings of the run."""
        return settings_of(self.problem, self.method, self.settings, self.generations)


def named_kinds(words: Sequence[str]) -> list[RobotKind]:
    """The kind of robot that a command line names, in words, in its task file, or by the run that it continues."""
    found = early([word for word in words if word != "--resume"], "--robot", "--task", "--out")
    robot = found.robot
    if robot is None and found.task is not None:
        robot = find_task(found.task).source
    if robot is None and "--resume" in words and found.out is not None:
        out = Path(found.out)
        if run := out if has_run(out) else run_of_any_seed(out):
            return [kind_of_run(run, read_config(run))]
    return [named_doing(robot, None).kind]


def check_said_once(args: argparse.Namespace) -> None:
    """Refuse settings of the method that options say twice, of which one would silently count.

    Raises:
        ValueError: for a name that is repeated by ``--set``, or has another value there than by its own option.
    """
    named = options.given((*SETTINGS, *SEARCH_BY_GRADIENTS), args)
    said: set[str] = set()
    for name, value in map(options.setting, args.set or ()):
        if name in said:
            raise ValueError(f"set: {name} is given twice; leave one out")
        if name in named and named[name] != value:
            raise ValueError(f"set: {name}={value} is not allowed beside {flag_of(name)} {named[name]}; leave one out")
        said.add(name)


def plan(args: argparse.Namespace) -> Plan:
    """The search that the options, and the run in the folder if it continues, ask for.

    Raises:
        ValueError: if they do not fit.
    """
    known = _known(args)
    name = args.method or METHOD
    if known:
        name = known["method"]["name"]
        if args.method not in (None, name):
            raise ValueError(
                f"method.name: {args.method!r} is not what the run in {args.out} has, {name!r}; leave it out"
            )
    if args.problem is not None or (known and known["problem"].get("kind") == FILE):
        design = Design(_problem_of_file(args, known))
    else:
        design = _robot_design(args, known, name)
    if known and (begun := _begun(args)):
        check_ground_files(known, getattr(design.problem, GROUND_FILES, {}), begun)
    check_objectives(name, design.problem.objective_names)
    settings = _method(args, name, design, known["method"] if known else None)
    generations = args.generations
    if generations is None:
        generations = known["generations"] if known else GENERATIONS
    return Plan(design.problem, name, settings, generations, design.note)


def _begun(args: argparse.Namespace) -> Path | None:
    """The folder of the run that continues; for one of several seeds that has not begun, that of another."""
    if not args.resume:
        return None
    if has_run(args.out):
        return args.out
    return run_of_any_seed(args.out.parent) if args.seeds else None


def _known(args: argparse.Namespace) -> dict[str, Any] | None:
    """Settings of the run that continues; for one of several seeds that has not begun, those of the others."""
    if (begun := _begun(args)) is None:
        return None
    known = read_config(begun)
    if begun == args.out:
        return known
    from optim.problems.robot_designing import seeded

    problem = seeded(known["problem"], known["method"]["seed"], args.seed)
    return {**known, "problem": problem, "method": {**known["method"], "seed": args.seed}}


def _robot_design(args: argparse.Namespace, known: dict[str, Any] | None, method: str) -> Design:
    """The problem of a robot, new or of the run that continues."""
    last = problem_of_run(begun, known) if known and (begun := _begun(args)) else None
    named = named_doing(args.robot, None)
    source = named.source
    kind = kind_of_description(known["problem"]) if known else named.kind
    if kind is None:
        raise ValueError(f"out: the run in {args.out} designs no robot")
    # Python sets any kind; which robot it is is compared.
    file = source is not None and source not in named.kind.designs
    if known and args.robot is not None and named.kind.name != kind.name and not file:
        raise ValueError(f"robot: the run in {args.out} is one of {kind.title}; leave --robot out")
    designer = designer_of(kind)
    if named.run is not None and not designer.holds:
        raise ValueError(f"robot: {named.run} is a run; {kind.title} goes on from none, give {named.run / BEST_DESIGN}")
    given = {**args.parser.values(args, kind), **options.given_compute(args)}
    best_of = None if named.run is None else history_of(named.run)
    return designer.design(
        DesignRequest(source, given, method, takes_several(method), last, args.out, args.resume, best_of)
    )


def _problem_of_file(args: argparse.Namespace, known: dict[str, Any] | None) -> "Problem":
    """The problem of ``--problem``, which must be that of the run that continues.

    Raises:
        ValueError: if the file is missing or another, or an option says what the file says.
    """
    from optim.problems.user_file import check_file, load_problem

    for name in (*args.parser.known_to, "robot", "precision", "device"):
        if getattr(args, name, None) is not None:
            raise ValueError(f"{name.replace('_', '-')}: the file of --problem says what is designed; leave it out")
    if args.problem is None:
        file = known["problem"].get("file") if known else None
        raise ValueError(f"problem: the run in {args.out} needs its file again; give --problem {file}")
    if known and known["problem"].get("kind") != FILE:
        raise ValueError(f"problem: the run in {args.out} is of no file; leave --problem out")
    problem = load_problem(args.problem)
    if known:
        check_file(problem, known["problem"], args.out)
    return problem


def _method(args: argparse.Namespace, name: str, design: Design, known: dict[str, Any] | None) -> dict[str, Any]:
    """Settings of the method; what is not given is as in the run that continues, or the default."""
    given = options.given((*SETTINGS, *SEARCH_BY_GRADIENTS), args)
    own = dict(options.setting(text) for text in args.set or ())
    _check_left_to_design(own, design)
    if design.start:
        given["start"] = dict(design.start)
    given |= own
    check_settings(name, given)
    settings = default_settings(name) if known is None else {k: v for k, v in known.items() if k != "name"}
    settings |= {**given, **design.settings}
    return settings | (_map(design.problem, settings) if getattr(METHODS[name], "kind", "") == "elites" else {})


def _check_left_to_design(own: Mapping[str, Any], design: Design) -> None:
    """Refuse settings of ``--set`` that the robot's own options, or its problem, decide otherwise.

    Raises:
        ValueError: for a start beside that of the options, and for what the problem needs to be another.
    """
    if "start" in own and design.start and own["start"] != dict(design.start):
        raise ValueError(
            f"set: start={own['start']} is not allowed beside options that say where to start; leave one out"
        )
    for name, value in design.settings.items():
        if name in own and own[name] != value:
            raise ValueError(f"set: {name}={own[name]} is not allowed; this search needs {name}={value}")


def _map(problem: "Problem", settings: Mapping[str, Any]) -> dict[str, Any]:
    """Axes of a map of elites and their ranges, as far as they are not given: the body, or what the robot suggests."""
    names, suggested = problem.space.names, getattr(problem, "descriptors", {})
    body = [each for each in names if each == "orientation" or each.startswith("pressure")]
    axes = settings.get("descriptors", body or list(suggested)[:2] or list(names[:2]))
    given = settings.get("ranges") or {}
    known = isinstance(axes, list) and isinstance(given, Mapping)
    ends = {n: list(ends) for n, ends in suggested.items() if known and n in axes and n not in given}
    return {"descriptors": axes} | ({"ranges": {**ends, **given}} if ends else {})
