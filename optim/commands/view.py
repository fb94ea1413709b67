"""``morpholab view``: robots in motion, as a page for browsers, as pictures, and as files for other programs."""

import argparse
import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from optim.commands import Report, options
from optim.commands.robots import Named, RobotOptions, loaded, named_source, refuse_foreign, world_and_own
from optim.commands.view_files import add_outputs, check_outputs, write_outputs
from optim.progress import Update, shown_progress
from optim.wording import counted, spoken_size
from robots.robot import KINDS, RobotKind
from taichi_sim.base.options import given

if TYPE_CHECKING:
    from robots.view.motion import Motion


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser: RobotOptions = commands.add_parser(
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
        help="inching or rolling; folder of a run, file of a robot, a design or a gait table; legged, wheeled or "
        "whegged quadruped; vehicle, rover or another kind of robot; up to four",
    )
    add_outputs(parser)
    parser.add_argument("--title", default="", help="of the page")
    parser.add_argument(
        "--frames", type=options.whole(2), default=1000, metavar="N", help="at most, of each robot (default: 1000)"
    )
    parser.add_argument(
        "--member", type=options.whole(1), metavar="N", help="the Nth design that a run keeps (default: the best)"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options.add_compute(parser, precision="f32, of rigid robots and vehicles f64")
    options.add_json(parser)
    parser.take_robots(_kinds, world_and_own("view"))
    parser.set_defaults(run=run, parser=parser)


def run(args: argparse.Namespace) -> Report:
    """Simulate, and write the files asked for."""
    from robots.view.player import MOST_MOTIONS

    count = len(args.sources)
    if count > MOST_MOTIONS:
        raise ValueError(f"sources: {count} robots are not allowed; give up to {MOST_MOTIONS}")
    check_outputs(args)
    named = [named_source(source) for source in args.sources]
    _check_options(args, named)
    with shown_progress(args.sources[0], float(count), args.quiet) as update:
        motions = []
        for done, (source, each) in enumerate(zip(args.sources, named, strict=True)):
            update(float(done), source)
            motions.append(_motion(each, args, partial(_tick, update, done)))
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


def _kinds(words: Sequence[str]) -> list[RobotKind]:
    """The kinds of robots among the words of a command line; words that name none are other things."""
    found = []
    for word in words:
        with contextlib.suppress(ValueError, OSError):
            found.append(named_source(word).kind)
    return found


def _check_options(args: argparse.Namespace, named: list[Named]) -> None:
    """Refuse options that say nothing of any of the robots.

    Raises:
        ValueError: for the first of them.
    """
    refuse_foreign(args)
    options_of = world_and_own("view")
    known = {option.name for each in named for option in options_of(each.kind)}
    for name in {option.name for kind in KINDS.builtin for option in options_of(KINDS[kind])} - known:
        if getattr(args, name, None) is not None:  # a file that is written was taken for a robot
            raise ValueError(f"{name.replace('_', '-')}: it is an option of other kinds; leave it out")
    if args.member is not None and not any(each.run for each in named):
        raise ValueError("member: it is of runs; leave it out")


def _motion(named: Named, args: argparse.Namespace, progress: Callable[[float], None]) -> "Motion":
    """Let a robot move."""
    kind = named.kind
    own = [option for option in kind.options if not option.commands or "view" in option.commands]
    robot, worlds = loaded(named, given(own, args), args.member if named.run else None)
    world = kind.chosen_world(given(kind.world_options, args)) or worlds[0]
    name = f"{named.label or robot.name} {world.where}".strip()
    compute = options.compute(args, kind.view_precision)
    return robot.replay((), world, frames=args.frames, name=name, compute=compute, progress=progress).motion


def _tick(update: Update, done: int, part: float) -> None:
    update(done + part)
