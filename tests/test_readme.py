"""What the documents say is so, and the site has all of them."""

import argparse
import ast
import itertools
import json
import pkgutil
import re
import shlex
import tomllib
from dataclasses import fields
from inspect import signature
from pathlib import Path

import pytest
from api_pages import api_pages, public_names
from command_pages import command_pages
from notebook_pages import notebook_page

import morpholab
from optim.cli import build_parser
from optim.search import METHODS
from optim.studies.catalogue import STUDIES

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text()
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "optim/studies").rglob("*.md"))]
DOCUMENTS = ["README.md", *(str(path.relative_to(ROOT)) for path in PAGES)]
TOPS = ["taichi_sim", "robots", "optim", "morpholab", "tests", "docs", "notebooks", "benchmarks", "examples", ".ci"]
LINKING = [*DOCUMENTS, "CHANGELOG.md", "CONTRIBUTING.md", "docs/data/README.md"]
NAVIGATION = (ROOT / "docs/site/mkdocs.yml").read_text().partition("\nnav:\n")[2]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_python_versions_are_those_declared():
    (sentence,) = re.findall(r"Python (3\.\d+), (3\.\d+) or (3\.\d+)", README)
    declared = [c.split(" :: ")[-1] for c in PROJECT["classifiers"] if ":: 3." in c]
    assert list(sentence) == declared
    low, high = (int(version.split(".")[1]) for version in (sentence[0], sentence[-1]))
    assert PROJECT["requires-python"] == f">=3.{low},<3.{high + 1}"


def test_every_command_is_real_and_none_is_missing():
    lines = re.findall(r"`morpholab ([^`]+)`", README)
    for line in lines:
        build_parser().parse_args(shlex.split(line))
    commands = next(a.choices for a in build_parser()._actions if a.dest == "command")
    assert {line.split()[0] for line in lines} == set(commands)


def options_of(parser):
    """Help of a command, and all its options: those of kinds of robots that the help leaves out, too."""
    return f"{parser.format_help()} {' '.join(parser._option_string_actions)}"


def test_every_option_named_exists():
    helps = [options_of(parser) for parser in build_parser()._actions[-1].choices.values()]
    for option in set(re.findall(r"`(--[a-z-]+)", README)) - {"--help"}:
        assert any(option in text for text in helps), option


@pytest.mark.parametrize("name", DOCUMENTS)
def test_what_documents_say_to_type_exists(name):
    parsers = build_parser()._actions[-1].choices
    helps = {command: options_of(parser) for command, parser in parsers.items()}
    for said in re.findall(r"`([^`\n]+)`", (ROOT / name).read_text()):
        words = said.split()
        options = [word for word in words if word.startswith("--")]
        if words[0] == "python":
            script = (ROOT / words[1]).read_text() + (ROOT / "benchmarks/equal_cost.py").read_text()
            assert all(f'"{option}"' in script for option in options), said
        elif words[0] in ("morpholab", *helps) and len(words) > 1:
            command = words[1] if words[0] == "morpholab" else words[0]
            assert all(option in helps[command] for option in options), said
        elif words[0].startswith("--") and words[0] != "--help":
            assert any(words[0] in text for text in helps.values()), said


@pytest.mark.parametrize("name", [name for name in DOCUMENTS if "moving-from" not in name])  # which has the old names
def test_every_name_that_documents_give_in_full_exists(name):
    text, package = (ROOT / name).read_text(), r"(?:taichi_sim|robots|optim)"
    names = re.findall(rf"`({package}(?:\.\w+)+)", text)
    for module, imported in re.findall(rf"^from ({package}[\w.]*) import ([\w, ]+)$", text, re.MULTILINE):
        names += [f"{module}.{each.strip()}" for each in imported.split(",")]
    for said in names:
        pkgutil.resolve_name(said)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_what_documents_set_is_a_setting_of_some_method_or_study(name):
    settings = {name for method in METHODS.values() for name in signature(method).parameters}
    settings |= {each.name for _, study in STUDIES.usable() for each in fields(study.scales["full"])}
    assert set(re.findall(r"`--set '?(\w+)=", (ROOT / name).read_text())) <= settings | {"NAME"}


def targets_of_make(text: str) -> set[str]:
    """Targets that a document names: in code, and in a list after the first, as in "`make demo`, `test`"."""
    found = [line.split()[1] for _, code in FENCE.findall(text) for line in code.splitlines() if line[:5] == "make "]
    for first, others in re.findall(r"`make ([a-z-]+)[^`]*`((?:, `[a-z-]+`)*)", FENCE.sub("", text)):
        found += [first, *re.findall(r"[a-z-]+", others)]
    return set(found)


def test_targets_of_make_are_found_whole_and_in_lists():
    text = "`make test-it DEVICE=a`, or `make demo`, `fuzz-all`, `make a`; we\nmake do\n```sh\nmake site  # all\n```"
    assert targets_of_make(text) == {"test-it", "demo", "fuzz-all", "a", "site"}


@pytest.mark.parametrize("name", [*DOCUMENTS, "CONTRIBUTING.md", "SECURITY.md"])
def test_every_target_of_make_exists(name):
    makefile = (ROOT / "Makefile").read_text()
    for target in targets_of_make((ROOT / name).read_text()):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


