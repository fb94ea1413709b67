"""What every kind of robot offers. Commands, searches, views and reports know robots by this module alone.

A kind of robot makes a :class:`Robot` of options or of a file. A robot has parameters that a search may change, and
worlds in which it is tried; a trial gives an :class:`Outcome`: measures, by which it is judged.
"""

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robots.abstract import DESIGN_FORMAT
from robots.abstract import FRAMES as FRAMES
from robots.abstract import FixedRobot as FixedRobot
from robots.abstract import Parameter as Parameter
from robots.abstract import Robot as Robot
from robots.kind import KINDS as KINDS
from robots.kind import USUAL as USUAL
from robots.kind import RobotKind as RobotKind
from robots.kind import lost_in as lost_in
from robots.kind import without_lost as without_lost
from robots.outcome import DIVERGED as DIVERGED
from robots.outcome import INVALID as INVALID
from robots.outcome import OK as OK
from robots.outcome import Facts as Facts
from robots.outcome import Judgement as Judgement
from robots.outcome import Measure as Measure
from robots.outcome import Outcome as Outcome
from robots.outcome import Picture as Picture
from robots.outcome import Place as Place
from robots.outcome import Quantity as Quantity
from robots.outcome import Replay as Replay
from robots.outcome import World as World
from robots.points import checked_design
from robots.trial import HERE as HERE
from robots.trial import Progress as Progress
from robots.trial import Trial as Trial
from robots.trial import part_of as part_of
from taichi_sim.base.checks import known_names, number, shown, table
from taichi_sim.base.compute import Compute as Compute
from taichi_sim.base.files import read_record, read_text
from taichi_sim.base.foreign import method_of, returned, staying
from taichi_sim.base.options import Option as Option
from taichi_sim.base.parsing import RepeatedNameError, parse_json
from taichi_sim.base.results_folder import BEST_DESIGN
from taichi_sim.base.variables import Variable


def find_robot(text: str) -> tuple[RobotKind, str | None] | None:
    """The kind of robot that a text names, and the source from which ``RobotKind.build`` makes it.

    Args:
        text: a kind's name, a design that a kind knows, or a file.

    Returns:
        None if it is none of these. Installed packages are imported only if no built-in kind knows the text.

    Raises:
        ValueError: for a file that cannot be read, or a package that cannot be imported and whose kind is named.
    """
    if text in KINDS.builtin:
        return KINDS[text], None
    for name in KINDS.builtin:
        if text in KINDS[name].designs:
            return KINDS[name], text
    if os.path.isfile(text):  # False of a name too long
        return kind_of_file(Path(text)), text
    if text in KINDS:
        return KINDS[text], None
    return next(((kind, text) for _, kind in KINDS.usable() if text in kind.designs), None)


def find_robot_doing(robot: str | None, gait: str | None = None) -> tuple[RobotKind, str | None]:
    """The kind and the source of the robot that the options ``robot``, a kind or a file, and ``gait`` name.

    Raises:
        ValueError: for an unknown kind, a file that is missing or of no kind, and both where one says all.
    """
    if robot is None:
        found = find_robot(gait) if gait is not None else None
        if found is None and gait is not None:
            _check_no_folder("gait", gait)
        return found or (KINDS[USUAL], gait)
    found = find_robot(robot)
    if found is None:
        _check_no_folder("robot", robot)
        if Path(robot).suffix or "/" in robot:
            raise ValueError(f"robot: {robot} is no file")
        KINDS.check(robot, besides=(design for name in KINDS.builtin for design in KINDS[name].designs))
        raise AssertionError
    kind, source = found
    if source is not None and gait is not None:
        raise ValueError(f"gait: {robot} is a robot by itself; leave it out")
    if gait is not None and (other := find_robot(gait)) is not None and other[0].name != kind.name:
        raise ValueError(f"gait: {gait} is of another kind, {other[0].title}; leave it out")
    return kind, source if source is not None else gait


def _check_no_folder(field: str, text: str) -> None:
    """Refuse a folder, such as that of a run, with the design in it, and the empty text, which would be one."""
    if not text:
        raise ValueError(f"{field}: '' is not allowed; give a name or a file")
    if os.path.isdir(path := Path(text)):
        best = path / BEST_DESIGN
        raise ValueError(
            f"{field}: {text} is a folder; give {best if best.is_file() else 'a file of a robot or a design'}"
        )


