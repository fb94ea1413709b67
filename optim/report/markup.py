"""HTML as text: the few elements that reports are made of. All that is not markup is escaped here.

Charts of matplotlib are SVG in the colours of the page, other pictures PNG, in the page themselves.
"""

import base64
import hashlib
import html
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.experiments.figures import STYLE
from taichi_sim.base.short_text import VAST, is_hidden, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MINUS = "\N{MINUS SIGN}"
INK = "#33302b"
# What follows the page from day to night.
VARIABLES = {INK: "ink", "#000000": "ink", "#ffffff": "paper", "#f3f1ec": "ground", "#f2f2f2": "ground"}
PIXELS, PRINTED = 200, 110  # an inch, of pictures in charts, and of those for print
SMALL = (3.7, 2.5)  # in


class Html(str):
    """Text that is markup already."""


Text = Html | str | int | float | None


@dataclass(frozen=True)
class Section:
    """A part of a page."""

    title: str  # its heading
    content: Sequence[Html] = field(default_factory=tuple)  # markup

    @property
    def anchor(self) -> str:
        """Name of the section in links to it."""
        return re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-")


def text(content: Text, digits: int = 4) -> Html:
    """Anything as markup: numbers as :func:`number` shows them, whole ones without decimals; None is a dash."""
    if isinstance(content, Html):
        return content
    if content is None:
        return Html("&ndash;")
    if isinstance(content, str):
        return Html(html.escape(content))
    return number(content, 0 if isinstance(content, int) else digits)


def number(value: float | None, digits: int = 4, unit: str = "") -> Html:
    """A number as read by people, and in full for machines; a dash for none."""
    if value is None or not math.isfinite(value):
        return text(None)
    if abs(value) >= VAST:
        shown = f"{value:.6g}"
    else:
        shown = f"{value:.3g}" if digits == 4 and is_hidden(value) else f"{value:z,.{digits}f}"
    shown = shown.replace("-", MINUS)
    exact = value.item() if isinstance(value, np.generic) else value
    return Html(f'<data value="{exact!r}">{shown}</data>{" " + html.escape(unit) if unit else ""}')


def paragraph(content: Text, kind: str = "") -> Html:
    """A paragraph, of a class of the style."""
    return Html(f"<p{_class(kind)}>{text(content)}</p>")


def joined(parts: Iterable[Text], separator: str = ", ") -> Html:
    """Parts, one after the other."""
    return Html(html.escape(separator).join(text(part) for part in parts))


def code(content: str) -> Html:
    """A name of a file, or the like."""
    return Html(f"<code>{html.escape(content)}</code>")


def listing(lines: Iterable[tuple[str, str]]) -> Html:
    """Commands, each below what it does."""
    parts = (
        f"<dt>{html.escape(what)}</dt><dd><pre><code>{html.escape(line)}</code></pre></dd>" for what, line in lines
    )
    return Html(f'<dl class="commands">{"".join(parts)}</dl>')


def table(caption: str, header: Sequence[Text], rows: Iterable[Sequence[Text]], digits: int = 4) -> Html:
    """A table; the first cell of each row is its name. Numbers have so many digits."""
    top = "".join(f'<th scope="col">{text(cell)}</th>' for cell in header)
    return _table(caption, f"<thead><tr>{top}</tr></thead>", rows, digits)


def facts(caption: str, rows: Iterable[tuple[str, Text]]) -> Html:
    """Names and what they are."""
    return _table(caption, "", rows, kind="facts")


def _table(caption: str, head: str, rows: Iterable[Sequence[Text]], digits: int = 4, kind: str = "") -> Html:
    body = []
    for name, *cells in rows:
        row = "".join(f"<td>{text(cell, digits)}</td>" for cell in cells)
        body.append(f'<tr><th scope="row">{text(name)}</th>{row}</tr>')
    label = html.escape(caption)
    return Html(
        f'<div class="scroll" role="region" aria-label="{label}" tabindex="0"><table{_class(kind)}>'
        f"<caption>{label}</caption>{head}<tbody>{''.join(body)}</tbody></table></div>"
    )


