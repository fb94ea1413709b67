"""What ``morpholab codesign`` shall do: its options, put together with the run that it continues."""

import argparse
import dataclasses
import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import options
from optim.problem import FILE, GAIT, Objective, objectives_of, score_of
from optim.search import check_objectives, check_settings, default_settings, takes_several

if TYPE_CHECKING:
    from optim.problem import Problem
    from optim.problems.inflatable.problem import GaitProblem

METHOD = "hill-climb"
GENERATIONS = 200
RELAXED = ("bits", "graded")  # encodings with gradients
# Options that are settings of the method by the same name, where they are given.
SETTINGS = ("climbers", "population", "seed", "rule", "learning_rate", "gradient", "samples", "smoothing")


@dataclass(frozen=True)
class Plan:
    """What is to be done.

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
    def what(self) -> str:
        """What is designed, or the score of a problem of the user's own."""
        kind = self.problem.describe().get("kind", GAIT)
        return self.score.name if kind == FILE else str(kind)

    @property
    def score(self) -> Objective:
        """Name and unit of the scores."""
        return score_of(objectives_of(self.problem))

    def config(self) -> dict[str, Any]:
        """The settings of the run."""
        from optim.runs.config import settings_of

        return settings_of(self.problem, self.method, self.settings, self.generations)


def plan(args: argparse.Namespace) -> Plan:
    """What the options, and the run in the folder if it continues, ask for.

    Raises:
        ValueError: in one line, if they do not fit.
    """
    from optim.commands.robot_options import is_robot, robot_problem
    from optim.problems.inflatable.problem import GaitProblem
    from optim.runs.config import has_run, problem_of, read_config

    known = read_config(args.out) if args.resume and has_run(args.out) else None
    name = _same("method.name", args.method, known["method"]["name"], args.out) if known else args.method or METHOD
    problem: Problem
    if args.problem is not None or (known and known["problem"].get("kind") == FILE):
        problem, note = _problem_of_file(args, known), ""
    elif is_robot(args, known):
        problem, note = robot_problem(args, known), ""
    else:
        last = problem_of(args.out, known, GaitProblem.from_description) if known else None
        problem, note = _problem(args, last, name)
    check_objectives(name, problem.objective_names)
    settings = _method(args, name, problem, known["method"] if known else None)
    generations = args.generations
    if generations is None:
        generations = known["generations"] if known else GENERATIONS
    return Plan(problem, name, settings, generations, note)


def _problem_of_file(args: argparse.Namespace, known: dict[str, Any] | None) -> "Problem":
    """The problem of ``--problem``, which must be that of the run that continues.

    Raises:
        ValueError: if the file is missing or another, or an option says what the file says.
    """
    from optim.commands.robot_options import refuse_design_options
    from optim.problems.user_file import check_file, load_problem

    refuse_design_options(args)
    if args.problem is None:
        file = known["problem"].get("file") if known else None
        raise ValueError(f"problem: the run in {args.out} needs its file again; give --problem {file}")
    if known and known["problem"].get("kind") != FILE:
        raise ValueError(f"problem: the run in {args.out} is of no file; leave --problem out")
    problem = load_problem(args.problem)
    if known:
        check_file(problem, known["problem"], args.out)
    return problem


def _same(field: str, given: str | None, known: str, folder: Path) -> str:
    """What a run that continues has; an error where something else is given, before that fits nothing else."""
    if given not in (None, known):
        raise ValueError(f"{field}: {given!r} is not what the run in {folder} has, {known!r}; leave it out")
    return known


def _problem(args: argparse.Namespace, known: "GaitProblem | None", method: str) -> tuple["GaitProblem", str]:
    """The problem asked for, and a note on what was fixed by default.

    What is not given is as in the run that continues, or else the default.
    """
    from optim.problems.inflatable.description import OPTIONS
    from optim.problems.inflatable.problem import PARTS, GaitProblem

    settings = {f.name: getattr(known, f.name) for f in dataclasses.fields(known)} if known else {}
    if known and known.schedule is None:
        _same("problem.encoding", args.encoding, known.encoding, args.out)
    settings.setdefault("encoding", args.encoding or ("bits" if method == "gradient" else "codes"))
    _choose_objectives(settings, args, known, method)
    if (rig := options.load_rig(args.calibration)) is not None:
        settings["properties"], own = rig
        settings.setdefault("geometry", own)
    for name in (*OPTIONS, "steps", "warm_up", "stages", "ladder", "ahead", "hard", "effort", "threads"):
        if getattr(args, name) is not None:
            settings[name] = getattr(args, name)
    terrains = settings["terrains"] = tuple(args.terrain or settings.get("terrains", ()))
    if not terrains:
        new = f", and {args.out} holds no run to continue" if args.resume else ""
        raise ValueError(f"terrain: none given{new}; say where the robot shall travel, such as --terrain flat")
    free = args.free.split(",") if args.free is not None else known.free if known else PARTS
    unknown = [part for part in free if part not in PARTS]
    if unknown:
        raise ValueError(f"free: {unknown[0]!r} is unknown; give some of {','.join(PARTS)}")
    if len(set(free)) < len(free):
        raise ValueError(f"free: {','.join(free)} is not allowed; give none twice")
    # As published, what is not free is as in rolling on flat ground, as in inching on hills; both: rolling.
    gait = args.gait or ("inching" if all(terrain.slope for terrain in terrains) else "rolling")
    taken = _fix(settings, args, free, gait)
    if args.gait and not taken:
        raise ValueError(f"gait: {gait} is not used; all it could give is free, or given")
    if settings["schedule"] is not None:
        if args.encoding is not None:
            raise ValueError(f"encoding: {args.encoding!r} is not used; the control is fixed")
        settings["schedule"] = options.cut(settings["schedule"], args.columns, args.repeats)
    if method == "gradient" and settings["schedule"] is None and settings["encoding"] not in RELAXED:
        raise ValueError(
            f"encoding: {settings['encoding']!r} has no gradient; method gradient needs {' or '.join(RELAXED)}"
        )
    if settings["schedule"] is None and settings["encoding"].startswith("graded") and args.repeats is not None:
        raise ValueError(f"repeats: {args.repeats} is not allowed; graded gaits are played as often as --steps allow")
    by_default = taken and not args.gait
    note = f"note: {', '.join(taken)} neither free nor given: as in {gait}" if by_default else ""
    return GaitProblem(**settings), note


