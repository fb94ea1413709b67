"""Atomic file writes: a file has its old content or its new content, whatever ends the process in between."""

import contextlib
import errno
import gzip
import hashlib
import io
import json
import math
import os
import platform
import shutil
import threading
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Arrays
from taichi_sim.base.checks import shown
from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.file_kinds import LARGEST, check_plain_file, place_to_write
from taichi_sim.base.foreign import said_by
from taichi_sim.base.parsing import RepeatedNameError, parse_json

Design = TypeVar("Design")
ASIDE = ".aside-"  # names of unfinished files begin so; a kill may leave them, and any later run may remove them
LARGEST_UNPACKED = 2_000_000_000  # bytes of arrays, however small they were packed
UNREADABLE = (  # what NumPy raises for a damaged file of arrays; its headers are read as Python's literals
    *(OSError, ValueError, KeyError, EOFError, SyntaxError, NotImplementedError, RecursionError),
    *(zipfile.BadZipFile, zlib.error, tokenize.TokenError, RuntimeError, TypeError),
)
MOST_PACKED = 1100  # bytes that a byte of a zip archive can stand for, a little above what deflation can do
_DIGEST_LENGTH = 64  # characters of a SHA-256 in hexadecimal
_LONGEST_KEPT, _END_KEPT = 80, 50  # bytes of a name behind others, and of the end of one that is longer


@contextlib.contextmanager
def replacing(path: Path, if_changed: bool = False) -> Iterator[Path]:
    """Give a temporary path to write to; the new file replaces ``path`` once it is safely on disk.

    Args:
        path: to write or replace; of a link it is the file to which it leads.
        if_changed: leave ``path`` untouched if its content is already the same.

    Raises:
        OSError: if the disk refuses, or ``path`` is a pipe or device; it is then as it was.
    """
    path = place_to_write(path)
    aside = _aside(path)
    try:
        yield aside
        if not (if_changed and path.is_file() and path.read_bytes() == aside.read_bytes()):
            _sync(aside)
            os.replace(aside, path)
            _sync(path.parent)
    finally:
        with contextlib.suppress(OSError):  # a full disk must not be filled further
            aside.unlink(missing_ok=True)


def keep_as(path: Path, copy: Path) -> None:
    """Let ``copy`` be what the file ``path`` is, which stays: a second name for it, or a copy where disks allow none.

    Only for files that are replaced and never changed in place.

    Raises:
        OSError: if the disk refuses; ``copy`` is then as it was.
    """
    aside = _aside(copy)
    try:
        aside.unlink(missing_ok=True)  # of a killed process that had this one's number: a second name of the file
        try:
            os.link(path, aside)
        except OSError:
            shutil.copyfile(path, aside)
            _sync(aside)
        os.replace(aside, copy)  # if both are names of one file already, nothing changes and the aside stays
    finally:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Give an empty folder to fill; once all is in it, it becomes ``path``, which must not exist.

    A kill leaves all of the folder or none of it. What it leaves aside, the next new folder beside it removes.

    Raises:
        OSError: if the disk refuses.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f"{ASIDE}*-{_machine()}-*"):
        _remove_if_cut_off(left)
    aside = _aside(path)
    shutil.rmtree(aside, ignore_errors=True)  # of a killed process that had this one's number
    aside.mkdir()
    try:
        yield aside
        _sync(aside)
        os.rename(aside, path)
        _sync(path.parent)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def remove_cut_off(folder: Path) -> None:
    """Remove unfinished files below a folder whose processes were of this machine and have ended, if the disk lets."""
    with contextlib.suppress(OSError):
        for aside in folder.rglob(f"{ASIDE}*-{_machine()}-*"):
            _remove_if_cut_off(aside)


def _aside(path: Path) -> Path:
    """Where this thread writes what will be at a path."""
    return path.with_name(f"{ASIDE}{os.getpid()}-{_machine()}-{threading.get_native_id()}-{short_name(path)}")


def short_name(path: Path) -> str:
    """Name of a file, or of one that is long a digest and its end: what is put before it must not make it too long."""
    name = os.fsencode(path.name)
    if len(name) <= _LONGEST_KEPT:
        return path.name
    return f"{sha256(name)[:16]}-{name[-_END_KEPT:].decode(errors='ignore')}"  # the suffix tells some writers the form


