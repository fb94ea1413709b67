"""Rules for the source that no linter checks, and what importing does. (Directions between packages: test_packaging.)

The lists of what still breaks a rule may only get shorter.
"""

import ast
import graphlib
import json
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import computing
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("taichi_sim", "robots", "optim", "morpholab")
FILES = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
HEAVY = ("taichi", "quadrants", "torch", "scipy", "matplotlib", "trimesh", "rich", "cmaes", "pymoo", "ray")
MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in FILES}

# Imports that close a circle.
CIRCLES: set[tuple[str, str]] = set()

# What knows robots only through robots.robot, and the commands in it that are about one kind of robot.
KINDS = {f"robots.{path.parent.name}" for path in (ROOT / "robots").glob("*/kind.py")}
OF_ANY_KIND = ("robots.view", "optim.commands", "optim.report", "optim.runs", "optim.search")
OF_ONE_KIND = {
    ("optim.commands.calibrate", "robots.inflatable"),
    ("optim.commands.reproduce", "robots.inflatable"),  # the floor that its feet are on
    ("optim.commands.sweep", "robots.braitenberg"),
    ("optim.commands.train", "robots.braitenberg"),
    ("optim.commands.vehicle_options", "robots.braitenberg"),
}

# What a rig is and is told, whichever robot it drives.
OF_ANY_RIG = ("lines", "units", "line_map", "rig", "rig_response", "rig_table", "timeline", "headroom", "channel_play")

# Functions with more parameters than a reader can hold, and how many they have.
MOST, MOST_IN_KERNELS = 10, 20
LONG: dict[str, int] = {}
UNTYPED_KEYWORDS = 40  # functions that take **keywords of any type


@cache
def parsed() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text()) for path in FILES}


def executed(node: ast.AST):
    """All statements below one, without blocks for type checkers; an expression has none."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr) and not (isinstance(child, ast.If) and is_name(child.test, "TYPE_CHECKING")):
            yield child
            yield from executed(child)


def is_name(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def imported(tree: ast.Module) -> set[str]:
    """Modules of this project that a module imports, inside functions too."""
    found = set()
    for node in executed(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names & MODULES.keys()
            if not names <= MODULES.keys():
                found.add(node.module)
    return found & MODULES.keys()


def kinds_in(tree: ast.Module) -> set[str]:
    """Packages of kinds of robots that a module imports, inside functions and for type checkers too."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {".".join(name.split(".")[:2]) for name in names} & KINDS


def functions():
    for path, tree in parsed().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                yield path.relative_to(ROOT).as_posix(), node


def test_no_imports_in_circles_not_even_inside_functions():
    edges = {(name, other) for name, path in MODULES.items() for other in imported(parsed()[path]) - {name}}
    assert edges >= CIRCLES, f"take these off the list: {CIRCLES - edges}"
    graph: dict[str, set[str]] = {name: set() for name in MODULES}
    for name, other in edges - CIRCLES:
        graph[name].add(other)
    assert list(graphlib.TopologicalSorter(graph).static_order())


def test_views_reports_searches_and_commands_know_no_kind_of_robot():
    general = [name for name in MODULES if f"{name}.".startswith(tuple(f"{package}." for package in OF_ANY_KIND))]
    known = {(name, kind) for name in general for kind in kinds_in(parsed()[MODULES[name]])}
    assert len(KINDS) == 7 and len(general) > 100
    assert known <= OF_ONE_KIND, f"take what is about a kind to its package: {known - OF_ONE_KIND}"
    assert known == OF_ONE_KIND, f"take these off the list: {OF_ONE_KIND - known}"


def test_a_rig_knows_no_kind_of_robot():
    needed = {f"robots.hardware.{name}" for name in OF_ANY_RIG}
    while more := {other for name in needed for other in imported(parsed()[MODULES[name]])} - needed:
        needed |= more
    assert not {name for name in needed if name.startswith(tuple(f"{kind}." for kind in KINDS))}


def test_functions_have_few_parameters():
    """Kernels and laws may have more: they take a step's quantities one by one."""
    long = {}
    for place, node in functions():
        given = node.args
        names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        count = len([name for name in names if name not in ("self", "cls")])
        marks = {ast.unparse(mark) for mark in node.decorator_list}
        if not marks & {"ti.kernel", "law"} and count > (MOST_IN_KERNELS if "ti.func" in marks else MOST):
            long[f"{place} {node.name}"] = count
    assert long.items() <= LONG.items(), f"too many parameters: {long.items() - LONG.items()}"
    assert long == LONG, f"take these off the list: {LONG.keys() - long.keys()}"


