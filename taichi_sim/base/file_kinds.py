"""What may be at a path that is read, written or locked: a plain file, and no pipe, device or folder."""

import errno
import os
import stat
from pathlib import Path

from taichi_sim.base.disk_faults import told_as

LARGEST = 200_000_000  # bytes of a file that is read at once
_PIPE = "a pipe or device"


def check_plain_file(path: str | os.PathLike[str], largest: int | None = LARGEST) -> None:
    """Refuse what cannot be read whole, before it is opened.

    Raises:
        OSError: if it does not exist, is no file but, say, a pipe, or has more than ``largest`` bytes.
    """
    found = os.stat(path)
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else _PIPE
        raise OSError(errno.EINVAL, f"it is {kind}, give a file")
    if largest is not None and found.st_size > largest:
        raise OSError(errno.EFBIG, f"{found.st_size} bytes are not allowed, give at most {largest}")


def is_pipe_or_device(path: str | os.PathLike[str]) -> bool:
    """Whether what is at a path, or where a link there leads, is neither a file nor a folder.

    Raises:
        OSError: if that cannot be told, as of a link that leads to itself.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def place_to_write(path: Path) -> Path:
    """Where a file is that takes the place of the one at a path: there, or where a link leads, which may be new.

    Raises:
        OSError: for a pipe or device, which a file must not take the place of.
    """
    if is_pipe_or_device(path):
        raise OSError(errno.EINVAL, f"{path.name} is {_PIPE}; name a file")
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def check_no_pipe(field: str, path: Path) -> None:
    """Refuse a pipe or device as a file to write, before any work is done for it.

    Raises:
        ValueError: if it is one, or a link that leads to itself.
        RuntimeError: if the disk is broken.
    """
    with told_as(f"{field}: {path} cannot be written", begun=False):
        wrong = is_pipe_or_device(path)
    if wrong:
        raise ValueError(f"{field}: {path} is {_PIPE}; name a file")
