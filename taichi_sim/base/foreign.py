"""Runs code that is not morpholab's, users' files and optional packages, and tells whose fault an exception is."""

import contextlib
import dis
import errno
import os
import sys
import traceback
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import FrameType, ModuleType
from typing import TypeVar

# What loaders, compilers and C++ say where memory ends; the last is of a thread whose stack finds no place.
NO_MEMORY = (
    *("memory allocation", "failed to map segment", "bad_alloc", "ut of memory", "annot allocate memory"),
    "Resource temporarily unavailable",
)
BLAMED = "a fault of "  # how notes at exceptions begin that say whose fault they are
LONGEST_SAID = 300  # characters of what an exception says
OWN_PACKAGES = "morpholab", "optim", "robots", "taichi_sim"
GROUPS = "morpholab."  # how the names of all groups of entry points begin
Wanted = TypeVar("Wanted")


@contextlib.contextmanager
def needing(field: str, packages: str, extra: str) -> Iterator[None]:
    """Import optional packages inside; if one is missing, ``field`` says how to install the extra that has them.

    Raises:
        ValueError: if one is missing.
    """
    try:
        yield
    except ImportError as error:
        if lacks_memory(error):
            raise
        raise ValueError(f"{field}: {packages} is missing; {install_extra(extra)}") from None


@contextlib.contextmanager
def staying() -> Iterator[None]:
    """Run users' code inside, which may change the working folder: it is the same again afterwards.

    Relative paths of a command, such as where results go, are meant from there.
    """
    try:
        here = os.getcwd()
    except OSError:  # it has been deleted, and nobody can return to it
        here = ""
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if here and os.getcwd() != here:
                os.chdir(here)


@contextlib.contextmanager
def users_code(file: object) -> Iterator[None]:
    """Run a user's file inside; an exception that leaves it is told in one line, with the name of the file.

    Raises:
        ValueError: for any exception and for an exit, but for Ctrl-C and lack of memory, which pass.
    """
    try:
        with staying():
            yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if lacks_memory(error):
            raise
        raise ValueError(f"{file}: {class_and_message(error)}") from None


@contextlib.contextmanager
def modules_beside(folder: str | os.PathLike[str], kept: dict[str, ModuleType] | None = None) -> Iterator[None]:
    """Run a user's file of a folder inside, which may import the modules beside it.

    It does not get those that a file of another folder, or the user's own program, has imported by the same names;
    these have theirs again afterwards. Its own of these names are put into ``kept``, and taken from there if it is
    given again, so that they run once.
    """
    place = Path(os.path.realpath(folder))
    aside = _set_aside(place)
    own = {} if kept is None else kept
    sys.modules.update(own)
    sys.path.insert(0, str(place))
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # the file may have changed the path itself
            sys.path.remove(str(place))
        for name in {each.partition(".")[0] for each in (*aside, *own)}:
            own.update(_forget(name))
        sys.modules.update(aside)


def _set_aside(place: Path) -> dict[str, ModuleType]:
    """Take away modules of other folders that are called as those of this one are; return them."""
    found: dict[str, ModuleType] = {}
    there = {each.removesuffix(".py") for each in _names_in(place)} - {*OWN_PACKAGES, *sys.stdlib_module_names}
    for name in there & {each.partition(".")[0] for each in [*sys.modules]}:
        file = getattr(sys.modules.get(name), "__file__", None)
        is_named_so = (place / f"{name}.py").is_file() or (place / name / "__init__.py").is_file()
        if is_named_so and isinstance(file, str) and not _lies_in(place, name) and not _is_installed(file):
            found |= _forget(name)
    return found


def _names_in(folder: Path) -> list[str]:
    """Names of what is in a folder; none if it cannot be read."""
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _forget(name: str) -> dict[str, ModuleType]:
    """Take a module and those in it away, and return them."""
    found = {each: sys.modules.pop(each, None) for each in [*sys.modules] if each.partition(".")[0] == name}
    return {each: module for each, module in found.items() if module is not None}  # another thread may be faster


def _is_installed(file: str) -> bool:
    return not {"site-packages", "dist-packages"}.isdisjoint(Path(file).parts)


def _lies_in(folder: Path, name: str) -> bool:
    """Whether an imported module is a file of a folder, or a package in it."""
    file = getattr(sys.modules[name], "__file__", None)
    return isinstance(file, str) and Path(file) in (folder / f"{name}.py", folder / name / "__init__.py")


@contextlib.contextmanager
def blamed(file: str, run_as: str) -> Iterator[None]:
    """Run functions of a user's file inside; an exception that comes from it passes, with a note of file and line.

    The note survives workers, which pass exceptions on; :func:`blame` finds it. See also :func:`failure_of`.

    Args:
        file: its name, for people.
        run_as: path under which Python has run it.
    """
    try:
        with staying():
            yield
    except BaseException as raised:
        error = failure_of(raised)
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == run_as]
        if lines and not lacks_memory(error) and not blame(error):
            error.add_note(f"{BLAMED}{_place_and_message(raised, file, lines[-1])}")
        if error is not raised:
            raise error from None
        raise


