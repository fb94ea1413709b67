"""Lock files: a process holds one as long as it lives, and can tell whether its path still leads to it."""

import errno
import fcntl
import os
from pathlib import Path
from typing import IO, Any

GONE = (errno.ENOENT, errno.ENOTDIR, errno.ESTALE)  # the last: deleted by another machine of a network file system


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
