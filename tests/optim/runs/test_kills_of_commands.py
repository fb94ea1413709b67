"""Each command that takes long, killed again and again: what it then leaves is what it leaves when nothing kills it."""

import random
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass

import pytest
from kills import SHORTENED, kill, killed_again_and_again, lasting, start
from measurements import GRIPPING
from small_pipeline import SEARCHES, write_task

pytestmark = pytest.mark.slow
KILLS = 25
OF_TIME = ("timing.jsonl",)  # when generations ended, and how long they took
VEHICLE = "--time-step 0.5 --steps 1000 --threads 1 --quiet"
FREEFORM = "--shape 3,2,2 --cycles 1 --frequency 12 --settling 0.02"


@dataclass(frozen=True)
class Command:
    """A command line that writes the folder ``out``, and in which ``{given}`` stands for the folder of its input.

    Attributes:
        line: the words after ``morpholab``.
        module: that runs it.
        differ: names of files whose content may differ; all others, and the names themselves, may not.
    """

    line: str
    module: str = "optim.cli"
    differ: tuple[str, ...] = ()


COMMANDS = {
    "train": Command(
        "train --designs 80,100-103,162,6553 --repetitions 4 --budget-evaluations 120 --seed 3 --radius 1 "
        f"{VEHICLE} --out out"
    ),
    "interference": Command(
        "interference --robots legged,whegged --fitness sum,min --runs 2 --generations 20 --population 10 "
        "--steps 200 --threads 1 --quiet --out out"
    ),
    "calibrate": Command("calibrate {given}/drags.toml --threads 1 --quiet --out out"),
    "pipeline": Command("pipeline {given}/task.toml --threads 1 --quiet --out out", SHORTENED, OF_TIME),
    "freeform": Command(
        f"codesign --robot freeform {FREEFORM} --method race --set climbers=4 --generations 8 --threads 1 --quiet "
        "--resume --out out",
        differ=OF_TIME,
    ),
    "measure": Command(
        "measure --robot vehicle --controllers 1500 --climbers 8 --generations 12 --runs 2 --success closest<=1 "
        "--threads 1 --quiet --out out"
    ),
    "body-and-learning": Command("reproduce body-and-learning --budget small --quiet --out out", SHORTENED),
    "forgetting": Command("reproduce forgetting --budget small --quiet --out out", SHORTENED),
    "jobs": Command("reproduce forgetting --budget small --jobs 2 --quiet --out out", SHORTENED),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_25_kills_at_random_instants_change_nothing(tmp_path, name):
    command = COMMANDS[name]
    (tmp_path / "drags.toml").write_text(GRIPPING)
    write_task(tmp_path, SEARCHES)
    line = command.line.replace("{given}", str(tmp_path))
    (tmp_path / "whole").mkdir()
    begun = time.monotonic()
    process = start(line, command.module, tmp_path / "whole")
    said, seconds = process.communicate()[1], time.monotonic() - begun
    whole = lasting(tmp_path / "whole", command.differ)
    assert whole and process.returncode in (0, 1), said
    found = killed_again_and_again(line, command.module, tmp_path / "killed", seconds, KILLS, seed=1)
    print(f"{name}: {seconds:.1f} s if nothing kills it; {found.kills} kills, {found.kept} of them left files, until")
    print(f"{len(found.folders)} folders were complete, {time.monotonic() - begun:.0f} s in all")
    assert found.kills == KILLS
    assert set(found.codes) == {process.returncode}, found.said
    assert set(found.said) <= {"", said}, found.said
    for folder in found.folders:
        left = lasting(folder, command.differ)
        assert sorted(left) == sorted(whole)
        assert [path for path in whole if left[path] != whole[path]] == []


def _ended(process):
    """Wait until it has ended well."""
    said = process.communicate()[1]
    assert process.returncode == 0, said


def test_25_kills_leave_a_folder_for_paraview_whole_or_none(tmp_path):
    """It has no part to go on with; what a kill leaves beside it, the next command removes."""
    line = "view inching --columns 1 --repeats 1 --frames 300 --quiet --paraview out"
    begun = time.monotonic()
    _ended(start(line, folder=tmp_path))
    seconds, whole = time.monotonic() - begun, lasting(tmp_path / "out")
    rng, met, left = random.Random(1), 0, 0
    for _ in range(KILLS):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        process = start(line, folder=tmp_path)
        with suppress(subprocess.TimeoutExpired):
            process.wait(rng.uniform(0.6 * seconds, seconds))
        assert kill(process) == ""
        met += process.returncode == -signal.SIGKILL
        left += any(tmp_path.glob(".aside-*"))
        assert not (tmp_path / "out").exists() or lasting(tmp_path / "out") == whole
    print(f"{met} kills met a command of {seconds:.1f} s, {left} of them while it wrote")
    assert left
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    _ended(start(line, folder=tmp_path))
    assert lasting(tmp_path / "out") == whole and [path.name for path in tmp_path.iterdir()] == ["out"]