def _remove_if_cut_off(aside: Path) -> None:
    """Remove an unfinished file or folder of this machine if its process has ended, if the disk lets."""
    writer = aside.name.removeprefix(ASIDE).partition("-")[0]
    if writer.isdecimal() and not _runs(int(writer)):
        with contextlib.suppress(OSError):
            shutil.rmtree(aside) if aside.is_dir() and not aside.is_symlink() else aside.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file in one step.

    Raises:
        ValueError: if the path cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    with told_as(f"{path}: cannot be written"), replacing(Path(path)) as aside:
        aside.write_bytes(content)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text in UTF-8, with the errors of :func:`write_bytes`."""
    write_bytes(path, text.encode())


def found_beside(folder: Path, file: str) -> str:
    """The path of a file that is in the working directory, or else in a folder; as it is given if it is in neither."""
    beside = folder / file
    with contextlib.suppress(OSError):  # of a name that is too long
        if not Path(file).exists() and beside.is_file():
            return str(beside)
    return file


def copy_in(folder: Path, file: str) -> Path:
    """Where a folder keeps its copy of a file that may be anywhere, or gone, by the file's name."""
    return folder / f"copy-{sha256(file.encode())[:12]}{Path(file).suffix}"


def content_of(path: str | os.PathLike[str], largest: int = LARGEST) -> bytes:
    """Read a file whole; raises OSError if it cannot be read, or :func:`check_plain_file` refuses it."""
    check_plain_file(path, largest)
    return Path(path).read_bytes()


def read_bytes(path: str | os.PathLike[str], largest: int = LARGEST) -> bytes:
    """Read a file whole, as :func:`content_of` does.

    Raises:
        ValueError: if it cannot be read or is larger.
    """
    try:
        return content_of(path, largest)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a text in UTF-8, without the mark of byte order that some editors and spreadsheets put before it.

    Raises:
        ValueError: if the file cannot be read or is no text.
    """
    try:
        return content_of(path).decode("utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: is not a text file") from None


def why_unread(error: Exception) -> str:
    """Reason why a file could not be read or understood, without its name."""
    return (error.strerror if isinstance(error, OSError) else None) or said_by(error)


def write_record(path: str | os.PathLike[str], form: str, record: Mapping[str, Any]) -> None:
    """Write a record as JSON, with the name of its format first."""
    write_text(path, json.dumps({"format": form, **record}, indent=2) + "\n")


def read_record(path: str | os.PathLike[str], form: str, build: Callable[[dict[str, Any]], Design]) -> Design:
    """Read a record that :func:`write_record` wrote, and return what ``build`` makes of it.

    Raises:
        ValueError: if the file is unreadable, of another format, or refused by ``build``; names the file.
    """

    def formed(record: Any) -> Design:
        if not isinstance(record, dict) or record.get("format") != form:
            raise ValueError(f"it is not of the format {form!r}")
        return build(record)

    return read_json(path, formed, f" of the format {form!r}")


def read_json(path: str | os.PathLike[str], build: Callable[[Any], Design], what: str = "") -> Design:
    """Read a file of JSON, and return what ``build`` makes of it; ``what`` it should hold is told where it is none.

    Raises:
        ValueError: if the file is unreadable, no JSON, or refused by ``build``; names the file.
    """
    text = read_text(path)
    try:
        record = parse_json(text)
    except RepeatedNameError as error:
        raise ValueError(f"{path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: it is no JSON{what} ({error})") from None
    try:
        return build(record)
    except KeyError as missing:
        raise ValueError(f"{path}: {missing} is missing") from None
    except (ValueError, TypeError, OverflowError) as problem:
        raise ValueError(f"{path}: {problem}") from None


def sha256(content: bytes) -> str:
    """SHA-256 checksum in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def pack(arrays: Arrays | Mapping[str, Any]) -> bytes:
    """Pack arrays as the content of an .npz file, whose comment is the SHA-256 of all bytes before the comment."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    # A zip archive ends with the length of its comment (two bytes, zero so far) and the comment.
    content = buffer.getvalue()[:-2] + _DIGEST_LENGTH.to_bytes(2, "little")
    return content + sha256(content).encode()


def unpack(content: bytes) -> Arrays:
    """Unpack the arrays that :func:`pack` packed.

    Raises:
        ValueError: if a single bit differs, or there are no arrays under the checksum.
    """
    if sha256(content[:-_DIGEST_LENGTH]).encode() != content[-_DIGEST_LENGTH:]:
        raise ValueError("the checksum does not match")
    try:
        return arrays_of(content)
    except UNREADABLE as error:
        raise ValueError(f"it holds no arrays ({why_unread(error)})") from None


def unzipped(content: bytes, largest: int = LARGEST) -> bytes:
    """Decompress the content of a gzip file.

    Raises:
        OSError, EOFError, zlib.error: if it is damaged, or would take more than ``largest`` bytes.
    """
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as file:
        found = file.read(largest + 1)
    if len(found) > largest:
        raise OSError(errno.EFBIG, f"more than {largest} bytes when decompressed are not allowed")
    return found


def arrays_of(content: bytes) -> Arrays:
    """Unpack arrays from the content of a file that NumPy wrote (``.npz``), but no pickles.

    Raises:
        UNREADABLE: one of these if it is damaged, or would take more than ``LARGEST_UNPACKED`` bytes.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(each.file_size for each in archive.infolist())
        if size > LARGEST_UNPACKED:
            raise ValueError(f"{size} bytes of arrays are not allowed, at most {LARGEST_UNPACKED} are")
        for each in archive.infolist():
            name, fits = each.filename.removesuffix(".npy"), each.file_size <= MOST_PACKED * each.compress_size
            if name == each.filename or not fits or each.compress_size > len(content):
                raise ValueError(f"{name} is no array, or has not the {each.file_size} bytes that it tells")
            with archive.open(each) as file:
                _check_header(file, name, each.file_size)
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return dict(arrays)


