"""Runs: a folder on disk and the loop that fills it, able to continue exactly after any interruption."""

from optim.runs.config import read_config
from optim.runs.folder import RunFolder, open_run
from optim.runs.generation import Generation
from optim.runs.loop import run_search

__all__ = ["Generation", "RunFolder", "open_run", "read_config", "run_search"]
