"""What a run ran on."""

import os
import platform
import shlex
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = ("morpholab", "numpy", "taichi")


def environment(**more: Any) -> dict[str, Any]:
    """Versions, machine and command line of this process, with ``more`` about the run; fits JSON."""
    return {
        **software(),
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "command": shlex.join(sys.argv),
        **more,
    }


def software() -> dict[str, Any]:
    """Versions and processor of this process: what the last bits of a result can depend on."""
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        "machine": platform.machine(),
        "processor": _processor(),
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Where two environments differ in what results can depend on, such as ``numpy 2.4.6, now 2.5.0``."""
    known, found = before.get("versions", {}), now.get("versions", {})
    pairs = [(name, known.get(name), found.get(name)) for name in (*known, *(set(found) - set(known)))]
    pairs += [(name, before.get(name), now.get(name)) for name in ("machine", "processor")]
    return [f"{name} {old}, now {new}" for name, old, new in pairs if old != new]


def _processor() -> str | None:
    """Model of the processor, where the system tells."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), None)
    except OSError:
        return platform.processor() or None


def _version(package: str) -> str | None:
    try:
        return version(package)  # from the package's metadata: importing it would start it
    except PackageNotFoundError:
        return None
