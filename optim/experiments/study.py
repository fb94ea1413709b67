"""Studies: experiments that ``morpholab reproduce`` runs to repeat or extend something published."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import InitVar, asdict, dataclass, field, fields, is_dataclass, replace
from functools import partial
from inspect import signature
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

from optim.experiments.data import WHERE, Data
from optim.experiments.results import Progress
from robots.world import FLOORS, floor_of
from taichi_sim.base import checks

# Types of fields: whole numbers of at least 0, 1 and 2.
Whole = Annotated[int, partial(checks.integer, low=0)]
Count = Annotated[int, partial(checks.integer, low=1)]
Several = Annotated[int, partial(checks.integer, low=2)]


def some_of(field_name: str, value: Any, names: Collection[str]) -> tuple[str, ...]:
    """Check that a setting is a tuple of one or more different names of those that are known."""
    if not isinstance(value, list | tuple) or not value or len(set(map(str, value))) < len(value):
        raise ValueError(f"{field_name}: {checks.shown(value)} is not allowed; give different names, one or more")
    return tuple(checks.choice(field_name, name, names) for name in value)


@dataclass(frozen=True)
class Settings:
    """Settings of a study, whose fields say by their types what is allowed, and on which all results depend."""

    def __post_init__(self) -> None:
        checks.check_fields(self)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values."""
        return {name: value for name, value in asdict(self).items() if name not in WHERE}

    def lasting(self, *grows: str) -> dict[str, Any]:
        """The description without fields by which a study only grows: its folder serves other values of them."""
        return {name: value for name, value in self.describe().items() if name not in grows}


def changed(settings: Any, changes: Mapping[str, Any]) -> Any:
    """Settings with other values by name, as JSON has them; one of settings in settings has both names, with a dot.

    What settings name in ``fixed``, their study sets itself: it cannot be changed.

    Raises:
        ValueError: for a name that is no setting, or a value that is not allowed.
    """
    if not changes:
        return settings
    kinds = {each.name: each.type for each in fields(settings) if each.init} if is_dataclass(settings) else {}
    names = list(_names(settings))
    values: dict[str, Any] = {}
    within: dict[str, dict[str, Any]] = {}
    for name, value in changes.items():
        if name not in names:
            known = f"choose one of {', '.join(names)}{checks.nearest(name, names)}"
            raise ValueError(f"set: {checks.shown(name)} is unknown; {known}")
        outer, dot, inner = name.partition(".")
        if dot:
            within.setdefault(outer, {})[inner] = value
            continue
        try:
            values[name] = _of_kind(kinds[name], value)
        except (TypeError, ValueError, OverflowError):
            present = checks.shown(getattr(settings, name))
            text = f"{name}: {checks.shown(value)} is not allowed; give a value such as {present}"
            raise ValueError(text) from None
    for outer, given in within.items():
        try:
            values[outer] = changed(getattr(settings, outer), given)
        except ValueError as error:  # of a field of the inner ones, as all refusals
            raise ValueError(f"{outer}.{error}") from None
    return replace(settings, **values)


def _names(settings: Any) -> Iterator[str]:
    """Names of all settings that can be changed, those in settings after a dot: no arrays, and none of ``fixed``."""
    fixed = getattr(settings, "fixed", ())
    for each in fields(settings) if is_dataclass(settings) else ():
        value = getattr(settings, each.name)
        if each.init and is_dataclass(value):
            names = (f"{each.name}.{name}" for name in _names(value))
            yield from (name for name in names if not any(f"{name}.".startswith(f"{one}.") for one in fixed))
        elif each.init and not isinstance(value, np.ndarray):
            yield each.name


