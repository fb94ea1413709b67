"""Tasks: a robot, the worlds in which it is tried, the objective, and when a design has succeeded.

The built-in tasks are in ``tasks.toml``; a user's own task is a TOML file with the same keys. A task does not say how
it is solved, so searches, learned controllers and designs by hand are compared by the same numbers.
"""

import operator
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robots.robot import HERE, Option, Outcome, Robot, World, find_robot_doing, make_robot
from robots.world import with_file_in
from taichi_sim.base.arrays import Bools
from taichi_sim.base.checks import nearest
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import content_of, found_beside, why_unread
from taichi_sim.base.parsing import parse_toml
from taichi_sim.base.short_text import shortest

BUILTIN = Path(__file__).with_name("tasks.toml")
OWN = ("title", "success")  # keys that are not options of commands
SIGNS: Mapping[str, Callable[[Any, Any], Any]] = {">=": operator.ge, "<=": operator.le}
_BOUND = re.compile(r"\s*(\w+)\s*(>=|<=)\s*(\S+)\s*")


@dataclass(frozen=True)
class Success:
    """Condition of success: a bound on a measure, which must hold in every world.

    Attributes:
        measure: name of the measure.
        sign: ``">="`` or ``"<="``.
        bound: value of the bound, in the measure's unit.
    """

    measure: str
    sign: str
    bound: float

    @classmethod
    def parse(cls, text: Any) -> "Success":
        """Parse a bound such as ``"speed >= 0.5"``.

        Raises:
            ValueError: for anything else.
        """
        found = _BOUND.fullmatch(text) if isinstance(text, str) else None
        try:
            bound = float(found[3]) if found else np.nan
        except ValueError:
            bound = np.nan
        if found is None or not np.isfinite(bound):
            raise ValueError(f"success: {text!r} is not allowed; give MEASURE >= NUMBER or MEASURE <= NUMBER")
        return cls(found[1], found[2], bound)

    @property
    def text(self) -> str:
        """The condition as it is written."""
        return f"{self.measure} {self.sign} {shortest(self.bound)}"

    def kept(self, outcome: Outcome) -> Bools:
        """Whether each design of an outcome keeps the bound, shape (N,); False for designs that failed."""
        found: Bools = self.allows(np.asarray(outcome.measures[self.measure], float))
        return found & (np.asarray(outcome.status) == "ok")

    def summary(self, outcome: Outcome, world: World) -> str:
        """The value of a single design's measure in a world, or why it has none, beside the condition."""
        status, value = outcome.status_or_reason[0], float(np.asarray(outcome.measures[self.measure])[0])
        found = shortest(float(f"{value:.4g}")) if outcome.status[0] == "ok" else status
        return f"{self.measure} is {found} in {world.name} and should be {self.sign} {shortest(self.bound)}"

    def allows(self, values: Any) -> Any:
        """Whether a number, or each of an array of numbers, is within the bound."""
        return SIGNS[self.sign](values, self.bound)


def is_bound(text: str) -> bool:
    """Whether a text is meant as a bound on a measure."""
    return any(sign in text for sign in SIGNS)


def check_success(bounds: Iterable[Success], robot: Robot, worlds: Sequence[World]) -> None:
    """Refuse bounds on measures that a robot does not have in the given worlds.

    Raises:
        ValueError: for the first such bound; names the measures that exist.
    """
    names = [measure.name for measure in robot.measures_in(worlds)]
    for one in bounds:
        if one.measure not in names:
            raise ValueError(f"success: {one.measure!r} is unknown; choose one of {', '.join(names)}")


