"""Settings that all tests share, and the command line."""

import shlex

import pytest
from hypothesis import settings
from stand_in import Simulator

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


@pytest.fixture
def simulator(monkeypatch):
    """The stand-in, in a folder and with pictures of its own."""
    stand_in = Simulator()
    monkeypatch.setattr("robots.inflatable.simulate", stand_in)
    monkeypatch.setattr("robots.gaits.simulate_relaxed", stand_in)
    picture = lambda design, terrain, path, **_: path.write_text(f"{terrain.name} {design}")  # noqa: E731
    monkeypatch.setattr("robots.view.picture.save_motion_picture", picture)
    return stand_in
