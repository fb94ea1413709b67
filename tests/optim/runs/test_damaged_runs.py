"""Files of a run folder that are not as they were written: recovered from, or refused in one line."""

import json
import os
import random
import shutil
import signal

import pytest
from run_products import log

from optim.runs.environment import differences, environment
from taichi_sim.base import files

pytestmark = pytest.mark.usefixtures("simulator")

LINE = "codesign --terrain flat --seed 3 --climbers 3 --geometry small --columns 4 --quiet"
RESULTS = ("log.jsonl", "best.json", "gait.csv", "robot_flat.png")


def mutate(folder, rng):
    """Do one random harm to one file; what was done."""
    path = rng.choice(sorted(path for path in folder.iterdir() if path.name != ".lock"))
    other = rng.choice(sorted(p for p in folder.iterdir() if p.name != ".lock" and p != path))
    content = path.read_bytes()
    place, bit = rng.randrange(len(content)), 1 << rng.randrange(8)
    how = rng.choice(["truncated", "flipped", "flipped", "emptied", "swapped", "lost", "grown"])
    if how == "lost":
        path.unlink()
    elif how == "swapped":
        path.write_bytes(other.read_bytes())
        other.write_bytes(content)
    else:
        path.write_bytes(
            {
                "truncated": content[:place],
                "flipped": content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :],
                "emptied": b"",
                "grown": content + content[place:],
            }[how]
        )
    return f"{path.name} {how} at {place} bit {bit}, {other.name}"


@pytest.mark.long
@pytest.mark.parametrize("mutations", [60, pytest.param(600, marks=pytest.mark.slow)])
def test_no_damage_ends_in_a_traceback_or_a_wrong_number(morpholab, tmp_path, mutations):
    assert morpholab(f"{LINE} --generations 5 --out whole")[0] == 0
    assert morpholab(f"{LINE} --generations 3 --out short")[0] == 0
    assert morpholab("export short --csv short.csv")[0] == 0
    results = {name: (tmp_path / "whole" / name).read_bytes() for name in RESULTS}
    known = {line["generation"]: line for line in log(tmp_path / "whole")}
    rng, recovered = random.Random(1), 0
    for _ in range(mutations):
        shutil.rmtree(tmp_path / "a", ignore_errors=True)
        shutil.copytree(tmp_path / "short", tmp_path / "a")
        harm = mutate(tmp_path / "a", rng)

        told = None
        code, out, error = morpholab("status a --json")
        if code == 2:
            assert error.count("\n") == 1, harm
        else:
            (told,) = json.loads(out)
            assert (code, "reason" in told) in ((1, True), (0, False)), harm
            if code == 0:
                right = known[told["generation"]]
                assert {name: right[name] for name in ("best", "mean", "evaluations")}.items() <= told.items(), harm
        code, _, error = morpholab("export a --csv a.csv")
        assert (code == 2 and error.count("\n") == 1) or code == 0, harm
        if code == 0 and told and told.get("generation") == 3:
            assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "short.csv").read_bytes(), harm

        code, _, error = morpholab("codesign --resume --quiet --generations 5 --out a")
        assert "Traceback" not in error and code in (0, 2), harm
        if code == 2:
            assert error.count("\n") == 1 and error.startswith("morpholab codesign: error: "), harm
        else:
            recovered += 1
            assert {name: (tmp_path / "a" / name).read_bytes() for name in RESULTS} == results, harm
    assert mutations > recovered > mutations / 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("format = 1", "format = 7"), "was written by a newer morpholab (format 7; this"),
        (lambda text: text.replace("seed = 3", "seed = 4"), "is not as it was written; its checksum does not match"),
        (lambda text: text[: text.rindex("#")], "is not as it was written; its checksum is missing"),
        (lambda text: text + "\x00", "cannot be read"),
    ],
)
def test_changed_settings_are_refused(morpholab, tmp_path, change, message):
    assert morpholab(f"{LINE} --generations 1 --out a")[0] == 0
    path = tmp_path / "a/config.toml"
    path.write_text(change(path.read_text()))
    for line in ("codesign --resume --out a", "export a --csv b.csv"):
        code, _, error = morpholab(line)
        assert code == 2 and f"config.toml: {message}" in error and error.count("\n") == 1
    code, out, _ = morpholab("status a")
    assert code == 1 and out.startswith("a: damaged: ") and message in out


