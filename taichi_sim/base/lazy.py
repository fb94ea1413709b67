"""Public names of a package that are imported when they are first used, so that importing the package is quick."""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any


def exported_from(package: str, module: str, names: Sequence[str]) -> Callable[[str], Any]:
    """A package's ``__getattr__`` (PEP 562) that takes public names from one of its modules.

    Args:
        package: ``__name__`` of the package.
        module: full name of the module that defines them.
        names: which names, normally ``__all__`` of the package.
    """

    def __getattr__(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(module), name)
        setattr(sys.modules[package], name, value)  # found at once the next time
        return value

    return __getattr__
