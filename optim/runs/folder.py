"""Run folders: the files of a run, written so that it survives a kill.

=========================== ======================================================================
``config.toml``             every setting: the problem, the method, the number of generations; sealed
``environment.json``        versions, machine, command line
``log.jsonl``               one line a generation; the same bytes for the same settings
``timing.jsonl``            one line a generation: how long it took
``checkpoint.npz``          state of the method after the last line of the log, with checksums
``checkpoint.previous.npz`` the one before
``best.json``               the best design so far
``front.json``              of methods that keep many: the designs of the front, or the elites
``copy-*``                  of the files of heights of its ground, which may then be gone
``calibration.json``        of the robot of a rig: its properties
``products.json``           which files were made of the best design, with checksums
``failed-*.json``           designs that killed the processes that evaluated them
=========================== ======================================================================

Files are written aside, flushed to disk and renamed, so a kill at any moment leaves each of them whole. Only
the logs grow in place; they are cut back to what the checkpoint knows when a run continues.
"""

import contextlib
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from optim.notes import note as print_note
from optim.runs import checkpoint
from optim.runs.checkpoint import CHECKPOINT, LOG, PREVIOUS, Record, State
from optim.runs.compatibility import check_resumable
from optim.runs.config import (
    GROUND_FILES,
    OBJECTIVES,
    SECTIONS,
    check_same,
    has_run,
    identity,
    read_config,
    write_config,
)
from optim.runs.environment import differences
from optim.runs.folder_lock import locked
from taichi_sim.base import files, line_files
from taichi_sim.base.disk_faults import unwritten
from taichi_sim.base.file_kinds import check_plain_file
from taichi_sim.base.locks import HeldLock
from taichi_sim.base.parsing import parse_json

ENVIRONMENT, TIMING = "environment.json", "timing.jsonl"


