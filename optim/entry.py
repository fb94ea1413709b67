"""The start of the command ``morpholab``, which Ctrl-C may meet while modules are still being imported."""

import sys


def start() -> int:
    """Import and run the command; its exit code, see :func:`optim.cli.main`."""
    try:
        from optim.cli import main

        return main()
    except KeyboardInterrupt:  # before a command has begun, which tells of it itself
        from optim.interrupts import INTERRUPTED

        print("morpholab: interrupted", file=sys.stderr)  # silent, if stderr is closed
        return INTERRUPTED
