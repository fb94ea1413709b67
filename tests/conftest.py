"""Settings that all tests share, and the command line."""

import shlex

import pytest
from hypothesis import settings

from optim.cli import main

# The same examples in every run, and no deadline: shared machines pause.
settings.register_profile("lab", derandomize=True, deadline=None)
settings.load_profile("lab")


@pytest.fixture
def morpholab(tmp_path, monkeypatch, capfd):
    """Runs a command line in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(line):
        try:
            code = main(shlex.split(line))
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run
