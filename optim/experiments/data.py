"""Data of a study that has been run: tables and settings, read and checked, from which it can be told again."""

import math
import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, TypeVar, get_args

from numpy.typing import NDArray

from optim.experiments.tables import Record, read_table, value_of
from taichi_sim.base import checks, files
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import build_settings, load_parts

Kind = type | types.UnionType | Collection[str]  # such as ``float``, ``float | None``, or all allowed texts
Of = TypeVar("Of")
WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "True or False", list: "a list of numbers"}
UNWRITTEN = {"nan", "inf", "-inf"}  # numbers that Python's literals do not have
WHERE = ("device", "threads")  # fields of settings that change no result


@dataclass(frozen=True)
class Data:
    """Data of a study in a folder, which is only read."""

    folder: Path

    def path(self, name: str) -> Path:
        """The file of a table, which may be compressed: it then has ``.gz`` at the end of its name."""
        path = self.folder / name
        packed = self.folder / f"{name}.gz"
        return packed if packed.is_file() and not path.is_file() else path

    def records(
        self,
        name: str,
        columns: Mapping[str, Kind],
        *groups: str,
        may_be_empty: bool = False,
        finite: Collection[str] = (),
    ) -> list[Record]:
        """Read the rows of a table, which may have more columns than these.

        Args:
            name: of its file, which may be compressed, with ``.gz`` after its name.
            columns: what the cells of each are: ``int``, ``float``, ``str``, ``bool`` or ``list``; or one of them or
                None, which is an empty cell, such as ``float | None``; or one of some texts.
            groups: columns with some texts, whose every combination must have a row.
            may_be_empty: whether a table without rows is allowed.
            finite: columns of numbers of which none may be NaN or infinite.

        Raises:
            ValueError: if the file cannot be read, lacks a column or a group, or has a cell of another kind.
        """
        path = self.path(name)
        header, rows = read_table(path)
        for missing in (column for column in columns if column not in header):
            raise ValueError(f"{path}: it has no column {missing}")
        if not rows and not may_be_empty:
            raise ValueError(f"{path}: it has no rows")
        found: list[Record] = []
        for number, row in enumerate(rows, 2):  # the header is the first
            cells = dict(zip(header, row, strict=True))
            checked = {column: _cell(path, number, column, cells[column], kind) for column, kind in columns.items()}
            for column in finite:
                if checked[column] is not None and not math.isfinite(checked[column]):
                    told = checks.shown(checked[column])
                    raise ValueError(f"{path}: row {number} has {told} as {column}; it must be a finite number")
            found.append({name: checked[name] if name in checked else value_of(cell) for name, cell in cells.items()})
        there = {tuple(row[group] for group in groups) for row in found}
        allowed = (kind for kind in map(columns.__getitem__, groups) if isinstance(kind, Collection))
        for each in product(*allowed) if groups else ():
            if each not in there:
                about = ", ".join(f"{group} {value}" for group, value in zip(groups, each, strict=True))
                raise ValueError(f"{path}: it has no rows of {about}")
        return found

    def columns(self, name: str) -> list[str]:
        """Names of the columns of a table, which older data may have fewer of.

        Raises:
            ValueError: if the file cannot be read.
        """
        return read_table(self.path(name))[0]

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return self.path(name).is_file()

    def kept(self, kind: str, build: Callable[[dict[str, Any]], Of]) -> Of:
        """Read the settings that a :class:`ResultsFolder` keeps in the file of its kind, and make something of them.

        Raises ValueError if there is no such file, or it is damaged, or refused by ``build``.
        """
        return build_settings(self.folder, kind, build)

    def part(self, name: str, **kinds: str) -> Arrays | None:
        """Read the arrays of a part that a :class:`ResultsFolder` keeps, of kinds such as ``speeds="f2"``.

        None if it is missing; one that is damaged is as good as missing, and warned of.
        """
        return next(load_parts(self.folder, name, **kinds), None)

    def array(self, name: str, key: str, kind: str) -> NDArray[Any]:
        """Read one array of a :meth:`part`; raises ValueError if it is missing."""
        if (found := self.part(name, **{key: kind})) is None:
            raise ValueError(f"{self.folder}: its part {name} is missing")
        return found[key]

    def arrays(self, name: str, names: Collection[str]) -> Arrays:
        """Read arrays of these names from an ``.npz`` file.

        Raises ValueError if the file cannot be read, or lacks one.
        """
        found = self._arrays(name)
        for missing in (each for each in names if each not in found):
            raise ValueError(f"{self.folder / name}: it has no array {missing!r}")
        return {each: found[each] for each in names}

    def array_names(self, name: str) -> Collection[str]:
        """Names of the arrays in an ``.npz`` file, of which older ones may have fewer.

        Raises ValueError if the file cannot be read.
        """
        return self._arrays(name).keys()

    def _arrays(self, name: str) -> Arrays:
        path = self.folder / name
        try:
            return files.arrays_of(files.content_of(path))
        except files.UNREADABLE as error:
            raise ValueError(f"{path}: cannot be read ({files.why_unread(error)})") from None

    def from_summary(self, build: Callable[[Mapping[str, Any]], Of]) -> Of:
        """Read ``summary.json``, and return what ``build`` makes of it.

        Raises ValueError that names the file if it cannot be read, lacks what ``build`` asks for, or is refused by it.
        """
        return files.read_json(self.folder / "summary.json", lambda record: build(checks.table("summary", record)))

    def count(self, *names: str) -> int:
        """Read a whole number of at least 1 from ``summary.json``, from a table in a table where there are more names.

        Raises ValueError if it cannot be read, is missing, or is anything else.
        """

        def build(record: Any) -> int:
            for place, name in enumerate(names):
                record = checks.table(".".join(names[:place]) or "summary", record)[name]
            return checks.integer(".".join(names), record, 1)

        return self.from_summary(build)

    def settings(self, kind: type[Of]) -> Of:
        """Read the settings of the study, a dataclass, as its ``describe`` told them, from ``summary.json``.

        Raises ValueError if it cannot be read, or some are missing, unknown, or not allowed.
        """

        def build(summary: Mapping[str, Any]) -> Of:
            given = dict(checks.table("settings", summary["settings"]))
            names = [each.name for each in fields(kind)]  # type: ignore[arg-type]
            for unknown in given.keys() - set(names):
                raise ValueError(f"settings: {unknown} is none of {', '.join(names)}")
            for missing in (name for name in names if name not in given and name not in WHERE):
                raise ValueError(f"settings: {missing} is missing")
            return kind(**given)

        return self.from_summary(build)


