"""Lazy imports: a package's public names are imported when first used, so that importing the package is quick."""

import ast
import inspect
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

GetAttr, Dir = Callable[[str], Any], Callable[[], list[str]]


def exported(package: str, places: Mapping[str, str]) -> tuple[GetAttr, Dir]:
    """Make a package's ``__getattr__`` (PEP 562), which imports public names when they are used, and its ``__dir__``.

    What the package itself imports is in no listing: only public names are, and modules of it that are imported.

    Args:
        package: ``__name__`` of the package.
        places: full name of the module of each public name.
    """

    def __getattr__(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(places[name]), name)
        setattr(sys.modules[package], name, value)  # found at once the next time
        return value

    def __dir__() -> list[str]:
        here = vars(sys.modules[package])
        own = {name for name, value in here.items() if getattr(value, "__name__", "") == f"{package}.{name}"}
        special = {name for name in here if name.startswith("__") and name.endswith("__")}
        return sorted({*special, *own, *here.get("__all__", ()), *places})

    return __getattr__, __dir__


def imported(place: str) -> Any:
    """What has a place told by module and name, such as ``robots.view.film:save_gif``."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def exported_names(package: str) -> tuple[GetAttr, Dir, list[str]]:
    """Make ``__getattr__``, ``__dir__`` and ``__all__`` for all that a package imports under ``if TYPE_CHECKING:``.

    So each public name stands in the package once, where type checkers and editors find it, too.
    """
    blocks = [block for block in ast.parse(inspect.getsource(sys.modules[package])).body if isinstance(block, ast.If)]
    imports = [line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom)]
    places = {name.name: line.module or "" for line in imports for name in line.names}
    return *exported(package, places), sorted(places)
