"""Which compiler of kernels a process takes."""

import json
import os
import subprocess
import sys

import pytest

from optim.runs.environment import versions
from taichi_sim.base import compiler as choice


def installing(monkeypatch, *names):
    """Pretend that these compilers are installed and no other; the environment says nothing."""
    monkeypatch.delenv(choice.VARIABLE, raising=False)
    monkeypatch.setattr(choice, "installed_version", lambda name: "1.0" if name in names else None)


def test_it_is_taichi_if_that_is_installed_else_quadrants(monkeypatch):
    installing(monkeypatch, "taichi", "quadrants")
    assert choice.compiler() == "taichi"
    installing(monkeypatch, "quadrants")
    assert choice.compiler() == "quadrants"


def test_the_environment_may_say_which(monkeypatch):
    installing(monkeypatch, "taichi", "quadrants")
    monkeypatch.setenv(choice.VARIABLE, "quadrants")
    assert choice.compiler() == "quadrants"


@pytest.mark.parametrize(
    ("there", "wanted", "line"),
    [
        (["taichi"], "halide", "MORPHOLAB_COMPILER: 'halide' is unknown; give one of taichi, quadrants"),
        (["taichi"], "quadrants", "MORPHOLAB_COMPILER: quadrants is not installed; install it with pip"),
        ([], "", "MORPHOLAB_COMPILER: taichi or quadrants is not installed; install it with pip"),
    ],
)
def test_what_is_not_there_is_told_in_one_line(monkeypatch, there, wanted, line):
    installing(monkeypatch, *there)
    monkeypatch.setenv(choice.VARIABLE, wanted)
    with pytest.raises(ValueError) as error:
        choice.compiler()
    assert str(error.value) == line


def test_runs_note_the_version_of_the_one_in_use():
    noted = versions()
    used = choice.compiler()
    assert noted[used] == choice.installed_version(used)
    assert [name for name in choice.COMPILERS if noted[name]] == [used]


@pytest.mark.kernels
def test_it_prints_nothing_but_results():
    """The compiler announces neither itself nor its own warnings, not even where its sources are compiled anew."""
    command = [sys.executable, "-m", "morpholab", "simulate", "--robot", "vehicle", "--json"]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": os.devnull}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == "" and json.loads(done.stdout)
