"""What MkDocs does for this site beyond Markdown: pages of code and notebooks, links as the repository has them."""

import os
import posixpath
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from api_pages import ROOT, api_pages
from command_pages import command_pages
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from notebook_pages import notebook_page

# Files outside docs/ that have pages, and where: others that pages link to are shown as they are.
PAGES = {"CHANGELOG.md": "project/changelog.md", "CONTRIBUTING.md": "project/contributing.md"}
LANGUAGES = {
    ".py": "python",
    ".toml": "toml",
    ".json": "json",
    ".ino": "cpp",
    ".vxa": "xml",
    ".cff": "yaml",
    "": "make",
}
LINK = re.compile(r"(?<=\]\()([^)\s]+)(?=\))")
CODE = re.compile(r"`[^`]+`")
ROLE = re.compile(r":(?:func|meth|class|mod|data|attr):(?=<code>)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages that are made into the navigation, at ``commands/*`` and ``api/*``."""
    config.nav = _expanded(config.nav, {"commands/*": list(command_pages()), "api/*": list(api_pages())})
    return config


def _expanded(nav: Any, made: dict[str, list[str]]) -> Any:
    if isinstance(nav, dict):
        return {title: _expanded(below, made) for title, below in nav.items()}
    if isinstance(nav, list):
        return [
            each
            for item in nav
            for each in (made.get(item, [item]) if isinstance(item, str) else [_expanded(item, made)])
        ]
    return nav


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made: commands, the Python interface, notebooks, studies, and files that pages link to."""
    made = {**command_pages(), **api_pages()}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        made[f"notebooks/{path.stem}.md"] = notebook_page(path)
        files.append(File.generated(config, f"notebooks/{path.name}", abs_src_path=str(path)))
    for source, place in _pages().items():
        made[place] = (ROOT / source).read_text()
    for source in _linked(files, made):
        made[_place(source)] = _shown(ROOT / source)
    for place, text in made.items():
        files.append(File.generated(config, place, content=text))
    return files


def _pages() -> dict[str, str]:
    """Markdown outside docs/ and where it goes."""
    studies = (ROOT / "optim/studies").rglob("*.md")
    return PAGES | {str(path.relative_to(ROOT)): _place(str(path.relative_to(ROOT))) for path in sorted(studies)}


def _place(source: str) -> str:
    """Where the site has a file of the repository."""
    if source in PAGES:
        return PAGES[source]
    if source.startswith("docs/") and not (ROOT / source).is_dir():
        return source.removeprefix("docs/")
    if source.startswith("optim/studies") and source.endswith(".md"):
        return source.removeprefix("optim/")
    if source.startswith("notebooks/"):
        return source.removesuffix(".ipynb") + ".md"
    return f"files/{source}.md"


def _linked(files: Files, made: dict[str, str]) -> list[str]:
    """Files and folders of the repository that pages link to and that are no pages."""
    known = {file.src_uri for file in files} | set(made)
    texts = {file.src_uri: file.content_string for file in files.documentation_pages()} | made
    found = set()
    for place, text in texts.items():
        for link in LINK.findall(text):
            source = _source_of(link, place)
            if source is not None and (ROOT / source).exists() and _place(source) not in known:
                found.add(source)
    return sorted(found)


def _source_of(link: str, place: str) -> str | None:
    """The file of the repository that a link on a page names; None for addresses, and for pages that are made."""
    if re.match(r"[a-z]+:|#", link) or place.startswith(("api/", "commands/")) or "?download" in link:
        return None
    path = posixpath.normpath(posixpath.join(posixpath.dirname(_origin(place)), link.partition("#")[0]))
    return path if not path.startswith("..") else None


def _origin(place: str) -> str:
    """The file of the repository that a page shows."""
    shown = {where: source for source, where in _pages().items()}
    if place.startswith("notebooks/"):
        return place
    return shown.get(place, f"docs/{place}")


def _shown(path: Path) -> str:
    """The page of a file that is no Markdown, or of a folder: its text, or the names in it."""
    name = path.relative_to(ROOT)
    if path.is_dir():
        inside = sorted(each for each in path.rglob("*") if each.is_file() and "__pycache__" not in each.parts)
        sizes = [f"| {_listed(each, path)} | {each.stat().st_size:,} |" for each in inside]
        return "\n".join([f"# The folder `{name}`", "", "| file | bytes |", "| --- | ---: |", *sizes, ""])
    return f"# The file `{name}`\n\n````{LANGUAGES.get(path.suffix, 'text')}\n{path.read_text()}\n````\n"


def _listed(path: Path, folder: Path) -> str:
    """The name of a file in a folder, with a link if the site has the file."""
    name = f"`{path.relative_to(folder)}`"
    if path.suffix == ".md" or not path.is_relative_to(ROOT / "docs"):
        return name
    here = posixpath.dirname(_place(str(folder.relative_to(ROOT))))
    return f"[{name}]({posixpath.relpath(path.relative_to(ROOT / 'docs').as_posix(), here)})"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to where the site has what they name in the repository."""
    place = page.file.src_uri
    if place == "index.md":
        page.meta["hide"] = ["navigation"]

    def moved(found: re.Match[str]) -> str:
        link = found[0]
        if "?download" in link:
            return link.removesuffix("?download")
        source = _source_of(link, place)
        if source is None or not (ROOT / source).exists() or place.startswith("files/"):
            return link
        anchor = "#" + link.partition("#")[2] if "#" in link else ""
        return posixpath.relpath(_place(source), posixpath.dirname(place) or ".") + anchor

    return LINK.sub(moved, _with_bars(markdown))


def _with_bars(markdown: str) -> str:
    """Code in tables with its bars as they are: Python's Markdown would show the backslashes that GitHub's asks for."""
    rows = [
        CODE.sub(lambda code: code[0].replace("\\|", "|"), row) if row[:1] == "|" else row
        for row in markdown.split("\n")
    ]
    return "\n".join(rows)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Drop the roles that docstrings give to names."""
    return ROLE.sub("", html) if page.file.src_uri.startswith("api/") else html


class _Loads(HTMLParser):
    """Addresses that a page would load by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = dict(attributes)
        loads = given.get("src") or (given.get("href") if tag == "link" else None) or given.get("srcset")
        if loads and re.match(r"(https?:)?//", loads) and given.get("rel") != "canonical":
            self.found.append(loads)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Refuse a page that would load anything from elsewhere: the site works without a network."""
    loads = _Loads()
    loads.feed(output)
    if loads.found:
        raise PluginError(f"{page.file.src_uri}: loads {', '.join(loads.found)} from elsewhere")
    return output


os.chdir(ROOT)  # so that examples which the command line names are found, wherever mkdocs was started
