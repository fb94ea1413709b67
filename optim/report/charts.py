"""Charts and pictures that lie in a page themselves: matplotlib's as SVG in the colours of the page, or as PNG."""

import base64
import hashlib
import html
import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from optim.experiments.figures import STYLE
from optim.report.markup import Html, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#33302b"
# What follows the page from day to night.
VARIABLES = {INK: "ink", "#000000": "ink", "#ffffff": "paper", "#f3f1ec": "ground", "#f2f2f2": "ground"}
PIXELS, PRINTED = 200, 110  # an inch, of pictures in charts, and of those for print
SMALL = (3.7, 2.5)  # in


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
    own = "c" + hashlib.sha256((alt + svg).encode()).hexdigest()[:8]
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
