"""``morpholab simulate``: one robot in one world."""

import argparse
import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.commands import Report, options
from optim.commands.options import Command, Option, count, file_text, flag, path_to
from optim.commands.robots import TABLE_FILE, kinds_of_robot, loaded, named_doing, world_and_own
from optim.doubts import doubts_after
from optim.exit_codes import FAILED
from optim.notes import note
from optim.progress import shown_progress
from robots.robot import KINDS, OK, Outcome, Robot, World
from taichi_sim.base.checks import whole_number

FILES = ("design.json", "result.json", "frames.npz", TABLE_FILE, "robot.png")
COMMAND = Command(
    "simulate",
    "simulate a robot",
    "Simulate a robot and say how far and how fast it goes, or what else it is judged by.",
    (
        options.robot("one of a kind does what --gait says, or what searches of it start with"),
        Option("gait", "inching, rolling, the file of a design of any kind, or a gait table as CSV", metavar="GAIT"),
        Option("table", "a gait table as CSV that the rig of --rig plays, sample by sample", file_text, "FILE"),
        count("record_every", 1, "with --out: write the pose at every so many steps to frames.npz", metavar="STEPS"),
        flag(
            "judge",
            "tell how far the speed can be trusted; of a gait: the mean of eight runs from starts that differ by 10 "
            "nm, what remains of it under harder conditions, on measured floors, with other friction and with half the "
            "time step, how far feet slip while they grip and all parts under load, drift and chatter; of other "
            "robots: what remains of it if starts or numbers of the design differ a little, with less friction, and "
            "with shorter time steps",
        ),
        Option(
            "uncertain",
            "what is not known exactly, such as friction=20%%,slope=1 (degrees): tell mean, standard deviation, CVaR "
            "and worst over --draws of it that no search sees; repeat it for more",
            metavar="QUANTITY=WIDTH,...",
            several=True,
        ),
        count("draws", 2, "with --uncertain: how many, at most 1000 (default: 64)"),
        Option(
            "risk",
            "with --uncertain, told first: mean, cvar:SHARE of the worst draws, or worst (default: mean)",
            metavar="RISK",
        ),
        path_to("out", "DIR", "new folder for design.json, result.json and robot.png, of gaits also gait.csv"),
        flag("quiet", "no progress"),
    ),
    options.simulation("f64"),
    kinds_of_robot,
    world_and_own("simulate"),
)


def run(args: argparse.Namespace) -> Report:
    """Simulate, and write the files asked for."""
    _check_own_robot(args)
    gait = _gait_of(args)
    options.claim_folder(args, *FILES)
    named = named_doing(args.robot, gait)
    args.precision = args.precision or named.precision
    robot, worlds = loaded(named, args.parser.values(args, named.kind))
    world, compute, what = worlds[0], options.compute(args, "f64"), gait or args.robot
    others = named.other_worlds(worlds)
    title = f"{what} {world.where}".strip() if not others else f"{what} on {world.name}"
    measured = {measure.name for measure in robot.measures}
    own = KINDS.of(robot)  # a file of Python may set a robot of another kind than files of Python are
    place = own.world_option if own.world_option not in measured else "world"

    def told_of(world: World) -> dict[str, Any]:
        values = {name: value for name, value in own.world_values(world).items() if name != own.world_option}
        return {"gait" if gait else "robot": what, place: world.name, **values}

    about = told_of(world)
    if args.judge and not args.uncertain:
        reports = [_judged(args, robot, each, f"{what} on {each.name}" if others else title) for each in worlds]
        documents = [{**told_of(each), **dict(report.document)} for each, report in zip(worlds, reports, strict=True)]
        document = {"worlds": documents} if others else documents[0]
        return Report(document, "\n".join(report.text for report in reports), max(report.code for report in reports))
    if others and not args.quiet:
        note(f"{others} tries another")
    if args.uncertain:
        return _uncertain(args, robot, world, title, about)
    with shown_progress(title, 1.0, args.quiet) as update:
        outcome = robot.simulate((), world, compute=compute, record_every=args.record_every, progress=update)
    return _report(args, robot, world, outcome, title, about)


def _judged(args: argparse.Namespace, robot: Robot, world: World, title: str) -> Report:
    """How far the robot's speed in a world can be trusted."""
    with shown_progress(f"{title}, judged", 1.0, args.quiet) as update:
        found = robot.judge(world, compute=options.compute(args, "f64"), progress=update)
    return Report(dict(found.document), f"{title}: {found.text}", FAILED if found.failed else 0)


def _check_own_robot(args: argparse.Namespace) -> None:
    """Refuse a rig or its table beside a robot that no rig plays here, or that is not the table's."""
    if args.robot is None or (args.table is None and args.rig is None):
        return
    named = named_doing(args.robot, None)
    field, value = ("rig", args.rig) if args.table is None else ("table", args.table)
    serves = named.kind.instead.get(field, "leave it out")
    if field in named.kind.instead or all(option.name != "rig" for option in named.kind.options_for("simulate")):
        article = "an" if named.kind.title[0] in "aeiou" else "a"
        raise ValueError(f"{field}: {value} is not allowed with {args.robot}, {article} {named.kind.title}; {serves}")
    if args.table is not None and (named.run or named.source) is not None:
        raise ValueError(f"table: {args.table} has a gait by itself; leave --robot {args.robot} out")


