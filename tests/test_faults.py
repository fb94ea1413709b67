"""Disks and memory that fail: each command, with the n-th call that changes the disk, or the n-th large array,
failing, ends in one line; nothing is half.

What was there before is as it was, what is there after is whole or absent, and the same command then gives what it
gives where nothing fails.
"""

import errno
import io
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.kernels, pytest.mark.long]

BRIEF = "--time-step 0.5 --steps 60 --threads 1 --quiet"
RUN = "codesign --robot vehicle --climbers 2 --generations 2 --quiet --out"
# What prepares the folder, the command, and what gives its result after a failure, if that is another command.
COMMANDS = {
    "export": ("", "export inching --csv gait.csv", ""),
    "export a mould": ("", "export starfish.py --parts parts --mould draft=2,wall=3", ""),
    "view": ("", "view vehicle --out page.html --picture still.png --glb motion.glb --quiet", ""),
    "paraview": ("", "view vehicle --paraview frames --frames 20 --quiet", ""),
    "simulate": ("", "simulate --robot vehicle --out a", ""),
    "check gradients": ("", "gradient-check --robot vehicle --horizons 4 --directions 2 --quiet --out a", ""),
    "codesign": ("", f"{RUN} a", "codesign --resume --quiet --out a"),
    "report": (f"{RUN} a", "report a --out page.html --no-player --quiet", ""),
    "track": (f"{RUN} a", "track a --parquet runs.parquet", ""),
    "sweep": ("", f"sweep --designs 162,6553 --weights 5 {BRIEF} --out a", ""),
    "train": ("", f"train --designs 162 --methods nes --repetitions 2 --budget-evaluations 6 {BRIEF} --out a", ""),
    "measure": ("", "measure --robot vehicle --controllers 4 --success closest<=1 --quiet --out a", ""),
}
MOST = 30  # calls of a command that are tried
# What tells times, or checksums of such.
VOLATILE = ("timing.jsonl", "environment.json", ".lock", "checkpoint.npz", "checkpoint.previous.npz")


class HalfWritten(io.FileIO):
    """A file that takes half of what is written first, and then nothing, as on a full disk."""

    full = False

    def write(self, content):
        if not self.full:
            super().write(content[: len(content) // 2])
        self.full = True
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Disk:
    """Calls by which the lab changes the disk; the n-th fails as on a full disk, where it writes in the middle."""

    CALLS = (
        (os, "replace"),
        (os, "rename"),
        (os, "link"),
        (os, "fsync"),
        (os, "truncate"),
        (os, "mkdir"),
        (Path, "write_bytes"),
        (Path, "write_text"),
        (Path, "mkdir"),
        (Path, "open"),  # to append
    )

    TOLD = ("No space left on device", "cannot be written")

    def __init__(self, monkeypatch):
        self.fails_at = self.count = 0
        for owner, name in self.CALLS:
            monkeypatch.setattr(owner, name, self._failing(getattr(owner, name)))

    def _failing(self, function):
        def call(*given, **options):
            if function.__name__ == "open" and "a" not in given[1:2] and "ab" not in given[1:2]:
                return function(*given, **options)
            self.count += 1
            if self.count == self.fails_at:
                if "ab" in given[1:2]:  # a log
                    return io.BufferedWriter(HalfWritten(given[0], "ab"))
                if function.__name__.startswith("write"):  # a part of it still has room
                    path, content = given[:2]
                    function(path, content[: len(content) // 2])
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return function(*given, **options)

        return call

    def begin(self, fails_at):
        """Count anew, and fail at that call; never for 0."""
        self.fails_at, self.count = fails_at, 0


class Memory(Disk):
    """Calls by which NumPy makes arrays; the n-th large one fails as where memory ends."""

    NAMES = ("array", "asarray", "empty", "zeros", "ones", "full", "arange", "concatenate", "stack", "repeat", "tile")
    CALLS = tuple((np, name) for name in NAMES)
    TOLD = ("there is not enough memory for this",)
    LARGE = 200  # bytes; the commands here are small

    def _failing(self, function):
        def call(*given, **options):
            made = function(*given, **options)
            # Where trimesh lacks memory for normals, it sums them in another order: other last bits, but no failure.
            caller = sys._getframe(1).f_globals.get("__name__", "")
            if getattr(made, "nbytes", 0) >= self.LARGE and not caller.startswith("trimesh"):
                self.count += 1
                if self.count == self.fails_at:
                    raise MemoryError(f"Unable to allocate {made.nbytes} bytes")
            return made

        return call


FAULTS = {"disk": Disk, "memory": Memory}
QUICK = ("simulate", "codesign")  # of memory, in every run of the tests


def contents(folder):
    """Files below a folder that must not depend on failures."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in VOLATILE]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ("fault", "name", "every"),
    [
        pytest.param(
            *(fault, name, every),
            marks=pytest.mark.slow if every or (fault == "memory" and name not in QUICK) else (),
            id=f"{fault}-{name}-{'all' if every else 'one'}",
        )
        for fault in FAULTS
        for name in COMMANDS
        for every in (False, True)
    ],
)
def test_a_fault_costs_nothing_but_the_command(fault, name, every, morpholab, tmp_path, monkeypatch):
    prepare, line, after = COMMANDS[name]
    root = Path(__file__).resolve().parents[1]

    def fresh(folder):
        shutil.copytree(tmp_path / "prepared", folder)
        monkeypatch.chdir(folder)
        return contents(folder)

    (tmp_path / "prepared").mkdir()
    monkeypatch.chdir(tmp_path / "prepared")
    shutil.copy(root / "examples/starfish.py", ".")
    assert not prepare or morpholab(prepare)[0] == 0
    disk = FAULTS[fault](monkeypatch)
    fresh(tmp_path / "first")
    assert morpholab(line)[0] == 0  # so that what is made once a process is there
    before = fresh(tmp_path / "whole")
    disk.begin(0)
    code, _, error = morpholab(line)
    assert code == 0, error
    calls, whole = disk.count, contents(tmp_path / "whole")
    assert (calls and whole.keys() > before.keys()) or "page.html" in line
    for n in range(1, calls + 1, 1 + calls // MOST) if every else range(1, calls + 1)[calls // 2 :][:1]:
        folder = tmp_path / f"fails{n}"
        disk.begin(0)
        fresh(folder)
        disk.begin(n)
        code, _, error = morpholab(line)
        assert disk.count >= n, f"{n}: {error}"
        disk.begin(0)
        assert code in (0, 1), f"{n}: {error}"  # 0 where nothing was lost, see the end
        if code:
            assert "Traceback" not in error and len(error.splitlines()) <= 2, f"{n}: {error}"
            assert any(words in error for words in disk.TOLD), f"{n}: {error}"
        found = contents(folder)
        assert before.items() <= found.items(), f"{n}: something that was there has changed"
        strangers = [path for path in found if path not in whole]
        assert not strangers, f"{n}: {strangers} are left"
        again = after if after and (folder / "a/config.toml").exists() else line
        if code:
            code, _, error = morpholab(again)
            assert code == 0, f"{n}: {again}: {error}"
        assert contents(folder) == whole, f"{n}: not what it gives where nothing fails"