def kind_of_file(path: Path) -> RobotKind:
    """The kind of robot that a file describes.

    Raises:
        ValueError: if no kind recognises it.
    """
    record = _record_of(path)
    form = record.get("format")
    if form == DESIGN_FORMAT:
        return KINDS.find(record.get("kind"))
    for _, kind in KINDS.usable():
        if kind.recognises(path, form if isinstance(form, str) else None):
            return kind
    suffixes = sorted({".json", *(suffix for _, kind in KINDS.usable() for suffix in kind.suffixes)})
    raise ValueError(f"{path}: it is no file of a robot or a design; such files end in {', '.join(suffixes)}")


def make_robot(kind: RobotKind, source: str | None, options: Mapping[str, Any]) -> Robot:
    """The robot of a source and options, see ``RobotKind.build``; the source may also be a saved design of any kind.

    Raises:
        ValueError: for what is not allowed.
    """
    if source is not None and _record_of(Path(source)).get("format") == DESIGN_FORMAT:
        return load_design(Path(source)).changed(options)
    built = f"robot: {method_of(kind, 'build')}"
    with staying():
        robot = returned(kind.build(source, options), Robot, built, "a Robot")
    if not getattr(robot, "measures", ()):
        raise ValueError(f"{built} returns a robot without measures; name one at least, by which it is judged")
    for what, wanted, noun in (("parameters", Variable, "Parameter"), ("measures", Measure, "Measure")):
        given = getattr(robot, what)
        if not isinstance(given, tuple | list) or not all(isinstance(each, wanted) for each in given):
            raise ValueError(f"{built} returns a robot whose {what} are {shown(given)}; give a tuple of {noun} objects")
    warn_of_doubts(robot)
    return robot


def warn_of_doubts(robot: Robot) -> None:
    """Warn of what is allowed but likely a mistake, when a user gives a robot; copies of it are not looked at again."""
    for doubt in robot.doubts():
        warnings.warn(doubt, stacklevel=3)


def robot_to_try(kind: RobotKind, source: str | None, values: Mapping[str, Any]) -> tuple[Robot, tuple[World, ...]]:
    """The robot of a source and options, with nothing free, and the worlds that it is tried in.

    Args:
        kind: of the robot.
        source: see :func:`make_robot`.
        values: of the kind's options; one of them may name the world.

    Raises:
        ValueError: for what is not allowed.
    """
    world, options = world_and_others(kind, values)
    robot = make_robot(kind, source, options)
    worlds = tuple(robot.worlds) if world is None else (world,)
    return robot.design(robot.start) if robot.parameters else robot, worlds


def world_and_others(kind: RobotKind, values: Mapping[str, Any]) -> tuple[World | None, dict[str, Any]]:
    """The world that values of a kind's options name, None if none of them does, and the values of the others."""
    places = {option.name for option in kind.world_options}
    return kind.chosen_world(values), {name: value for name, value in values.items() if name not in places}


def load_design(path: Path) -> Robot:
    """The design that ``Robot.save`` wrote.

    Raises:
        ValueError: if the file is unreadable or damaged, or a value lies beyond the bounds of its parameter.
    """

    def build(record: dict[str, Any]) -> Robot:
        robot = KINDS.find(record["kind"]).from_description(record["robot"])
        known_names(record, "format", "kind", "robot", "values")
        known_names(table("values", record["values"]), *(parameter.name for parameter in robot.parameters))
        values = [number(parameter.name, record["values"][parameter.name]) for parameter in robot.parameters]
        return robot.design(checked_design(robot.parameters, robot.points(values)[0]))

    return read_record(path, DESIGN_FORMAT, build)


def _record_of(path: Path) -> dict[str, Any]:
    """The content of a JSON file that is a record; nothing of other files."""
    try:
        record = parse_json(read_text(path)) if path.suffix.lower() == ".json" and path.is_file() else None
    except RepeatedNameError as error:  # of which kind it is, it may still tell, but not what is meant
        raise ValueError(f"{path}: {error}") from None
    except ValueError:
        return {}
    return record if isinstance(record, dict) else {}
