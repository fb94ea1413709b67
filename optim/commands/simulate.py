"""``morpholab simulate``: one gait on one terrain."""

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.commands import FAILED, Report, options
from optim.progress import shown_progress
from robots.world import Terrain

if TYPE_CHECKING:
    from robots.inflatable.design import InflatableDesign


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "simulate",
        help="simulate a gait",
        description="Simulate a gait and say how far and how fast the robot goes.",
    )
    parser.add_argument(
        "--gait", required=True, metavar="GAIT", help="inching, rolling, the file of a design, or a gait table as CSV"
    )
    parser.add_argument(
        "--from-rows",
        action="store_true",
        help="of a gait table, what its rows play, by the inverse of its pressure map, not the design in its header",
    )
    options.add_terrain(parser, "(default: flat)")
    parser.add_argument(
        "--pressure",
        type=options.pressure(),
        metavar="PA",
        help="of the core, or such as 12000,0 of each of several (default: the gait's own)",
    )
    parser.add_argument(
        "--orientation",
        type=options.number(0.0, 90.0, "degrees"),
        metavar="DEGREES",
        help="0 rolls, 90 inches uphill (default: the gait's own)",
    )
    parser.add_argument(
        "--perturbation",
        type=options.number(0.0, unit="m"),
        default=0.0,
        metavar="M",
        help="standard deviation of noise on the start positions (default: 0)",
    )
    parser.add_argument("--seed", type=options.whole(0), default=0, help="of the noise (default: 0)")
    parser.add_argument(
        "--record-every",
        type=options.whole(1),
        metavar="STEPS",
        help="with --out: write the pose at every so many steps to frames.npz",
    )
    parser.add_argument(
        "--judge",
        action="store_true",
        help="tell what the gait is worth: mean speed of eight runs from starts that differ by 10 nm, what remains of "
        "it under harder conditions, and how far feet slip while they grip",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new folder for design.json, result.json, gait.csv and robot.png",
    )
    options.add_calibration(parser)
    options.add_robot(parser, precision="f64")
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Simulate, and write the files asked for."""
    from robots.inflatable import simulation
    from robots.inflatable.design import InflatableDesign
    from robots.inflatable.simulation import sideways

    if args.record_every is not None and args.out is None:
        raise ValueError("record-every: the poses need a folder; give --out")
    options.claim_folder(args)
    design = options.load_gait(args.gait, args.from_rows)
    design = InflatableDesign(
        design.pressure if args.pressure is None else args.pressure,
        design.orientation if args.orientation is None else args.orientation,
        options.cut(design.schedule, args.columns, args.repeats),
    )
    terrain = options.chosen_terrain(args) or Terrain()
    robot, geometry, weight = _robot(args, design)
    if args.judge:
        return _judge(args, design, terrain, robot)
    title = f"{args.gait} {terrain.where}"
    with shown_progress(title, 1.0) as update:
        result = simulation.simulate(
            [design],
            terrain,
            **robot,
            precision=args.precision or "f64",
            device=args.device or "cpu",
            threads=args.threads,
            record_every=args.record_every,
            perturbation=args.perturbation,
            seed=args.seed,
            progress=update,
        )
    numbers = {name: float(getattr(result, name)[0]) for name in ("distance", "speed", "speed_simulated")}
    numbers["sideways"] = float(sideways(result.displacement, [design.orientation])[0])
    document = {
        "gait": args.gait,
        "terrain": terrain.name,
        "pressure": design.pressure,
        "orientation": design.orientation,
        "schedule": design.schedule.to_text(),
        "repeats": design.schedule.repeats,
        "geometry": geometry,
        "weight": weight,
        **_rig(args),
        "status": str(result.status[0]),
        "steps": int(result.steps[0]),
        **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
    }
    if args.out is not None:
        _write(args.out, design, terrain, robot, document, result.frames)
    text = f"{title}: {document['status']} after {document['steps']:,} steps"
    failed = document["status"] != "ok"
    if not failed:
        text += (
            f"\ndistance {numbers['distance']:.4f} m, {abs(numbers['sideways']):.4f} m to the "
            f"{'left' if numbers['sideways'] >= 0 else 'right'}, speed {numbers['speed']:.4f} BL/s "
            f"(published convention; {numbers['speed_simulated']:.4f} in the time simulated)"
        )
    return Report(document, text, FAILED if failed else 0)


def _judge(args: argparse.Namespace, design: "InflatableDesign", terrain: Terrain, robot: dict[str, Any]) -> Report:
    """What the gait is worth, see ``robots.inflatable.robustness``."""
    from robots.inflatable.robustness import judge_gait

    for name in ("out", "weight", "perturbation"):
        if value := getattr(args, name):
            raise ValueError(f"{name}: {value} is not allowed with --judge, which plays both weights with noise")
    title = f"{args.gait} {terrain.where}"
    with shown_progress(f"{title}, judged", 1.0) as update:
        found = judge_gait(
            design,
            terrain,
            **robot,
            seed=args.seed,
            precision=args.precision or "f64",
            device=args.device or "cpu",
            threads=args.threads,
            progress=update,
        )
    document = {"gait": args.gait, "terrain": terrain.name, **_rig(args), **found.to_document()}
    if found.diverged:
        return Report(document, f"{title}: {'; '.join(found.faults)}", FAILED)
    speeds = (f"{s.mean():.4f} BL/s, standard deviation {s.std(ddof=1):.4f}" for s in (found.speeds, found.hard_speeds))
    text = f"{title}: {next(speeds)}, {len(found.speeds)} runs\nharder conditions: {next(speeds)}"
    slip = f"{found.slip_ratio:.2f} of the way while they grip, standard deviation {found.slip_deviation:.2f}"
    text += f"\nfeet slip {slip}; {found.steps:,} steps\n"
    text += "physical" if found.physical else "not physical: " + "; ".join(found.faults)
    return Report(document, text)


def _rig(args: argparse.Namespace) -> dict[str, str]:
    """The calibration, if there is one, for the document."""
    return {} if args.calibration is None else {"calibration": str(args.calibration)}


def _robot(args: argparse.Namespace, design: "InflatableDesign") -> tuple[dict[str, Any], str, str]:
    """Geometry and actuation, and the names of the geometry and of how bladders weigh."""
    rig = options.load_rig(args.calibration)
    name, weight = args.geometry or (rig[1] if rig else "published"), args.weight or "published"
    return options.inflatable_robot(name, weight, rig[0] if rig else None, design), name, weight


def _write(
    folder: Path,
    design: "InflatableDesign",
    terrain: Terrain,
    robot: dict[str, Any],
    document: dict[str, Any],
    frames: Any,
) -> None:
    from robots.hardware import export_csv
    from robots.inflatable.cores import common_pressure
    from robots.inflatable.files import save_design
    from robots.view.picture import save_motion_picture

    folder.mkdir(parents=True, exist_ok=True)
    save_design(design, folder / "design.json")
    (folder / "result.json").write_text(json.dumps(document, indent=2) + "\n")
    if frames is not None:
        np.savez_compressed(folder / "frames.npz", **vars(frames))
    if common_pressure(design.pressure) is not None:  # else no rig plays it
        export_csv(design, folder / "gait.csv", on_violation="clip")  # the header tells what was clipped
    save_motion_picture(design, terrain, folder / "robot.png", **robot)
