"""A command in many environments: the same document in all, or one line that says what is in the way."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from taichi_sim.base.compiler import compiler

pytestmark = [pytest.mark.kernels, pytest.mark.long]
ROOT = Path(__file__).resolve().parents[1]
SIMULATE = ("simulate", "--robot", "vehicle", "--json")
SEARCH = ("codesign", "--robot", "vehicle", "--climbers", "3", "--generations", "2", "--quiet", "--json", "--out", "a")


ABORTS = (signal.SIGABRT, signal.SIGSEGV, signal.SIGBUS)  # LLVM's, and C++'s, where memory ends


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


def told(folder, *flags, command=SIMULATE, cache=None, before=None, prepare=None, shell=None, aborts=(), **environment):
    """What the command says in an environment: exit code, document, stderr; ``aborts`` are signals that may end it."""
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
    assert done.returncode >= 0 or -done.returncode in aborts, f"killed by signal {-done.returncode}: {done.stderr}"
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
    "another device for Taichi": {"TI_ARCH": "vulkan"},
    "a device that Taichi does not know": {"TI_ARCH": "none"},
    "another order of sets": {"PYTHONHASHSEED": "12345"},
    "nothing set but the path": {name: None for name in os.environ if name not in ("PATH", "MORPHOLAB_CACHE")},
}
FLAGS = {
    "optimised": ["-O"],
    "without docstrings": ["-OO"],
    "warnings are errors": ["-W", "error"],
    "developing": ["-X", "dev"],
}
QUICK = (
    "no home",
    "another device for Taichi",
    "a cache of garbage",
    "no files above 64 kB",
    "plain ASCII",
    "optimised",
    "warnings are errors",
)


def marked(names):
    return [pytest.param(name, marks=() if name in QUICK else SLOW) for name in names]


@pytest.mark.parametrize("name", marked([*ENVIRONMENTS, *FLAGS]))
def test_a_trial_is_the_same_everywhere(name, usual, tmp_path):
    code, out, error = told(tmp_path, *FLAGS.get(name, ()), **ENVIRONMENTS.get(name, {}))
    assert code == 0 and json.loads(out) == usual[SIMULATE], error
    assert error.count("\n") <= 1 and (not error or "note: " in error), error


def test_a_setting_of_taichi_that_it_does_not_take_is_named(tmp_path):
    name = "TI_RANDOM_SEED" if compiler() == "taichi" else "QD_RANDOM_SEED"
    code, _, error = told(tmp_path, **{name: "x"})
    assert code == 2 and f"environment: {compiler()} does not start with {name}=x (" in error and error.count("\n") == 1


@SLOW
@pytest.mark.parametrize("name", [*ENVIRONMENTS, *FLAGS])
def test_a_search_is_the_same_everywhere(name, usual, tmp_path):
    code, out, error = told(tmp_path, *FLAGS.get(name, ()), command=SEARCH, **ENVIRONMENTS.get(name, {}))
    assert code == 0 and same_run(json.loads(out), usual[SEARCH]), error
    assert error.count("\n") <= 1 and (not error or "note: " in error), error


def same_run(found, expected):
    """Whether two runs have found the same score in as many evaluations."""
    return {name: found[name] for name in ("best", "evaluations")} == {
        name: expected[name] for name in ("best", "evaluations")
    }


LIMITS = (160, 400, 1000, 1560, 1580, 1600, 1650, 1800)  # MB: Taichi asks for 1 GB of addresses when it starts
REPORT = ("report", "run", "--out", "page.html", "--quiet")
VIEW = ("view", "vehicle", "--out", "page.html", "--quiet")
MEASURE = ("measure", "--robot", "vehicle", "--controllers", "4", "--success", "closest<=1", "--quiet", "--out", "m")
SEVERAL = {  # a command, and the one that goes on where it ended
    "simulate": (SIMULATE, SIMULATE),
    "codesign": (SEARCH, ("codesign", "--resume", "--quiet", "--json", "--out", "a")),
    "report": (REPORT, REPORT),
    "view": (VIEW, VIEW),
    "measure": (MEASURE, MEASURE),
}


def files_of(folder):
    """Results below a folder, without times."""
    others = ("timing.jsonl", "environment.json", "checkpoint.npz", "checkpoint.previous.npz", ".lock")
    found = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in others]
    found = [path for path in found if not path.name.startswith(".aside-")]  # a kill may leave it
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


@SLOW
@pytest.mark.parametrize("name", SEVERAL)
def test_too_little_memory_is_told_and_costs_nothing_else(name, tmp_path):
    command, again = SEVERAL[name]
    (tmp_path / "whole").mkdir()
    run = [*SEARCH[:-1], "run"]
    assert name != "report" or told(tmp_path / "whole", command=run)[0] == 0
    for mb in LIMITS:
        shutil.copytree(tmp_path / "whole", tmp_path / str(mb))
    assert told(tmp_path / "whole", command=command)[0] == 0
    whole, failed = files_of(tmp_path / "whole"), 0
    for mb in LIMITS:
        folder = tmp_path / str(mb)
        code, _, error = told(folder, command=command, aborts=ABORTS, before=limited(resource.RLIMIT_AS, mb << 20))
        assert code in (0, 1) or code < 0, f"{mb} MB: {error}"
        if code == 1:
            *_, line = error.splitlines()  # Taichi may tell its own before
            assert "there is not enough memory" in line, f"{mb} MB: {error}"
        if code:
            failed += 1
            begun = (folder / "a/config.toml").exists()
            assert begun or files_of(folder).items() <= whole.items(), f"{mb} MB: something is half written"
            assert told(folder, command=again if begun else command)[0] == 0
        assert files_of(folder) == whole, f"{mb} MB"
    assert failed


@SLOW
def test_many_compile_at_once_into_one_cache(usual, tmp_path):
    folders = [tmp_path / str(n) for n in range(6)]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor(len(folders)) as pool:
        found = list(pool.map(lambda folder: told(folder, MORPHOLAB_CACHE=str(tmp_path / "cache")), folders))
    assert [(code, json.loads(out), error) for code, out, error in found] == [(0, usual[SIMULATE], "")] * len(folders)


def test_pictures_are_the_same_whatever_a_user_has_set_up_for_matplotlib(tmp_path):
    (tmp_path / "odd").write_text("savefig.bbox: tight\naxes.grid: True\ntext.usetex: True\nfont.size: 20\n")
    odd = {"MPLBACKEND": "nonsense", "MATPLOTLIBRC": str(tmp_path / "odd")}
    for name, environment in (("plain.png", {}), ("odd.png", odd)):
        code, _, error = told(tmp_path, command=("view", "vehicle", "--picture", name, "--quiet"), **environment)
        assert (code, error) == (0, "")
    assert (tmp_path / "plain.png").read_bytes() == (tmp_path / "odd.png").read_bytes()
