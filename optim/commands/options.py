"""Options that commands share, and the checks of their values."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.world import STEEPEST, Terrain
from taichi_sim.base import checks, files
from taichi_sim.base.options import checked as checked
from taichi_sim.base.options import number as number
from taichi_sim.base.options import value_of
from taichi_sim.base.options import whole as whole

if TYPE_CHECKING:
    from robots.calibration import Properties
    from robots.inflatable.cores import Pressure
    from robots.inflatable.design import InflatableDesign
    from robots.inflatable.schedule import GaitSchedule

GAITS = ("inching", "rolling")  # that commands know by name
GEOMETRIES = ("published", "small", "two-core")  # likewise
GAIT_SCHEDULE = ("all of the gait", "the gait's own")  # columns and repeats by default


def pressure(high: float = math.inf) -> Callable[[str], "Pressure"]:
    """Pressures from 0 to a bound [Pa]: one, or one for each of several cores, with commas between."""

    def convert(text: str) -> "Pressure":
        each = tuple(checks.number("", value_of(part), 0.0, high, "Pa") for part in text.split(","))
        return each[0] if len(each) == 1 else each

    return checked(convert)


terrain = checked(Terrain.parse)


def add_terrain(parser: argparse.ArgumentParser, told: str) -> None:
    """Options for one terrain, by its name or its slope; ``told`` says whose it is and the default."""
    parser.add_argument("--terrain", type=terrain, metavar="TERRAIN", help=f"flat, hill:15 or water {told}")
    slope = number(-STEEPEST, STEEPEST, "degrees")
    parser.add_argument(
        "--slope", type=slope, metavar="DEGREES", help="of the ground, uphill is positive; instead of --terrain"
    )


def chosen_terrain(args: argparse.Namespace) -> Terrain | None:
    """What the options of :func:`add_terrain` say; None if none was given.

    Raises:
        ValueError: in one line, for both of them.
    """
    if args.terrain is not None and args.slope is not None:
        raise ValueError(f"slope: {args.slope:g} is not allowed beside --terrain {args.terrain.name}; give one of them")
    return args.terrain if args.slope is None else Terrain(args.slope)


def add_robot(
    parser: argparse.ArgumentParser, precision: str, schedule: tuple[str, str] | None = GAIT_SCHEDULE, own: str = ""
) -> None:
    """Options about the robot's body and its simulation.

    Args:
        parser: of the command.
        precision: what the help calls the default.
        schedule: likewise of columns and repeats; None for commands without these options.
        own: what the help says after the other defaults.
    """
    group = parser.add_argument_group("robot and simulation")
    group.add_argument("--geometry", choices=GEOMETRIES, help=f"the robot's body (default: published{own})")
    if schedule:
        columns, repeats = schedule
        group.add_argument(
            "--columns", type=whole(1), metavar="T", help=f"columns of the schedule (default: {columns})"
        )
        group.add_argument(
            "--repeats", type=whole(1), metavar="N", help=f"how often the columns are played (default: {repeats})"
        )
    group.add_argument(
        "--weight",
        choices=("published", "physical"),
        help=f"of bladders: none while they move or stay inflated, or always (default: published{own})",
    )
    group.add_argument("--precision", choices=("f32", "f64"), help=f"of the numbers (default: {precision})")
    group.add_argument("--device", choices=("cpu", "cuda", "vulkan", "metal"), help="(default: cpu)")
    group.add_argument("--threads", type=whole(1), metavar="N", help="CPU threads (default: all)")


def add_calibration(parser: Any, own: str = "") -> None:
    """The option for the robot of a rig, of a parser or a group of one; ``own`` as of :func:`add_robot`."""
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help=f"properties of a rig, the calibration.json of morpholab calibrate; its geometry is the default{own}",
    )


def load_rig(path: Path | None) -> "tuple[Properties, str] | None":
    """Properties and the name of the geometry of the rig of such a file, if one is given."""
    if path is None:
        return None
    from robots.calibration import load_calibration

    return load_calibration(path)


def inflatable_robot(
    geometry: str, weight: str, properties: "Properties | None", design: "InflatableDesign"
) -> dict[str, Any]:
    """Geometry and actuation that play a design, as options of ``robots.inflatable.simulate``.

    Raises:
        ValueError: in one line, where a rig's skin is too stiff for the times of a gait.
    """
    from robots.calibration import robot_of
    from robots.inflatable.body import NAMED_GEOMETRIES

    if properties is not None and design.schedule.has_own_times:
        properties.check_time_step(NAMED_GEOMETRIES[geometry])
    body, actuation = robot_of(geometry, weight, properties)
    return {"geometry": body, "actuation": actuation}


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option to speak to machines."""
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def load_gait(text: str, from_rows: bool = False) -> "InflatableDesign":
    """The design of a known gait's name, or of a file; with ``from_rows`` what the rows of a gait table play.

    Raises:
        ValueError: in one line, for anything else.
    """
    from robots.hardware import read_design
    from robots.inflatable.design import INCHING, ROLLING

    known = dict(zip(GAITS, (INCHING, ROLLING), strict=True))
    if text in known and not from_rows:
        return known[text]
    if text not in known and not Path(text).is_file():
        raise ValueError(f"gait: {text!r} is neither a known gait ({', '.join(known)}) nor a file")
    return read_design(Path(text), from_rows)


def claim_folder(args: argparse.Namespace) -> None:
    """Make the new folder ``--out``, if one is given, and keep other processes off it while the command runs.

    Raises:
        ValueError: if the folder holds anything, cannot be made, or another process fills it.
    """
    if args.out is not None:
        args.held.enter_context(files.claimed_folder("out", args.out))


def cut(schedule: "GaitSchedule", columns: int | None, repeats: int | None) -> "GaitSchedule":
    """The first columns of a schedule, and how often they are played; None keeps what there is."""
    if columns is not None and columns > schedule.columns:
        raise ValueError(f"columns: {columns} is not allowed; the gait has {schedule.columns}")
    return schedule.cut(columns, repeats)
