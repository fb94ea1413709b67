"""Who imports whom, and what importing does. (Directions between packages: ``test_packaging``.)"""

import ast
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("taichi_sim", "robots", "optim", "morpholab")
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in (ROOT / package).rglob("*.py")
}
HEAVY = ("taichi", "torch", "scipy", "matplotlib", "trimesh", "rich", "cmaes", "pymoo", "ray")


def imported_at_once(path: Path) -> set[str]:
    """Modules of this project that a module imports before it is complete."""
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (names & MODULES.keys()) or {node.module}
    return found & MODULES.keys()


def run(program: str) -> str:
    command = [sys.executable, "-c", program]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    return process.stdout


def test_no_imports_in_circles():
    graph = {name: imported_at_once(path) - {name} for name, path in MODULES.items()}
    assert list(graphlib.TopologicalSorter(graph).static_order())


def test_help_of_every_command_imports_nothing_heavy():
    out = run(
        "import contextlib, sys\n"
        "from optim.cli import main\n"
        "for arguments in ([], ['simulate'], ['codesign'], ['status'], ['compare'], ['export'], ['bench']):\n"
        "    with contextlib.suppress(SystemExit):\n"
        "        main([*arguments, '--help'])\n"
        f"print('heavy:', [name for name in {HEAVY} if name in sys.modules])"
    )
    assert out.count("usage: morpholab") == 7
    assert out.splitlines()[-1] == "heavy: []"


def test_importing_everything_starts_no_taichi_and_prints_nothing():
    names = sorted(name for name in MODULES if not name.endswith("__main__"))
    out = run(
        "import importlib\n"
        f"for name in {names}:\n"
        "    importlib.import_module(name)\n"
        "from taichi_sim.runtime import ti\n"
        "assert ti.lang.impl.get_runtime().prog is None"
    )
    assert out == ""


@pytest.mark.parametrize(
    "package", ["optim.search", "optim.measures.pareto", "optim.runs", "optim.space", "optim.problem"]
)
def test_searching_needs_neither_robots_nor_physics(package):
    program = f"import sys, {package}; print(*sys.modules)"
    loaded = set(run(program).split())
    ground = {"taichi_sim", "taichi_sim.base"} | {name for name in loaded if name.startswith("taichi_sim.base.")}
    assert {name for name in loaded - ground if name.partition(".")[0] in ("robots", "taichi_sim", "taichi")} == set()


def test_the_public_api_is_quick_to_import_and_every_name_is_there():
    out = run(
        "import sys, time\n"
        "began = time.process_time()\n"
        "import morpholab\n"
        "print(time.process_time() - began < 0.3)\n"
        f"print([name for name in {(*HEAVY, 'numpy')} if name in sys.modules])\n"
        "names = [name for name in dir(morpholab) if not name.startswith('_')]\n"
        "print(len([getattr(morpholab, name) for name in names]) > 30)\n"
    )
    assert out.splitlines() == ["True", "[]", "True"]
