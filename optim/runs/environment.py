"""What a run ran on."""

import os
import platform
import shlex
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = ("morpholab", "numpy", "taichi")


def environment(**more: Any) -> dict[str, Any]:
    """Versions, machine and command line of this process, with ``more`` about the run; fits JSON."""
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "command": shlex.join(sys.argv),
        **more,
    }


def _version(package: str) -> str | None:
    try:
        return version(package)  # from the package's metadata: importing it would start it
    except PackageNotFoundError:
        return None