def test_few_functions_hide_parameters():
    hidden = [
        f"{place} {node.name}"
        for place, node in functions()
        if node.args.kwarg and ast.unparse(node.args.kwarg.annotation or ast.Name("Any")) in ("Any", "object")
    ]
    assert len(hidden) <= UNTYPED_KEYWORDS, hidden


def test_formatting_is_rarely_switched_off():
    marks = [
        len(re.findall(r"# fmt: (?:skip|off)", path.read_text())) for path in (*FILES, *ROOT.glob("tests/**/*.py"))
    ]
    assert sum(marks) < 60


def run(program: str) -> str:
    command = [sys.executable, "-c", program]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    return process.stdout


def test_help_of_every_command_imports_nothing_heavy():
    out = run(
        "import contextlib, sys\n"
        "from optim.cli import main\n"
        "for arguments in ([], ['simulate'], ['codesign'], ['status'], ['compare'], ['export'], ['bench'], ['view']):\n"
        "    with contextlib.suppress(SystemExit):\n"
        "        main([*arguments, '--help'])\n"
        f"print('heavy:', [name for name in {HEAVY} if name in sys.modules])"
    )
    assert out.count("usage: morpholab") == 8
    assert out.splitlines()[-1] == "heavy: []"


@pytest.mark.long
def test_importing_everything_starts_no_taichi_and_prints_nothing():
    names = sorted(name for name in MODULES if not name.endswith("__main__"))
    out = run(
        "import importlib\n"
        f"for name in {names}:\n"
        "    importlib.import_module(name)\n"
        "from taichi_sim.runtime import ti\n"
        "started = vars(ti.lang.impl.get_runtime())\n"
        "assert started['_prog' if '_prog' in started else 'prog'] is None"
    )
    assert out == ""


@pytest.mark.parametrize(
    "package", ["optim.search", "optim.measures.pareto", "optim.runs", "optim.space", "optim.problem"]
)
def test_searching_needs_neither_robots_nor_physics(package):
    program = f"import sys, {package}; print(*sys.modules)"
    loaded = set(run(program).split())
    ground = {"taichi_sim", "taichi_sim.base"} | {name for name in loaded if name.startswith("taichi_sim.base.")}
    assert {
        name for name in loaded - ground if name.partition(".")[0] in ("robots", "taichi_sim", "taichi", "quadrants")
    } == set()


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


def test_what_is_told_of_tests_is_of_tests_that_exist():
    texts = {str(path.relative_to(ROOT)): path.read_text() for path in (ROOT / "tests").rglob("test_*.py")}
    for part in (*computing.SINGLE, *computing.DOUBLE, *computing.TWO_THREADS):
        place, _, name = part.partition("::")
        within = [text for path, text in texts.items() if place in path or not place.endswith(".py")]
        sought = name.partition("[")[0] or ("" if place.endswith(".py") else place.partition("[")[0])
        assert any(sought in text for text in within), part
    for part in computing.RIGID:
        assert any(part in path for path in texts), part


LAZY = sorted(name for name, path in MODULES.items() if "= exported_names(__name__)" in path.read_text())


@pytest.mark.parametrize("package", LAZY)
def test_a_package_lists_and_gives_its_public_names_alone(package):
    """To ``import *`` and to ``dir``, before any of them was used: those that it imports under ``TYPE_CHECKING``."""
    public = {
        alias.name
        for block in parsed()[MODULES[package]].body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    given: dict[str, object] = {}
    exec(f"from {package} import *", given)
    given.pop("__builtins__")
    assert given.keys() == public and len(public) > 3
    module = sys.modules[package]
    listed = {name for name in dir(module) if not name.startswith("__")}
    assert public <= listed
    assert {f"{package}.{name}" for name in listed - public} <= sys.modules.keys()  # modules of its own


def test_a_package_whose_names_are_found_by_a_registry_lists_them():
    import optim.search

    assert {"HillClimb", "METHODS", "build_method"} <= set(dir(optim.search))
    assert not {"Any", "Mapping", "signature", "exported", "Registry"} & set(dir(optim.search))


def imported_by_notebooks():
    """Module and name of everything of the packages that notebooks import by name."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text())["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        plain = "\n".join(
            line for text in code for line in text.splitlines() if not line.lstrip().startswith(("%", "!"))
        )
        for node in ast.walk(ast.parse(plain)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in PACKAGES:
                yield from ((path.stem, node.module, alias.name) for alias in node.names)


def test_what_notebooks_import_is_there():
    """Running them takes minutes, and is a command of its own."""
    found = list(imported_by_notebooks())
    assert len(found) > 20
    for notebook, module, name in found:
        assert hasattr(import_module(module), name) or find_spec(f"{module}.{name}"), (notebook, module, name)
