"""``morpholab pipeline``: from terrains to a hardware package."""

import argparse
from dataclasses import asdict

from optim.commands import Report, goes_on
from optim.commands.options import QUIET, THREADS, Command, Option, file_text, path_to
from optim.exit_codes import FAILED
from optim.progress import shown_progress
from taichi_sim.base.short_text import decimal

COMMAND = Command(
    "pipeline",
    "from terrains to a hardware package",
    "Find a shape and a gait for each terrain, and the changes of shape between them, and write what a machine needs: "
    "tables, a state machine, pictures, a report; see docs/pipeline.md. The same command goes on where an earlier one "
    "was.",
    (
        path_to("task", "TASK", "file of the task (TOML)", words="?"),
        path_to("out", "DIR", "folder of the results; the package is in DIR/package"),
        path_to("replay", "PACKAGE", "play a package by its tables alone instead, and compare"),
        Option("rig", "with --replay: a preset or a .toml file that plays the tables over time, too", file_text, "RIG"),
        THREADS,
        QUIET,
    ),
)


def run(args: argparse.Namespace) -> Report:
    """Make a package, or play one."""
    if (args.task is None) == (args.replay is None):
        raise ValueError("task: give either the file of a task, or --replay PACKAGE to play one")
    if args.replay is not None:
        if args.out is not None:
            raise ValueError("out: is not allowed with --replay, which writes nothing")
        return _replay(args)
    if args.rig is not None:
        raise ValueError(f"rig: {args.rig} is not allowed without --replay; a task names its own")
    if args.out is None:
        raise ValueError("out: none given; name a folder for the results")
    return _make(args)


@goes_on
def _make(args: argparse.Namespace) -> Report:
    from optim.pipeline.package import write_package
    from optim.pipeline.run import PACKAGE, run_pipeline
    from optim.pipeline.task import KIND, read_task
    from optim.pipeline.trials import NoWorkingGait

    task = read_task(args.task)
    try:
        with shown_progress("pipeline", 1.0, args.quiet) as update:
            found = run_pipeline(task, args.out, update, args.threads)
            files = write_package(found, args.out / PACKAGE)
    except NoWorkingGait as error:
        return Report({"folder": str(args.out), "failed": str(error)}, f"failed: {error}", FAILED)
    faults = [fault for change in found.changes.values() if change for fault in change.faults]
    lines = [f"{KIND.world_told(each.terrain)}: {each.gait}, {decimal(each.speed)} BL/s" for each in found.states]
    lines += [f"change of shape: {fault}" for fault in faults]
    document = {"folder": str(args.out), "files": files, "faults": faults, **found.numbers()}
    return Report(document, "\n".join([*lines, f"{args.out / PACKAGE}: {len(files)} files"]), FAILED if faults else 0)


def _replay(args: argparse.Namespace) -> Report:
    from optim.pipeline.machine import replay_package
    from optim.pipeline.tables import check_changes
    from robots.hardware import PneumaticRig

    rig = None if args.rig is None else PneumaticRig.load(args.rig)
    if rig is not None:
        rig.check_plays_gaits()
    joined = check_changes(args.replay, rig)
    with shown_progress("replay", 1.0, args.quiet) as update:
        found = replay_package(args.replay, update, args.threads, rig)
    lines = []
    for one in found:
        verdict = "holds" if one.holds else "differs by more than 5 %"
        lines += [
            f"{one.name}: {decimal(one.replayed)} BL/s from its table, designed {decimal(one.designed)} ({verdict})",
            f"  over time: {one.course}",
        ]
        if rig is not None and one.on_rig is not None:
            lines.append(f"  on the rig {rig.name}, in its time: {decimal(one.on_rig)} BL/s")
    holds = all(one.holds for one in found) and not any(each.faults for each in joined)
    document = {
        "package": str(args.replay),
        "states": [{**asdict(one), "holds": one.holds} for one in found],
        "changes": [asdict(each) for each in joined],
    }
    return Report(document, "\n".join([*lines, *map(str, joined)]), 0 if holds else FAILED)
