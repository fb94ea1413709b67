"""Which compiler of kernels a process uses: Taichi, or Quadrants, its maintained fork."""

import os
from importlib.metadata import PackageNotFoundError, version

COMPILERS = ("taichi", "quadrants")  # by preference: they are packages, too
VARIABLE = "MORPHOLAB_COMPILER"


def compiler() -> str:
    """Name of the compiler: that of the environment variable ``MORPHOLAB_COMPILER``, else the first that is installed.

    Raises:
        ValueError: for a name that is not known, or a compiler that is not installed.
    """
    wanted = os.environ.get(VARIABLE)
    if wanted and wanted not in COMPILERS:
        raise ValueError(f"{VARIABLE}: {wanted!r} is unknown; give one of {', '.join(COMPILERS)}")
    for name in [wanted] if wanted else COMPILERS:
        if installed_version(name):
            return name
    raise ValueError(f"{VARIABLE}: {wanted or ' or '.join(COMPILERS)} is not installed; install it with pip")


def installed_version(package: str) -> str | None:
    """Version of an installed package, which is not imported; None for one that is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