def _of_kind(kind: Any, value: Any) -> Any:
    """A value of JSON as one of the type of a setting; raises TypeError, ValueError or OverflowError if it is none."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _of_kind(inner[0], value)
    if origin in (Union, UnionType):
        return None if value is None and NoneType in inner else _of_kind(inner[0], value)
    if kind is tuple or origin in (tuple, Sequence):
        each = tuple(value) if isinstance(value, list) else (value,)
        alike = origin is not tuple or inner[-1] is ...
        own = (inner or (Any,))[:1] * len(each) if alike else inner
        return tuple(_of_kind(one, part) for one, part in zip(own, each, strict=True))
    if origin in (Mapping, dict) and isinstance(value, dict):
        return {name: _of_kind(inner[1], each) for name, each in value.items()}
    if kind is float and type(value) is int:
        return float(value)
    plain = str if origin is Literal else kind
    if plain is not Any and type(value) is not plain:
        raise TypeError
    return value


@dataclass(frozen=True)
class Study:
    """A study that repeats or extends something published.

    ``run`` is called as ``run(folder, settings, progress)``:

    * ``folder`` takes the results; it is new, or that of a study with equal settings, which continues where it ended.
      A folder of something else is refused by a ValueError, before any work.
    * ``settings`` are any, those in ``scales`` or others.
    * ``progress`` is called with the fraction done; it may be None.
    * ``threads``, where ``run`` takes it, are CPU threads, all available if None; they change no result.

    It writes ``summary.json`` or a table, and figures; where it returns anything, that is what ``summary.json`` holds.
    If ``run`` takes ``sweep_folder``, it reads bodies from a sweep there, which may be new, instead of one beside the
    results; if it takes ``jobs``, so many of its parts go on at the same time, each in a process of its own.
    """

    title: str  # the question of the study, in a line
    source: str  # where that was published, such as ``"chapter 4"``
    # Settings by budget: "small", to see that it works; "medium", hours, where offered; and "full".
    scales: Mapping[str, Any]
    run: Callable[..., Any]  # does the study
    writes: tuple[str, ...]  # files in its folder, beside raw results
    cost: str = ""  # what ``"full"`` takes, where that is hours
    # Makes tables, summary and figures again from the data of a study that has been run, in a new folder.
    rewrite: Callable[[Data, Path], None] | None = None
    tell: InitVar[Callable[[Data, Path], None] | None] = None  # name of ``rewrite`` up to 2.0

    def __post_init__(self, tell: Callable[[Data, Path], None] | None) -> None:
        if tell is not None:
            object.__setattr__(self, "rewrite", tell)

    @property
    def options(self) -> set[str]:
        """Options among ``"sweep_folder"`` and ``"jobs"`` that ``run`` takes."""
        return {"sweep_folder", "jobs"} & set(signature(self.run).parameters)

    @property
    def has_ground(self) -> bool:
        """Whether its settings have a ``friction`` of the inflatable robot's feet, or a named ``floor``."""
        return all(hasattr(each, "friction") or hasattr(each, "floor") for each in self.scales.values())

    def reproduce(
        self,
        folder: Path,
        budget: str = "full",
        progress: Progress = None,
        friction: tuple[float, float] | None = None,
        changes: Mapping[str, Any] = MappingProxyType({}),
        **options: Any,
    ) -> None:
        """Run the study, or continue it where its folder ended, with some of :attr:`options`.

        A ``friction`` of sliding and of gripping feet is for studies that have a ground; ``changes`` are other values
        of settings of the budget, by name.

        Raises ValueError if the study does not have the budget or a setting, or the folder holds something else.
        """
        settings = changed(self.scales[checks.choice("budget", budget, self.scales)], changes)
        if friction is not None and hasattr(settings, "friction"):
            settings = replace(settings, friction=friction)
        elif friction is not None:
            if (floor := floor_of(friction)) is None:
                raise ValueError(f"friction: {friction} is not allowed; give that of a floor, {', '.join(FLOORS)}")
            settings = replace(settings, floor=floor)
        self.run(folder, settings, progress, **options)


@dataclass(frozen=True)
class StudySection:
    """A part of what a report tells of a study: a table, pictures, or both."""

    title: str  # heading
    caption: str = ""  # of the table
    header: Sequence[str] = ()  # names of the table's columns
    rows: Sequence[Sequence[str | int | float | None]] = ()  # of the table; the first cell of each is its name
    digits: int = 4  # of the table's numbers
    note: str = ""  # what its columns mean
    charts: Mapping[str, Callable[[Any], None]] = field(default_factory=dict)  # that draw on axes, by what they show
    size: tuple[float, float] = (3.7, 3.0)  # width and height of the charts [in]
    pictures: Mapping[str, Path] = field(default_factory=dict)  # PNG files, by what they show


@dataclass(frozen=True)
class StudyReport:
    """What a report tells of a study's folder."""

    kind: str  # what the study is, in a word
    lead: str  # what was done, in a sentence
    counts: Mapping[str, int]  # what matters most, by name
    settings: Mapping[str, Any]  # of the study, by name
    sections: Sequence[StudySection]  # tables and pictures
    document: Mapping[str, Any] = field(default_factory=dict)  # more for machines, beside kind and counts
