"""``morpholab view``: robots in motion, as a page for browsers, as pictures, and as files for other programs."""

import argparse
from functools import partial
from typing import Any

from optim.commands import Report, options
from optim.commands.view_files import add_outputs, check_outputs, write_outputs
from optim.progress import Update, shown_progress
from optim.wording import counted, spoken_size


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "view",
        help="see robots move, in a browser and in pictures",
        description="Simulate robots and write a page that plays their motions side by side, with their actuation. It "
        "is one file that needs no network; any browser opens it. Or write pictures, films and files for Blender and "
        "ParaView.",
    )
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="ROBOT",
        help="inching or rolling; folder of a run, file of a design or gait table; legged, wheeled or whegged "
        "quadruped; vehicle or rover; up to four",
    )
    add_outputs(parser)
    parser.add_argument("--title", default="", help="of the page")
    parser.add_argument(
        "--frames", type=options.whole(2), default=1000, metavar="N", help="at most, of each robot (default: 1000)"
    )
    options.add_terrain(parser, "around soft robots (default: flat, of runs their own)")
    parser.add_argument(
        "--member", type=options.whole(1), metavar="N", help="the Nth design that a run keeps (default: the best)"
    )
    group = parser.add_argument_group("rigid robots and vehicles")
    group.add_argument(
        "--controller",
        metavar="W",
        help="two numbers such as 1,-0.5 for vehicle and rover (default: 1,1); for quadrupeds a .npy or .json file "
        "with 5 rows, the sensors, of 8 weights (default: random)",
    )
    group.add_argument("--seed", type=options.whole(0), metavar="N", help="of random weights (default: 0)")
    group.add_argument(
        "--design",
        type=options.whole(1),
        metavar="N",
        help="sensors of vehicle and rover: a body of the published grid, 1 to 6561 (default: 6553)",
    )
    group.add_argument(
        "--environment",
        type=int,
        choices=(1, 2, 3, 4),
        help="place of the light, or of the vehicle (default: 1)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_robot(parser, precision="f32, of rigid robots and vehicles f64", own=", of runs their own")
    options.add_calibration(parser, own=", of runs their own")
    options.add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Report:
    """Simulate, and write the files asked for."""
    from optim.commands.view_sources import check_options, motion_of
    from robots.view.player import MOST_MOTIONS

    count = len(args.sources)
    if count > MOST_MOTIONS:
        raise ValueError(f"sources: {count} robots are not allowed; give up to {MOST_MOTIONS}")
    check_outputs(args)
    check_options(args)
    with shown_progress(args.sources[0], float(count), args.quiet) as update:
        motions = []
        for done, source in enumerate(args.sources):
            update(float(done), source)
            motions.append(motion_of(source, args, partial(_tick, update, done)))
    files = write_outputs(motions, args)
    lines = [f"{path}: {spoken_size(size)}" for path, size in files]
    about = [
        {
            "source": source,
            "name": m.name,
            "frames": len(m.times),
            "nodes": len(m.nodes),
            "seconds": float(m.times[-1] - m.times[0]),
        }
        for source, m in zip(args.sources, motions, strict=True)
    ]
    document = {"robots": about, "files": [{"path": str(path), "bytes": size} for path, size in files]}
    told = [
        f"{a['name']}: {counted(a['nodes'], 'part')}, {counted(a['frames'], 'frame')}, {a['seconds']:.1f} s"
        for a in about
    ]
    return Report(document, "\n".join([*told, *lines]))


def _tick(update: Update, done: int, part: float) -> None:
    update(done + part)
