"""What a run is on disk.

=========================== ======================================================================
``config.toml``             every setting: the problem, the method, the number of generations
``environment.json``        versions, machine, command line
``log.jsonl``               one line a generation; the same bytes for the same settings
``timing.jsonl``            one line a generation: how long it took
``checkpoint.npz``          state of the method after the last line of the log, with checksum
``checkpoint.previous.npz`` the one before
``best.json``               the best design so far
=========================== ======================================================================

Files are written aside, flushed to disk and renamed, so a kill at any moment leaves each of them whole. Only
the logs grow in place; they are cut back to what the checkpoint knows when a run continues.
"""

import fcntl
import json
import os
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from optim.runs import files

State = dict[str, NDArray[Any]]

CONFIG = "config.toml"
SECTIONS = {"problem": dict, "method": dict, "generations": int}
_LINES, _LAST_LINE = "run/lines", "run/last_line"  # entries of a checkpoint beside the method's own


class RunFolder:
    """A run folder that this process has locked; made by :func:`open_run`.

    Attributes:
        path: the folder.
        config: content of ``config.toml``.
    """

    def __init__(self, path: Path, config: dict[str, Any], note: Callable[[str], None]) -> None:
        """Take over a folder that is locked and has its configuration."""
        self.path, self.config, self._note = path, config, note
        self._log, self._timing = path / "log.jsonl", path / "timing.jsonl"
        self._checkpoint, self._previous = path / "checkpoint.npz", path / "checkpoint.previous.npz"
        self._lines = 0

    def restore(self) -> tuple[State, str] | None:
        """Go back to the last checkpoint: the method's state and the last line of the log; None without any.

        Raises:
            ValueError: in one line, if there are checkpoints but none is whole, or the log has lost lines.
        """
        state = self._load()
        if state is not None:
            self._lines = int(state.pop(_LINES))
        known = len(files.complete_lines(self._log))
        if state is None and known > 1:  # one may have come just before the first checkpoint
            raise ValueError(
                f"{self.path}: log.jsonl has {known} lines, but no checkpoint is left; cannot resume"
            )
        if known < self._lines:
            raise ValueError(f"{self.path}: log.jsonl has {known} lines of {self._lines}; cannot resume")
        files.keep_lines(self._log, self._lines)
        files.keep_lines(self._timing, self._lines)
        return None if state is None else (state, state.pop(_LAST_LINE).tobytes().decode())

    def _load(self) -> State | None:
        """The last whole checkpoint; None if there has not been any."""
        reasons: dict[str, str] = {}
        for path in (self._checkpoint, self._previous):
            try:
                state = files.unpack(path.read_bytes())
            except FileNotFoundError:
                reasons[path.name] = "missing"
            except (OSError, ValueError) as error:
                reasons[path.name] = str(error)
            else:
                if reasons:
                    reason = reasons[self._checkpoint.name]
                    self._note(
                        f"note: {self.path}: checkpoint.npz is unusable ({reason}), taking the one before"
                    )
                    # Else the next checkpoint would push out the only one that is whole.
                    os.replace(self._previous, self._checkpoint)
                return state
        if set(reasons.values()) == {"missing"}:
            return None
        found = " and ".join(f"{name} ({reason})" for name, reason in reasons.items())
        raise ValueError(f"{self.path}: {found} are unusable; cannot resume")

    def commit(self, line: str, state: State, seconds: float) -> None:
        """End a generation: its log line, its wall time [s], then the checkpoint that knows them."""
        self._lines += 1
        files.append_line(self._log, line)
        finished = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        timing = {"generation": self._lines - 1, "seconds": round(seconds, 3), "finished": finished}
        files.append_line(self._timing, json.dumps(timing))
        own = {_LINES: np.array(self._lines), _LAST_LINE: np.frombuffer(line.encode(), np.uint8)}
        with files.replacing(self._checkpoint) as aside:
            aside.write_bytes(files.pack({**state, **own}))
            if self._checkpoint.exists():
                os.replace(self._checkpoint, self._previous)

    def replacing(self, name: str) -> AbstractContextManager[Path]:
        """A path to write a file to; it becomes the file ``name`` of the folder once it is whole."""
        return files.replacing(self.path / name)


