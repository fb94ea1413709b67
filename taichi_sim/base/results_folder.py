"""Folders that keep the results of long work part by part, so that it can be continued."""

import functools
import hashlib
import io
import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Arrays
from taichi_sim.base.checks import LONGEST_SHOWN
from taichi_sim.base.files import (
    ASIDE,
    UNREADABLE,
    arrays_of,
    content_of,
    make_folder,
    read_record,
    read_text,
    remove_cut_off,
    why_unread,
    write_bytes,
    write_text,
)
from taichi_sim.base.parsing import parse_json

BEST_DESIGN = "best.json"  # of a search, in its folder
_SETTINGS = "settings/"  # of a part: an array of this name and the kind of work has the digest of the settings

Made = TypeVar("Made")


class ResultsFolder:
    """Folder with settings as JSON and results as compressed files of arrays, each written atomically.

    Work with the same settings continues with the parts that are there. If it is killed, it loses only the part that
    it has not yet added.
    """

    def __init__(self, path: Path, kind: str, settings: Mapping[str, Any]) -> None:
        """Make the folder, or check that it has the same settings.

        Args:
            path: the folder, which may be new, empty, or of the same work.
            kind: what the work is, such as ``"sweep"``; also the name of the settings file.
            settings: everything on which results depend; fits JSON.

        Raises:
            ValueError: if the folder has other settings or other files, or cannot be made.
        """
        self.path = path
        text, file = json.dumps({"format": _form(kind), **settings}, indent=2) + "\n", path / f"{kind}.json"
        self._kind, self._digest = kind, _digest(text)
        if file.exists():
            if (before := read_text(file)) != text:
                article = "" if kind.endswith("s") else "an " if kind[0] in "aeiou" else "a "
                raise ValueError(
                    f"out: {path} holds {article}{kind} of other settings{_difference(kind, before, text)}; "
                    "name another folder"
                )
            remove_cut_off(path)
            return
        if path.exists() and (not path.is_dir() or any(not each.name.startswith(ASIDE) for each in path.iterdir())):
            raise ValueError(f"out: {path} holds something else; name a new folder")
        make_folder(path)
        write_text(file, text)

    def add(self, name: str, of: bytes, **arrays: NDArray[Any]) -> None:
        """Write a file of arrays, whose name is ``name`` and a digest of ``of``; it tells of which settings it is.

        Raises:
            ValueError: if the path cannot be written.
            RuntimeError: if the disk is full or broken, or the folder no longer has these settings.
        """
        if _digest_in(self.path, self._kind) != self._digest:
            raise RuntimeError(
                f"{self.path}: the folder was moved or replaced, or its {self._kind}.json changed, in use; the parts "
                "that are done are kept where it is now"
            )
        content, digest = io.BytesIO(), np.frombuffer(self._digest, np.uint8)
        np.savez_compressed(content, allow_pickle=False, **arrays, **{f"{_SETTINGS}{self._kind}": digest})
        write_bytes(self.path / f"{name}-{hashlib.sha256(of).hexdigest()[:16]}.npz", content.getvalue())

    def load(self, name: str, check: Callable[[Arrays], object] | None = None, /, **kinds: str) -> Iterator[Arrays]:
        """Load the arrays of every file of that name; see :func:`load_parts`."""
        return load_parts(self.path, name, check, **kinds)


def load_parts(
    folder: Path, name: str, check: Callable[[Arrays], object] | None = None, /, **kinds: str
) -> Iterator[Arrays]:
    """Load the arrays of every file of that name in a folder of results; damaged files are skipped with a warning.

    So are files of work with other settings, which may have been copied there. Those that earlier versions wrote do
    not tell, and are taken.

    Args:
        folder: which is only read.
        name: of the part.
        check: refuses the arrays of a damaged file by a ValueError.
        kinds: kind of type and number of axes of each array that a file must have, such as ``solved="b2"``.
    """
    digest_of = functools.cache(functools.partial(_digest_in, folder))  # the settings are read once for all parts
    for path in sorted(folder.glob(f"{name}-*.npz")):
        try:
            found = arrays_of(content_of(path))  # archives have checksums of their own
            _take_settings(digest_of, found)
            for each, kind in kinds.items():
                if each not in found:
                    raise ValueError(f"{each} is missing")
                if f"{found[each].dtype.kind}{found[each].ndim}" != kind:
                    told = f"{found[each].dtype} of shape {found[each].shape}"
                    raise ValueError(f"{each}: {told} is not allowed; give type and axes {kind}")
            if len({len(found[each]) for each in kinds}) > 1:
                raise ValueError(f"{', '.join(kinds)}: have different lengths")
            if check:
                check(found)
        except UNREADABLE as error:
            reason = why_unread(error)
            warnings.warn(f"{path}: is damaged, and as good as missing ({reason})", stacklevel=2)
        else:
            yield found


def _take_settings(digest_of: Callable[[str], bytes | None], found: Arrays) -> None:
    """Take the digest of its settings, if it has one, out of a part; refuse that of other settings than the folder's.

    Raises:
        ValueError: if the part is of work with other settings.
    """
    for each in [each for each in found if each.startswith(_SETTINGS)]:
        kind, digest = each.removeprefix(_SETTINGS), found.pop(each)
        if "/" in kind or digest.tobytes() != digest_of(kind):
            raise ValueError(f"it is a part of a {kind} of other settings")


def _digest_in(folder: Path, kind: str) -> bytes | None:
    """Digest of the settings in a folder; None if it has none that can be read."""
    try:
        return _digest(read_text(folder / f"{kind}.json"))
    except ValueError:
        return None


def _digest(settings: str) -> bytes:
    return hashlib.sha256(settings.encode()).digest()


def read_settings(path: Path, kind: str) -> dict[str, Any]:
    """Read the settings of the work whose results a folder holds; see :func:`build_settings`."""
    return build_settings(path, kind, dict)


def build_settings(path: Path, kind: str, build: Callable[[dict[str, Any]], Made]) -> Made:
    """Read the settings of the work whose results a folder holds, and return what ``build`` makes of them.

    Raises:
        ValueError: if it holds none, or the file of settings is damaged, or refused by ``build``.
    """
    file = path / f"{kind}.json"
    if not file.is_file():
        raise ValueError(f"{path}: holds no {kind}")
    return read_record(file, _form(kind), lambda record: build({n: v for n, v in record.items() if n != "format"}))


def _difference(kind: str, before: str, now: str) -> str:
    """First setting that differs, in brackets, for a message."""
    try:
        old, new = parse_json(before), parse_json(now)
        name = next(name for name in [*new, *old] if old.get(name) != new.get(name))
    except (ValueError, AttributeError, StopIteration):
        return f" ({kind}.json is damaged)"
    values = [json.dumps(record.get(name)) for record in (old, new)]
    return f" ({name}: {values[0]}, not {values[1]})" if max(map(len, values)) < LONGEST_SHOWN else f" ({name})"


def _form(kind: str) -> str:
    return f"morpholab-{kind}-1"
