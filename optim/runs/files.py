"""Files that are either whole or not there, and arrays that tell whether they are."""

import contextlib
import hashlib
import io
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Arrays

ASIDE = ".aside-"  # how files begin that are not whole yet; as of ``taichi_sim.base.files``
_DIGEST_LENGTH = 64  # characters of a SHA-256 in hexadecimal


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` once it is safely on disk."""
    with _aside(path) as aside:
        yield aside
        _put(aside, path)


def update(path: Path, write: Callable[[Path], None]) -> None:
    """Let ``write`` make a file; ``path`` changes only if the content does."""
    with _aside(path) as aside:
        write(aside)
        if path.is_file() and path.read_bytes() == aside.read_bytes():
            aside.unlink()
        else:
            _put(aside, path)


@contextlib.contextmanager
def _aside(path: Path) -> Iterator[Path]:
    aside = path.with_name(f"{ASIDE}{path.name}")
    try:
        yield aside
    except OSError:
        with contextlib.suppress(OSError):  # what a full disk has no room for must not fill it further
            aside.unlink(missing_ok=True)
        raise


def _put(aside: Path, path: Path) -> None:
    _sync(aside)
    os.replace(aside, path)
    _sync(path.parent)


def sha256(content: bytes) -> str:
    """Checksum in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The arrays as the content of an .npz file whose comment is the SHA-256 of all bytes before it."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    # A zip archive ends with the length of its comment (two bytes, zero so far) and the comment.
    content = buffer.getvalue()[:-2] + _DIGEST_LENGTH.to_bytes(2, "little")
    return content + sha256(content).encode()


def unpack(content: bytes) -> Arrays:
    """The arrays that :func:`pack` packed.

    Raises:
        ValueError: if a single bit differs.
    """
    if sha256(content[:-_DIGEST_LENGTH]).encode() != content[-_DIGEST_LENGTH:]:
        raise ValueError("the checksum does not match")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def append_line(path: Path, line: str) -> None:
    """Add a line to a text file and see it safely on disk."""
    with path.open("ab") as file:
        file.write(line.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def complete_lines(path: Path) -> list[bytes]:
    """The lines of a text file, without a torn last one; none if there is no file."""
    content = path.read_bytes() if path.exists() else b""
    return [line + b"\n" for line in content.split(b"\n")[:-1]]


def keep_lines(path: Path, count: int) -> None:
    """Cut a text file, if there is one, after its first ``count`` complete lines."""
    size = len(b"".join(complete_lines(path)[:count]))
    if path.exists() and path.stat().st_size > size:
        os.truncate(path, size)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
