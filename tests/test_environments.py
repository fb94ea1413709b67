"""A command in many environments: the same document in all, or one line that says what is in the way."""

import json
import os
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytestmark = [pytest.mark.kernels, pytest.mark.long]
ROOT = Path(__file__).resolve().parents[1]
SIMULATE = ("simulate", "--robot", "vehicle", "--json")
SEARCH = ("codesign", "--robot", "vehicle", "--climbers", "3", "--generations", "2", "--quiet", "--json", "--out", "a")


def limited(what, value):
    """Before the command: a limit of its process."""
    return lambda: resource.setrlimit(what, (value, value))


def harmed(harm):
    """Before the command: a cache that it has filled, of which every file is harmed."""

    def prepare(folder):
        code, _, error = told(folder, cache="cache")
        files = [path for path in (folder / "cache").rglob("*") if path.is_file()]
        assert code == 0 and len(files) > 1, error
        for path in files:
            path.write_bytes(harm(path.read_bytes()))

    return prepare


def told(folder, *flags, command=SIMULATE, cache=None, before=None, prepare=None, shell=None, **environment):
    """What the command says in an environment: exit code, document, stderr."""
    if prepare:
        prepare(folder)
    # A cache of its own where the cache matters; else that of the tests.
    values = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    if cache:
        values["MORPHOLAB_CACHE"] = str(folder / cache)
    values = {name: value for name, value in values.items() if value is not None}
    line = [sys.executable, *flags, "-m", "optim", *command]
    line = ["sh", "-c", f'exec "$@" {shell}', "sh", *line] if shell else line
    done = subprocess.run(
        line, cwd=folder, env=values, capture_output=True, text=True, timeout=300, check=False, preexec_fn=before
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode >= 0, f"killed by signal {-done.returncode}: {done.stderr}"
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """What both commands say where nothing is in the way."""
    found = {command: told(tmp_path_factory.mktemp("usual"), command=command) for command in (SIMULATE, SEARCH)}
    assert all((code, error) == (0, "") for code, _, error in found.values())
    return {command: json.loads(out) for command, (_, out, _) in found.items()}


SLOW = pytest.mark.slow
ENVIRONMENTS = {
    "no home": {"HOME": None},
    "a home that is not there": {"HOME": "/nowhere/at/all", "XDG_CACHE_HOME": None},
    "a cache that is a file": {"MORPHOLAB_CACHE": "/dev/null/cache"},
    "an empty cache": {"cache": "cache"},
    "a cache of garbage": {"cache": "cache", "prepare": harmed(lambda content: b"\x93 nothing that was ever a kernel")},
    "a cache of halves": {"cache": "cache", "prepare": harmed(lambda content: content[: len(content) // 2])},
    "no files above 64 kB": {"cache": "cache", "before": limited(resource.RLIMIT_FSIZE, 65_536)},
    "few open files": {"before": limited(resource.RLIMIT_NOFILE, 64)},
    "no core dumps": {"before": limited(resource.RLIMIT_CORE, 0)},
    "a small stack": {"before": limited(resource.RLIMIT_STACK, 1 << 20)},
    "4 GB of address space": {"before": limited(resource.RLIMIT_AS, 4 << 30)},
    "no terminal that is known": {"TERM": "unknown", "COLUMNS": "0"},
    "a narrow terminal": {"COLUMNS": "1", "TERM": "dumb"},
    "plain ASCII": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "a locale that is not there": {"LC_ALL": "xx_YY.UTF-8"},
    "no folder for temporary files": {"TMPDIR": "/nowhere"},
    "standard input closed": {"shell": "<&-"},
    "standard error closed": {"shell": "2>&-"},
    "many threads of libraries": {"OMP_NUM_THREADS": "64", "MKL_NUM_THREADS": "64"},
    "threads that are no number": {"OMP_NUM_THREADS": "many"},
    "another order of sets": {"PYTHONHASHSEED": "12345"},
    "nothing set but the path": {name: None for name in os.environ if name not in ("PATH", "MORPHOLAB_CACHE")},
}
FLAGS = {
    "optimised": ["-O"],
    "without docstrings": ["-OO"],
    "warnings are errors": ["-W", "error"],
    "developing": ["-X", "dev"],
}
QUICK = ("no home", "a cache of garbage", "no files above 64 kB", "plain ASCII", "optimised", "warnings are errors")


def marked(names):
    return [pytest.param(name, marks=() if name in QUICK else SLOW) for name in names]


@pytest.mark.parametrize("name", marked([*ENVIRONMENTS, *FLAGS]))
def test_a_trial_is_the_same_everywhere(name, usual, tmp_path):
    code, out, error = told(tmp_path, *FLAGS.get(name, ()), **ENVIRONMENTS.get(name, {}))
    assert code == 0 and json.loads(out) == usual[SIMULATE], error
    assert error.count("\n") <= 1 and (not error or error.startswith("note: ")), error


@SLOW
@pytest.mark.parametrize("name", [*ENVIRONMENTS, *FLAGS])
def test_a_search_is_the_same_everywhere(name, usual, tmp_path):
    code, out, error = told(tmp_path, *FLAGS.get(name, ()), command=SEARCH, **ENVIRONMENTS.get(name, {}))
    assert code == 0 and same_run(json.loads(out), usual[SEARCH]), error
    assert error.count("\n") <= 1 and (not error or error.startswith("note: ")), error


def same_run(found, expected):
    """Whether two runs have found the same score in as many evaluations."""
    return {name: found[name] for name in ("best", "evaluations")} == {
        name: expected[name] for name in ("best", "evaluations")
    }


@SLOW
def test_many_compile_at_once_into_one_cache(usual, tmp_path):
    folders = [tmp_path / str(n) for n in range(6)]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor(len(folders)) as pool:
        found = list(pool.map(lambda folder: told(folder, MORPHOLAB_CACHE=str(tmp_path / "cache")), folders))
    assert [(code, json.loads(out), error) for code, out, error in found] == [(0, usual[SIMULATE], "")] * len(folders)
