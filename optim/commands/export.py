"""``morpholab export``: a designed gait and body for the hardware and for other simulators."""

import argparse
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from optim.commands import Report, options
from optim.commands.options import Command, Option, count, file_text, flag, path_to
from optim.commands.robots import history_of, kinds_of_words, named_source, own_alone
from optim.problems import robot_of_run
from optim.runs.config import has_run
from robots.robot import Robot, robot_to_try
from taichi_sim.base.claims import undone_if_it_fails
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from robots.hardware.rig import PneumaticRig
    from robots.hardware.rig_table import RigTable
    from robots.hardware.start import Start

REFUSED = 2  # exit code, as of other input that is not allowed
PICTURES = (".pdf", ".png", ".svg")
TABLES = ("csv", "plain", "c_header")
OUTPUTS = (*TABLES, "plot", "voxels", "parts", "model", "commands")  # options that name what is written
OF_TABLES = "rig", "rate", "units", "full_scale"  # options that shape a table of pressures
COMMAND = Command(
    "export",
    "write a gait for the hardware, surfaces to print, a mould, or a file for other simulators",
    "Write the pressures that play a gait on a pneumatic rig, within its limits, as CSV; of a lattice robot also its "
    "surfaces for printers, a mould to cast it in, and a file for other simulators; of a robot from an MJCF or URDF "
    "file that file with bodies of the design's sizes, and what its drives are told.",
    (
        path_to(
            "source", "RUN", "inching or rolling, folder of a run, file of a design, or a gait table as CSV", words="1"
        ),
        path_to("csv", "FILE", "to write; replaced if it exists"),
        path_to("plain", "FILE", "new; the same as numbers alone, without a header: time, then pressures of all lines"),
        path_to("c_header", "FILE", "new; the same as arrays of a C header, such as gait.h"),
        Option("units", "of pressures (default: those of the rig)", choices=("kpa", "psi")),
        Option(
            "rig",
            "dissertation, dissertation-gentle, or a TOML file with channels and limits (default: that of a gait table "
            "which is for a preset, else dissertation)",
            file_text,
            "RIG",
        ),
        Option(
            "rate",
            "rows per second (default: rows where pressures turn, to be joined by lines)",
            options.number(0.0, unit="Hz"),
            "HZ",
        ),
        Option(
            "on_violation",
            "what to do with pressures and rates beyond the rig's limits (default: refuse)",
            choices=("refuse", "clip"),
            default="refuse",
        ),
        flag("dry_run", "show what would happen when; write no table"),
        path_to("plot", "FILE", "new picture of the pressures to write: PNG, SVG or PDF"),
        Option(
            "full_scale",
            "of a lattice robot's sizes or temperatures, what pressures of lines stand for: F above rest, or LOW:HIGH "
            "(default: the lowest to the highest value that it takes)",
            metavar="F",
        ),
        path_to(
            "parts",
            "PATH",
            "new surfaces in millimetres: a .3mf with an object for each material and channel, a .stl of the whole "
            "body, or a folder of STL files, one for each",
        ),
        Option(
            "mould",
            "write a two-part mould to --parts instead, such as draft=2,wall=3 [degrees, mm]; pull=x, y or z is the "
            "axis along which it opens",
            metavar="SETTINGS",
        ),
        path_to("voxels", "FILE", "new, for other simulators: a .vxa, or a .vxl.json of the body alone"),
        path_to(
            "model",
            "FILE",
            "new: the MJCF or URDF file of a robot of such a file, with bodies and hinges of the design; .mjcf of a "
            "URDF robot has its drives and ground, too",
        ),
        path_to("commands", "FILE", "new: a CSV table of the angles or rates that drives of such a robot are told"),
        count("member", 1, "the Nth design that the search keeps, as in front.json (default: the best design)"),
    ),
    kinds=kinds_of_words,
    options_of=own_alone("export"),
)


def run(args: argparse.Namespace) -> Report:
    """Write the CSV file, its picture, surfaces and voxels, or tell what would be written."""
    if args.mould is not None and args.parts is None:
        raise ValueError("mould: it needs a place; give --parts as well, a .3mf file or a folder")
    wanted = args.csv or args.dry_run or args.plot or args.plain or args.c_header
    if not (args.dry_run or any(getattr(args, name) for name in OUTPUTS)):
        raise ValueError(
            "csv: is missing; name the file to write, or ask for --dry-run or --plot; bodies are written by --parts, "
            "--voxels or --model, what drives of a file's robot are told by --commands"
        )
    if not wanted and (idle := [name for name in OF_TABLES if getattr(args, name) is not None]):
        raise ValueError(
            f"{idle[0].replace('_', '-')}: it shapes a table of pressures, and none is asked for; leave it out, or "
            "name --csv, --plain, --c-header or --plot, or ask for --dry-run"
        )
    if args.plot and args.plot.suffix.lower() not in PICTURES:
        raise ValueError(f"plot: {args.plot} is not allowed; give a file that ends in {', '.join(PICTURES)}")
    _check_files(args)
    robot, seed = _robot(args)
    with undone_if_it_fails() as made:  # what is new; else it would be in the way when the same is tried again
        table = _write_table(args, robot, seed, made) if wanted else Report({}, "")
        document, lines = _write_bodies(args, robot, made)
    text = "\n".join(filter(None, [table.text, *lines]))
    return Report({"source": str(args.source), **cast(dict[str, Any], table.document), **document}, text, table.code)


