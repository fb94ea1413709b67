"""What surrounds a process must not end it: no cache, no home, threads, forks, closed pipes, two at once."""

import contextlib
import gzip
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.results import check_folder
from taichi_sim.base import claims, files
from taichi_sim.base.results_folder import ResultsFolder

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[1]

# Small kernels in both precisions, so that threads restart Taichi under each other.
WITHOUT_CACHE_AND_HOME = """
import os, sys, threading
import numpy as np
from taichi_sim.signals import warping_distances

signals = np.random.default_rng(0).standard_normal((2, 3, 20))
measure = lambda precision: warping_distances(*signals, precision=precision, threads=1)
expected = {precision: measure(precision) for precision in ("f64", "f32")}
wrong = []

def work(precisions):
    wrong.extend(p for p in precisions if not np.array_equal(measure(p), expected[p]))

threads = [threading.Thread(target=work, args=(order,)) for order in (("f32", "f64"), ("f64", "f32"))]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print("wrong:", wrong, flush=True)
child = os.fork()
if child == 0:
    try:
        measure("f64")
    except RuntimeError as refusal:
        print("child:", refusal, flush=True)
    sys.exit(3)
print("child ended:", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def run(*command, environment=None, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    environment = {name: value for name, value in environment.items() if value is not None}
    process = subprocess.run(
        [sys.executable, *command],
        env=environment,
        text=True,
        stderr=subprocess.PIPE,
        timeout=120,
        check=False,
        **options,
    )
    assert "Traceback" not in process.stderr and process.returncode >= 0, process.stderr
    return process


@pytest.mark.kernels
def test_threads_and_forks_without_a_cache_and_a_home(tmp_path):
    """Compiles two small kernels."""
    (tmp_path / "file").touch()
    process = run(
        "-W",
        "ignore",
        "-c",
        WITHOUT_CACHE_AND_HOME,
        environment={"HOME": None, "MORPHOLAB_CACHE": str(tmp_path / "file/below")},
        stdout=subprocess.PIPE,
    )
    assert process.returncode == 0, process.stderr
    notes = process.stderr.splitlines()
    assert len(notes) == 1 and notes[0].startswith("note: kernels are not cached, ") and "cannot be written" in notes[0]
    wrong, refusal, ended = process.stdout.splitlines()
    assert wrong == "wrong: []" and "'spawn'" in refusal and ended == "child ended: 3"


def test_output_that_nobody_takes_is_no_traceback(tmp_path):
    """A closed pipe, a full disk, and streams that were closed before the start."""
    for command in (("export", "rolling", "--dry-run", "--json"), ("--help",), ("--version",)):
        end, closed = os.pipe()
        os.close(end)
        process = run("-m", "optim", *command, stdout=closed)
        os.close(closed)
        assert (process.returncode, process.stderr) == (141, "")
        with open("/dev/full", "w") as full:
            process = run("-m", "optim", *command, stdout=full)
        assert process.returncode == 1
        assert process.stderr.endswith("failed: standard output cannot be written (No space left on device)\n")
        assert process.stderr.count("\n") == 1
    for json_or_not, streams, code, told in (
        ("", ">&- 2>&-", 0, ""),
        ("--json", ">&- 2>&-", 1, ""),
        ("--json", ">&-", 1, "morpholab export: failed: standard output is closed, which --json needs; "),
    ):
        shell = f'exec "$0" -m optim export rolling --dry-run {json_or_not} {streams}'
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        process = subprocess.run(
            ["sh", "-c", shell, sys.executable], env=environment, check=False, capture_output=True, text=True
        )
        assert process.returncode == code and process.stderr.startswith(told), streams
        assert process.stderr.count("\n") == (1 if told else 0)


def test_characters_that_the_output_lacks_are_escaped(tmp_path):
    for module in ("optim", "morpholab"):
        command = ("-m", module, "export", "rolling", "--csv", str(tmp_path / f"{module} Ж.csv"))
        process = run(*command, environment={"PYTHONIOENCODING": "latin-1"}, stdout=subprocess.PIPE)
        assert (process.returncode, process.stderr) == (0, "")
        assert f"{module} \\u0416.csv" in process.stdout


@pytest.mark.parametrize("module", ["optim.cli", "optim.commands.codesign", "optim.commands.robots"])
def test_an_interrupt_while_the_command_is_imported_is_no_traceback(module):
    """Such an import takes a second; a command that has begun tells of interrupts itself."""
    interrupted = f"""
import sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == "{module}":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
sys.argv = ["morpholab", "status", "."]
from optim.entry import start
sys.exit(start())
"""
    process = run("-c", interrupted)
    assert (process.returncode, process.stderr) == (130, "morpholab: interrupted\n")


def test_an_unexpected_exception_is_a_bug_with_a_log(morpholab, monkeypatch, tmp_path):
    def broken(*_):
        raise KeyError("fault")

    monkeypatch.setattr("optim.commands.simulate.loaded", broken)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code, out, error = morpholab("simulate --gait rolling")
    assert (code, out) == (70, "") and error.count("\n") == 1
    assert error.startswith(
        "morpholab simulate: this is a bug in morpholab (KeyError: 'fault'); please report it with "
    )
    log = Path(error.split()[-1])
    assert log.parent == tmp_path and "Traceback" in log.read_text() and 'raise KeyError("fault")' in log.read_text()
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
        patch.setenv("MORPHOLAB_DEBUG", "1")
        code, _, error = morpholab("simulate --gait rolling")
    assert code == 70 and "Traceback" in error and error.endswith("; set MORPHOLAB_DEBUG=1 to see where\n")


def test_a_recursion_without_end_is_a_bug_too(morpholab, monkeypatch, tmp_path):
    def endless(*given):
        return endless(*given)

    monkeypatch.setattr("optim.commands.simulate.loaded", endless)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code, out, error = morpholab("simulate --gait rolling")
    assert (code, out) == (70, "") and error.count("\n") == 1
    assert error.startswith("morpholab simulate: this is a bug in morpholab (RecursionError: maximum recursion depth")


@pytest.mark.parametrize(
    ("line", "claimed"),
    [
        ("simulate --gait rolling --out a/b", "a/b"),
        ("gradient-check --out a/b", "a/b"),
        ("view rolling --glb a.glb --out a.html", "a.html"),
        ("report run --out a.html", "a.html"),
        ("calibrate --example a.toml", "a.toml"),
        ("compare runs --out a.png", "a.png"),
    ],
)
def test_of_two_commands_that_write_the_same_the_second_is_refused(morpholab, tmp_path, line, claimed):
    claim = claims.claimed_folder if claimed == "a/b" else claims.claimed_path
    with claim("out", tmp_path / claimed):
        code, out, error = morpholab(line)
        assert (
            code == 2
            and out == ""
            and error.endswith("is being written already; name a new " + error.split()[-1] + "\n")
        )
        assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_of_many_that_want_a_path_one_gets_it(tmp_path):
    """And what it writes is there; those after it are refused, too."""
    got, refused = [], []

    def work(number, claim, path, write):
        try:
            with claim("out", path):
                write(path, str(number))
                got.append(number)
        except ValueError as error:
            refused.append(str(error))

    for claim, path, write in (
        (claims.claimed_path, tmp_path / "a.txt", files.write_text),
        (claims.claimed_folder, tmp_path / "b/c", lambda path, text: files.write_text(path / "a.txt", text)),
    ):
        got.clear()
        threads = [threading.Thread(target=work, args=(number, claim, path, write)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(got) == 1 and (path if path.is_file() else path / "a.txt").read_text() == str(got[0])
        assert [each.name for each in path.parent.iterdir() if each.name.startswith(".")] == []
    assert len(refused) == 14


def test_a_claim_of_a_killed_process_is_free(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a/.aside-claim").touch()
    with claims.claimed_folder("out", tmp_path / "a"):
        pass
    assert list((tmp_path / "a").iterdir()) == []
    with pytest.raises(ValueError, match=r"^out: .*a/b cannot be made \(Not a directory\)$|^out: .* is a file"):
        (tmp_path / "file").touch()
        claims.claimed_folder("out", tmp_path / "file/a").__enter__()


def test_a_claim_of_a_folder_that_was_moved_leaves_the_next_one_alone(tmp_path):
    with contextlib.ExitStack() as second:
        with claims.claimed_folder("out", tmp_path / "a"):
            (tmp_path / "a").rename(tmp_path / "moved")
            second.enter_context(claims.claimed_folder("out", tmp_path / "a"))
        with pytest.raises(ValueError, match="a is being written already"):
            claims.claimed_folder("out", tmp_path / "a").__enter__()


def test_a_folder_that_a_killed_process_had_claimed_is_free_of_what_it_made(tmp_path):
    """And of nothing else."""
    folder, names = tmp_path / "a", ("a.json", "a.png")
    gone = subprocess.Popen(["true"])
    gone.wait()

    def claimed_and_killed():
        with claims.claimed_folder("out", folder, names):
            files.write_text(folder / "a.json", "half")
            shutil.copytree(folder, tmp_path / "killed")
        shutil.rmtree(folder)
        shutil.move(tmp_path / "killed", folder)
        (folder / f".aside-{gone.pid}-{files._machine()}-{gone.pid}-a.png").touch()
        (folder / f".aside-{gone.pid}-elsewhere-{gone.pid}-a.png").touch()

    claimed_and_killed()
    (folder / "notes.txt").touch()
    with pytest.raises(ValueError, match="is not empty"), claims.claimed_folder("out", folder, names):
        pass
    assert {"a.json", "notes.txt"} <= {each.name for each in folder.iterdir()}
    shutil.rmtree(folder)
    claimed_and_killed()
    with pytest.raises(ValueError, match="is not empty"), claims.claimed_folder("out", folder, ["b.json"]):
        pass  # which makes other files
    shutil.rmtree(folder)
    claimed_and_killed()
    foreign = f".aside-{gone.pid}-elsewhere-{gone.pid}-a.png"  # of another machine, where the process may run
    with claims.claimed_folder("out", folder, names):
        assert {each.name for each in folder.iterdir()} == {".aside-claim", foreign}
        files.write_text(folder / "a.json", "whole")
    assert {each.name for each in folder.iterdir()} == {"a.json", foreign}
    with pytest.raises(ValueError, match="is not empty"), claims.claimed_folder("out", folder, names):
        pass
    assert (folder / "a.json").read_text() == "whole"


def test_unfinished_files_of_processes_that_have_ended_are_removed(tmp_path):
    gone = subprocess.Popen(["true"])
    gone.wait()
    here = files._machine()
    names = [
        f".aside-{os.getpid()}-{here}-1-a.csv",
        f".aside-{gone.pid}-{here}-1-a.csv",
        f".aside-1-{here}-1-{gone.pid}",
        f".aside-{gone.pid}-elsewhere-1-a.csv",
        ".aside-claim",
    ]
    (tmp_path / "parts").mkdir()
    for name in names:
        (tmp_path / "parts" / name).touch()
    check_folder(tmp_path, ["parts"])
    assert {each.name for each in (tmp_path / "parts").iterdir()} == {names[0], *names[2:]}
    ResultsFolder(tmp_path / "kept", "sweep", {})
    left = tmp_path / "kept" / f".aside-{gone.pid}-{here}-1-b.npz"
    left.touch()
    ResultsFolder(tmp_path / "kept", "sweep", {})
    assert not left.exists()


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("codesign --task pipe --out a", "task: pipe cannot be read (it is a pipe or device, give a file)"),
        ("codesign --problem pipe --out a", "problem: pipe cannot be read (it is a pipe or device, give a file)"),
        ("simulate --robot pipe.py", "robot: pipe.py is no file"),
        ("simulate --robot stops.py", "stops.py: BaseException: no"),
        ("export rolling --dry-run --rig pipe.toml", "pipe.toml: cannot be read (it is a pipe or device, give a file)"),
        (f"simulate --gait rolling --out {300 * 'a'}", "a name of 300 characters is too long for a file"),
    ],
)
def test_files_that_never_end_and_code_that_gives_up_are_bad_input(morpholab, tmp_path, line, told):
    for name in ("pipe", "pipe.py", "pipe.toml"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "stops.py").write_text("raise BaseException('no')\n")
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.endswith(f"error: {told}\n") and error.count("\n") == 1


def test_a_working_directory_that_was_deleted(tmp_path):
    (tmp_path / "gone").mkdir()
    shell = 'cd gone && rmdir ../gone && exec "$0" -P -m optim status runs'
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.run(
        ["sh", "-c", shell, sys.executable], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert process.returncode == 1
    assert process.stderr == "morpholab: failed: the working directory was deleted; change to another one\n"


def test_archives_that_would_fill_the_memory_are_refused(tmp_path, monkeypatch):
    """Before they are unpacked: a gzip file, a file of arrays, and a file that is too large itself."""
    monkeypatch.setattr(files, "LARGEST_UNPACKED", 10_000)
    packed = files.pack({"many": np.zeros(100_000)})
    with pytest.raises(ValueError, match="800128 bytes of arrays are not allowed, at most 10000 are"):
        files.unpack(packed)
    assert files.unzipped(gzip.compress(bytes(1000)), 1000) == bytes(1000)
    with pytest.raises(OSError, match="more than 999 bytes when decompressed are not allowed"):
        files.unzipped(gzip.compress(bytes(1000)), 999)
    (tmp_path / "large").write_bytes(bytes(11))
    with pytest.raises(ValueError, match=r"large: cannot be read \(11 bytes are not allowed, give at most 10\)"):
        files.read_bytes(tmp_path / "large", 10)


def test_a_missing_module_is_told_as_that(morpholab, monkeypatch):
    def broken(*_):
        raise ModuleNotFoundError("No module named 'rich.progress'", name="rich.progress")

    monkeypatch.setattr("optim.commands.simulate.loaded", broken)
    told = "morpholab simulate: failed: the module rich.progress is missing; install morpholab's dependencies\n"
    assert morpholab("simulate --gait rolling") == (1, "", told)


def test_ctrl_c_during_the_import_of_the_compiler_lets_the_next_call_work():
    interrupted = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "taichi.lang.ast":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    import taichi_sim.runtime
except KeyboardInterrupt:
    print("interrupted")
from taichi_sim.runtime import ti
print(ti.lang.__name__)
"""
    process = run("-c", interrupted, stdout=subprocess.PIPE)
    assert (process.returncode, process.stdout) == (0, "interrupted\ntaichi.lang\n"), process.stderr
