"""Data of a study that has been run: tables and settings, read and checked, from which it can be told again."""

import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, TypeVar, get_args

from numpy.typing import NDArray

from optim.experiments.tables import Record, read_records
from taichi_sim.base import checks, files
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import build_settings, load_parts

Kind = type | types.UnionType | Collection[str]  # such as ``float``, ``float | None``, or all allowed texts
Of = TypeVar("Of")
WORDS = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "True or False",
    list: "a list",
    tuple: "several",
}
UNWRITTEN = {"nan", "inf", "-inf"}  # numbers that Python's literals do not have


@dataclass(frozen=True)
class Data:
    """Data of a study in a folder, which is only read."""

    folder: Path

    def path(self, name: str) -> Path:
        """The file of a table, which may be compressed: it then has ``.gz`` at the end of its name."""
        path = self.folder / name
        packed = self.folder / f"{name}.gz"
        return packed if packed.is_file() and not path.is_file() else path

    def records(self, name: str, columns: Mapping[str, Kind], *groups: str, may_be_empty: bool = False) -> list[Record]:
        """Read the rows of a table, which may have more columns than these.

        Args:
            name: of its file, which may be compressed, with ``.gz`` after its name.
            columns: what the cells of each are: ``int``, ``float``, ``str``, ``bool`` or ``list``; or one of them or
                None, which is an empty cell, such as ``float | None``; or one of some texts.
            groups: columns with some texts, whose every combination must have a row.
            may_be_empty: whether a table without rows is allowed.

        Raises:
            ValueError: if the file cannot be read, lacks a column or a group, or has a cell of another kind.
        """
        path = self.path(name)
        rows = read_records(path)
        for missing in (column for column in columns if rows and column not in rows[0]):
            raise ValueError(f"{path}: it has no column {missing}")
        if not rows and not may_be_empty:
            raise ValueError(f"{path}: it has no rows")
        found: list[Record] = [{**row, **_checked(path, number, row, columns)} for number, row in enumerate(rows, 1)]
        there = {tuple(row[group] for group in groups) for row in found}
        allowed = (kind for kind in map(columns.__getitem__, groups) if isinstance(kind, Collection))
        for each in product(*allowed):
            if each not in there:
                about = ", ".join(f"{group} {value}" for group, value in zip(groups, each, strict=True))
                raise ValueError(f"{path}: it has no rows of {about}")
        return found

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
        path = self.folder / name
        try:
            found = files.arrays_of(files.content_of(path))
        except files.UNREADABLE as error:
            raise ValueError(f"{path}: cannot be read ({files.why_unread(error)})") from None
        for missing in (each for each in names if each not in found):
            raise ValueError(f"{path}: it has no array {missing!r}")
        return {each: found[each] for each in names}

    def summary(self, *names: str) -> dict[str, Any]:
        """Read ``summary.json``, which must have these fields.

        Raises ValueError if it cannot be read, or lacks one.
        """

        def build(record: Any) -> dict[str, Any]:
            found = dict(checks.table("summary", record))
            return {**found, **{name: found[name] for name in names}}

        return files.read_json(self.folder / "summary.json", build)

    def count(self, *names: str) -> int:
        """Read a whole number of at least 1 from ``summary.json``, from a table in a table where there are more names.

        Raises ValueError if it cannot be read, is missing, or is anything else.
        """

        def build(record: Any) -> int:
            for place, name in enumerate(names):
                record = checks.table(".".join(names[:place]) or "summary", record)[name]
            return checks.integer(".".join(names), record, 1)

        return files.read_json(self.folder / "summary.json", build)

    def settings(self, kind: type[Of]) -> Of:
        """Read the settings of the study, which ``summary.json`` keeps.

        Raises ValueError if it cannot be read, or some are missing, unknown, or not allowed.
        """
        path = self.folder / "summary.json"
        return files.read_json(path, lambda record: settings_from(checks.table("summary", record)["settings"], kind))


def settings_from(record: Any, kind: type[Of]) -> Of:
    """Make settings, a dataclass, from what their ``describe`` gives; what it does not tell keeps its default.

    Raises ValueError if some are unknown or not allowed.
    """
    given = dict(checks.table("settings", record))
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    for unknown in given.keys() - set(names):
        raise ValueError(f"settings: {unknown} is none of {', '.join(names)}")
    return kind(**given)


def _checked(path: Path, number: int, row: Record, columns: Mapping[str, Kind]) -> dict[str, Any]:
    """The cells of a row, as their columns say."""
    return {name: _cell(path, number, name, row[name], kind) for name, kind in columns.items()}


def _cell(path: Path, number: int, name: str, value: Any, kind: Kind) -> Any:
    if isinstance(kind, Collection):
        if value not in kind:
            raise ValueError(f"{path}: row {number} has {checks.shown(value)} as {name}; allowed are {', '.join(kind)}")
        return value
    kinds = get_args(kind) or (kind,)
    if float in kinds and isinstance(value, str) and value in UNWRITTEN:
        return float(value)
    if str in kinds and value is not None and not isinstance(value, str):
        return str(value)  # a text such as ``162``, which reads as a number
    allowed = (*kinds, int) if float in kinds else kinds
    if not isinstance(value, allowed) or (isinstance(value, bool) and bool not in kinds):
        words = " or ".join("empty" if each is types.NoneType else WORDS[each] for each in kinds)
        raise ValueError(f"{path}: row {number} has {checks.shown(value)} as {name}; it must be {words}")
    return value


def found(data: Path, study: str) -> Data:
    """The data of a study in a folder, or in the folder of its name there, as in ``docs/data``.

    Raises ValueError if there is no such folder.
    """
    if not data.is_dir():
        raise ValueError(f"from-data: {data} is no folder")
    return Data(next(each for each in (data / study, data) if each.is_dir()))


def columns_of(names: str, kind: Kind) -> dict[str, Kind]:
    """Columns of the same kind, from their names in a line."""
    return dict.fromkeys(names.split(), kind)
