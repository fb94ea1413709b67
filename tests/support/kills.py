"""Commands in processes of their own that are killed, and what they leave."""

import json
import os
import random
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from optim.runs.checkpoint import CHECKPOINT, PREVIOUS
from taichi_sim.base import files

ROOT = Path(__file__).parents[2]
SHORTENED = "shortened_commands"  # the module of this folder that runs a command on small robots


def start(line: str, module: str = "optim.cli", folder: Path = ROOT) -> "subprocess.Popen[str]":
    """Start a command in a process of its own, in a folder."""
    places = [str(ROOT), str(ROOT / "tests/support"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(places)}
    words = [sys.executable, "-m", module, *line.split()]
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(words, cwd=folder, env=environment, **streams)


def kill(process: "subprocess.Popen[str]") -> str:
    """Kill a process, unless it has ended, without a chance to clean up, and return what it wrote to standard error."""
    process.send_signal(signal.SIGKILL)
    return process.communicate()[1]


@dataclass
class Killed:
    """What came of killing a command.

    Attributes:
        kills: that met a running command.
        folders: all that were filled until the command ended by itself; the last one after the last kill.
        said: what the command wrote to standard error, killed or not.
        codes: exit codes of the commands that ended by themselves.
        kept: kills that left some file.
    """

    kills: int
    folders: list[Path]
    said: list[str]
    codes: list[int]
    kept: int


def killed_again_and_again(line: str, module: str, above: Path, seconds: float, kills: int, seed: int) -> Killed:
    """Start a command so often that so many kills meet it, each at a random instant of ``seconds``, then let it end.

    Each goes on in the folder of the last one, until that is complete; then in a new one.
    """
    rng, found = random.Random(seed), Killed(0, [], [], [], 0)

    def started() -> "subprocess.Popen[str]":
        if len(found.folders) == len(found.codes):
            found.folders.append(above / str(len(found.folders)))
            found.folders[-1].mkdir(parents=True)
        return start(line, module, found.folders[-1])

    while found.kills < kills:
        assert len(found.codes) < 2 * kills, "nearly all end before they are killed"
        process = started()
        with suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.0, seconds))
        found.said.append(kill(process))
        if process.returncode == -signal.SIGKILL:
            found.kills += 1
            found.kept += any(path.is_file() for path in found.folders[-1].rglob("*"))
        else:
            found.codes.append(process.returncode)
    process = started()
    found.said.append(process.communicate()[1])
    found.codes.append(process.returncode)
    return found


def lasting(folder: Path, but: tuple[str, ...] = ()) -> dict[str, bytes]:
    """Content of all files below a folder by path, empty for those of the names ``but``.

    Of checkpoints, without the checksum of the file that tells times.
    """
    found = {}
    for path in sorted(each for each in folder.rglob("*") if each.is_file()):
        content = b"" if path.name in but else path.read_bytes()
        found[str(path.relative_to(folder))] = (
            _of_checkpoint(content) if path.name in (CHECKPOINT, PREVIOUS) else content
        )
    return found


def _of_checkpoint(content: bytes) -> bytes:
    arrays = files.unpack(content)
    record = json.loads(arrays.pop("run/record").tobytes())
    del record["timing"]
    return files.pack(arrays) + json.dumps(record).encode()