def _plays_channels(args: argparse.Namespace) -> bool:
    """Whether the robot is one whose tables are of channels, by an option of their own."""
    kind = None if args.robot is None else named_doing(args.robot, None).kind
    return kind is not None and any(option.name == "channels" for option in kind.options_for("simulate"))


def _gait_of(args: argparse.Namespace) -> str | None:
    """Refuse options that do not go together; the gait or the table that is simulated, if any."""
    if args.table is not None:
        if args.gait is not None:
            raise ValueError(f"table: {args.table} is not allowed with --gait; give one of them")
        if args.rig is None:
            raise ValueError("rig: none is given; name the rig that plays the table, such as ideal or dissertation")
        for name in ("judge", "uncertain"):
            if getattr(args, name):
                raise ValueError(f"{name}: is not allowed with --table, which is played once")
        if args.out is not None:
            raise ValueError(f"out: {args.out} is not allowed with --table; its files are those of a gait")
    elif args.rig is not None and not _plays_channels(args):
        raise ValueError(f"rig: {args.rig} is not allowed without --table, which it plays")
    if args.robot is None and args.gait is None and args.table is None:
        raise ValueError("gait: none is given; name a gait or a design, or another kind of robot by --robot")
    if args.record_every is not None and args.out is None:
        raise ValueError("record-every: the poses need a folder; give --out")
    for name in ("draws", "risk"):
        if not args.uncertain and (value := getattr(args, name)) is not None:
            raise ValueError(f"{name}: {value} is not allowed without --uncertain; say what is uncertain")
    if args.judge and args.out and not args.uncertain:
        raise ValueError(f"out: {args.out} is not allowed with --judge, which plays many runs with noise")
    gait: str | None = args.gait if args.table is None else args.table
    return gait


def _uncertain(args: argparse.Namespace, robot: Robot, world: World, title: str, about: dict[str, Any]) -> Report:
    """How the robot does where something is not known exactly."""
    from optim.problems.uncertain import MOST_DRAWS
    from robots.uncertainty import JUDGED_DRAWS, Risk, Uncertainty, judge_uncertain

    for name in ("judge", "out", "record_every"):
        if getattr(args, name):
            raise ValueError(f"{name}: it is not allowed with --uncertain; leave it out")
    unknown, risk = Uncertainty.parse(",".join(args.uncertain)), Risk.parse(args.risk or "mean")
    draws = whole_number("draws", args.draws or JUDGED_DRAWS, 2, MOST_DRAWS)
    compute = options.compute(args, "f64")
    with shown_progress(f"{title}, {draws} draws", 1.0, args.quiet) as update:
        found = judge_uncertain(robot, world, unknown, risk, draws, compute=compute, progress=update)
    return Report({**about, **found.document}, f"{title}: {found.text}", FAILED if found.failed else 0)


def _report(
    args: argparse.Namespace, robot: Robot, world: World, outcome: Outcome, title: str, about: dict[str, Any]
) -> Report:
    """What the command says, and the files that it writes."""
    ok = outcome.status[0] == OK
    if not args.quiet:
        for doubt in doubts_after(robot, world, outcome):
            note(doubt)
    numbers = {name: float(values[0]) for name, values in outcome.measures.items()}
    document = {
        **about,
        **robot.document(),
        "status": str(outcome.status[0]),
        **({"reason": str(outcome.reason[0])} if outcome.reason[0] else {}),
        "steps": int(outcome.steps[0]),
        **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
    }
    after = f" after {steps:,} steps" if (steps := document["steps"]) else ""  # kinds need not count them
    status = outcome.reason[0] or f"{outcome.status[0]}{after}"
    text = f"{title}: {status}" + (f"\n{robot.spoken(outcome)}" if ok else "")
    if args.out is not None and (without := robot.no_table_reason):
        document["no_table"] = without
        text += f"\nno {TABLE_FILE}: {without}"
    report = Report(document, text, 0 if ok else FAILED)
    if args.out is None:
        return report
    return report.written_by(partial(_write, args, robot, world, document, outcome))


def _write(args: argparse.Namespace, robot: Robot, world: World, document: dict[str, Any], outcome: Outcome) -> str:
    """Write all files of a trial in its folder, or none; nothing is said of them."""
    from robots.hardware import write_csv
    from robots.view.picture import save_robot_picture
    from taichi_sim.base.claims import undone_if_it_fails
    from taichi_sim.base.disk_faults import told_as
    from taichi_sim.base.files import make_folder, write_text

    folder: Path = args.out
    make_folder(folder)
    frames: dict[str, Any] = dict(outcome.frames or {})
    # In another precision, a robot whose motion is chaotic would be drawn elsewhere than the numbers tell.
    draw = partial(save_robot_picture, robot, world, compute=options.compute(args, "f64"))
    writers: dict[str, Callable[[Path], object]] = {
        "design.json": partial(robot.save, ()),
        "result.json": lambda path: write_text(path, json.dumps(document, indent=2) + "\n"),
        **({"frames.npz": lambda path: np.savez_compressed(path, **frames)} if frames else {}),
        # The header tells what was clipped.
        **({TABLE_FILE: partial(write_csv, robot.table(on_violation="clip"))} if robot.has_table else {}),
        **({"robot.png": draw} if robot.has_motion else {}),
    }
    with undone_if_it_fails() as made:
        for name, write in writers.items():
            made.append(folder / name)
            with told_as(f"out: {folder / name} cannot be written"):  # errors need not tell of which file they are
                write(folder / name)
    return ""
