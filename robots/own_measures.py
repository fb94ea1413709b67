"""Measures of a user's own: functions of how a robot moves, with gradients by all that is free of it.

A package names one by an entry point in the group ``morpholab.measures``, so that commands and run folders find it.
"""

import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from robots.outcome import Measure
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.autodiff.tracing import Traced
from taichi_sim.base.registry import Registry

OF_OBJECTIVES = ("mean", "each", "worst")  # words that say how worlds are combined
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


@dataclass(frozen=True)
class OwnMeasure(Measure):
    """A measure that a user defines, for lattice, freeform and articulated robots that are given it.

    Attributes:
        name: lower-case letters, digits and underscores, beginning with a letter.
        law: function that computes the measure of B robots, shape (B,), from their motion: a
            ``robots.lattice_robot.SoftMotion`` or a ``robots.articulated.RigidMotion``. The value for a robot must
            depend on that robot's row alone; a robot for which it is not finite counts as diverged.

    Raises:
        ValueError: for a name that is not allowed, or no function.
    """

    _: KW_ONLY
    law: Callable[[Any], Any]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise ValueError(f"name: {self.name!r} is not allowed; give lower-case letters, digits and underscores")
        if self.name in OF_OBJECTIVES:
            raise ValueError(f"name: {self.name!r} is not allowed; it says how worlds are combined")
        if not callable(self.law):
            raise ValueError(f"law: {self.law!r} is no function; give one of how robots moved")

    def told(self, motion: Any, count: int) -> Any:
        """Compute the measure of ``count`` = B robots, shape (B,), traced for derivatives if their motion is.

        Raises:
            ValueError: if the law fails, or does not give a number for each robot.
        """
        try:
            with np.errstate(all="ignore"):  # of robots that diverged
                found = self.law(motion)
        except Exception as error:  # whatever a user's law may raise
            raise ValueError(f"own_measures: {self.name} fails: {type(error).__name__}: {error}") from error
        plain = np.asarray(value_of(found))
        if plain.shape != (count,) or plain.dtype.kind not in "fiu":
            raise ValueError(
                f"own_measures: {self.name} gives {plain.dtype} of shape {plain.shape}; give a number for each robot, "
                f"shape ({count},)"
            )
        return found if isinstance(found, Traced) else plain.astype(float)


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
        raise ValueError(f"own_measures: {given!r} is not allowed; give several, such as ('drift',)")
    found = tuple(_installed(each) if isinstance(each, str) else each for each in given)
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


def names_of(measures: Iterable[OwnMeasure]) -> list[str]:
    """Names by which descriptions keep measures, as no code is stored in them.

    Raises:
        ValueError: for a measure that no installed package has under its name.
    """
    named = []
    for each in measures:
        if OWN_MEASURES.get(each.name) != each:
            raise ValueError(
                f"own_measures: {each.name} is not kept in files, which hold no code; name it as an entry point of a "
                f"package in the group {OWN_MEASURES.group}"
            )
        named.append(each.name)
    return named


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
