"""Disks and memory that fail at the n-th call: files opened, written, renamed, or large arrays made."""

import builtins
import errno
import io
import os
import sys
from pathlib import Path

import numpy as np


def full(path=None):
    """The error of a full disk; of calls that name a path, as the system tells it, with the path."""
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), *([] if path is None else [str(path)]))


class FailingFile(io.FileIO):
    """A file each write of which asks the disk first; from the one that fails on, it takes half of it, then nothing."""

    def __init__(self, path, mode, disk):
        super().__init__(path, mode)
        self.disk, self.full = disk, False

    def write(self, content):
        if not self.full and not self.disk.fails():
            return super().write(content)
        if not self.full:
            super().write(memoryview(content).cast("B")[: len(content) // 2])
        self.full = True
        raise full()


class Disk:
    """Calls by which Python changes the disk; the n-th fails as on a full disk, where it writes in the middle."""

    PATHS = ((os, "replace"), (os, "rename"), (os, "link"), (os, "mkdir"), (os, "truncate"))
    TOLD = ("No space left on device",)
    NAMES_PATHS = True  # its messages

    def __init__(self, monkeypatch):
        self.fails_at = self.count = 0
        for owner, name in self.PATHS:
            monkeypatch.setattr(owner, name, self._failing(getattr(owner, name)))
        monkeypatch.setattr(os, "fsync", self._failing(os.fsync))
        monkeypatch.setattr(os, "write", self._written(os.write))
        monkeypatch.setattr(os, "open", self._opened_by_system(os.open))
        for owner in (io, builtins):
            monkeypatch.setattr(owner, "open", self._opened(io.open))

    def begin(self, fails_at):
        """Count anew, and fail at that call; never for 0."""
        self.fails_at, self.count = fails_at, 0

    def fails(self):
        """Count a call; whether it is the one that fails."""
        self.count += 1
        return self.count == self.fails_at

    def _failing(self, function):
        def call(what, *given, **options):
            if self.fails():
                raise full(what if isinstance(what, str | os.PathLike) else None)
            return function(what, *given, **options)

        return call

    def _written(self, function):
        def call(descriptor, content):
            if self.fails():
                function(descriptor, content[: len(content) // 2])
                raise full()
            return function(descriptor, content)

        return call

    def _opened_by_system(self, function):
        def call(path, flags, *given, **options):
            if flags & os.O_CREAT and self.fails():
                raise full(path)
            return function(path, flags, *given, **options)

        return call

    def _opened(self, function):
        def call(file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, **options):
            if not isinstance(file, str | os.PathLike) or not set(mode) & set("wax+") or options.get("opener"):
                return function(file, mode, buffering, encoding, errors, newline, **options)
            if self.fails():
                raise full(file)
            raw = FailingFile(file, mode.translate({ord("b"): None, ord("t"): None}), self)
            if buffering == 0:
                return raw
            buffered = (io.BufferedRandom if "+" in mode else io.BufferedWriter)(raw)
            return buffered if "b" in mode else io.TextIOWrapper(buffered, encoding, errors, newline)

        return call


class Memory:
    """Calls by which NumPy makes arrays; the n-th large one fails as where memory ends.

    ``places`` has, of each large array since ``begin``, the innermost lines of the lab that asked for it.
    """

    MADE = ("array", "asarray", "empty", "zeros", "ones", "full", "arange", "concatenate", "stack", "repeat", "tile")
    TOLD = ("there is not enough memory for this",)
    NAMES_PATHS = False
    LARGE = 200  # bytes; the commands here are small
    LAB, LINES = ("taichi_sim", "robots", "optim"), 3

    def __init__(self, monkeypatch):
        self.begin(0)
        for name in self.MADE:
            monkeypatch.setattr(np, name, self._failing(getattr(np, name)))

    def begin(self, fails_at):
        """Count anew, and fail at that call; never for 0."""
        self.fails_at, self.count = fails_at, 0
        self.places = []

    def one_of_each_place(self):
        """Numbers of calls, the middle one of those that each place has made."""
        made = {}
        for n, place in enumerate(self.places, start=1):
            made.setdefault(place, []).append(n)
        return sorted(calls[len(calls) // 2] for calls in made.values())

    def _place(self):
        frame, lines = sys._getframe(2), []
        while frame is not None and len(lines) < self.LINES:
            if frame.f_globals.get("__name__", "").partition(".")[0] in self.LAB:
                lines.append((frame.f_code.co_filename, frame.f_lineno))
            frame = frame.f_back
        return tuple(lines)

    def _failing(self, function):
        def call(*given, **options):
            made = function(*given, **options)
            # Where trimesh lacks memory for normals, it sums them in another order: other last bits, but no failure.
            caller = sys._getframe(1).f_globals.get("__name__", "")
            if getattr(made, "nbytes", 0) >= self.LARGE and not caller.startswith("trimesh"):
                self.count += 1
                self.places.append(self._place())
                if self.count == self.fails_at:
                    raise MemoryError(f"Unable to allocate {made.nbytes} bytes")
            return made

        return call


def contents(folder: Path, but=()):
    """Content of the files below a folder by path, but for those of some names."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in but]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