@dataclass(frozen=True)
class Task:
    """A task: which robot is designed, in which worlds, for which objective, and when a design succeeds.

    Attributes:
        name: name of the task, or of its file.
        options: options of ``codesign``, by name with underscores: robot, worlds, objective and any others.
        title: readable description of the task.
        success: bounds that a design must keep in every world; empty for a task without a condition of success.
    """

    name: str
    options: Mapping[str, Any]
    title: str = ""
    success: tuple[Success, ...] = ()

    @cached_property
    def robot(self) -> Robot:
        """The robot, with its free variables.

        Raises:
            ValueError: if the robot does not exist, a value is not allowed, or a bound is on a measure that it lacks.
        """
        kind, source = find_robot_doing(self.source)
        found = make_robot(kind, source, self.values_of(kind.options))
        check_success(self.success, found, self._worlds or found.worlds)
        return found

    @property
    def raised(self) -> str:
        """Readable text of the objective and its limits."""
        given = self.options.get("objective", [])
        texts = [given] if isinstance(given, str) else list(given)
        goals, limits = ([text for text in texts if is_bound(text) == bound] for bound in (False, True))
        return " ".join(goals) + (f" where {' and '.join(limits)}" if limits else "")

    @property
    def source(self) -> str | None:
        """Name or file of the robot, as commands take it; None for the default robot."""
        return self.options.get("robot")

    def values_of(self, options: Iterable[Option]) -> dict[str, Any]:
        """Values of those of some options that the task gives, by name, converted as on the command line.

        Raises:
            ValueError: for a value that is not allowed.
        """
        return {each.name: each.read(self.options[each.name]) for each in options if each.name in self.options}

    @property
    def worlds(self) -> tuple[World, ...]:
        """Worlds in which the robot is tried: those that the task names, or the robot's own."""
        return self._worlds or self.robot.worlds

    @property
    def _worlds(self) -> tuple[World, ...]:
        """Worlds that the task names."""
        kind, _ = find_robot_doing(self.source)
        listed = (replace(each, several=each.name not in kind.ground_options) for each in kind.world_options)
        return kind.chosen_worlds(self.values_of(listed))

    def succeeded(self, robot: Robot, worlds: Sequence[World] = (), compute: Compute = HERE) -> bool | None:
        """Whether a robot without free variables keeps all bounds in all worlds; None if there are no bounds."""
        return not self.missed(robot, worlds, compute) if self.success else None

    def missed(self, robot: Robot, worlds: Sequence[World] = (), compute: Compute = HERE) -> list[str]:
        """Bounds that a robot without free variables does not keep, each with its value and the world."""
        tried = [(world, robot.simulate((), world, compute=compute)) for world in worlds or self.worlds]
        return [
            one.summary(outcome, world) for world, outcome in tried for one in self.success if not one.kept(outcome)[0]
        ]


def builtin_tasks() -> dict[str, Task]:
    """All built-in tasks, by name."""
    tables = tomllib.loads(BUILTIN.read_text(encoding="utf-8"))
    return {name: task_of(name, table) for name, table in tables.items()}


def task_of(name: str, table: Mapping[str, Any], folder: Path | None = None) -> Task:
    """Make a task from a TOML table, in which names of options may have hyphens.

    Args:
        name: name of the task.
        table: content of the table.
        folder: folder in which files of the robot and the terrains are searched, beside the working directory.

    Raises:
        ValueError: if the title or robot is not a text, an option is given twice, or a bound cannot be read.
    """
    for key in ("title", "robot"):
        if not isinstance(table.get(key, ""), str):
            raise ValueError(f"{key}: {table[key]!r} is not allowed; give a text")
    options: dict[str, Any] = {}
    for key, value in table.items():
        if (option := key.replace("-", "_")) in options:
            raise ValueError(f"task: {name} gives {key} twice; give it once")
        if key not in OWN:
            options[option] = value
    success = table.get("success", [])
    bounds = tuple(Success.parse(each) for each in (success if isinstance(success, list) else [success]))
    return Task(name, options if folder is None else _with_files(options, folder), table.get("title", ""), bounds)


def _with_files(options: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Options in which the files of a robot and of terrains have their paths, if they lie in a folder."""
    found = dict(options)
    if "robot" in found:
        found["robot"] = found_beside(folder, found["robot"])
    if "terrain" in found:
        given = found["terrain"] if isinstance(found["terrain"], list) else [found["terrain"]]
        found["terrain"] = [with_file_in(folder, each) if isinstance(each, str) else each for each in given]
    return found


def find_task(given: str | Path) -> Task:
    """Find a task by its name, or read it from a TOML file.

    Raises:
        ValueError: if there is no such task, or the file cannot be read.
    """
    known = builtin_tasks()
    if str(given) in known:
        return known[str(given)]
    path = Path(given)
    if not path.suffix and not os.path.exists(path):
        raise ValueError(
            f"task: {str(given)!r} is unknown; give a file, or one of {', '.join(known)}"
            f"{nearest(str(given), list(known))}"
        )
    try:
        table = parse_toml(content_of(path))
    except (OSError, ValueError) as error:
        raise ValueError(f"task: {given} cannot be read ({why_unread(error)})") from None
    return task_of(path.stem, table, path.parent)
