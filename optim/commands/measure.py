"""``morpholab measure``: what the body of a robot does to learning, by controllers tried in several environments."""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from optim.commands import Report, goes_on, options
from optim.commands.options import QUIET, Command, Option, count, path_to
from optim.commands.robots import Named, history_of, kinds_of_robot, named_doing, own_alone
from optim.progress import shown_progress
from optim.runs.config import GROUND_FILES
from robots.ground_files import ground_files
from robots.robot import Robot, RobotKind, World, make_robot
from robots.tasks import Success
from taichi_sim.base.parsing import json_text, parse_json
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from optim.experiments.body_metrics import BodyMetrics, Environments
    from optim.measures.catastrophic_interference import MeanOfRuns, SeveralRuns


USUAL_CONTROLLERS = 1000


COMMAND = Command(
    "measure",
    "measure what a robot's body does to learning",
    "Try controllers of a robot, drawn at random or all on a grid, in several environments: M_L is the share that "
    "succeeds in all of them, M_CI that share of those that succeed in any. Climbers that mutate controllers tell how "
    "much what helps in one environment harms in others (M1 to M4 of chapter 2); senses, how alike environments look "
    "to controllers that succeed everywhere. The same command goes on where an earlier one was.",
    (
        options.robot("or the folder of a run; all that is free of it counts as its controller", "(required)"),
        Option(
            "hold",
            "parameters that are not its controller, by name or pattern, such as '*_size': they are held as in the "
            "best design of the run, or else as simulate tries them; repeat it for more",
            metavar="NAME",
            several=True,
        ),
        Option(
            "environments",
            "a world of the robot, such as flat, hill:5 or the number of a light; repeat it (default: the robot's "
            "own, of a run those that it was designed in)",
            metavar="WORLD",
            several=True,
        ),
        Option(
            "success",
            "what a controller has to keep, such as 'speed >= 0.2'; one for all environments, or repeat it, one for "
            "each",
            options.checked(Success.parse),
            "BOUND",
            several=True,
            required=True,
        ),
        count("controllers", 1, f"drawn at random (default: {USUAL_CONTROLLERS})"),
        count("grid", 2, "values of each variable, instead, of which all combinations are tried"),
        count("climbers", 0, "that mutate controllers, for M1 to M4 (default: 0)", default=0),
        count("generations", 1, "of their mutations (default: 50)", default=50),
        count(
            "runs",
            1,
            "independent runs of the climbers; M1 to M4 are means over them, with 95 %% intervals (default: 1); the "
            "same command with more of them goes on",
            default=1,
        ),
        count("seed", 0, "(default: 0)", default=0),
        path_to("out", "DIR", "folder of the results", required=True),
        QUIET,
    ),
    options.simulation("that of searches, f64 of most kinds"),
    kinds_of_robot,
    own_alone("measure"),
)


