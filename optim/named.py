"""Robots, worlds and designs by what they are called: names, files, folders of runs, values of parameters."""

import os
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problems import kind_of_run, offered_by_run, robot_of_run
from optim.runs.config import read_config
from optim.runs.history import History, read_history
from robots.partly_fixed import freed, held_at, held_names, names_matching
from robots.points import takes
from robots.robot import KINDS, Robot, RobotKind, World, find_robot_doing, make_robot
from taichi_sim.base.arrays import copied
from taichi_sim.base.checks import nearest, shown

MOST_TOLD = 12  # names in a message
FEW_TOLD = 8  # of those in the middle of one

OptionValue = str | float | bool | PathLike[str] | Sequence[float] | None
Designs = ArrayLike | Mapping[str, ArrayLike] | None


def robot(source: str | PathLike[str] | Robot, **options: OptionValue) -> Robot:
    """Make a robot from its name or file, with options of its kind.

    Args:
        source: a name that :func:`robots` lists, such as ``"rolling"``; the file of a design, of a robot or of voxels;
            the folder of a run, for its best design (its world is not used); or a robot, to change its options.
        options: options as on the command line, such as ``geometry="small"``; text is parsed as there.

    Raises:
        ValueError: for an unknown robot or option, or a value that is not allowed.
    """
    if isinstance(source, Robot) and not options:
        return source
    kind = kind_of(source)
    known = {option.name: option for option in kind.options}
    values: dict[str, Any] = {}
    for name, value in options.items():
        if name not in known:
            raise ValueError(
                f"{name}: is no option of {kind.title}; there are {', '.join(known)}{nearest(name, list(known))}"
            )
        values[name] = None if value is None else known[name].read(value)
    if isinstance(source, Robot):
        return source.changed(values)
    if (run := run_in(source)) is not None:
        return of_run(run, elsewhere=True)[0].changed(values)
    given = {name: value for name, value in values.items() if value is not None}
    return make_robot(kind, find_robot_doing(fspath(source))[1], given)


def kind_of(source: str | PathLike[str] | Robot) -> RobotKind:
    """Return the kind of a robot, or of the robot that :func:`robot` makes from a name, file or run folder.

    Raises:
        ValueError: for an unknown robot.
    """
    if isinstance(source, Robot):
        return KINDS.of(source)
    if (run := run_in(source)) is not None:
        return kind_of_run(run, read_config(run))
    return find_robot_doing(fspath(source))[0]


def run_in(source: str | PathLike[str] | Robot) -> Path | None:
    """The folder of a run, if a source is one.

    Raises:
        ValueError: for what is no source of a robot.
    """
    if isinstance(source, Robot):
        return None
    if not isinstance(source, str | PathLike):
        raise ValueError(f"robot: {shown(source)} is not allowed; give a robot, or its name or file, such as 'rolling'")
    folder = Path(source)
    return folder if os.path.isdir(folder) and (folder / "config.toml").exists() else None  # False of a name too long


def robots() -> dict[str, str]:
    """List the kinds of robots and the designs that :func:`robot` knows by name, with a short title for each."""
    kinds = dict(KINDS.usable())
    known = {name: kind.title for name, kind in kinds.items()}
    return {**known, **{design: kind.title for kind in kinds.values() for design in kind.designs}}


def world(of: Robot, name: "str | int | World | None" = None) -> World:
    """Return a world for a robot, by the world's name, such as ``"hill:15"``, or its number.

    Args:
        of: the robot.
        name: name or number of the world; a world itself is returned as it is; None is the robot's usual world.

    Raises:
        ValueError: for a world that robots of its kind do not know, and for several worlds.
    """
    return of.worlds[0] if name is None else KINDS.of(of).named_world(name)


def of_run(folder: Path, elsewhere: bool = False) -> tuple[Robot, World]:
    """The best design of a run, and the first world that it was tried in.

    Files of the run's ground must be as they were, unless the design will be tried ``elsewhere``.
    """
    found, worlds = robot_of_run(read_history(folder), elsewhere=elsewhere)
    return found, worlds[0]


