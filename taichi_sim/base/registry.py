"""Registries: find things by name, built-in ones and those that installed packages add as entry points."""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module, metadata
from typing import Generic, TypeVar

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
    """

    def __init__(self, group: str, noun: str, builtin: Mapping[str, str]) -> None:
        self.group, self.noun, self.builtin = group, noun, dict(builtin)
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

    def package_of(self, name: object) -> str | None:
        """The installed package that adds the thing of a name; None of built-in things and of unknown names."""
        if not isinstance(name, str) or name in self.builtin:
            return None
        return next((entry.dist.name for entry in self._entries().select(name=name) if entry.dist), None)

    def _load(self, name: str) -> Thing:
        if name in self.builtin:
            module, _, attribute = self.builtin[name].partition(":")
            found: Thing = getattr(import_module(module), attribute)
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
            loaded: Thing = entries[0].load()
        except Exception as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(f"{self.noun}: {name!r} of the package {packages} cannot be imported ({why})") from error
        return loaded

    def _entries(self) -> metadata.EntryPoints:
        return metadata.entry_points(group=self.group)
