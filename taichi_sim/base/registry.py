"""Registries: find things by name, built-in ones and those that installed packages add as entry points."""

import difflib
import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from importlib import metadata
from typing import Generic, TypeVar

from taichi_sim.base.foreign import failure_of, lacks_memory, said_by, staying
from taichi_sim.base.lazy import imported

Thing = TypeVar("Thing")


class Registry(Mapping[str, Thing], Generic[Thing]):
    """Things by name, built-in or added by installed packages; each is imported when it is first used.

    A package adds one in its ``pyproject.toml``; a built-in name cannot be taken::

        [project.entry-points."morpholab.methods"]
        annealing = "my_package.annealing:Annealing"

    Listing names reads the metadata of installed packages and runs no code of theirs.

    Args:
        group: group name of the entry points, such as ``"morpholab.methods"``.
        noun: what error messages call one of these things; the name of the field that holds it.
        builtin: where each built-in thing is defined, as ``"module:attribute"``, by name.
        instances_of: what things of packages must be instances of.
        classes_of: or subclasses of.
    """

    def __init__(
        self,
        group: str,
        noun: str,
        builtin: Mapping[str, str],
        *,
        instances_of: type | None = None,
        classes_of: type | None = None,
    ) -> None:
        self.group, self.noun, self.builtin = group, noun, dict(builtin)
        self._instances_of, self._classes_of = instances_of, classes_of
        self._loaded: dict[str, Thing] = {}

    def __iter__(self) -> Iterator[str]:
        """All names: built-in ones first, then those of packages in alphabetical order."""
        yield from self.builtin
        yield from sorted(self._entries().names - set(self.builtin))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self.builtin or name in self._entries().names

    def __getitem__(self, name: str) -> Thing:
        """Import and return the thing of this name.

        Raises:
            KeyError: if there is none.
            ValueError: if a package's thing cannot be imported, or several packages give the same name.
        """
        if name not in self._loaded:
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def find(self, name: object) -> Thing:
        """Import and return the thing of a name that a user gave.

        Raises:
            ValueError: if there is none, with the nearest name; or if it cannot be imported.
        """
        return self[self.check(name)]

    def check(self, name: object, besides: Iterable[str] = ()) -> str:
        """Check that a thing of this name exists, without importing it, and return the name.

        Args:
            name: that a user gave.
            besides: what else would have been allowed, for the message.

        Raises:
            ValueError: if there is none, with the nearest name.
        """
        if isinstance(name, str) and name in self:
            return name
        known = [*self, *besides]
        close = difflib.get_close_matches(name, known, n=1) if isinstance(name, str) else []
        hint = f"did you mean {close[0]}? all of them: " if close else "choose one of "
        raise ValueError(f"{self.noun}: {name!r} is unknown; {hint}{', '.join(known)}")

    def usable(self) -> Iterator[tuple[str, Thing]]:
        """All names and things; those of packages that cannot be imported are left out, and a warning says so."""
        for name in self:
            try:
                found = self[name]
            except ValueError as error:
                warnings.warn(f"{error}; it is left out", UserWarning, stacklevel=2)
            else:
                yield name, found

    def package_of(self, name: object) -> str | None:
        """The installed package that adds the thing of a name; None of built-in things and of unknown names."""
        if not isinstance(name, str) or name in self.builtin:
            return None
        return next((entry.dist.name for entry in self._entries().select(name=name) if entry.dist), None)

    def _load(self, name: str) -> Thing:
        if name in self.builtin:
            found: Thing = imported(self.builtin[name])
            return found
        entries = list(self._entries().select(name=name))
        if not entries:
            raise KeyError(name)
        packages = ", ".join(sorted(entry.dist.name if entry.dist else "?" for entry in entries))
        if len(entries) > 1:
            raise ValueError(
                f"{self.noun}: {name!r} is defined by several packages ({packages}); uninstall all but one"
            )
        try:
            with staying():
                loaded: Thing = entries[0].load()
        except BaseException as raised:
            if lacks_memory(raised):
                raise
            error = failure_of(raised)
            why = said_by(error) or type(error).__name__
            raise ValueError(f"{self.noun}: {name!r} of the package {packages} cannot be imported ({why})") from raised
        self._check_type(name, packages, loaded)
        return loaded

    def _check_type(self, name: str, packages: str, loaded: object) -> None:
        """Raise a one-line ValueError for a thing of a package that is not what this registry holds."""
        whole, part = self._instances_of, self._classes_of
        fits = (whole is None and part is None) or (whole is not None and isinstance(loaded, whole))
        if not fits and not (part is not None and isinstance(loaded, type) and issubclass(loaded, part)):
            allowed = [f"an instance of {whole.__name__}"] if whole else []
            allowed += [f"a class derived from {part.__name__}"] if part else []
            raise ValueError(
                f"{self.noun}: {name!r} of the package {packages} is of type {type(loaded).__name__}; give "
                f"{' or '.join(allowed)}"
            )

    def _entries(self) -> metadata.EntryPoints:
        return _installed(self.group, tuple(_state(folder) for folder in sys.path))


@lru_cache(maxsize=64)
def _installed(group: str, folders: tuple[tuple[int, int, int] | None, ...]) -> metadata.EntryPoints:
    """Entry points of a group; all installed packages are read anew when folders on the path are others or changed."""
    return metadata.entry_points(group=group)


def _state(folder: str) -> tuple[int, int, int] | None:
    """What tells that it is the same folder and that nothing was installed there, or removed; None without one."""
    try:
        found = os.stat(folder or os.curdir)
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_mtime_ns