class RunFolder:
    """A run folder that this process has locked; made by :func:`open_run`.

    Attributes:
        path: the folder.
        config: content of ``config.toml``.
        lines: number of complete generations.
    """

    def __init__(
        self,
        path: Path,
        config: dict[str, Any],
        environment: Mapping[str, Any],
        note: Callable[[str], None],
        lock: HeldLock,
    ) -> None:
        """Take over a folder that is locked and has its configuration."""
        self.path, self.config, self._note, self._lock = path, config, note, lock
        self._environment = environment
        self._settings = identity(config)
        self.lines = 0
        self._log, self._timing = hashlib.sha256(), hashlib.sha256()

    def restore(self) -> tuple[State, str] | None:
        """Go back to the last checkpoint; return the method's state and the last line of the log, or None without any.

        Raises:
            ValueError: if there are checkpoints, but none is whole and fits the rest of the folder.
            RuntimeError: if the folder was moved or replaced.
        """
        self.check()
        found = checkpoint.load(self.path, self._settings)
        if found is None:
            self._cut(0)
            return None
        state, record, others = found
        if others:
            self._note(f"{self.path}: {CHECKPOINT} is unusable ({others[CHECKPOINT]}), taking the one before")
            # Else the next checkpoint would push out the only one that is whole.
            (self.path / PREVIOUS).replace(self.path / CHECKPOINT)
        last = self._cut(record.lines)
        self._check_timing(record)
        self._check_environment(record)
        return state, last.decode()

    def _cut(self, lines: int) -> bytes:
        """Cut the logs back to the lines that the checkpoint covers; return the last line of the log."""
        self.lines = lines
        for name in (LOG, TIMING):
            line_files.keep_lines(self.path / name, lines)
        timing, log = (checkpoint.summed(self.path / name) for name in (TIMING, LOG))
        self._timing, self._log = timing.hasher, log.hasher
        return log.last

    def check(self) -> None:
        """Refuse to go on in a folder that may by now be another run's.

        Raises:
            RuntimeError: if the folder was moved or replaced since it was locked.
        """
        self._lock.check(f"its {self.lines} complete generations are kept where it is now, go on there with --resume")

    def _check_timing(self, record: Record) -> None:
        """Begin the file of times anew if it is damaged: results do not depend on it."""
        if self._timing.hexdigest() != record.timing:
            self._note(f"{self.path}: {TIMING} is not as it was written, beginning it anew")
            (self.path / TIMING).unlink(missing_ok=True)
            self._timing = hashlib.sha256()

    def _check_environment(self, record: Record) -> None:
        """Note differences between this machine and the one on which the run began."""
        path = self.path / ENVIRONMENT
        content = path.read_bytes() if path.is_file() else b""
        if files.sha256(content) != record.environment:
            self._note(f"{self.path}: {ENVIRONMENT} is not as it was written, telling what runs now instead")
            _write_json(path, {**self._environment, "written_anew": True})
            return
        changed = differences(parse_json(content), self._environment)
        if changed:
            self._note(f"{self.path}: began elsewhere ({', '.join(changed)}); results may differ")

    def commit(self, line: str, state: State, seconds: float) -> None:
        """End a generation: write its log line, its wall time [s], then a checkpoint that covers both.

        Raises:
            RuntimeError: if the disk is full or broken, or the folder was moved or replaced; what was there is kept.
        """
        finished = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        timing = {"generation": self.lines, "seconds": round(seconds, 3), "finished": finished}
        with self.writing():
            for name, hasher, text in ((LOG, self._log, line), (TIMING, self._timing, json.dumps(timing))):
                line_files.append_line(self.path / name, text)
                hasher.update(text.encode() + b"\n")
            environment = files.sha256(files.content_of(self.path / ENVIRONMENT))
            digests = self._log.hexdigest(), self._timing.hexdigest(), environment, self._settings
            checkpoint.save(self.path, state, Record(self.lines + 1, *digests))
        self.lines += 1

    def update(self, name: str, write: Callable[[Path], object]) -> None:
        """Write the file ``name`` of the folder by calling ``write``; the file changes only if its content does.

        Raises:
            RuntimeError: if the disk is full or broken, or the folder was moved or replaced.
        """
        with self.writing(), files.replacing(self.path / name, if_changed=True) as aside:
            write(aside)

    def update_text(self, name: str, text: str) -> None:
        """Write a text to the file ``name``; the file changes only if the text does."""
        self.update(name, partial(Path.write_text, data=text, encoding="utf-8"))

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Let a file of the folder be written if the folder is still this run's; errors of the disk tell what is kept.

        Raises:
            RuntimeError: instead of errors of the disk, and if the folder was moved or replaced.
        """
        try:
            self.check()
        except OSError as error:  # of a disk that is gone
            raise self._unwritable(error) from None
        try:
            yield
        except (OSError, ValueError, RuntimeError) as error:  # all that can be wrong with a design's file is the disk
            raise self._unwritable(error) from None

    def _unwritable(self, error: Exception) -> RuntimeError:
        """The error that tells why the folder cannot be written, and what is kept."""
        reason = error.strerror if isinstance(error, OSError) else str(error)
        kept = f"its {self.lines} complete generations are kept, go on with --resume"
        return RuntimeError(f"{_place_of(error, self.path)}: cannot be written ({reason}); {kept}")


@contextlib.contextmanager
def open_run(
    path: Path | str,
    config: Mapping[str, Any],
    *,
    resume: bool = False,
    environment: Mapping[str, Any] | None = None,
    note: Callable[[str], None] = print_note,
) -> Iterator[RunFolder]:
    """Start a run in a new folder, or continue one, and lock the folder meanwhile.

    Args:
        path: the folder; unless ``resume``, it must not exist, be empty, or hold no generation yet.
        config: settings; see ``SECTIONS`` for the entries needed. Fits TOML.
        resume: continue the run in the folder: ``config`` may leave out what the folder knows, but not change
            it, except that ``generations`` may be raised. Without a run in the folder, start one.
        environment: kept in ``environment.json`` when a run starts.
        note: called with a line about anything the user should know.

    Raises:
        ValueError: if the folder is taken, in use, unreadable, not writable, or of other settings.
        RuntimeError: if the disk is full or broken.
    """
    path = Path(path)
    if path.is_symlink() and not path.exists():
        raise ValueError(f"out: {path} is a link to {os.readlink(path)}, which is not there; make that folder first")
    if not (resume and has_run(path)):
        check_free(path)
    with contextlib.ExitStack() as stack:
        try:
            path.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(locked(path))
            for aside in path.glob(f"{files.ASIDE}*"):  # of writes that were cut off; folders are not the run's
                if not aside.is_dir():
                    aside.unlink()
            files.remove_cut_off(path)
            _check_plain(path)
            resolved = _settle(path, config, resume, environment or {})
        except OSError as error:
            raise unwritten(f"out: {_place_of(error, path)} cannot be written", error, begun=False) from None
        yield RunFolder(path, resolved, environment or {}, note, lock)


def _place_of(error: Exception, folder: Path) -> Path:
    """The file of a folder that an error is about, also if it could not be replaced; the folder itself for others."""
    name = getattr(error, "filename2", None) or getattr(error, "filename", None) or ""
    place = Path(os.fsdecode(name))
    return folder if place.parent != folder or place.name.startswith(files.ASIDE) else place


def _check_plain(path: Path) -> None:
    """Refuse a run of whose files one that is read without further ado is a pipe, a device or a folder.

    Raises:
        ValueError: names the file.
    """
    for name in (ENVIRONMENT, LOG, TIMING):
        try:
            check_plain_file(path / name, None)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise ValueError(f"{path / name}: cannot be read ({error.strerror})") from None


def _settle(path: Path, config: Mapping[str, Any], resume: bool, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Write the settings of a run that begins, or check and update those of one that continues; return them."""
    if resume and has_run(path):
        known = read_config(path)
        check_resumable(known, _version_of(path))
        check_same(known, config, path)
        resolved = known | {"generations": config.get("generations", known["generations"])}
    else:
        check_free(path)
        told = (*SECTIONS, *(name for name in (OBJECTIVES, GROUND_FILES) if name in config))
        known, resolved = {}, {name: config[name] for name in told}
        _write_json(path / ENVIRONMENT, environment)
    if resolved != known:
        write_config(path, resolved)
    return resolved


def _version_of(path: Path) -> str | None:
    """Version of morpholab that began the run, as its environment tells; None if that cannot be read."""
    try:
        version = parse_json(files.content_of(path / ENVIRONMENT))["versions"]["morpholab"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return version if isinstance(version, str) else None


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    with files.replacing(path) as aside:
        aside.write_text(json.dumps(document, indent=2) + "\n")


def check_free(path: Path) -> None:
    """Raise ValueError unless a run may start here: in a new or empty folder, or where no generation was complete."""
    if path.exists() and not path.is_dir():
        raise ValueError(f"out: {path} is a file; name a new folder")
    if has_run(path):
        if not any((path / name).exists() for name in (LOG, CHECKPOINT, PREVIOUS)):
            return
        raise ValueError(f"out: {path} holds a run already; continue it with --resume or name another folder")
    if path.exists() and any(not e.name.startswith(".") and e.name != ENVIRONMENT for e in path.iterdir()):
        raise ValueError(f"out: {path} holds other files and no run; name a new folder")