def method_of(user: object, name: str) -> str:
    """How to tell people of a method of a user's class: ``module.Class.name``."""
    return f"{type(user).__module__}.{type(user).__qualname__}.{name}"


def returned(given: object, wanted: type[Wanted], place: str, noun: str) -> Wanted:
    """What users' code returned, if it is of the type that is wanted.

    Args:
        given: what it returned.
        wanted: the type.
        place: what returned it, such as ``"robot: package.Hopper.run"``.
        noun: what it should return, for people.

    Raises:
        ValueError: if it is of another type.
    """
    if not isinstance(given, wanted):
        raise ValueError(f"{place} returns a value of type {type(given).__name__}; return {noun}")
    return given


def failure_of(raised: BaseException) -> Exception:
    """What users' code has raised, as a failure of that code; for ``except BaseException``.

    What is no ``Exception``, such as an exit or a panic of Rust, becomes a RuntimeError that tells its class: it ends
    no program that calls the code.

    Raises:
        KeyboardInterrupt: if that is what was raised.
    """
    if isinstance(raised, KeyboardInterrupt):
        raise raised
    if isinstance(raised, Exception):
        return raised
    return RuntimeError(class_and_message(raised)).with_traceback(raised.__traceback__)


@contextlib.contextmanager
def blamed_package() -> Iterator[None]:
    """Run what an installed package may have added inside; an exception that comes from it passes, with such a note."""
    try:
        yield
    except BaseException as raised:
        error = blaming_package(raised, refusals=True)
        if error is not raised:
            raise error from None
        raise


def blaming_package(raised: BaseException, refusals: bool = False) -> Exception:
    """What was raised, as :func:`failure_of` has it, with a note of :func:`blame_package` if a package is at fault.

    Raises:
        KeyboardInterrupt: if that is what was raised.
    """
    error = failure_of(raised)
    if told := blame_package(raised, refusals):
        error.add_note(f"{BLAMED}{told}")
    return error


def blame_package(error: BaseException, refusals: bool = False) -> str:
    """File and line of a package that adds to morpholab which is at fault for an exception; empty if none is.

    A refusal, a ValueError or error of the system that morpholab or the package raises on purpose and that says why, is
    a fault only where ``refusals`` says that there is nothing to refuse.
    """
    if lacks_memory(error) or blame(error):
        return ""
    if not refusals and isinstance(error, ValueError | OSError) and said_by(error) and _is_meant(error):
        return ""
    packages = _packages_that_add()
    walked = traceback.walk_tb(error.__traceback__)
    frames = [(frame, line) for frame, line in walked if _package_of(frame) in packages]
    return _place_and_message(error, frames[-1][0].f_code.co_filename, frames[-1][1]) if frames else ""


def _is_meant(error: BaseException) -> bool:
    """Whether morpholab or a package's own ``raise`` made an exception, not what it calls, such as NumPy."""
    inner = last = None
    packages = {*OWN_PACKAGES, *_packages_that_add()}
    each = error.__traceback__
    while each is not None:
        inner, each = each, each.tb_next
        last = inner if _package_of(inner.tb_frame) in packages else last
    if last is None or _package_of(last.tb_frame) in OWN_PACKAGES:
        return True
    return last is inner and dis.opname[last.tb_frame.f_code.co_code[last.tb_lasti]] == "RAISE_VARARGS"


def _packages_that_add() -> set[str]:
    """Names of the modules of installed packages that add to morpholab."""
    entries = (entry for package in metadata.distributions() for entry in package.entry_points)
    return {entry.module.partition(".")[0] for entry in entries if entry.group.startswith(GROUPS)}


def _package_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__")).partition(".")[0]


def _place_and_message(error: BaseException, file: str, line: int | None) -> str:
    """Where an exception was raised, and what it says."""
    return f"{file}, line {line}: {class_and_message(error)}"


def class_and_message(error: BaseException) -> str:
    """The class of an exception and what it says, in one line that is cut off if it is long."""
    said = said_by(error)
    told = said if len(said) <= LONGEST_SAID else f"{said[:LONGEST_SAID]}... ({len(said)} characters)"
    return f"{type(error).__name__}{told and ': '}{told}"


def said_by(error: BaseException) -> str:
    """What an exception says, in one line; nothing if it fails to say it."""
    try:
        return " ".join(str(error).split())
    except Exception:  # of a class of users' code
        return ""


def blame(error: BaseException) -> str:
    """File and line of a user's code in which an exception was raised, and what it says; empty if in none."""
    notes = getattr(error, "__notes__", [])
    return next((note.removeprefix(BLAMED) for note in notes if note.startswith(BLAMED)), "")


def lacks_memory(error: BaseException) -> bool:
    """Whether memory is the reason of an error, be it Python's, the system's, a loader's or a compiler's."""
    if isinstance(error, OSError) and error.errno == errno.ENOMEM:
        return True
    told = isinstance(error, RuntimeError | ImportError) and any(words in said_by(error) for words in NO_MEMORY)
    return told or isinstance(error, MemoryError)


def install_extra(name: str) -> str:
    """Text for messages: how to install an optional dependency group of morpholab."""
    return f"install the extra {name} (pip install -e '.[{name}]' in a clone)"