def array_of(content: bytes) -> NDArray[Any]:
    """Unpack an array from the content of a file that NumPy wrote (``.npy``), but no pickle.

    Raises:
        UNREADABLE: one of these if it is damaged.
    """
    _check_header(io.BytesIO(content), "array", len(content))
    return np.load(io.BytesIO(content), allow_pickle=False)


def _check_header(file: IO[bytes], name: str, size: int) -> None:
    """Refuse an array that is not as large as its header tells, before any memory is taken for it."""
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    except MemoryError:  # what Python says of literals that are too deep
        raise ValueError(f"{name}: its header cannot be read") from None
    if dtype.hasobject or not dtype.itemsize:
        raise ValueError(f"{name}: {dtype} is not allowed, give numbers")
    told, found = math.prod(shape) * dtype.itemsize, size - file.tell()
    if min(shape, default=0) < 0 or told != found:
        raise ValueError(f"{name}: its header tells of shape {shown(shape)}, {shown(told)} bytes; it has {found}")


def make_folder(path: Path) -> None:
    """Make a folder and those above it, if they do not exist.

    Raises:
        ValueError: if a folder cannot be made.
        RuntimeError: if the disk is full or broken.
    """
    with told_as(f"out: {path} cannot be made", begun=False):
        path.mkdir(parents=True, exist_ok=True)


def check_parent(field: str, path: Path) -> None:
    """Refuse a file in a folder that does not exist or takes no files, before any work is done for it.

    Raises:
        ValueError: if there is no such folder.
    """
    if not path.parent.is_dir():
        raise ValueError(f"{field}: {path} cannot be written; there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise ValueError(f"{field}: {path} cannot be written; the folder {path.parent} takes no files")
    size, longest = len(os.fsencode(path.name)), os.pathconf(path.parent, "PC_NAME_MAX")
    if 0 <= longest < size:  # -1 is no limit
        raise ValueError(f"{field}: a name of {size} bytes is too long for a file; give at most {longest}")


def new_path(path: str | os.PathLike[str]) -> Path:
    """Check that nothing exists at a path yet, and return it.

    Raises:
        ValueError: if something exists there, or there is no such folder.
    """
    if Path(path).exists():
        raise ValueError(f"path: {path} exists; name a new file")
    check_parent("path", Path(path))
    return Path(path)


def _machine() -> str:
    """A short name of this machine, other than that of others which share its files."""
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _runs(process: int) -> bool:
    """Whether a process of this number runs on this machine."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True  # of another user, or no number of a process
    return True


def _sync(path: Path) -> None:
    """Wait until a file is on disk, or a folder with the names in it, if it may be read."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:
        if path.is_dir():  # one may write in it, but not list it: the new name is there, and gets to the disk later
            return
        raise
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
