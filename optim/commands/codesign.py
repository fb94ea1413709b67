"""``morpholab codesign``: search for a body and a gait, in a run folder that can be continued."""

import argparse
import dataclasses
import sys
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optim.commands import Report, options
from optim.commands.progress import shown_progress
from optim.search import METHODS, default_settings

if TYPE_CHECKING:
    from optim.gait_problem import GaitProblem
    from optim.runs import Generation, RunFolder
    from optim.search import Method

METHOD = "hill-climb"
GENERATIONS = 200
# Options that are settings of the method by the same name, where they are given.
SETTINGS = ("climbers", "seed", "rule", "learning_rate", "gradient", "samples", "smoothing")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "codesign",
        help="design a robot and its gait",
        description="Search for the orientation, shape and control with which the robot travels fastest.",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the run")
    parser.add_argument(
        "--resume", action="store_true", help="continue the run in the folder, with its settings"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_json(parser)

    search = parser.add_argument_group("search")
    search.add_argument("--method", choices=tuple(METHODS), help="(default: hill-climb)")
    search.add_argument(
        "--climbers", type=options.whole(1), metavar="N", help="independent searches (default: 60)"
    )
    search.add_argument(
        "--generations",
        type=options.whole(0),
        metavar="N",
        help="after the random starts (default: 200); may be raised when a run is continued",
    )
    search.add_argument(
        "--seed", type=options.whole(0), metavar="N", help="of all random numbers (default: 0)"
    )
    search.add_argument(
        "--start-orientation",
        type=options.number(0.0, 90.0, "degrees"),
        metavar="DEGREES",
        help="with which every climber starts (default: random)",
    )
    search.add_argument(
        "--start-pressure",
        type=options.number(0.0, 12_000.0, "Pa"),
        metavar="PA",
        help="with which every climber starts (default: random)",
    )

    _add_gradient_options(parser.add_argument_group("search by --method gradient"))

    design = parser.add_argument_group("what is designed")
    design.add_argument(
        "--terrain",
        type=options.terrain,
        action="append",
        metavar="TERRAIN",
        help="flat, or hill:15 for 15 degrees; repeat it for the mean over several",
    )
    design.add_argument(
        "--free", metavar="PARTS", help="what may change (default: orientation,shape,control)"
    )
    design.add_argument(
        "--encoding",
        choices=("codes", "bits"),
        help="of the control: frequency and offset of each actuator, or every bit (default: codes; bits with "
        "--method gradient)",
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
        type=options.number(0.0, unit="Pa"),
        metavar="PA",
        help="if shape is not free (default: the gait's own)",
    )
    options.add_robot(parser, precision="f32")
    parser.set_defaults(run=run)


def _add_gradient_options(group: Any) -> None:
    group.add_argument("--rule", choices=("adam", "l-bfgs"), help="of the steps (default: adam)")
    group.add_argument(
        "--learning-rate",
        type=options.number(0.0),
        metavar="RATE",
        help="typical step, in ranges of the variables (default: 0.05)",
    )
    group.add_argument(
        "--gradient",
        choices=("exact", "smoothed"),
        help="of the simulation, or estimated from perturbed points (default: exact)",
    )
    group.add_argument(
        "--samples", type=options.whole(1), metavar="N", help="pairs of perturbed points a climber (default: 8)"
    )
    group.add_argument(
        "--smoothing",
        type=options.number(0.0),
        metavar="DEVIATION",
        help="of the perturbations, in ranges of the variables (default: 0.05)",
    )


def run(args: argparse.Namespace) -> Report:
    """Search, then write what the best design needs."""
    from optim.gait_problem import GaitProblem
    from optim.runs import open_run
    from optim.runs.environment import environment
    from optim.runs.folder import has_run, read_config
    from optim.search import build_method

    known = read_config(args.out) if args.resume and has_run(args.out) else None
    name = _same("method.name", args.method, known["method"]["name"], args.out) if known else args.method or METHOD
    problem, note = _problem(args, GaitProblem.from_description(known["problem"]) if known else None, name)
    settings = _method(args, name, known["method"] if known else None)
    method = build_method(name, problem.space, settings)
    generations = args.generations
    if generations is None:
        generations = known["generations"] if known else GENERATIONS
    config = {"problem": problem.describe(), "method": {"name": name, **settings}, "generations": generations}
    about = environment(
        device=problem.device, precision=problem.precision, threads=args.threads, seed=settings["seed"]
    )
    with open_run(args.out, config, resume=args.resume, environment=about) as folder:
        if note and not args.quiet:
            print(note, file=sys.stderr)
        try:
            last = _search(problem, method, folder, generations, args.quiet)
            written = _write_best(problem, last, folder.path)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"; {args.out} keeps every complete generation, go on with --resume"
            ) from None
    return _report(last, folder.path, written)


def _search(
    problem: "GaitProblem", method: "Method", folder: "RunFolder", generations: int, quiet: bool
) -> "Generation":
    from optim.runs import run_search

    done = 0
    with shown_progress("random starts", generations + 1, quiet) as update:

        def show(last: "Generation") -> None:
            nonlocal done
            done = last.generation + 1
            update(done, _text(last, generations))

        problem = dataclasses.replace(problem, progress=lambda fraction: update(done + fraction, None))
        return run_search(problem, method, folder, generations, show)


def _same(field: str, given: str | None, known: str, folder: Path) -> str:
    """What a run that continues has; an error where something else is given, before that fits nothing else."""
    if given not in (None, known):
        raise ValueError(f"{field}: {given!r} is not what the run in {folder} has, {known!r}; leave it out")
    return known


