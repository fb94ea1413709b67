"""Whose fault it is that nothing can be written decides the exit code: 2 of a wrong path, 1 of a disk."""

import errno
import os
from pathlib import Path

import pytest

from optim.experiments.figures import figure
from optim.runs.workers.folder_files import make_folders
from taichi_sim.base import claims, files
from taichi_sim.base.disk_faults import unwritten

DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.ESTALE, errno.EMFILE)
PATH = (errno.EACCES, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.EPERM)
LINES = (  # that write before they compute, or compute nothing
    "simulate --robot vehicle --out a",
    "view vehicle --out a.html",
    "codesign --robot vehicle --climbers 2 --generations 1 --out a",
    "gradient-check --robot vehicle --out a",
    "sweep --designs 162 --out a",
    "train --designs 162 --methods nes --out a",
    "measure --robot vehicle --controllers 4 --success closest<=1 --out a",
    "calibrate --example a.toml",
    "export inching --csv a.csv",
    "export inching --plot a.png",
    "export voxel_walker.vxa --voxels a.vxa",
)


@pytest.fixture
def refusing(monkeypatch, tmp_path):
    """Lets the disk refuse everything that would change the folder of the test."""

    def refuse(number):
        def failing(function):
            def call(*given, **options):
                mode = (*given[1:2], options.get("mode", "r"))[0]
                reads = function.__name__ == "open" and mode.startswith("r")
                if reads or not Path(given[0]).absolute().is_relative_to(tmp_path):
                    return function(*given, **options)
                raise OSError(number, os.strerror(number), str(given[0]))

            return call

        for owner, name in ((os, "replace"), (os, "mkdir"), (Path, "mkdir"), (Path, "open")):
            monkeypatch.setattr(owner, name, failing(getattr(owner, name)))

    return refuse


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize(("number", "code", "how"), [(errno.ENOSPC, 1, "failed"), (errno.EACCES, 2, "error")])
def test_commands(morpholab, refusing, tmp_path, line, number, code, how):
    example = Path(__file__).parents[1] / "examples/voxel_walker.vxa"
    (tmp_path / example.name).write_bytes(example.read_bytes())
    refusing(number)
    found, out, error = morpholab(line)
    assert (found, out, error.count("\n")) == (code, "", 1), error
    assert error.startswith(f"morpholab {line.split()[0]}: {how}: ") and os.strerror(number) in error


def draw(path):
    with figure(path, 2.0, 2.0):
        pass


WRITERS = {
    "a file": lambda path: files.write_bytes(path / "a", b"content"),
    "a picture": lambda path: draw(path / "a.png"),
    "a folder": lambda path: files.make_folder(path / "a"),
    "a claim of a file": lambda path: claims.claimed_path("out", path / "a").__enter__(),
    "a claim of a folder": lambda path: claims.claimed_folder("out", path / "a").__enter__(),
    "a folder for workers": lambda path: make_folders(path / "a"),
}
BEGUN = ("a file", "a picture")  # as they are written when the work is done


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("number", [*DISK, *PATH, errno.EROFS])
def test_what_writes(refusing, tmp_path, name, number):
    refusing(number)
    wrong = number in PATH or (number == errno.EROFS and name not in BEGUN)
    with pytest.raises(ValueError if wrong else RuntimeError, match=rf"^.*/a.* \({os.strerror(number)}\)$"):
        WRITERS[name](tmp_path)


def test_an_error_without_a_number_is_a_failure():
    """As some libraries raise them."""
    assert str(unwritten("a.png cannot be written", OSError("encoder  error\n-2"))) == (
        "a.png cannot be written (encoder error -2)"
    )
    assert isinstance(unwritten("a", OSError("encoder error -2")), RuntimeError)