def _to_stderr(text: str) -> None:
    print(text, file=sys.stderr)


@contextmanager
def open_run(
    path: Path | str,
    config: Mapping[str, Any],
    *,
    resume: bool = False,
    environment: Mapping[str, Any] | None = None,
    note: Callable[[str], None] = _to_stderr,
) -> Iterator[RunFolder]:
    """Start a run in a new folder, or continue one, and keep other processes off meanwhile.

    Args:
        path: the folder; it must not exist, or be empty, unless ``resume``.
        config: settings; see ``SECTIONS`` for the entries needed. Fits TOML.
        resume: continue the run in the folder: ``config`` may leave out what the folder knows, but not change
            it, except that ``generations`` may be raised. Without a run in the folder, start one.
        environment: kept in ``environment.json`` when a run starts.
        note: called with a line about anything the user should know.

    Raises:
        ValueError: in one line, if the folder is taken, in use, unreadable, or of other settings.
    """
    path = Path(path)
    if not (resume and has_run(path)):
        _check_free(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"out: {path} cannot be created ({error.strerror})") from None
    with _locked(path):
        if resume and has_run(path):
            known = read_config(path)
            _check_same(known, config, path)
            resolved = known | {"generations": config.get("generations", known["generations"])}
        else:
            _check_free(path)
            known, resolved = {}, {name: config[name] for name in SECTIONS}
            with files.replacing(path / "environment.json") as aside:
                aside.write_text(json.dumps(environment or {}, indent=2) + "\n")
        if resolved != known:
            with files.replacing(path / CONFIG) as aside:
                aside.write_text(tomli_w.dumps(resolved))
        yield RunFolder(path, resolved, note)


def has_run(path: Path) -> bool:
    """Whether a run has been started in a folder."""
    return (path / CONFIG).exists()


def read_config(path: Path) -> dict[str, Any]:
    """The settings of the run in a folder.

    Raises:
        ValueError: in one line, if they cannot be read.
    """
    try:
        config = tomllib.loads((path / CONFIG).read_text())
    except (OSError, ValueError) as error:
        raise ValueError(f"{path / CONFIG}: cannot be read ({error})") from None
    for name, kind in SECTIONS.items():
        if not isinstance(config.get(name), kind):
            raise ValueError(f"{path / CONFIG}: {name} is missing or no {kind.__name__}")
    return config


def _check_free(path: Path) -> None:
    """A run may start where nothing is, or where one was killed before it had its configuration."""
    if path.exists() and not path.is_dir():
        raise ValueError(f"out: {path} is a file; name a new folder")
    if has_run(path):
        raise ValueError(f"out: {path} holds a run already; continue it with --resume or name another folder")
    if path.exists() and any(
        not e.name.startswith(".") and e.name != "environment.json" for e in path.iterdir()
    ):
        raise ValueError(f"out: {path} holds other files and no run; name a new folder")


def _check_same(known: Mapping[str, Any], asked: Mapping[str, Any], path: Path, prefix: str = "") -> None:
    for name, value in asked.items():
        old = known.get(name)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            _check_same(old, value, path, f"{prefix}{name}.")
        elif prefix + name == "generations" and value < known[name]:
            raise ValueError(
                f"generations: {value} is below the {old} of the run in {path}; it may only be raised"
            )
        elif prefix + name != "generations" and value != old:
            raise ValueError(
                f"{prefix}{name}: {value!r} is not what the run in {path} has, {old!r}; leave it out"
            )


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    with (path / ".lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f"out: {path} is in use by another process") from None
        yield