def picture(content: Html, caption: str, kind: str = "") -> Html:
    """A chart, or another picture, with its caption."""
    return Html(f"<figure{_class(kind)}>{content}<figcaption>{html.escape(caption)}</figcaption></figure>")


def side_by_side(parts: Iterable[Html]) -> Html:
    """Pictures in as many columns as there is room for."""
    return Html(f'<div class="pictures">{"".join(parts)}</div>')


def folded(summary: str, content: Html) -> Html:
    """Content that is shown when its summary is clicked."""
    return Html(f"<details><summary>{html.escape(summary)}</summary>{content}</details>")


def tiles(numbers: Iterable[tuple[str, Text]]) -> Html:
    """The most important numbers, in large type."""
    parts = (f"<div><dt>{html.escape(name)}</dt><dd>{text(value)}</dd></div>" for name, value in numbers)
    return Html(f'<dl class="tiles">{"".join(parts)}</dl>')


def page(title: str, lead: Sequence[Html], sections: Sequence[Section], foot: str) -> str:
    """The whole page."""
    links = "".join(f'<li><a href="#{one.anchor}">{html.escape(one.title)}</a></li>' for one in sections)
    parts = "".join(
        f'<section id="{one.anchor}"><h2>{html.escape(one.title)}</h2>{"".join(one.content)}</section>\n'
        for one in sections
    )
    style = resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    inline = "'unsafe-inline'"
    policy = f"default-src 'none'; script-src {inline}; style-src {inline}; img-src data: blob:; frame-src 'self'"
    return printable(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<header><h1>{html.escape(title)}</h1>{''.join(lead)}\n"
        f'<nav aria-label="Sections"><ul>{links}</ul></nav></header>\n'
        f"<main>\n{parts}</main>\n<footer><p>{html.escape(foot)}</p></footer>\n</body>\n</html>\n"
    )


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""


def charted(
    draw: "Callable[[Axes], None]", alt: str, caption: str = "", *, size: tuple[float, float] = SMALL, kind: str = ""
) -> Html:
    """A chart as SVG with its caption, which is ``alt`` by default; ``kind`` is a class of the style.

    It is drawn on axes of some width and height [in], and has a legend if anything has a label.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    inked = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    colours: dict[Any, Any] = dict.fromkeys(inked, INK)
    plain: dict[Any, Any] = {"svg.fonttype": "none", "savefig.transparent": True, "axes.unicode_minus": True}
    content = io.StringIO()
    with rc_context({**STYLE, **colours, **plain}):
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.add_subplot()
        draw(axes)
        if axes.get_legend_handles_labels()[0]:
            figure.legend(loc="outside upper left", ncols=2, fontsize=7, frameon=False)
        figure.savefig(content, format="svg", dpi=PIXELS, metadata={"Date": None})
    return picture(_inline(content.getvalue(), alt), caption or alt, kind)


def _inline(svg: str, alt: str) -> Html:
    """SVG for the middle of a page: its names are its own, its colours those of the page."""
    own = "c" + hashlib.sha256(printable(alt + svg).encode()).hexdigest()[:8]
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", svg)
    svg = re.sub(r'\bid="', f'id="{own}-', svg)
    svg = svg.replace("url(#", f"url(#{own}-").replace('xlink:href="#', f'href="#{own}-').replace("xlink:href", "href")
    for colour, name in VARIABLES.items():
        svg = svg.replace(colour, f"var(--{name})")
    box = re.search(r'viewBox="([^"]*)"', svg)
    opened = f'<svg viewBox="{box[1] if box else ""}" role="img" aria-label="{html.escape(alt)}">'
    return Html(re.sub(r"<svg[^>]*>", lambda _: opened, svg, count=1).strip())


def image(figure: "Figure", alt: str) -> Html:
    """A picture as PNG, for print."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=PRINTED)
    return picture_of(content.getvalue(), alt)


def picture_of(png: bytes, alt: str) -> Html:
    """A PNG file in the page."""
    return Html(f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">')