def test_a_folder_that_takes_no_files_is_refused_before_work(morpholab, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    told = "cannot be written; the folder . takes no files"
    for line, path in (("export inching --csv a.csv", "csv: a.csv"), ("view vehicle --out a.html", "out: a.html")):
        assert morpholab(line) == (2, "", f"morpholab {line.split()[0]}: error: {path} {told}\n")


def full(*_, **options):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def forbidden(*_, **options):
    raise OSError(errno.EACCES, os.strerror(errno.EACCES))


@pytest.mark.parametrize("json", ["", " --json"])
@pytest.mark.parametrize(("fails", "code", "how"), [(full, 1, "failed"), (forbidden, 2, "error")])
@pytest.mark.parametrize(
    ("writer", "file", "options"),
    [
        ("robots.inflatable.view.picture.save_motion_picture", "robot.png", ""),
        ("robots.hardware.write_csv", "gait.csv", ""),
        ("numpy.savez_compressed", "frames.npz", " --record-every 10"),
    ],
)
def test_what_was_computed_is_told_though_a_file_cannot_be_written(
    morpholab, simulator, monkeypatch, tmp_path, writer, file, options, fails, code, how, json
):
    result = morpholab(f"simulate --gait rolling{json}")
    assert result[0] == 0 and result[1]
    monkeypatch.setattr(writer, fails)
    found, out, error = morpholab(f"simulate --gait rolling --out a{options}{json}")
    assert (found, out) == (code, result[1])
    number = errno.ENOSPC if fails is full else errno.EACCES
    told = f"morpholab simulate: {how}: out: a/{file} cannot be written ({os.strerror(number)})"
    assert error.splitlines()[-1] == told
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("json", ["", " --json"])
def test_runs_are_compared_though_their_picture_has_no_room(morpholab, monkeypatch, tmp_path, json):
    problem = 'bounds = {"x": (0, 1)}\nname = "height"\n\n\ndef evaluate(points):\n    return points[:, 0]\n'
    (tmp_path / "problem.py").write_text(problem)
    for seed in (1, 2):
        options = f"--method random --climbers 2 --generations 2 --seed {seed} --quiet"
        assert morpholab(f"codesign --problem problem.py --out runs/{seed} {options}")[0] == 0
    code, whole, _ = morpholab(f"compare runs{json}")
    monkeypatch.setattr("optim.plots.save_curves", full)
    assert morpholab(f"compare runs --out a.png{json}")[:2] == (1, whole) and code == 0
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("train --sample 2 --out un", "un: cannot be used"),
        ("measure --robot vehicle --controllers 4 --success closest<=1 --out un", "un: cannot be used"),
        ("interference --out un", "un: cannot be used"),
        ("codesign --robot vehicle --climbers 2 --generations 1 --out un", "un: cannot be used"),
        ("train --sample 2 --out un/x", "un/x/training.json: cannot be used"),
        ("simulate --robot vehicle --out un/x", "un/x: cannot be used"),
        ("export inching --csv un/x/a.csv", "un/x/a.csv: cannot be used"),
        ("report un/x --out a.html", "un/x/sweep.json: cannot be used"),
    ],
)
def test_a_folder_that_is_forbidden_is_told_in_a_line(morpholab, monkeypatch, tmp_path, line, told):
    def forbidding(function, within):
        def call(path=".", *given, **options):
            place = Path(os.path.abspath(path)) if isinstance(path, str | os.PathLike) else Path()
            if (tmp_path / "un" in place.parents) if within else place == tmp_path / "un":
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), os.fspath(path))
            return function(path, *given, **options)

        return call

    (tmp_path / "un").mkdir()
    monkeypatch.setattr(os, "listdir", forbidding(os.listdir, within=False))
    if "un/" in line:
        monkeypatch.setattr(os, "mkdir", forbidding(os.mkdir, within=True))
        monkeypatch.setattr(os, "stat", forbidding(os.stat, within=True))
    code, out, error = morpholab(line)
    assert (code, out, error) == (2, "", f"morpholab {line.split()[0]}: error: {told} (Permission denied)\n")
