"""Describe the environment of a run: machine, versions and command line."""

import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from taichi_sim.base import files
from taichi_sim.base.compiler import COMPILERS, compiler, installed_version

EVALUATING = ("morpholab", "numpy", *COMPILERS)  # packages that evaluations depend on
SEARCHING = ("cmaes", "pymoo")  # packages whose operators some searches use
LAWS = "laws"  # version of the laws of simulation; morpholab's own version changes at releases only
PRESENT_LAWS, FIRST_LAWS = "12", "1"  # the first is raised when a law changes results; old folders, with none, have "1"
CODE = " (code "  # separates the version of a user's package from the checksum of its code


def environment(added: Iterable[str] = (), **more: Any) -> dict[str, Any]:
    """Describe versions, machine and command line of this process as a dictionary for JSON.

    Args:
        added: names of the users' packages that the run needs, see ``optim.runs.plug_ins``.
        **more: further entries about the run.
    """
    return {
        "versions": versions(added),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "processor": cpu_model(),
        "cpu_count": os.cpu_count(),
        "command": shlex.join(sys.argv),
        **more,
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """List differences between two environments that can change results, such as ``numpy 2.4.6, now 2.5.0``.

    Entries that ``before`` lacks are unknown, not different; so is the checksum of the code of a user's package.
    """
    known, found = before.get("versions", {}), now.get("versions", {})
    if known and found:
        known = {**known, LAWS: known.get(LAWS, FIRST_LAWS)}
    pairs = [(name, known[name], _comparable(known[name], found.get(name))) for name in known]
    pairs += [(name, before.get(name), now.get(name)) for name in ("machine", "processor")]
    return [f"{name} {old}, now {new}" for name, old, new in pairs if old != new]


def versions(added: Iterable[str] = ()) -> dict[str, str | None]:
    """Versions of Python, of the packages that results depend on, and of the laws of simulation.

    None for packages that are missing or not used. ``added`` are packages of users; they are often edited between
    releases, so a checksum of their code follows their version.
    """
    known = {name: _version(name) for name in (*EVALUATING, *SEARCHING)}
    packages = {"python": platform.python_version(), **known, **{name: _version_with_code(name) for name in added}}
    return {**packages, LAWS: PRESENT_LAWS}


def other_version(here: Mapping[str, Any], there: Mapping[str, Any]) -> tuple[str, str | None, str | None] | None:
    """Find the first package with different versions on two machines: its name, version here and version there.

    Packages in ``SEARCHING`` may differ. None if there is no such package.
    """
    for name in [name for name in {**here, **there} if name not in SEARCHING]:
        if _essential(name, here.get(name)) != _essential(name, there.get(name)):
            return name, here.get(name), there.get(name)
    return None


def cpu_model() -> str:
    """Model of the CPU; kernels are compiled for it, so results of two models may differ in their last bits."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _version(package: str) -> str | None:
    """Version of a package; None if it is not installed, or is a compiler that is not in use."""
    return None if package in COMPILERS and package != compiler() else installed_version(package)


def _version_with_code(package: str) -> str | None:
    """Version of a user's package with a checksum of its code, such as ``1.0 (code 1f3a9c02)``."""
    version = _version(package)
    if version is None:
        return None
    modules = sorted({entry.module for entry in distribution(package).entry_points})
    paths = dict.fromkeys(path for module in modules for path in _files_of(module))  # each once
    code = "".join(files.sha256(path.read_bytes()) for path in paths)
    return f"{version}{CODE}{files.sha256(code.encode())[:8]})"


def _files_of(module: str) -> list[Path]:
    """Python files of the outermost package that contains a module, sorted; the module's own file if there is none.

    Namespace packages are skipped, as they also contain files of other distributions.
    """
    parts = module.split(".")
    for name in (".".join(parts[: count + 1]) for count in range(len(parts))):
        try:
            spec = find_spec(name)
        except (ImportError, ValueError):  # no such module, or one without a spec
            return []
        if spec is not None and spec.origin is not None:
            folders = spec.submodule_search_locations or ()
            found = [path for folder in folders for path in Path(folder).rglob("*.py")] or [Path(spec.origin)]
            return sorted(path for path in found if path.is_file())
    return []


def _comparable(before: str | None, now: str | None) -> str | None:
    """Present version of a package, without the checksum of its code if the earlier record has none."""
    return now.partition(CODE)[0] if now is not None and before is not None and CODE not in before else now


def _essential(name: str, version: str | None) -> str | None:
    """Part of a version that must agree; for Python, without the patch release."""
    return version.rpartition(".")[0] if name == "python" and version else version
