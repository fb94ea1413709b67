"""Lock files: a process holds one as long as it lives, and can tell whether its path still leads to it."""

import errno
import fcntl
import os
from pathlib import Path
from typing import IO, Any

from taichi_sim.base.file_kinds import is_pipe_or_device

GONE = (errno.ENOENT, errno.ENOTDIR, errno.ESTALE)  # the last: deleted by another machine of a network file system


def opened_to_lock(field: str, path: Path, mode: str) -> IO[Any]:
    """Open a file that is there to be locked, in the mode ``"a"``, which makes it, or ``"rb"``.

    Raises:
        ValueError: for a pipe or device, on which to open may wait for ever; names it after ``field``.
        OSError: if it cannot be opened.
    """
    if is_pipe_or_device(path):
        raise ValueError(f"{field}: {path} is a pipe or device; remove it")
    return path.open(mode)


class HeldLock:
    """A lock on an open file, which other processes find by its path; the system frees it when the process ends.

    The lock is on the file, whatever becomes of its path: who moves the file's folder, or deletes the file, lets
    another process lock a new one at the same path.
    """

    def __init__(self, path: Path, file: IO[Any]) -> None:
        """Lock a file that has been opened at a path.

        Raises:
            BlockingIOError: if another process has locked it.
        """
        self.path, self._file = path, file
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    @property
    def found_at_path(self) -> bool:
        """Whether the path still leads to this file."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path))
        except OSError as error:
            if error.errno in GONE:
                return False
            raise

    def check(self, kept: str = "nothing more is written there") -> None:
        """Refuse to go on in a folder that may by now be another process's.

        Args:
            kept: what the message tells of the work that is done.

        Raises:
            RuntimeError: if the path no longer leads to this file.
        """
        if not self.found_at_path:
            folder, name = self.path.parent, self.path.name
            raise RuntimeError(f"{folder}: the folder was moved or replaced, or its {name} deleted, in use; {kept}")
