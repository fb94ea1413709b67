import ast
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
GROUND = "taichi_sim.base."  # checks, files and types that every package may use
PACKAGES = ("taichi_sim", "robots", "optim", "morpholab")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def run(*command: str | Path, **options) -> str:
    process = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, **options)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel built from a copy of the sources, without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    for name in ("tests", "notebooks", "benchmarks"):  # must not get into the wheel
        (source / name).mkdir()
        (source / name / "__init__.py").touch()
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, source)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def site(wheel):
    """A folder with the installed wheel and nothing else."""
    folder = wheel.parent / "site"
    run(sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", folder, wheel)
    return folder


@pytest.mark.long
def test_the_wheel_holds_the_packages_and_nothing_else(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    contents = {name for name in names if ".dist-info/" not in name}
    modules = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    page = [path for path in (ROOT / "robots/view/player").iterdir() if path.is_file() and path.suffix != ".py"]
    page += [*(ROOT / "optim/explorer").glob("*.[cj]s*"), *(ROOT / "optim/report").glob("*.[chj]*")]
    page += [ROOT / "robots/tasks.toml"]
    expected = [*modules, *page, *(ROOT / package / "py.typed" for package in PACKAGES)]
    assert contents == {path.relative_to(ROOT).as_posix() for path in expected}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


@pytest.mark.long
def test_the_installed_wheel_runs_outside_the_source_tree(site, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(site)}
    usage = run(site / "bin" / "morpholab", "--help", cwd=tmp_path, env=environment)
    assert usage.startswith("usage: morpholab")
    for package in PACKAGES:
        program = f"import {package}; print({package}.__file__)"
        place = run(sys.executable, "-c", program, cwd=tmp_path, env=environment)
        assert Path(place).is_relative_to(site)
    assert run(sys.executable, "-m", "morpholab", "--help", cwd=tmp_path, env=environment) == usage


def test_the_constraints_pin_every_declared_dependency_within_its_range():
    lines = [line.partition("#")[0].strip() for line in (ROOT / "constraints.txt").read_text().splitlines()]
    pairs = (line.split("==") for line in lines if line)
    pins = {canonicalize_name(name): version for name, version in pairs}
    extras = PROJECT["optional-dependencies"].values()
    for text in [*PROJECT["dependencies"], *(text for extra in extras for text in extra)]:
        requirement = Requirement(text)
        if requirement.name != "morpholab":
            assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)]), text


@pytest.mark.parametrize("name", ["CITATION.cff", "CHANGELOG.md"])
def test_documents_know_the_version(name):
    assert PROJECT["version"] in (ROOT / name).read_text()


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def imports(folder: str) -> list[tuple[str, str]]:
    """(place, imported top-level package) for every import below a folder; what all may use counts as none."""
    found = []
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom):
                modules = [node.module or ""]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                continue
            place = f"{path.relative_to(ROOT).as_posix()}:{node.lineno}"
            found += [(place, module.partition(".")[0]) for module in modules if not f"{module}.".startswith(GROUND)]
    return found


@pytest.mark.parametrize(
    ("folder", "forbidden"),
    [
        ("taichi_sim", {"robots", "optim", "morpholab"}),
        ("robots", {"optim", "morpholab"}),
        ("optim", {"morpholab"}),
        ("optim/search", {"robots", "taichi_sim"}),
        ("optim/measures", {"robots", "taichi_sim"}),
    ],
)
def test_imports_run_downwards_only(folder, forbidden):
    assert [place for place, package in imports(folder) if package in forbidden] == []


def test_type_checks_are_relaxed_only_for_modules_that_exist():
    for override in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]:
        for name in override["module"]:
            if name.partition(".")[0] in PACKAGES and not name.endswith(".*"):
                assert (ROOT / name.replace(".", "/")).with_suffix(".py").exists(), name


def test_only_the_runtime_imports_taichi():
    places = [place for folder in PACKAGES for place, package in imports(folder) if package in ("taichi", "quadrants")]
    assert {place.partition(":")[0] for place in places} == {"taichi_sim/runtime.py"}


def test_only_tests_need_mujoco():
    assert [place for folder in PACKAGES for place, package in imports(folder) if package == "mujoco"] == []
    needing = {extra for extra, texts in PROJECT["optional-dependencies"].items() if "mujoco" in " ".join(texts)}
    assert needing == {"dev"} and "mujoco" not in " ".join(PROJECT["dependencies"])