@goes_on
def run(args: argparse.Namespace) -> Report:
    """Measure, and write ``metrics.json``."""
    from optim.experiments.body_metrics import MEASURABLE, Measuring, check_bounds, controllers_of, measure_body
    from optim.space import Space
    from taichi_sim.base.files import write_text
    from taichi_sim.base.results_folder import ResultsFolder

    if args.robot is None:
        raise ValueError(f"robot: measure needs one of which something is free; give --robot, such as {MEASURABLE}")
    if args.grid and args.controllers:
        raise ValueError(
            f"controllers: {args.controllers} is not allowed beside --grid, which tries all combinations; leave one out"
        )
    named = named_doing(args.robot, None)
    kind = named.kind
    robot, worlds = _robot(named, args.parser.values(args, kind), args.hold or ())
    environments = _environments(kind, worlds, args.environments, args.success)
    check_bounds(robot, environments)
    drawn = args.controllers or USUAL_CONTROLLERS
    settings = Measuring(drawn, args.grid or 0, args.climbers, args.generations, args.seed, args.runs)
    controllers_of(Space(tuple(robot.parameters)), settings)  # refuses a grid that is too large
    compute = options.compute(args, kind.search_precision)
    said = {
        "robot": {"kind": kind.name, **parse_json(json_text(robot.describe()))},
        "environments": [world.name for world in environments.worlds],
        "success": [[bound.text for bound in bounds] for bounds in environments.success],
        **settings.lasting("runs"),
        "precision": compute.precision,
        **({GROUND_FILES: files} if (files := ground_files(environments.worlds)) else {}),
    }
    folder = ResultsFolder(args.out, "measures", said)
    with shown_progress(counted(settings.controllers, "controller"), 1.0, args.quiet) as update:
        found = measure_body(robot, environments, settings, compute, folder, update)
    document = {"folder": str(args.out), "robot": robot.name, "environments": said["environments"], **found.document()}

    def write() -> str:
        write_text(args.out / "metrics.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
        return ""

    return Report(document, "\n".join(_lines(robot, environments, found))).written_by(write)


def _robot(named: Named, given: Mapping[str, Any], hold: Sequence[str]) -> tuple[Robot, tuple[World, ...]]:
    """The robot that is named, with what is to be held of it fixed, and the worlds in which it is tried unless told.

    Raises:
        ValueError: for a run of which nothing is held: its best design would not matter.
    """
    from optim.named import held_of_run
    from robots.partly_fixed import held_at

    if named.run is None:
        robot = make_robot(named.kind, named.source, given)
        return held_at(robot, robot.start, hold) if hold else robot, tuple(robot.worlds)
    return held_of_run(history_of(named.run), hold, given, "what is no controller")


def _environments(
    kind: RobotKind, usual: tuple[World, ...], worlds: list[str] | None, bounds: list[Success]
) -> "Environments":
    """Worlds and what has to be kept in each.

    Raises:
        ValueError: for worlds that the kind does not have, and bounds that are neither one nor one each.
    """
    from optim.experiments.body_metrics import Environments

    found = tuple(kind.world(text) for text in worlds) if worlds else usual
    if len(bounds) not in (1, len(found)):
        raise ValueError(f"success: {len(bounds)} are not allowed for {len(found)} environments; give one, or one each")
    each = bounds if len(bounds) > 1 else bounds * len(found)
    return Environments(found, tuple((bound,) for bound in each))


def _lines(robot: Robot, environments: "Environments", found: "BodyMetrics") -> list[str]:
    from optim.named import FEW_TOLD, some_of

    sampled = found.sampled
    free = some_of([parameter.name for parameter in robot.parameters], FEW_TOLD)
    lines = [f"{robot.name}: {counted(sampled.learnability.of, 'controller')}, each with values of its own of {free}"]
    for world, bounds, share in zip(environments.worlds, environments.success, sampled.each, strict=True):
        lines.append(f"  {world.name}, {' and '.join(b.text for b in bounds)}: {_share(share)}")
    lines.append(f"M_L, succeed in all: {_share(sampled.learnability)}")
    lines.append(f"M_CI, of those that succeed in any: {_share(sampled.resistance)}; {sampled.alone:.4f} by chance")
    if found.mutations is not None:
        lines.append(_mutations(found.mutations, _unit_of_missing(robot, environments)))
    if found.felt is not None:
        distance, low, high, number = found.felt
        lines.append(f"homeostasis: {distance:.4g} ({low:.4g} to {high:.4g}), of {counted(number, 'controller')}")
    return lines


def _unit_of_missing(robot: Robot, environments: "Environments") -> str:
    """Text of the unit in which M1 counts what is missing: parts of the bound, or the measure's unit if that is 0."""
    units = {measure.name: measure.unit for measure in robot.measures}
    firsts = [bounds[0] for bounds in environments.success]
    none = dict.fromkeys(units[each.measure] for each in firsts if not each.bound)
    if not none:
        return " of the bound missing"
    spoken = " or ".join(unit or "units of the measure" for unit in none)
    return f" {spoken} missing" if not any(each.bound for each in firsts) else f" of the bound ({spoken} if 0) missing"


def _mutations(found: "SeveralRuns", missing: str) -> str:
    """M1 to M4: of a run, or their means over runs; ``missing``: what M1 counts."""
    runs = len(found.runs)
    whose = "the champion" if runs == 1 else f"the champions of {runs} runs"
    told = (
        ("M1", found.worst, ".4g", missing),
        ("M2", found.angle, ".1f", " degrees"),
        ("M3", found.length, ".4g", ""),
        ("M4", found.share, ".3f", ""),
    )
    means = ", ".join(f"{name} {_mean(mean, form, unit, runs)}" for name, mean, form, unit in told)
    return f"mutations that were kept, {found.changes} of {whose}: {means}"


def _mean(mean: "MeanOfRuns", form: str, unit: str, runs: int) -> str:
    """A mean with its interval, where it has one, its unit, and of how many runs it is, if not of all."""
    if mean.value is None:
        return "none"
    between = "" if mean.low is None else f" ({mean.low:{form}} to {mean.high:{form}})"
    some = "" if mean.counted == runs else f" in {counted(mean.counted, 'run')}"
    return f"{mean.value:{form}}{between}{unit}{some}"


def _share(share: Any) -> str:
    if not share.of:
        return "none"
    values = asdict(share)
    return "{count} of {of}, {value:.4f} ({low:.4f} to {high:.4f})".format(**values)
