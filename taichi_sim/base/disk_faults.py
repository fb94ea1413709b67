"""Tells whether a failed write is the fault of a path, which the user gave, or of the disk."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from taichi_sim.base.foreign import said_by

# Of a path that cannot be what was asked. All others, such as of a full or broken disk, are failures.
_OF_PATHS = (
    *(errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENOTEMPTY, errno.ENAMETOOLONG, errno.ELOOP),
    *(errno.EACCES, errno.EPERM, errno.EINVAL, errno.EXDEV, errno.EBUSY, errno.ENXIO, errno.ENODEV),
    *(errno.EOPNOTSUPP, errno.ENOSYS),  # of locks, on file systems that have none
)


def unwritten(what: str, error: OSError, begun: bool = True) -> ValueError | RuntimeError:
    """The error to raise in place of one of the system: bad input if the path is at fault, else work that failed.

    Args:
        what: what could not be done, such as ``"out: a/b cannot be written"``.
        error: why.
        begun: whether work has begun; a disk that is read-only is a wrong path before, and a broken disk then.
    """
    of_path = error.errno in _OF_PATHS or (error.errno == errno.EROFS and not begun)
    return (ValueError if of_path else RuntimeError)(f"{what} ({error.strerror or said_by(error)})")


@contextmanager
def told_as(what: str, begun: bool = True) -> Iterator[None]:
    """Raise errors of the system as those of :func:`unwritten`, which say what could not be done."""
    try:
        yield
    except OSError as error:
        raise unwritten(what, error, begun) from None
