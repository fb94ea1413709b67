"""The start of the command ``morpholab``, which Ctrl-C may meet while modules are still being imported."""

import os
import sys


def start() -> int:
    """Import and run the command; its exit code, see :func:`optim.cli.main`.

    Its pictures are the same for everybody: neither windows nor styles that a user has set up for matplotlib count.
    """
    os.environ |= {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    try:
        from optim.cli import main

        return main()
    except KeyboardInterrupt:  # before a command has begun, which tells of it itself
        from optim.exit_codes import INTERRUPTED

        print("morpholab: interrupted", file=sys.stderr)  # silent, if stderr is closed
        return INTERRUPTED
