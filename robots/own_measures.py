"""Measures of a user's own: functions of how a robot moves, with gradients by all that is free of it.

A package names one by an entry point in the group ``morpholab.measures``, so that commands and run folders find it. Of
one that only a Python file of a robot defines, run folders keep the name and the file's checksum, but no code.
"""

import functools
import os
import re
import runpy
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import numpy as np

from robots.kind import OWN_MEASURES_FIELD
from robots.outcome import Measure
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.autodiff.tracing import Traced
from taichi_sim.base.checks import known_names
from taichi_sim.base.files import content_of, sha256
from taichi_sim.base.foreign import class_and_message, failure_of, lacks_memory, modules_beside, users_code
from taichi_sim.base.registry import Registry

OF_OBJECTIVES = ("mean", "each", "worst")  # words that say how worlds are combined
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


@dataclass(frozen=True)
class RobotFile:
    """The Python file of a robot that defines measures: its name and SHA-256; its path where it has been run."""

    name: str
    sha256: str
    path: str = ""

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> "RobotFile":
        """The file as it is now."""
        return cls(os.path.basename(path), sha256(content_of(path)), os.path.abspath(path))


@dataclass(frozen=True)
class OwnMeasure(Measure):
    """A measure that a user defines, for lattice, freeform and articulated robots that are given it.

    Attributes:
        name: lower-case letters, digits and underscores, beginning with a letter.
        law: function that computes the measure of B robots, shape (B,), from their motion: a
            ``robots.lattice_robot.SoftMotion`` or a ``robots.articulated.RigidMotion``. The value for a robot must
            depend on that robot's row alone; a robot for which it is not finite counts as diverged.
        file: the Python file of a robot that alone defines it, if one does; set when the file is run.

    Raises:
        ValueError: for a name that is not allowed, or no function.
    """

    _: KW_ONLY
    law: Callable[[Any], Any]
    file: RobotFile | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise ValueError(f"name: {self.name!r} is not allowed; give lower-case letters, digits and underscores")
        if self.name in OF_OBJECTIVES:
            raise ValueError(f"name: {self.name!r} is not allowed; it says how worlds are combined")
        if not callable(self.law):
            raise ValueError(f"law: {self.law!r} is no function; give one of how robots moved")

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle a measure that only a file defines as by that: functions of a file that was run have no module."""
        if self.file is None or self.lost:
            return super().__reduce_ex__(protocol)
        return _measure_of_file, (self.file, self.name)

    @property
    def lost(self) -> bool:
        """Whether a run folder has only told of the measure, so that nothing can compute it."""
        return self.law is _unknown

    @property
    def source(self) -> str:
        """Name of the file that alone defines the measure; empty if there is none."""
        return "" if self.file is None else self.file.name

    def _modules_beside(self) -> AbstractContextManager[None]:
        """A context in which the law may import modules beside its file."""
        path = self.file and self.file.path
        return modules_beside(os.path.dirname(path)) if path else nullcontext()

    def values(self, motion: Any, count: int) -> Any:
        """Compute the measure of ``count`` = B robots, shape (B,), traced for derivatives if their motion is.

        Raises:
            ValueError: if nothing can compute it, the law fails, or does not give a number for each robot.
        """
        if self.lost:
            raise ValueError(f"own_measures: {self.name} is defined by {self.source} alone; give that as the robot")
        try:
            with np.errstate(all="ignore"), self._modules_beside():  # errors of robots that diverged
                found = self.law(motion)
        except BaseException as raised:  # whatever a user's law may raise
            if lacks_memory(raised):
                raise
            error = failure_of(raised)
            has = f"; it has {', '.join(_members(motion))}" if getattr(error, "obj", None) is motion else ""
            raise ValueError(f"own_measures: {self.name} fails: {class_and_message(raised)}{has}") from error
        plain = np.asarray(value_of(found))
        if plain.shape != (count,) or plain.dtype.kind not in "fiu":
            raise ValueError(
                f"own_measures: {self.name} gives {plain.dtype} of shape {plain.shape}; give a number for each robot, "
                f"shape ({count},)"
            )
        return found if isinstance(found, Traced) else plain.astype(float)


def _members(motion: Any) -> list[str]:
    """Names of what a law may ask of a motion."""
    return [name for name in dir(motion) if not name.startswith("_")]


def sealed(array: Any) -> Any:
    """An array that a law cannot change, as others see it too; one that is traced never can be."""
    if isinstance(array, Traced):
        return array
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


OWN_MEASURES: Registry[OwnMeasure] = Registry("morpholab.measures", "own_measures", {}, instances_of=OwnMeasure)


def checked_own_measures(given: Iterable[Any], others: Collection[str]) -> tuple[OwnMeasure, ...]:
    """Measures, some of which may be given by the names of those of installed packages.

    Args:
        given: measures and names.
        others: names of what the robot tells anyway.

    Raises:
        ValueError: for a name that no package has or the robot tells anyway, what is no measure, or one given twice.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise ValueError(f"own_measures: {given!r} is not allowed; give a tuple, such as ('drift',)")
    found = tuple(_found(each) for each in given)
    for number, each in enumerate(found):
        if not isinstance(each, OwnMeasure):
            raise ValueError(
                f"own_measures: {each!r} is not allowed; give an OwnMeasure, or the name of an installed one"
            )
        if each.name in (other.name for other in found[:number]):
            raise ValueError(f"own_measures: {each.name} is given twice; give each once")
        if each.name in others:
            raise ValueError(f"own_measures: {each.name} is a measure that the robot has anyway; call yours otherwise")
    return found