def _cell(path: Path, number: int, name: str, text: str, kind: Kind) -> Any:
    """The value of a cell of a column of a kind."""
    if isinstance(kind, Collection):
        if text not in kind:
            raise ValueError(f"{path}: row {number} has {checks.shown(text)} as {name}; allowed are {', '.join(kind)}")
        return text
    kinds = get_args(kind) or (kind,)
    if text and str in kinds:
        return text
    value = float(text) if float in kinds and text in UNWRITTEN else value_of(text)
    if not any(_is_of(value, each) for each in kinds):
        words = " or ".join("empty" if each is types.NoneType else WORDS[each] for each in kinds)
        raise ValueError(f"{path}: row {number} has {checks.shown(value)} as {name}; it must be {words}")
    return value


def _is_of(value: Any, kind: type) -> bool:
    if kind is list:
        return isinstance(value, list | tuple) and all(_is_of(each, float) for each in value)
    if kind is float:  # or a whole number that is no larger than floats are
        return isinstance(value, float) or (isinstance(value, int) and checks.finite(value) is not None)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def found(data: Path, study: str) -> Data:
    """The data of a study in a folder, or in the folder of its name there, as in ``docs/data``.

    Raises ValueError if there is no such folder.
    """
    if not data.is_dir():
        raise ValueError(f"from-data: {data} is no folder")
    return Data(next(each for each in (data / study, data) if each.is_dir()))
