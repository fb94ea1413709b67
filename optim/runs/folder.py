"""Run folders: the files of a run, written so that the run survives a kill.

=========================== ======================================================================
``config.toml``             every setting: the problem, the method, the number of generations; sealed
``environment.json``        versions, machine, command line
``log.jsonl``               one line per generation; the same bytes for the same settings
``timing.jsonl``            one line per generation: how long it took
``evaluations.jsonl``       if asked for, every design with its scores, a line per generation
``checkpoint.npz``          state of the method after the last line of the log, with checksums
``checkpoint.previous.npz`` the checkpoint before
``best.json``               the best design so far
``front.json``              designs of the front, or the elites, of methods that keep several
``copy-*``                  copies of the files of heights of the ground; the originals may then be removed
``calibration.json``        properties of the robot of a rig
``products.json``           checksums of the files that were made from the best design
``failed-*.json``           designs that killed the processes that evaluated them
=========================== ======================================================================

Files are written under a temporary name, flushed to disk and renamed, so a kill at any moment leaves each of them
whole. Only the logs grow in place; when a run continues, they are cut back to the lines that the checkpoint covers.
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
from optim.runs.evaluations import EVALUATIONS
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
        """Use a folder that is already locked and has its ``config.toml``."""
        self.path, self.config, self._note, self._lock = path, config, note, lock
        self._environment = environment
        self._settings = identity(config)
        self.lines = 0
        self._log, self._timing = hashlib.sha256(), hashlib.sha256()

    def restore(self) -> tuple[State, str] | None:
        """Go back to the last checkpoint: return the method's state and the log's last line; None without a checkpoint.

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
            # Otherwise the next checkpoint would replace the only undamaged one.
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
        """Check that the folder is still the one that was locked.

        Raises:
            RuntimeError: if the folder was moved or replaced since it was locked.
        """
        self._lock.check(f"its {self.lines} complete generations are kept where it is now, go on there with --resume")

    def _check_timing(self, record: Record) -> None:
        """Start a new file of times if it is damaged; results do not depend on it."""
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
        """Context in which files of the folder are written, after a check that the folder is still this run's.

        Raises:
            RuntimeError: instead of errors of the disk, with what is kept; or if the folder was moved or replaced.
        """
        try:
            self.check()
        except OSError as error:  # the disk is gone
            raise self._unwritable(error) from None
        try:
            yield
        except (OSError, ValueError, RuntimeError) as error:  # writing a design fails only because of the disk
            raise self._unwritable(error) from None

    def _unwritable(self, error: Exception) -> RuntimeError:
        """Make the error that says why the folder cannot be written and what is kept."""
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
    """Start a run in a new folder, or continue one; the folder is locked inside the context.

    Args:
        path: the folder; unless ``resume``, it must not exist, be empty, or hold no generation yet.
        config: settings that can be written as TOML; ``SECTIONS`` names the required entries.
        resume: continue the run in the folder. ``config`` may then leave out settings but not change them, except
            that ``generations`` may be larger. If the folder holds no run, one is started.
        environment: content of ``environment.json`` when a run starts.
        note: called with one line about anything that the user should know.

    Raises:
        ValueError: if the folder is taken, in use, unreadable, not writable, or has other settings.
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
            for aside in path.glob(f"{files.ASIDE}*"):  # left by interrupted writes; folders are not the run's
                if not aside.is_dir():
                    aside.unlink()
            files.remove_cut_off(path)
            _check_plain(path)
            resolved = _settle(path, config, resume, environment or {})
        except OSError as error:
            raise unwritten(f"out: {_place_of(error, path)} cannot be written", error, begun=False) from None
        yield RunFolder(path, resolved, environment or {}, note, lock)


def _place_of(error: Exception, folder: Path) -> Path:
    """File of a folder that an error is about, including one that could not be replaced; otherwise the folder."""
    name = getattr(error, "filename2", None) or getattr(error, "filename", None) or ""
    place = Path(os.fsdecode(name))
    return folder if place.parent != folder or place.name.startswith(files.ASIDE) else place


def _check_plain(path: Path) -> None:
    """Check that the environment and the logs of a run are plain files, not pipes, devices or folders.

    Raises:
        ValueError: for the first that is not; names the file.
    """
    for name in (ENVIRONMENT, LOG, TIMING, EVALUATIONS):
        try:
            check_plain_file(path / name, None)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise ValueError(f"{path / name}: cannot be read ({error.strerror})") from None


def _settle(path: Path, config: Mapping[str, Any], resume: bool, environment: Mapping[str, Any]) -> dict[str, Any]:
    """Write the settings of a new run, or check and update those of one that continues; return them."""
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
    """Version of morpholab that began the run, from ``environment.json``; None if that cannot be read."""
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