def _problem(args: argparse.Namespace, known: "GaitProblem | None", method: str) -> tuple["GaitProblem", str]:
    """The problem asked for, and a note on what was fixed by default.

    What is not given is as in the run that continues, or else the default.
    """
    from optim.gait_problem import OPTIONS, PARTS, GaitProblem

    settings = {f.name: getattr(known, f.name) for f in dataclasses.fields(known)} if known else {}
    if known and known.schedule is None:
        _same("problem.encoding", args.encoding, known.encoding, args.out)
    settings.setdefault("encoding", args.encoding or ("bits" if method == "gradient" else "codes"))
    for name in (*OPTIONS, "threads"):
        if getattr(args, name) is not None:
            settings[name] = getattr(args, name)
    terrains = settings["terrains"] = tuple(args.terrain or settings.get("terrains", ()))
    if not terrains:
        raise ValueError("terrain: none given; say where the robot shall travel, such as --terrain flat")
    free = args.free.split(",") if args.free is not None else known.free if known else PARTS
    unknown = [part for part in free if part not in PARTS]
    if unknown:
        raise ValueError(f"free: {unknown[0]!r} is unknown; give some of {','.join(PARTS)}")
    # As published, what is not free is as in rolling on flat ground, as in inching on hills; both: rolling.
    gait = args.gait or ("inching" if all(terrain.slope for terrain in terrains) else "rolling")
    taken = _fix(settings, args, free, gait)
    if args.gait and not taken:
        raise ValueError(f"gait: {gait} is not used; all it could give is free, or given")
    if settings["schedule"] is not None:
        settings["schedule"] = options.cut(settings["schedule"], args.columns, args.repeats)
    if method == "gradient" and not known and settings["schedule"] is None and settings["encoding"] == "codes":
        raise ValueError("encoding: 'codes' has no gradient; method gradient needs bits")
    by_default = taken and not args.gait
    note = f"note: {', '.join(taken)} neither free nor given: as in {gait}" if by_default else ""
    return GaitProblem(**settings), note


def _fix(settings: dict[str, Any], args: argparse.Namespace, free: Collection[str], gait: str) -> list[str]:
    """Set what is not free, and clear what is; the names of what was taken from the gait."""
    from optim.gait_problem import PARTS

    design = options.load_gait(gait)
    taken = []
    for part, name in PARTS.items():
        given = getattr(args, name, None)
        if part in free:
            if given is not None:
                hint = f"take {part} out of --free, or use --start-{name}"
                raise ValueError(f"{name}: {given:g} would fix what is free; {hint}")
            settings[name] = None
        elif given is not None:
            settings[name] = given
        elif args.gait or settings.get(name) is None:
            settings[name] = getattr(design, name)
            taken.append(name)
    return taken


def _method(args: argparse.Namespace, name: str, known: dict[str, Any] | None) -> dict[str, Any]:
    """Settings of the method; what is not given is as in the run that continues, or the default."""
    given = {name: getattr(args, name) for name in SETTINGS}
    start = {"orientation": args.start_orientation, "pressure": args.start_pressure}
    settings = default_settings(name) if known is None else {k: v for k, v in known.items() if k != "name"}
    settings |= {name: value for name, value in given.items() if value is not None}
    if name == "gradient":
        settings["verify"] = True  # a relaxed judgement of a gait is never quite the true one
    if any(value is not None for value in start.values()):
        settings["start"] = {name: value for name, value in start.items() if value is not None}
    return settings


def _write_best(problem: "GaitProblem", last: "Generation", folder: Path) -> list[str]:
    """Gait table and pictures of the best design, unless they are up to date; the names of all files."""
    from optim.runs.files import replacing
    from robots.hardware import export_csv
    from robots.inflatable import NAMED_GEOMETRIES, InflatableActuation
    from robots.view.picture import save_motion_picture

    if last.best_point is None:
        return []
    design = problem.design(problem.space.from_dict(last.best_point))
    robot: dict[str, Any] = {
        "geometry": NAMED_GEOMETRIES[problem.geometry],
        "actuation": InflatableActuation(weight=problem.weight),
    }
    best = folder / "best.json"
    table = folder / "gait.csv"
    if _older(table, best):
        export_csv(design, table)
    pictures = [folder / f"robot_{terrain.name.replace(':', '_')}.png" for terrain in problem.terrains]
    for terrain, picture in zip(problem.terrains, pictures, strict=True):
        if _older(picture, best):
            with replacing(picture) as aside:
                save_motion_picture(design, terrain, aside, **robot)
    return [path.name for path in (best, table, *pictures)]


def _older(path: Path, than: Path) -> bool:
    return not path.exists() or path.stat().st_mtime_ns < than.stat().st_mtime_ns


def _report(last: "Generation", folder: Path, written: list[str]) -> Report:
    document = {"folder": str(folder), **dataclasses.asdict(last), "files": written}
    if last.best is None:
        return Report(document, f"{folder}: all {last.evaluations} evaluations failed", failed=True)
    details = (last.best_details or {}).items()
    speeds = ", ".join(f"{name.removeprefix('speed_')} {value:.4f}" for name, value in details)
    text = (
        f"best gait: {last.best:.4f} BL/s ({speeds}) after {last.evaluations} evaluations\n"
        f"{folder}: {', '.join(written)}"
    )
    return Report(document, text)


def _text(last: "Generation", generations: int) -> str:
    best, mean = ("none" if value is None else f"{value:.4f}" for value in (last.best, last.mean))
    speeds = f"best {best}, mean {mean} BL/s"
    return f"generation {last.generation}/{generations}: {speeds}, {last.evaluations} evaluations"
