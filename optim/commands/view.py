"""``morpholab view``: robots in motion, as a page for browsers, as pictures, and as files for other programs."""

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from optim.commands import Report, options
from optim.commands.options import QUIET, Command, Option, count
from optim.commands.robots import Named, kinds_of_words, loaded, named_source, world_and_own
from optim.commands.view_files import APPEARANCE, OUTPUTS, TITLE, check_outputs, write_outputs
from optim.progress import Update, shown_progress
from optim.wording import spoken_size
from robots.robot import Robot, World
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from robots.view.motion import Motion


WELL_AFTER = 1.01  # times how long a motion lasts, whose last frame may be a little off
COMMAND = Command(
    "view",
    "see robots move, in a browser and in pictures",
    "Simulate robots and write a page that plays their motions side by side, with their actuation. It is one file that "
    "needs no network; any browser opens it. Or write pictures, films and files for Blender, ParaView and Rerun.",
    (
        Option(
            "sources",
            "inching or rolling; folder of a run, file of a robot, a design or a gait table; legged, wheeled or "
            "whegged quadruped; vehicle, rover or another kind of robot; up to four",
            metavar="ROBOT",
            words="+",
        ),
        *(output.option for output in OUTPUTS),
        TITLE,
        count("frames", 2, "at most, of each robot (default: 1000)", default=1000),
        count("member", 1, "the Nth design that a run keeps (default: the best)"),
        QUIET,
    ),
    {"pictures and films": APPEARANCE, **options.simulation("f64, of runs their own")},
    kinds_of_words,
    world_and_own("view"),
)


def run(args: argparse.Namespace) -> Report:
    """Simulate, and write the files asked for."""
    from robots.view.player import MOST_MOTIONS

    count = len(args.sources)
    if count > MOST_MOTIONS:
        raise ValueError(f"sources: {count} robots are not allowed; give up to {MOST_MOTIONS}")
    check_outputs(args)
    named = [named_source(source) for source in args.sources]
    if args.member is not None and not any(each.run for each in named):
        raise ValueError("member: it is of runs; leave it out")
    kinds = [each.kind for each in named]
    robots = [
        loaded(each, args.parser.values(args, each.kind, *kinds), args.member if each.run else None) for each in named
    ]
    if args.at is not None:
        _check_moment(args.at, [robot for robot, _ in robots])
    motions: list[Motion] = []
    others = [_others(each, worlds) for each, (_, worlds) in zip(named, robots, strict=True)]
    with shown_progress(args.sources[0], float(count), args.quiet) as update:
        for done, (each, (robot, (world, *_))) in enumerate(zip(named, robots, strict=True)):
            update(float(done), args.sources[done])
            name = f"{each.label or robot.name} {world.where}".strip()
            compute, tick = options.compute(args, each.precision), partial(_tick, update, done)
            replay = robot.replay((), world, frames=args.frames, name=name, compute=compute, progress=tick)
            motions.append(replay.motion)
    files = write_outputs(motions, args)
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
        f"{a['name']}: {counted(a['nodes'], 'part')}, {counted(a['frames'], 'frame')}, {_seconds(a['seconds'])}{more}"
        for a, more in zip(about, others, strict=True)
    ]
    return Report(document, "\n".join([*told, *(f"{path}: {spoken_size(size)}" for path, size in files)]))


def _check_moment(at: float, robots: Sequence[Robot]) -> None:
    """Refuse a time after the end of a motion, before it is simulated; its frames tell the end exactly."""
    for robot in robots:
        if at > WELL_AFTER * robot.lasts:
            raise ValueError(f"at: {at:g} s is not allowed; {robot.name} moves for {robot.lasts:.4g} s")


def _seconds(time: float) -> str:
    return f"{time:.1f} s" if time >= 0.95 else f"{time:.2g} s"


def _others(named: Named, worlds: Sequence[World]) -> str:
    """A remark on the other worlds of a run, of which the first is shown; empty without any."""
    others = named.other_worlds(worlds)
    return f"; {others} shows another" if others else ""


def _tick(update: Update, done: int, part: float) -> None:
    update(done + part)
