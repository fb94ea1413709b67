"""Measures of a user's own: functions of how a soft robot moves, with gradients by all that is free of it.

A package names one by an entry point in the group ``morpholab.measures``, so that commands and run folders find it.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from robots.control.cyclic import LAST_CYCLE, SEGMENTS
from robots.lattice_robot.measures import MEASURES, OF_PROPS, TARGETED, Constants, Record
from robots.robot import Measure
from taichi_sim.autodiff.arrays import value_of
from taichi_sim.autodiff.tracing import Traced
from taichi_sim.base.arrays import Floats
from taichi_sim.base.registry import Registry
from taichi_sim.lattice import LatticeBody

TAKEN = frozenset(each.name for each in (*MEASURES, TARGETED, *OF_PROPS)) | {"cells", "channels"}
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


@dataclass(frozen=True, eq=False)
class SoftMotion:
    """How B soft robots of V voxels moved, without the props around them, as a law of a user's own sees it.

    Arrays may be traced for derivatives: a law computes with operators and with the functions of NumPy that
    ``taichi_sim.autodiff.arrays`` knows, and takes plain arrays just as well.

    Attributes:
        times: of the 17 moments of the last cycle, from where it begins [s], shape (17,).
        positions: of voxel centres in these moments [m], shape (B, 17, V, 3).
        sizes: rest size of every voxel along its own axes in these moments [m], shape (B, 17, V, 3).
        strains: of every link in these moments, shape (B, 17, L).
        start: voxel centres before anything moved [m], shape (B, V, 3).
        began: voxel centres where cycles begin to count, after the first one [m], shape (B, V, 3).
        ended: voxel centres after the last cycle [m], shape (B, V, 3).
        masses: of voxels [kg], shape (B, V).
        duration: of the cycles that count [s].
        heading: unit vector of the direction of travel, shape (3,).
        length: in which speeds are told [m].
        body: the first robot's, whose voxels and links are those of all.
    """

    times: Floats
    positions: Any
    sizes: Any
    strains: Any
    start: Floats
    began: Any
    ended: Any
    masses: Any
    duration: float
    heading: Floats
    length: float
    body: LatticeBody

    @classmethod
    def of(cls, record: Record, constants: Constants) -> "SoftMotion":
        """What a robot without props did."""
        body = constants.body
        start = np.tile(body.start_positions, (len(constants.density), 1, 1))
        start[:, :, 2] += constants.raised
        return cls(
            np.arange(SEGMENTS + 1) / (SEGMENTS * constants.frequency),
            record.positions[:, LAST_CYCLE],
            record.sizes[:, LAST_CYCLE],
            record.strains[:, LAST_CYCLE],
            start,
            record.positions[:, 0],
            record.positions[:, 1],
            constants.density * body.voxel_size**3,
            constants.duration,
            constants.direction,
            constants.length,
            body,
        )

    def centres(self, positions: Any) -> Any:
        """Centres of mass, shape (B, ..., 3), of voxel centres, shape (B, ..., V, 3)."""
        shares = [masses / masses.sum() for masses in self.masses]
        along = [
            np.stack([row @ share for row, share in zip(positions[..., axis], shares, strict=True)])
            for axis in range(3)
        ]
        return np.stack(along, axis=-1)


@dataclass(frozen=True)
class OwnMeasure(Measure):
    """A measure of a user's own, which lattice and freeform robots tell when it is among their ``own_measures``.

    Attributes:
        name: lower-case letters, digits and underscores, beginning with a letter.
        law: gives the measure of B robots, shape (B,), of their :class:`SoftMotion`; what each is told must depend on
            its own row alone.

    Raises:
        ValueError: for a name that is not allowed, or no function.
    """

    _: KW_ONLY
    law: Callable[[SoftMotion], Any]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise ValueError(f"name: {self.name!r} is not allowed; give lower-case letters, digits and underscores")
        if self.name in TAKEN:
            raise ValueError(f"name: {self.name!r} is a measure of every soft robot; give another one")
        if not callable(self.law):
            raise ValueError(f"law: {self.law!r} is no function; give one of a SoftMotion")

    def told(self, record: Record, constants: Constants) -> Any:
        """The measure of B robots, shape (B,), which is traced if the record is.

        Raises:
            ValueError: if the law fails, or does not give a number for each robot.
        """
        try:
            with np.errstate(all="ignore"):  # of robots that diverged
                found = self.law(SoftMotion.of(record, constants))
        except Exception as error:  # whatever a user's law may raise
            raise ValueError(f"own_measures: {self.name} fails: {type(error).__name__}: {error}") from error
        plain, count = np.asarray(value_of(found)), len(constants.density)
        if plain.shape != (count,) or plain.dtype.kind not in "fiu":
            raise ValueError(
                f"own_measures: {self.name} gives {plain.dtype} of shape {plain.shape}; give a number for each robot, "
                f"shape ({count},)"
            )
        return found if isinstance(found, Traced) else plain.astype(float)


OWN_MEASURES: Registry[OwnMeasure] = Registry("morpholab.measures", "own_measures", {}, instances_of=OwnMeasure)


def checked_own_measures(given: Iterable[Any]) -> tuple[OwnMeasure, ...]:
    """Measures, some of which may be given by the names of those of installed packages.

    Raises:
        ValueError: for a name that no package has, what is no measure, or a measure that is given twice.
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