def records_of(measures: Iterable[OwnMeasure]) -> list[Any]:
    """Measures as descriptions keep them, which store no code: names, with the file if that alone defines a measure.

    Raises:
        ValueError: for a measure of no file that no installed package has under its name.
    """
    records: list[Any] = []
    for each in measures:
        if _is_installed(each):
            records.append(each.name)
        elif each.file is not None:
            told = {"name": each.name, "unit": each.unit, "title": each.title}
            records.append({**told, "file": each.file.name, "sha256": each.file.sha256})
        else:
            raise ValueError(
                f"own_measures: {each.name} is not kept in files, which hold no code; name it as an entry point of a "
                f"package in the group {OWN_MEASURES.group}, or set the robot in a Python file and give that"
            )
    return records


def of_file(robot: Any, file: RobotFile) -> Any:
    """A robot whose measures, other than those of installed packages, say that a Python file defines them."""
    given: tuple[OwnMeasure, ...] = getattr(robot, OWN_MEASURES_FIELD, ())
    if all(map(_is_installed, given)):
        return robot
    return robot.changed({OWN_MEASURES_FIELD: [m if _is_installed(m) else replace(m, file=file) for m in given]})


@functools.lru_cache(maxsize=4)
def _measures_of_file(file: RobotFile) -> dict[str, OwnMeasure]:
    """Measures that the Python file of a robot defines, by name; the file is run.

    Raises:
        ValueError: if it fails, or is another one by now.
    """
    with users_code(file.path), modules_beside(os.path.dirname(file.path)):
        if sha256(content_of(file.path)) != file.sha256:
            raise ValueError("it has changed since the search began")
        robot = runpy.run_path(file.path)["robot"]
    return {each.name: replace(each, file=file) for each in robot.own_measures}


def _measure_of_file(file: RobotFile, name: str) -> OwnMeasure:
    """One of the measures that a file defines."""
    return _measures_of_file(file)[name]


def _unknown(motion: Any) -> Any:
    """The law of a measure of which only the name is known."""
    raise NotImplementedError


def _is_installed(measure: OwnMeasure) -> bool:
    return OWN_MEASURES.get(measure.name) == measure


def _found(given: Any) -> Any:
    """The measure of a name or of a record; what is neither, as it is."""
    if isinstance(given, str):
        return _installed(given)
    if not isinstance(given, Mapping):
        return given
    known_names(given, "name", "unit", "title", "file", "sha256")
    for field_name in ("name", "unit", "title", "file", "sha256"):
        if not isinstance(given.get(field_name), str):
            raise ValueError(f"own_measures: {field_name} {given.get(field_name)!r} is not allowed; give text")
    file = RobotFile(given["file"], given["sha256"])
    return OwnMeasure(given["name"], given["unit"], given["title"], law=_unknown, file=file)


def _installed(name: str) -> OwnMeasure:
    """The measure of an installed package.

    Raises:
        ValueError: if none has one of this name, or calls another one so.
    """
    if name not in OWN_MEASURES and not len(OWN_MEASURES):
        raise ValueError(f"own_measures: {name!r} is unknown; no installed package has measures")
    found = OWN_MEASURES.find(name)
    if found.name != name:
        raise ValueError(
            f"own_measures: the package's measure {name!r} calls itself {found.name!r}; give both one name"
        )
    return found