def _check_files(args: argparse.Namespace) -> None:
    """Refuse files that cannot be written, would take the place of what is read or kept, and two of one name."""
    from taichi_sim.base.file_kinds import check_no_pipe
    from taichi_sim.base.files import check_parent

    taken: dict[str, str] = {}
    given = {name: value for name, value in vars(args).items() if name not in OUTPUTS and isinstance(value, str | Path)}
    read = {os.path.realpath(value): name for name, value in given.items() if os.path.isfile(value)}
    for field, path in _outputs(args).items():
        if field != "parts" and (path.is_dir() or not path.name):
            raise ValueError(f"{field}: {path} is a folder; name a file")
        check_no_pipe(field, path)
        if field != "parts" or path.suffix:
            check_parent(field, path)
        place = os.path.realpath(path)
        if other := taken.get(place):
            which = "the table" if other == "csv" else f"that of --{other}"
            raise ValueError(f"{field}: {path} is {which}, too; name another file")
        taken[place] = field
        if args.dry_run and field.replace("-", "_") in TABLES:
            continue
        if place in read:
            raise ValueError(f"{field}: {path} is the {read[place]}, which is only read; name another file")
        _check_kept(field, path)


def _outputs(args: argparse.Namespace) -> dict[str, Path]:
    """What is to be written, by the option that names it."""
    return {name.replace("_", "-"): path for name in OUTPUTS if (path := getattr(args, name))}


def _check_kept(field: str, path: Path) -> None:
    """Refuse to replace a file, other than a table that is of no run."""
    from optim.runs.folder import ENVIRONMENT

    if not path.exists():
        return
    if field == "parts" and path.is_dir():
        if any(path.iterdir()):
            raise ValueError(f"parts: {path} exists and is not empty; name a new folder")
    elif field != "csv":
        raise ValueError(f"{field}: {path} exists; name a new file")
    folder = path.resolve().parent
    if field == "csv" and has_run(folder) and (folder / ENVIRONMENT).exists():
        raise ValueError(f"csv: {path} is a file of the run in {folder}; name another file")


def _begun(made: list[Path], field: str, path: Path) -> Path:
    """Note a new file or folder that is made now, which another process must not have made meanwhile."""
    _check_kept(field, path)
    if not path.exists():
        made.append(Path(os.path.realpath(path)))
    return path


def _write_bodies(args: argparse.Namespace, robot: Robot, made: list[Path]) -> tuple[dict[str, Any], list[str]]:
    """Write bodies and commands of drives, if they are asked for; what machines and people are told."""
    document: dict[str, Any] = {}
    lines: list[str] = []
    if args.voxels:
        robot.save_voxels(_begun(made, "voxels", args.voxels))
        document["voxels"] = str(args.voxels)
        lines.append(f"{args.voxels}: voxels")
    if args.model:
        untold = robot.save_model(robot.start, _begun(made, "model", args.model))
        document["model"] = {"path": str(args.model), "untold": untold}
        lines.extend([f"{args.model}: the robot's file with this design", *(f"note: {each}" for each in untold)])
    if args.commands:
        robot.save_commands(robot.start, _begun(made, "commands", args.commands))
        document["commands"] = str(args.commands)
        lines.append(f"{args.commands}: what its drives are told, in rad or rad/s")
    if args.parts:
        place = _begun(made, "parts", args.parts)
        try:
            written = robot.save_parts(place, args.mould)
        except BaseException:  # a folder that was there before stays, and was empty
            made.extend(place.iterdir() if place.is_dir() else ())
            raise
        document["parts"] = {"path": str(args.parts), "written": written}
        lines.append(f"{args.parts}: in millimetres")
        lines.extend(f"  {each}" for each in written)
    return document, lines


