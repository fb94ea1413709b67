"""The lock of a run folder, or of a folder that workers share: one process at a time works there."""

import contextlib
import fcntl
import time
from collections.abc import Iterator
from pathlib import Path

from taichi_sim.base.locks import HeldLock, opened_to_lock

LOCK = ".lock"
LOCK_PATIENCE = 0.5  # s; a command that only reads a run may hold its lock for a moment


@contextlib.contextmanager
def locked(path: Path, field: str = "out") -> Iterator[HeldLock]:
    """Lock a folder against other processes; check the yielded lock before each write.

    Args:
        path: the folder.
        field: name of the setting that gave the folder, for messages.

    Raises:
        ValueError: if another process has locked it, the folder is moved or replaced meanwhile, or the lock file is a
            pipe.
    """
    with opened_to_lock(field, path / LOCK, "a") as file:
        deadline = time.monotonic() + LOCK_PATIENCE
        while True:
            try:
                lock = HeldLock(path / LOCK, file)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise ValueError(f"{field}: {path} is in use by another process") from None
                time.sleep(0.02)
        if not lock.found_at_path:
            raise ValueError(f"{field}: {path} was moved or replaced just now; try again")
        yield lock


def in_use(path: Path) -> bool:
    """Whether a process has locked the folder because its run is going on.

    Raises:
        ValueError: if the lock file is a pipe.
    """
    try:
        with opened_to_lock("run", path / LOCK, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
