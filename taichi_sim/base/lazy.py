"""Lazy imports: a package's public names are imported when first used, so that importing the package is quick."""

import ast
import inspect
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def exported(package: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """Make a package's ``__getattr__`` (PEP 562), which imports each public name from its module when it is used.

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

    return __getattr__


def exported_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make a package's ``__getattr__`` and ``__dir__`` for all that it imports under ``if TYPE_CHECKING:``.

    So each public name stands in the package once, where type checkers and editors find it, too.
    """
    blocks = [block for block in ast.parse(inspect.getsource(sys.modules[package])).body if isinstance(block, ast.If)]
    imports = [line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom)]
    places = {name.name: line.module or "" for line in imports for name in line.names}
    return exported(package, places), lambda: sorted({*vars(sys.modules[package]), *places})
