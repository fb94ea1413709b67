"""Pages of the Python interface: the public names of each package, which mkdocstrings fills in from docstrings."""

import ast
from functools import cache
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# The packages and modules that have a page, from the general to the special, and what each page is called.
PACKAGES = {
    "optim": "Searches in one call",
    "optim.search": "Search methods",
    "optim.problems.robot": "Problems of robots",
    "optim.runs": "Run folders",
    "optim.measures": "Measures",
    "optim.plots": "Plots",
    "optim.experiments.study": "Studies",
    "robots.robot": "Kinds of robots",
    "robots.world": "Terrains",
    "robots.inflatable": "Inflatable robot",
    "robots.lattice_robot": "Lattice robots",
    "robots.freeform": "Freeform robots",
    "robots.articulated": "Articulated robots",
    "robots.quadruped": "Quadrupeds",
    "robots.rover": "Two-wheel vehicle",
    "robots.braitenberg": "Braitenberg vehicles",
    "robots.hardware": "Pneumatic rig",
    "robots.calibration": "Calibration",
    "robots.gym.policies": "Gymnasium policies",
    "robots.view.still": "Pictures",
    "robots.view.film": "Films",
    "robots.view.player": "Player",
    "taichi_sim.lattice": "Physics of lattices",
    "taichi_sim.lattice.files": "Files of lattices",
    "taichi_sim.rigid": "Physics of rigid bodies",
    "taichi_sim.vehicle": "Physics of vehicles",
    "taichi_sim.base.compute": "Where to compute",
}


def api_pages() -> dict[str, str]:
    """Text of all pages by their place: the first lists what ``morpholab`` exports, then one a package.

    The first also describes what ``morpholab`` exports of places without a page.
    """
    where: dict[str, str] = {}  # the page of each object, which only the first to name it describes
    pages = {}
    for package, title in PACKAGES.items():
        named = {name: place for name, place in public_names(package).items() if _is_described(place)}
        pages[f"api/{package}.md"] = _page(package, title, {n: p for n, p in named.items() if p not in where}, named)
        where |= {place: package for place in named.values() if place not in where}
    return {"api/morpholab.md": _overview(where), **pages}


def _page(package: str, title: str, described: dict[str, str], named: dict[str, str]) -> str:
    elsewhere = [f"[`{name}`][{place}]" for name, place in named.items() if name not in described]
    parts = [f"# {title}: `{package}`", f"::: {package}\n    options: {{members: false, show_root_heading: false}}"]
    if elsewhere:
        parts.append(f"Described on other pages: {', '.join(elsewhere)}.")
    return "\n\n".join([*parts, *(f"::: {place}" for place in described.values())]) + "\n"


def _overview(where: dict[str, str]) -> str:
    exported = public_names("morpholab")
    pages = {place: f"[{PACKAGES[package]}]({package}.md)" for place, package in where.items()}
    rows = [
        f"| [`{n}`][{place}] | {_first_line(place)} | {pages.get(place, 'below')} |" for n, place in exported.items()
    ]
    below = [f"::: {place}" for place in exported.values() if place not in where]
    intro = (
        "The names that most programs need: `from morpholab import ...` has all of them, each imported when it is "
        "first used. The other pages describe them, and more, package by package; packages import downwards only, "
        "`optim` from `robots` from `taichi_sim` ([architecture](../architecture.md))."
    )
    return "\n".join(
        [
            "# `morpholab`",
            "",
            intro,
            "",
            "| name | is | page |",
            "| --- | --- | --- |",
            *rows,
            "",
            "\n\n".join(below),
            "",
        ]
    )


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_source(module).read_text())


@cache
def public_names(module: str) -> dict[str, str]:
    """Public names of a package or module, each with the full name of what it stands for.

    They are those of ``__all__``, or else what is imported as itself (``import X as X``) and the classes and functions
    that are defined there.
    """
    tree = _tree(module)
    for line in tree.body:
        if isinstance(line, ast.Assign) and "__all__" in _assigned(line):
            return {name: _defined(f"{module}.{name}") for name in ast.literal_eval(line.value)}
    handed_on = [each.name for line in _import_lines(tree) for each in line.names if each.asname == each.name]
    own = [line.name for line in tree.body if isinstance(line, ast.ClassDef | ast.FunctionDef)]
    return {name: _defined(f"{module}.{name}") for name in [*handed_on, *own] if not name.startswith("_")}


def _defined(place: str) -> str:
    """Where an object is defined that a module may only hand on."""
    module, _, name = place.rpartition(".")
    imported = _imports(module)
    return _defined(imported[name]) if name in imported else place


@cache
def _imports(module: str) -> dict[str, str]:
    """Names that a module imports from others, each with where from."""
    lines = _import_lines(_tree(module))
    return {each.asname or each.name: f"{line.module}.{each.name}" for line in lines for each in line.names}


def _import_lines(tree: ast.Module) -> list[ast.ImportFrom]:
    """The imports from modules of the lab at the top of a module, those for type checkers among them."""
    inner = [line for block in tree.body if isinstance(block, ast.If) for line in block.body]
    tops = ("taichi_sim", "robots", "optim")
    found = [line for line in [*tree.body, *inner] if isinstance(line, ast.ImportFrom)]
    return [line for line in found if (line.module or "").partition(".")[0] in tops]


def _source(module: str) -> Path:
    path = ROOT / module.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _is_described(place: str) -> bool:
    """Whether an object has a line of its own, unlike names that one line sets together."""
    module, _, name = place.rpartition(".")
    return any(getattr(line, "name", None) == name or name in _assigned(line) for line in _tree(module).body)


def _first_line(place: str) -> str:
    """The first line of a docstring; of a constant, of the string below it or the comment beside it."""
    module, _, name = place.rpartition(".")
    for line, after in pairwise([*_tree(module).body, ast.Pass()]):
        if isinstance(line, ast.ClassDef | ast.FunctionDef) and line.name == name:
            return (ast.get_docstring(line) or "").partition("\n")[0].replace("|", "\\|")
        if name in _assigned(line):
            below = after.value if isinstance(after, ast.Expr) else None
            last = _source(module).read_text().splitlines()[(line.end_lineno or 1) - 1]
            beside = last.partition("  # ")[2]
            return str(below.value).partition("\n")[0] if isinstance(below, ast.Constant) else beside
    return ""


def _assigned(line: ast.stmt) -> list[str]:
    targets = line.targets if isinstance(line, ast.Assign) else [line.target] if isinstance(line, ast.AnnAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]
