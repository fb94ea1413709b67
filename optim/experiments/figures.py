"""Style of the figures of studies: small, for print, and legible for colour-blind readers.

Source of the colours: Okabe & Ito, Color Universal Design, 2008.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from robots.view.scene import CHART_COLOURS
from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.files import replacing, write_bytes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

COLUMN, PAGE = 3.5, 7.2  # in, widths of a column and of a page
COLOURS = CHART_COLOURS
PICTURES = (".png", ".svg", ".pdf")
STYLE: Any = MappingProxyType(
    {
        "font.size": 8,
        "axes.titlesize": 8,
        "axes.labelsize": 8,
        "xtick.labelsize": 7,
        "ytick.labelsize": 7,
        "legend.fontsize": 7,
        "legend.frameon": False,
        "axes.linewidth": 0.6,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "lines.linewidth": 1.0,
        "figure.constrained_layout.h_pad": 0.06,  # in
        "figure.constrained_layout.w_pad": 0.06,
        "svg.hashsalt": "morpholab",  # the same figure is the same file
        "pdf.fonttype": 42,  # letters stay letters
    }
)


@contextmanager
def figure(
    path: Path, width: float, height: float, letters: str = "a", **panels: Any
) -> "Iterator[tuple[Figure, np.ndarray[Any, Any]]]":
    """Give a figure of some size [in] and its panels, shape (rows, columns), to draw on, and write it afterwards.

    Args:
        path: its name ends in one of ``PICTURES``; raises ValueError for another, or one that cannot
            be written, and RuntimeError if the disk is full or broken.
        letters: the first of several panels' letters, see :func:`letter`; none if it is empty.
        panels: keyword arguments of ``Figure.subplots``: rows, columns, shared axes.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    if path.suffix not in PICTURES:
        raise ValueError(f"{path}: is no picture; give a name that ends in {', '.join(PICTURES)}")
    dated: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix, {})
    with rc_context(dict(STYLE)):
        drawn = Figure(figsize=(width, height), layout="constrained")
        axes = drawn.subplots(squeeze=False, **panels)
        yield drawn, axes
        if letters and axes.size > 1:
            letter(axes, letters)
        with told_as(f"{path}: cannot be written"), replacing(path) as aside:
            drawn.savefig(aside, dpi=200, metadata=dated)


def save_arrays(path: Path, arrays: "Mapping[str, np.ndarray[Any, Any]]") -> None:
    """Write the numbers of a figure, by name, as a compressed ``.npz``."""
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    write_bytes(path, content.getvalue())


def letter(panels: "np.ndarray[Any, Any]", first: str = "a") -> None:
    """Write letters from the first one on, such as a, b, c, at the upper left of panels, in reading order."""
    for number, axes in enumerate(panels.flat):
        place: Axes = axes
        place.set_title(chr(ord(first) + number), loc="left", fontweight="bold")


def caption(axes: "Axes", text: str) -> None:
    """Write a small text above the middle of a panel."""
    axes.annotate(text, (0.5, 1.02), xycoords="axes fraction", ha="center", va="bottom", fontsize=7)


def note(axes: "Axes", text: str, top: float) -> None:
    """Small text in the upper right corner of a panel; ``top`` is the height of its upper edge [panels]."""
    axes.annotate(text, (0.97, top), xycoords="axes fraction", ha="right", va="top", fontsize=7)


def headroom(axes: "Axes", share: float = 0.15) -> None:
    """Raise the upper limit of y until a share of a panel is empty above what is drawn: room for a note."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, low + (high - low) / (1 - share))


def legend_above(drawn: "Figure", handles: "Sequence[Artist]") -> None:
    """Add a legend above all panels, where it hides nothing, in as few rows as fit."""
    for columns in range(len(handles), 0, -1):
        legend = drawn.legend(handles=handles, loc="outside upper center", ncols=columns)
        if columns == 1 or legend.get_window_extent().width <= drawn.bbox.width:
            return
        legend.remove()


def logarithmic(axes: "Axes", name: Literal["x", "y"], marks: "Sequence[float] | None" = None) -> None:
    """Make an axis logarithmic, with numbers written out: at some marks, or at 1, 2 and 5 of each decade."""
    from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator, StrMethodFormatter

    axes.set(**{f"{name}scale": "log"})
    axis: Axis = getattr(axes, f"{name}axis")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)) if marks is None else FixedLocator(marks))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
    if marks is not None:
        axis.set_minor_locator(NullLocator())


def dots(axes: "Axes", groups: "Mapping[str, np.ndarray[Any, Any]]") -> None:
    """Draw each group of values, (n,) by title, as a row of dots with a bar at its mean; a comma breaks a title."""
    for row, values in enumerate(groups.values()):
        axes.plot(values, np.full(len(values), row), "o", ms=3.5, alpha=0.5, color=COLOURS[row], mew=0)
        axes.plot(values.mean(), row, "|", ms=14, mew=2, color=COLOURS[row])
    axes.set_yticks(range(len(groups)), [title.replace(", ", ",\n") for title in groups])
    axes.set_ylim(len(groups) - 0.5, -0.5)
