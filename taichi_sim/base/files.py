"""Files that are whole or not there."""

import contextlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

Design = TypeVar("Design")
ASIDE = ".aside-"  # how files begin that are not whole yet; run folders clear away what a kill left of them


def new_path(path: str | os.PathLike[str]) -> Path:
    """A path at which there is nothing yet, in a folder that there is.

    Raises:
        ValueError: in one line, if there is something, or no such folder.
    """
    if Path(path).exists():
        raise ValueError(f"path: {path} exists; name a new file")
    check_parent("path", Path(path))
    return Path(path)


def make_folder(path: Path) -> None:
    """Make a folder for results, if there is none.

    Raises:
        ValueError: in one line, if it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"out: {path} cannot be made ({error.strerror})") from None


def check_parent(field: str, path: Path) -> None:
    """Refuse a file whose folder there is not: better before the work than after it."""
    if not path.parent.is_dir():
        raise ValueError(f"{field}: {path} cannot be written; there is no folder {path.parent}")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file aside, then rename it into place: a crash leaves the old file or the new one.

    Raises:
        ValueError: in one line, when the file cannot be written.
    """
    path = Path(path)
    aside = path.with_name(f"{ASIDE}{path.name}.{os.getpid()}")
    try:
        with aside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    except OSError as error:
        with contextlib.suppress(OSError):  # nor may it be possible to remove
            aside.unlink(missing_ok=True)
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """The same for a text."""
    write_bytes(path, text.encode())


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a text file.

    Raises:
        ValueError: in one line, when it cannot be read or is no text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is not a text file") from None


def why_unread(error: Exception) -> str:
    """Why a file could not be read or understood, in one line that leaves its name out."""
    return (error.strerror if isinstance(error, OSError) else None) or " ".join(str(error).split())


def write_record(path: str | os.PathLike[str], form: str, record: Mapping[str, Any]) -> None:
    """Write a design as JSON, its format first."""
    write_text(path, json.dumps({"format": form, **record}, indent=2) + "\n")


def read_record(path: str | os.PathLike[str], form: str, build: Callable[[dict[str, Any]], Design]) -> Design:
    """What ``build`` makes of a record written by :func:`write_record`.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    text = read_text(path)
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: it is no JSON of the format {form!r} ({error})") from None
    try:
        if not isinstance(record, dict) or record.get("format") != form:
            raise ValueError(f"it is not of the format {form!r}")
        return build(record)
    except KeyError as missing:
        raise ValueError(f"{path}: {missing} is missing") from None
    except (ValueError, TypeError, OverflowError) as problem:
        raise ValueError(f"{path}: {problem}") from None
