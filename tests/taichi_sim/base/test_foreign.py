"""Whose fault an exception is, where code runs that is not morpholab's."""

import asyncio
import errno
import os
import pickle
import sys

import pytest

from taichi_sim.base import foreign


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("no room"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("Resource temporarily unavailable"),
        ImportError("lib.so: failed to map segment from shared object"),
        RuntimeError("std::bad_alloc"),
    ],
)
def test_lack_of_memory_is_no_fault_of_a_package_or_a_file(error):
    with pytest.raises(type(error)), foreign.users_code("own.py"):
        raise error
    if isinstance(error, ImportError):
        with pytest.raises(ImportError), foreign.needing("video", "imageio", "video"):
            raise error


def test_what_a_package_or_a_file_is_at_fault_for_is_one_line():
    missing = pytest.raises(ValueError, match=r"^video: imageio is missing; install the extra video")
    with missing, foreign.needing("video", "imageio", "video"):
        raise ImportError("No module named imageio")
    for error in (SystemExit("no"), OSError(errno.ENOENT, "gone"), RuntimeError("a\nb")):
        with pytest.raises(ValueError, match=r"^own.py: .*(no|gone|a b)"), foreign.users_code("own.py"):
            raise error
    with pytest.raises(KeyboardInterrupt), foreign.users_code("own.py"):
        raise KeyboardInterrupt


def own(tmp_path, text: str):
    """A function of a file of that text, and the path of the file."""
    path = tmp_path / "own.py"
    path.write_text(text)
    names: dict = {}
    exec(compile(text, str(path), "exec"), names)
    return names["judge"], str(path)


@pytest.mark.parametrize("kind", [ZeroDivisionError, ValueError, OSError])
def test_an_exception_of_a_users_function_passes_and_tells_whose_it_is(kind, tmp_path):
    judge, path = own(tmp_path, f"def judge():\n    helper()\ndef helper():\n    raise {kind.__name__}('a\\nb:')\n")
    with pytest.raises(kind) as found, foreign.blamed("outer.py", "outer.py"), foreign.blamed("own.py", path):
        judge()
    for error in (found.value, pickle.loads(pickle.dumps(found.value))):
        assert foreign.blame(error) == f"own.py, line 4: {kind.__name__}: a b:"


class Panic(BaseException):
    """What goes past handlers of failures, as those of Rust do."""


class Leaving(SystemExit):
    """An exit of a user's own."""


UNCOMMON = [
    (Panic("a\nb"), "Panic: a b"),
    (Leaving(3), "Leaving: 3"),
    (SystemExit(), "SystemExit"),
    (GeneratorExit(), "GeneratorExit"),
    (asyncio.CancelledError(), "CancelledError"),
]


@pytest.mark.parametrize(("error", "told"), UNCOMMON)
def test_what_is_no_exception_is_a_failure_that_tells_its_class(error, told, tmp_path):
    judge, path = own(tmp_path, "def judge(error):\n    raise error\n")
    with pytest.raises(RuntimeError) as found, foreign.blamed("own.py", path):
        judge(error)
    assert (str(found.value), foreign.blame(found.value)) == (told, f"own.py, line 2: {told}")
    with pytest.raises(RuntimeError, match=rf"^{told}$"), foreign.blamed_package():
        judge(error)
    with pytest.raises(ValueError, match=rf"^own.py: {told}$"), foreign.users_code("own.py"):
        judge(error)


@pytest.mark.parametrize("kind", [KeyboardInterrupt, type("Own", (KeyboardInterrupt,), {})])
def test_an_interrupt_passes_users_code(kind, tmp_path):
    for users in (foreign.blamed("own.py", "own.py"), foreign.blamed_package(), foreign.users_code("own.py")):
        with pytest.raises(kind), users:
            raise kind


def test_generators_that_users_code_closes_end_as_ever():
    ended = []

    def steps():
        try:
            yield 1
        finally:
            ended.append(sys.exception())

    with foreign.blamed("own.py", __file__), foreign.blamed_package(), foreign.users_code("own.py"):
        for _ in steps():
            break
        assert isinstance(ended.pop(), GeneratorExit)


def test_a_call_that_is_refused_is_the_fault_of_the_line_that_makes_it(tmp_path):
    judge, path = own(tmp_path, "import math\ndef judge():\n    return math.sqrt(-1)\n")
    with pytest.raises(ValueError, match="math") as found, foreign.blamed("own.py", path):
        judge()
    assert foreign.blame(found.value).startswith("own.py, line 3: ValueError: ")


def test_an_exception_of_other_files_of_that_name_is_no_fault_of_the_file(tmp_path):
    judge, _ = own(tmp_path, "def judge():\n    raise ValueError\n")
    with pytest.raises(ValueError, match=r"^$") as found, foreign.blamed("own.py", "/elsewhere/own.py"):
        judge()
    assert foreign.blame(found.value) == ""


def test_users_code_leaves_the_working_folder_as_it_was(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    judge, path = own(tmp_path, "import os\ndef judge(fails):\n    os.chdir('/')\n    1 / (not fails)\n")
    for users in (foreign.staying(), foreign.users_code("own.py"), foreign.blamed("own.py", path)):
        with users:
            judge(False)
        assert os.getcwd() == str(tmp_path)
    with pytest.raises(ValueError, match=r"own.py: ZeroDivisionError"), foreign.users_code("own.py"):
        judge(True)
    assert os.getcwd() == str(tmp_path)
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with foreign.staying():
        judge(False)


def test_what_an_exception_says_is_one_line_or_nothing():
    class Speechless(ValueError):
        def __str__(self):
            raise OSError

    assert foreign.said_by(ValueError("a\n b")) == "a b"
    assert foreign.said_by(Speechless()) == ""
    assert foreign.class_and_message(Speechless("a")) == "Speechless" and not foreign.lacks_memory(Speechless())


def test_nobody_is_blamed_for_lack_of_memory_or_an_error_of_no_file():
    assert foreign.blame(ValueError("of morpholab")) == ""
    with pytest.raises(MemoryError) as found, foreign.blamed("own.py", __file__):
        raise MemoryError
    assert foreign.blame(found.value) == ""