@pytest.mark.parametrize("name", LINKING)
def test_every_link_leads_somewhere(name):
    document = ROOT / name
    for link in re.findall(r"\]\(([^)]+)\)", FENCE.sub("", document.read_text())):
        path, _, anchor = link.partition("#")
        target = document.parent / path if path else document
        assert link.startswith("https://") or target.exists(), link
        assert not anchor or link.startswith("https://") or anchor in headings(target), link


def headings(document: Path) -> list[str]:
    """Of a page, as anchors name them."""
    found = re.findall(r"^#+ (.+)$", FENCE.sub("", document.read_text()), re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found]


@pytest.mark.parametrize("name", LINKING)
def test_code_of_documents_is_what_its_language_and_the_command_line_take(name):
    for language, code in FENCE.findall((ROOT / name).read_text()):
        if language == "python":
            ast.parse(code)
        elif language == "toml":
            tomllib.loads(code)
        elif language == "json":
            json.loads(code)
        elif language in ("", "sh", "bash"):
            for line in code.replace("\\\n", " ").splitlines():
                check_command(line)


def check_command(line: str) -> None:
    """Fail if a line of a shell is a command of ``morpholab`` that its parser refuses."""
    words = shlex.split(line, comments=True) if line.startswith("morpholab ") else []
    if words:
        named = ["articulated" if word.endswith((".xml", ".urdf")) else word for word in words[1:]]  # files not here
        try:
            build_parser().parse_args(named)
        except SystemExit as stop:  # without an error after help
            assert stop.code == 0, line


def test_every_page_and_notebook_is_in_the_navigation():
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").glob("*.md")}
    studies = {path.relative_to(ROOT / "optim").as_posix() for path in (ROOT / "optim/studies").rglob("*.md")}
    notebooks = {f"notebooks/{path.stem}.md" for path in (ROOT / "notebooks").glob("*.ipynb")}
    made = {"data/README.md", "project/contributing.md", "project/changelog.md"}
    listed = re.findall(r"[\w/.-]+\.md$", NAVIGATION, re.MULTILINE)
    assert sorted(listed) == sorted(pages | studies | notebooks | made)


def test_the_gallery_has_every_picture_and_how_it_is_made():
    blocks = (ROOT / "docs/gallery.md").read_text().split("\n\n")
    pictures = [re.match(r"!\[.+\]\((.+)\)", block) for block in blocks]
    files = [path.name for kind in ("*.webp", "*.gif") for path in (ROOT / "docs").glob(kind)]
    assert sorted(found[1] for found in pictures if found) == sorted(files)
    for picture, after in itertools.pairwise(range(len(blocks))):
        if pictures[picture]:
            made = re.search(r"`(morpholab|python|make|shape_picture)\b", blocks[after])
            assert made or pictures[after], blocks[picture]


def test_pages_of_the_site_have_every_command_option_and_public_name():
    commands, interface = command_pages(), api_pages()
    for name, parser in build_parser()._actions[-1].choices.items():
        parser.format_help()
        hidden = argparse.SUPPRESS
        shown = {option for action in parser._actions if action.help != hidden for option in action.option_strings}
        missing = [option for option in shown - {"-h", "--help"} if f"`{option}" not in commands[f"commands/{name}.md"]]
        assert not missing, name
    rows = re.findall(r"^\| \[`(\w+)`\]\[[\w.]+\] \| \S.* \|", interface["api/morpholab.md"], re.MULTILINE)
    assert sorted(rows) == sorted(public_names("morpholab")) == [name for name in dir(morpholab) if name in rows]


def test_a_notebook_becomes_a_page_with_all_its_cells():
    path = ROOT / "notebooks" / "vehicle.ipynb"
    page = notebook_page(path)
    cells = json.loads(path.read_text())["cells"]
    assert page.startswith("# ") and page.count("```python\n") == sum(cell["cell_type"] == "code" for cell in cells)


@pytest.mark.kernels
def test_the_example_runs(capsys):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(example.splitlines()) <= 8
    exec(compile(example, "README.md", "exec"), {})
    first, second = capsys.readouterr().out.splitlines()
    assert re.match(r"soft quadruped on hill:5: speed -?\d\.\d{4} BL/s, ", first)
    assert re.match(r"\[.+ .+\]$", second)


def test_the_document_on_architecture_names_only_what_exists():
    named = set(re.findall(r"`([a-z_/]+(?:/|\.py))`", ARCHITECTURE))
    (house,) = re.findall(r"```\n(taichi_sim/.*?)```", ARCHITECTURE, re.DOTALL)
    folders = set(re.findall(r"\b([a-z_0-9]+)/", house))
    tops = [ROOT / name for name in ("taichi_sim", "robots", "optim", "morpholab")]
    known = {path.name for top in tops for path in [top, *top.rglob("*")]}
    assert folders and folders <= known
    kept = [path.as_posix() for top in ROOT.iterdir() if top.name in TOPS for path in (top, *top.rglob("*"))]
    missing = [name for name in named if not any(path.endswith("/" + name.rstrip("/")) for path in kept)]
    assert missing == []


def test_documents_are_short_and_the_picture_small():
    assert README.count("\n") <= 120 and ARCHITECTURE.count("\n") <= 280
    assert (ROOT / "docs" / "rolling.gif").stat().st_size < 500_000


@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.name)
def test_notebooks_are_kept_without_their_outputs(path):
    cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    assert cells and not any(cell["outputs"] or cell["execution_count"] for cell in cells)