def _choose_objectives(
    settings: dict[str, Any], args: argparse.Namespace, known: "GaitProblem | None", method: str
) -> None:
    """The mean over the terrains, or each of them where the method looks for a front."""
    several = takes_several(method)
    if known:
        _same("problem.objectives", args.objective, known.objectives, args.out)
    settings.setdefault("objectives", args.objective or ("terrains" if several else "mean"))
    count = len(set(args.terrain)) if args.terrain else 0
    if settings["objectives"] == "terrains" and not several:
        raise ValueError(f"objective: 'terrains' needs a method for several objectives; {method} takes one, the mean")
    if settings["objectives"] == "terrains" and not known and count < 2:
        raise ValueError("objective: 'terrains' needs at least two; repeat --terrain, or choose --objective mean")


def _fix(settings: dict[str, Any], args: argparse.Namespace, free: Collection[str], gait: str) -> list[str]:
    """Set what is not free, and clear what is; the names of what was taken from the gait."""
    from optim.problems.inflatable.problem import PARTS

    design = options.load_gait(gait)
    taken = []
    for part, name in PARTS.items():
        given = getattr(args, name, None)
        if part in free:
            if given is not None:
                hint = f"take {part} out of --free, or use --start-{name}"
                told = ",".join(f"{value:g}" for value in (given if isinstance(given, tuple) else (given,)))
                raise ValueError(f"{name}: {told} would fix what is free; {hint}")
            settings[name] = None
        elif given is not None:
            settings[name] = given
        elif args.gait or settings.get(name) is None:
            settings[name] = getattr(design, name)
            taken.append(name)
    return taken


def _method(args: argparse.Namespace, name: str, problem: "Problem", known: dict[str, Any] | None) -> dict[str, Any]:
    """Settings of the method; what is not given is as in the run that continues, or the default."""
    from optim.problems.user_file import FileProblem

    given = {option: getattr(args, option) for option in SETTINGS if getattr(args, option) is not None}
    if start := _start(args, problem):
        given["start"] = start
    given |= dict(_setting(text) for text in args.set or ())
    check_settings(name, given)
    settings = default_settings(name) if known is None else {k: v for k, v in known.items() if k != "name"}
    settings |= given
    if name == "gradient" and not isinstance(problem, FileProblem):
        settings["verify"] = True  # a relaxed judgement of a gait is never quite the true one
    if name == "map-elites":  # the grid of the lab: the body
        body = [name for name in problem.space.names if name == "orientation" or name.startswith("pressure")]
        settings.setdefault("descriptors", body or list(problem.space.names[:2]))
    return settings


def _start(args: argparse.Namespace, problem: "Problem") -> dict[str, float]:
    """Where variables start: at a gait, but for what is given of its shape; a pressure is of all cores, or one each."""
    from optim.problems.inflatable.problem import GaitProblem
    from optim.problems.inflatable.start import start_values
    from robots.inflatable.cores import each_pressure

    if not isinstance(problem, GaitProblem):
        return {}
    start = {} if args.start is None else start_values(problem, options.load_gait(args.start))
    if args.start_orientation is not None:
        start["orientation"] = args.start_orientation
    if args.start_pressure is not None:
        start |= dict(zip(problem.shape.pressures, each_pressure(args.start_pressure, problem.body), strict=True))
    return start


def _setting(text: str) -> tuple[str, Any]:
    """``NAME=VALUE``, the value as JSON, or else as text."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise ValueError(f"set: {text!r} is not allowed; give NAME=VALUE")
    try:
        return name.replace("-", "_"), json.loads(value)
    except ValueError:
        return name.replace("-", "_"), value
