"""Reserves paths while their content is computed, and removes what is half done after a failure."""

import contextlib
import os
import shutil
from collections.abc import Collection, Iterator
from pathlib import Path

from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.files import ASIDE, check_parent, content_of, remove_cut_off, short_name
from taichi_sim.base.locks import HeldLock, opened_to_lock


@contextlib.contextmanager
def claimed_path(field: str, path: Path, kind: str = "file") -> Iterator[None]:
    """Reserve a new file or folder for this process while its content is computed.

    Args:
        field: named in messages.
        path: must not exist, in a folder that does.
        kind: ``"file"`` or ``"folder"``, for messages.

    Raises:
        ValueError: if the path exists, another process has reserved it, or the folder cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    check_parent(field, path)
    with _reserved(field, path, path.with_name(f"{ASIDE}claim-{short_name(path)}"), kind):
        if os.path.lexists(path):
            raise ValueError(f"{field}: {path} exists; name a new {kind}")
        yield


@contextlib.contextmanager
def claimed_folder(field: str, path: Path, names: Collection[str] = ()) -> Iterator[None]:
    """Make a new folder and reserve it for this process; it is removed again if nothing was put there.

    Args:
        field: named in messages.
        path: must not exist, or be empty, or hold what a killed process has reserved it for.
        names: files that this process will make there. If it is killed, the next that makes the same removes them.

    Raises:
        ValueError: if the folder holds anything, cannot be made, or another process has reserved it.
        RuntimeError: if the disk is full or broken.
    """
    above = next((each for each in (path, *path.parents) if os.path.lexists(each)), path)
    if os.path.lexists(above) and not above.is_dir():
        raise ValueError(f"{field}: {above} is a file; name a new folder")
    made = [each for each in (path, *path.parents) if not each.exists()]
    with told_as(f"{field}: {path} cannot be made", begun=False):
        path.mkdir(parents=True, exist_ok=True)
    try:
        claim = path / f"{ASIDE}claim"
        with _reserved(field, path, claim, "folder"):
            with told_as(f"{field}: {path} cannot be written", begun=False):
                # What a killed process that made the same files has left of them, as it had found the folder empty.
                known = names if content_of(claim).decode(errors="replace") == "\n".join(names) else ()
                left = [each for each in path.iterdir() if not each.name.startswith(ASIDE)]
                if any(each.name not in known for each in left):
                    raise ValueError(f"{field}: {path} exists and is not empty; name a new folder")
                for each in left:
                    each.unlink()
                remove_cut_off(path)
                claim.write_text("\n".join(names))
            yield
    finally:
        with contextlib.suppress(OSError):  # stops at the first that is not empty
            for each in made:
                each.rmdir()


@contextlib.contextmanager
def undone_if_it_fails() -> Iterator[list[Path]]:
    """Yields a list for files and folders that are being made; they are removed if what follows fails.

    Put in only what this process alone makes: nothing of others may be removed.
    """
    made: list[Path] = []
    try:
        yield made
    except BaseException:
        for path in made:
            with contextlib.suppress(OSError):  # as far as the disk lets
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def _reserved(field: str, path: Path, lock: Path, kind: str) -> Iterator[None]:
    """Hold a lock on a file; the system frees it when the process ends, however it ends."""
    with contextlib.ExitStack() as stack:
        with told_as(f"{field}: {path} cannot be written", begun=False):
            try:
                while True:
                    file = stack.enter_context(opened_to_lock(field, lock, "a"))
                    held = HeldLock(lock, file)
                    if held.found_at_path:
                        break  # else the holder before has just removed the file: make a new one
            except BlockingIOError:
                raise ValueError(f"{field}: {path} is being written already; name a new {kind}") from None
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                if held.found_at_path:  # else the folder was moved, and this is the claim of who has made a new one
                    lock.unlink()