def test_checkpoints_of_another_run_are_refused(morpholab, tmp_path):
    assert morpholab(f"{LINE} --generations 2 --out a")[0] == 0
    assert morpholab(f"{LINE.replace('--seed 3', '--seed 4')} --generations 2 --out b")[0] == 0
    for name in ("checkpoint.npz", "checkpoint.previous.npz"):
        shutil.copy(tmp_path / "b" / name, tmp_path / "a" / name)
    code, _, error = morpholab("codesign --resume --quiet --out a")
    assert code == 2 and error.count("made with other settings") == 2 and error.count("\n") == 1


def test_a_state_of_the_checkpoint_before_is_told_by_its_name(morpholab, tmp_path):
    assert morpholab(f"{LINE} --generations 3 --out a")[0] == 0
    older = tmp_path / "a/checkpoint.previous.npz"
    arrays = files.unpack(older.read_bytes())
    del arrays["points"]
    older.write_bytes(files.pack(arrays))
    (tmp_path / "a/checkpoint.npz").write_bytes(b"damaged")
    code, _, error = morpholab("export a --member 1 --csv b.csv")
    assert code == 2 and "a: checkpoint.previous.npz: state: points is missing" in error and error.count("\n") == 1


@pytest.fixture
def in_time():
    """What waits for ever fails after a while."""

    def give_up(*_):
        raise AssertionError("it waits for ever")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("device", [False, True], ids=["pipe", "link to a device"])
def test_pipes_and_devices_in_place_of_files_are_told(morpholab, tmp_path, in_time, device):
    """A pipe never begins and /dev/zero never ends; each is told in a line that names it."""
    assert morpholab(f"{LINE} --generations 2 --out a")[0] == 0
    resume = "codesign --resume --generations 3 --quiet --out f"
    readers = ("status f", "compare f", "report f --out p.html --no-player --quiet", "view f --picture p.png", resume)
    given = "cannot be read (it is a pipe or device, give a file)"
    for name, told, lines in (
        ("log.jsonl", given, readers),
        ("timing.jsonl", given, readers),
        ("environment.json", given, (resume,)),
        (".lock", "is a pipe or device; remove it", readers),
    ):
        shutil.rmtree(tmp_path / "f", ignore_errors=True)
        shutil.copytree(tmp_path / "a", tmp_path / "f")
        path = tmp_path / "f" / name
        path.unlink()
        path.symlink_to("/dev/zero") if device else os.mkfifo(path)
        for line in lines:
            code, out, error = morpholab(line)
            whole = out if line == "status f" else error
            assert f"f/{name}" in whole and told in whole, (name, line)
            assert code == (1 if line == "status f" else 2) and error.count("\n") <= 1, (name, line)
        assert path.is_fifo() or path.is_symlink()


def test_a_pipe_in_place_of_a_lock_or_a_claim_is_told(morpholab, tmp_path, in_time):
    (tmp_path / "f").mkdir()
    os.mkfifo(tmp_path / "f" / ".lock")
    code, _, error = morpholab(f"{LINE} --generations 1 --out f")
    assert (code, error) == (
        2,
        "morpholab codesign: error: out: f/.lock is a pipe or device; remove it\n",
    )
    assert morpholab(f"{LINE} --generations 1 --out a")[0] == 0
    os.mkfifo(tmp_path / f"{files.ASIDE}claim-p.html")
    code, _, error = morpholab("report a --out p.html --no-player --quiet")
    told = "morpholab report: error: out: .aside-claim-p.html is a pipe or device; remove it\n"
    assert (code, error) == (2, told) and not (tmp_path / "p.html").exists()


def test_packages_whose_operators_searches_use_are_part_of_the_environment():
    before = environment()
    assert {"numpy", "taichi", "cmaes", "pymoo"} <= before["versions"].keys()
    now = {**before, "versions": {**before["versions"], "cmaes": "9.9"}}
    (difference,) = differences(before, now)
    assert difference == f"cmaes {before['versions']['cmaes']}, now 9.9"
    del before["versions"]["cmaes"]  # as in runs of before: not known, so not different
    assert differences(before, now) == []


def test_another_machine_is_noted(morpholab, tmp_path, monkeypatch):
    assert morpholab(f"{LINE} --generations 1 --out a")[0] == 0
    monkeypatch.setattr("optim.runs.environment._version", lambda package: "9.9")
    code, _, error = morpholab("codesign --resume --generations 2 --quiet --out a")
    assert code == 0 and "note: a: began elsewhere (" in error and "now 9.9" in error