def _write_table(args: argparse.Namespace, robot: Robot, seed: int | None, made: list[Path]) -> Report:
    """Write the table and its picture, or tell what would be written."""
    from robots.hardware import RigViolation, write_csv
    from robots.hardware.plain_files import write_c_header, write_plain

    rig = _rig_of(args)
    settings: dict[str, Any] = {"rig": rig, "units": args.units, "on_violation": args.on_violation}
    if args.full_scale is not None:
        settings["full_scale"] = args.full_scale
    if (start := _start_of(args)) is not None:
        settings["start"] = start
    try:
        table = robot.table(rate=args.rate, seed=seed, **settings)
    except RigViolation as refusal:
        if not args.dry_run:
            raise
        violations = [str(violation) for violation in refusal.violations]
        text = "\n".join([f"{rig.name}: refuses the gait", *violations, refusal.advice])
        document = {"source": str(args.source), "violations": violations, "advice": refusal.advice}
        return Report(document, text, REFUSED)
    longer = _longer(robot, args.rate, table, settings)
    if args.csv and not args.dry_run:
        write_csv(table, args.csv)
    if args.plain and not args.dry_run:
        write_plain(table, _begun(made, "plain", args.plain))
    if args.c_header and not args.dry_run:
        write_c_header(table, _begun(made, "c-header", args.c_header))
    if args.plot:
        from robots.hardware.gait_chart import save_gait_chart

        save_gait_chart(table, _begun(made, "plot", args.plot))
    return _report(args, table, longer)


def _longer(robot: Robot, rate: float | None, table: "RigTable", settings: dict[str, Any]) -> str:
    """How much longer whole samples make a table than it is without them, and which rates fit; empty if hardly."""
    from robots.hardware.sample_rates import LONGER, fitting_rates

    if rate is None:
        return ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the table's own were told
        unsampled = robot.table(**settings)
        if table.seconds <= LONGER * unsampled.seconds:
            return ""
        fitting = fitting_rates(unsampled, rate, lambda other: robot.table(rate=other, **settings).seconds)
    told = f"in whole samples at {rate:g} Hz it takes that long; without --rate {unsampled.seconds:.1f} s"
    return f"{told}; --rate {' or '.join(f'{each:g}' for each in fitting)} fits" if fitting else told


def _rig_of(args: argparse.Namespace) -> "PneumaticRig":
    """The rig that is asked for; else that of the table, if the source is one; else the usual one."""
    from robots.hardware import read_csv
    from robots.hardware.rig import PneumaticRig
    from robots.hardware.stream import rig_of_table

    if args.rig is None and args.source.suffix.lower() == ".csv":
        return rig_of_table(read_csv(args.source))
    return PneumaticRig.load(args.rig or "dissertation")


def _start_of(args: argparse.Namespace) -> "Start | None":
    """Where the table begins that is the source, if that is one which follows another gait."""
    from robots.hardware import read_csv

    return read_csv(args.source).start if args.source.suffix.lower() == ".csv" else None


def _report(args: argparse.Namespace, table: "RigTable", longer: str) -> Report:
    from robots.hardware.dry_run import timing_document, timing_text

    written = None if args.dry_run or not args.csv else str(args.csv)
    document = {
        "source": str(args.source),
        "csv": written,
        "plot": str(args.plot) if args.plot else None,
        **{name: str(path) for name, path in _other_files(args).items()},
        "units": table.units,
        "seconds": table.seconds,
        "clipped": list(table.clipped),
    }
    if args.dry_run:
        return Report({**document, **timing_document(table)}, timing_text(table))
    name = ", ".join(filter(None, [written, *map(str, _other_files(args).values())])) or document["plot"]
    text = f"{name}: {_counts(table)}, {table.seconds:.1f} s, {table.units}"
    if longer:
        text += f"\nnote: {longer}"
    if table.clipped:
        text += f"\nclipped {counted(len(table.clipped), 'time')}, as the file's header tells; first {table.clipped[0]}"
    return Report(document, text)


def _counts(table: "RigTable") -> str:
    """How many channels a table has; where the rig has lines beside those that play them, also how many lines."""
    channels, lines = len(getattr(table, "played_by", ())), len(table.channels)
    of_lines = f" on {counted(lines, 'line')}" if 0 < channels < lines else ""
    return counted(channels or lines, "channel") + of_lines


def _other_files(args: argparse.Namespace) -> dict[str, Path]:
    """Other forms of the table that are written, by name."""
    files = {"plain": args.plain, "c_header": args.c_header}
    return {} if args.dry_run else {name: path for name, path in files.items() if path}


def _robot(args: argparse.Namespace) -> tuple[Robot, int | None]:
    """The best design of a run, as its checked log tells, or another that it keeps, or that of a file; its seed."""
    source, member = args.source, args.member
    named = named_source(str(source))
    values = args.parser.values(args, named.kind)
    if named.run is not None:
        history = history_of(named.run)
        found, _ = robot_of_run(history, member, elsewhere=True)
        return found.changed(values), history.config["method"].get("seed")
    if member is not None:
        raise ValueError(f"member: {member} is not allowed, as {source} is the file of one design; name a run")
    return robot_to_try(named.kind, named.source, values)[0], None
