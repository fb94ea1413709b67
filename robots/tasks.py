"""Tasks: a robot, worlds in which it is tried, what is to be raised, and when a design has succeeded.

Tasks that come with the lab are named in ``tasks.toml``; one of the user's own is a TOML file with the same keys. A
task says nothing of how it is solved: searches, learned controllers and designs by hand are told apart by the same
numbers.
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
OWN = ("title", "success")  # keys that are no options of commands
SIGNS: Mapping[str, Callable[[Any, Any], Any]] = {">=": operator.ge, "<=": operator.le}
_BOUND = re.compile(r"\s*(\w+)\s*(>=|<=)\s*(\S+)\s*")


@dataclass(frozen=True)
class Success:
    """A bound that a measure has to keep in every world.

    Attributes:
        measure: its name.
        sign: ``">="`` or ``"<="``.
        bound: in the measure's unit.
    """

    measure: str
    sign: str
    bound: float

    @classmethod
    def parse(cls, text: Any) -> "Success":
        """The bound of a text, such as ``"speed >= 0.5"``.

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
        """Which designs of an outcome keep it; none that failed."""
        found: Bools = self.allows(np.asarray(outcome.measures[self.measure], float))
        return found & (np.asarray(outcome.status) == "ok")

    def allows(self, values: Any) -> Any:
        """Whether numbers are within the bound; one, or an array of them."""
        return SIGNS[self.sign](values, self.bound)


def is_bound(text: str) -> bool:
    """Whether a text is meant as a bound on a measure."""
    return any(sign in text for sign in SIGNS)


def check_success(bounds: Iterable[Success], robot: Robot, worlds: Sequence[World]) -> None:
    """Refuse bounds on what a robot has no measure of in some worlds.

    Raises:
        ValueError: that names the measures there are.
    """
    names = [measure.name for measure in robot.measures_in(worlds)]
    for one in bounds:
        if one.measure not in names:
            raise ValueError(f"success: {one.measure!r} is unknown; choose one of {', '.join(names)}")


@dataclass(frozen=True)
class Task:
    """Something that robots shall do.

    Attributes:
        name: of the task, or of its file.
        options: of ``codesign``, by name with underscores: robot, worlds, objective, and what else a file says.
        title: what is to be done, for people.
        success: bounds that a design has to keep in every world; none for a task that cannot be solved or missed.
    """

    name: str
    options: Mapping[str, Any]
    title: str = ""
    success: tuple[Success, ...] = ()

    @cached_property
    def robot(self) -> Robot:
        """The robot, with what is free of it.

        Raises:
            ValueError: for robots that are not there, values that are not allowed, and bounds on what it has no
                measure of.
        """
        kind, source = find_robot_doing(self.source)
        found = make_robot(kind, source, self.values_of(kind.options))
        check_success(self.success, found, self._worlds or found.worlds)
        return found

    @property
    def raised(self) -> str:
        """What is raised or minimised, and within which limits, for people."""
        given = self.options.get("objective", [])
        texts = [given] if isinstance(given, str) else list(given)
        goals, limits = ([text for text in texts if is_bound(text) == bound] for bound in (False, True))
        return " ".join(goals) + (f" where {' and '.join(limits)}" if limits else "")

    @property
    def source(self) -> str | None:
        """The robot as commands name it; None for the usual one."""
        return self.options.get("robot")

    def values_of(self, options: Iterable[Option]) -> dict[str, Any]:
        """The values of some options that it gives, by name, as the command line would make them.

        Raises:
            ValueError: for what is not allowed.
        """
        return {each.name: each.read(self.options[each.name]) for each in options if each.name in self.options}

    @property
    def worlds(self) -> tuple[World, ...]:
        """Where the robot is tried."""
        return self._worlds or self.robot.worlds

    @property
    def _worlds(self) -> tuple[World, ...]:
        """The worlds that it names."""
        kind, _ = find_robot_doing(self.source)
        listed = (replace(each, several=each.name not in kind.ground_options) for each in kind.world_options)
        return kind.chosen_worlds(self.values_of(listed))

    def succeeded(self, robot: Robot, worlds: Sequence[World] = (), compute: Compute = HERE) -> bool | None:
        """Whether a robot, of which nothing is free, keeps all bounds in all worlds; None if there are no bounds."""
        if not self.success:
            return None
        outcomes = [robot.simulate((), world, compute=compute) for world in worlds or self.worlds]
        return all(bool(one.kept(outcome)[0]) for outcome in outcomes for one in self.success)


def builtin_tasks() -> dict[str, Task]:
    """All tasks that come with the lab, by name."""
    tables = tomllib.loads(BUILTIN.read_text(encoding="utf-8"))
    return {name: task_of(name, table) for name, table in tables.items()}


def task_of(name: str, table: Mapping[str, Any], folder: Path | None = None) -> Task:
    """The task of a table of TOML, in which names of options may have hyphens.

    Args:
        name: of the task.
        table: what a file says.
        folder: where files of its robot and its terrains are looked for, beside the working directory.

    Raises:
        ValueError: for a title or robot that is no text, an option that is given twice, and bounds that are none.
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
    """Options with the paths of the files of a robot and of terrains that lie in a folder."""
    found = dict(options)
    if "robot" in found:
        found["robot"] = found_beside(folder, found["robot"])
    if "terrain" in found:
        given = found["terrain"] if isinstance(found["terrain"], list) else [found["terrain"]]
        found["terrain"] = [with_file_in(folder, each) if isinstance(each, str) else each for each in given]
    return found


def find_task(given: str | Path) -> Task:
    """The task of a name or of a TOML file.

    Raises:
        ValueError: if there is none, or the file cannot be read.
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