def held_of_run(
    history: History, patterns: Sequence[str], given: Mapping[str, Any], what: str
) -> tuple[Robot, tuple[World, ...]]:
    """The robot of a run with some parameters held as its best design has them, and the run's worlds.

    Args:
        history: of the run.
        patterns: names of the parameters, or patterns of names.
        given: options of the robot that are to be other than in the run; what they free starts as in a new run.
        what: is wanted, for the message if there are no patterns.

    Raises:
        ValueError: if nothing is held, now or by the run, so that the best design would not matter; for patterns that
            match nothing; if there is no best design, or it is of several robots.
    """
    found, best, worlds = offered_by_run(history)
    if not patterns and not held_names(found):
        free = some_of([parameter.name for parameter in found.parameters], FEW_TOLD)
        raise ValueError(f"hold: nothing of the best design of {history.path}; name {what}, of {free}")
    kind = KINDS.of(found)
    robot, names = freed(found, given), names_matching(found, patterns)
    point = dict(zip((parameter.name for parameter in robot.parameters), robot.start, strict=True))
    point |= dict(zip((parameter.name for parameter in found.parameters), found.points(best)[0], strict=True))
    for parameter in robot.parameters:
        if parameter.name in names and not takes(parameter, point[parameter.name]):
            told = f"{point[parameter.name]:.6g}, beyond {parameter.low:g} to {parameter.high:g}"
            raise ValueError(f"hold: {parameter.name} of {history.path} is {told}; give a range that has it")
    held = held_at(robot, list(point.values()), names) if names else robot
    return held, tuple(kind.present_world(world) for world in worlds)


def points_of(tried: Robot, designs: Designs) -> ArrayLike:
    """Points, shape (N, P), of what a caller may give: values by name lie within the bounds, unless of an angle.

    Points may lie beyond them: differences at a design on a bound need that.
    """
    if designs is None:
        return tried.start[None]
    if isinstance(designs, str):
        raise ValueError(f"designs: {designs!r} is not allowed; of a world say where={designs!r}")
    designs = _by_name(designs)
    if not isinstance(designs, Mapping):
        return designs
    names = [parameter.name for parameter in tried.parameters]
    for name in designs:
        if name not in names:
            known = f"there are {some_of(names)}{nearest(name, names)}" if names else "nothing of the robot is free"
            raise ValueError(f"designs: {name!r} is unknown; {known}")
    try:
        given = np.broadcast_arrays(*(np.atleast_1d(copied(value)) for value in designs.values()))
    except (ValueError, TypeError):
        raise ValueError("designs: give numbers, or arrays of one length, for each parameter") from None
    if given and given[0].ndim > 1:
        raise ValueError("designs: give numbers, or arrays of one length, for each parameter")
    points = np.tile(tried.start, (len(given[0]) if given else 1, 1))
    for name, values in zip(designs, given, strict=True):
        parameter = tried.parameters[names.index(name)]
        beyond = ~np.isfinite(values)
        if parameter.kind != "angle":
            beyond |= (values < parameter.low) | (values > parameter.high)
        if beyond.any():
            allowed = f"give a number from {parameter.low:g} to {parameter.high:g}"
            raise ValueError(f"designs: {values[beyond][0]:.12g} of {name} is not allowed; {allowed}")
        points[:, names.index(name)] = values
    return points


def _by_name(designs: Any) -> Any:
    """A table of pandas, or a row of it, by the names of its columns; all else as it is."""
    labels = getattr(designs, "columns", getattr(designs, "index", ())) if hasattr(designs, "to_numpy") else ()
    if len(labels) and all(isinstance(label, str) for label in labels):
        return {label: np.asarray(designs[label]) for label in labels}
    return designs


def some_of(names: Sequence[str], most: int = MOST_TOLD) -> str:
    """Names with commas between them, of many only the first."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
