"""A picture of the study: machines on one course, how far they go, and how soon they notice changes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.experiments.figures import COLOURS, COLUMN, PAGE, figure
from optim.experiments.tables import Record, select
from robots.course import KINDS, Course
from taichi_sim.base.arrays import Floats, Ints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHADES = dict(zip(KINDS, ("#999999", *COLOURS[:3]), strict=True))  # of gaits and grounds
DARK = "#000000"
LINES = (DARK, *COLOURS[3:])  # of machines


@dataclass(frozen=True, eq=False)
class Example:
    """Machines on one course.

    Attributes:
        course: where.
        names: of the machines that are shown, shape (B,).
        gaits: that they played, shape (B, L).
        places: of their middles [m], shape (B, L).
    """

    course: Course
    names: Sequence[str]
    gaits: Ints
    places: Floats


def draw(
    path: Path,
    example: Example | None,
    machines: Mapping[str, Mapping[str, Any]],
    events: Sequence[Record],
    look: float,
) -> None:
    """Write the picture; without an example only its right half. A look is so many seconds from the next."""
    columns: dict[str, Any] = {"ncols": 2, "width_ratios": (1.5, 1)} if example else {}
    with figure(path, PAGE if example else COLUMN, 4.6, nrows=2, **columns) as (_, axes):
        if example:
            _course(axes[0, 0], example)
            _time(axes[1, 0], example, look)
        _shares(axes[0, -1], machines)
        _delays(axes[1, -1], events, look)


def _course(axes: "Axes", example: Example) -> None:
    """Draw the course from the side, and above it which gait each machine played where."""
    end = float(example.places.max()) + 0.05
    x = np.linspace(-0.05, end, 2000)
    height, kind = example.course.height(x), example.course.kind(x)
    for number, name in enumerate(KINDS):
        axes.fill_between(x, height - 0.02, height, where=kind == number, color=SHADES[name], linewidth=0, label=name)
    top, step = float(height.max()) + 0.02, 0.037
    for row, name in enumerate(example.names):
        level = top + step * (len(example.names) - row)
        places, gaits = example.places[row], example.gaits[row]
        for number, gait in enumerate(KINDS):
            which = np.flatnonzero(gaits[:-1] == number)
            low, high = np.sort([places[which], places[which + 1]], axis=0)
            axes.broken_barh(list(zip(low, high - low, strict=True)), (level - 0.005, 0.01), color=SHADES[gait])
        axes.annotate(name, (0.0, level), xytext=(0, 5), textcoords="offset points", fontsize=6, va="bottom")
    axes.set(xlabel="along the way [m]", ylabel="height [m]", xlim=(-0.05, end))
    axes.set_ylim(-0.03, top + step * (len(example.names) + 1))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=len(KINDS), handlelength=1.0, columnspacing=1.0)


def _time(axes: "Axes", example: Example, look: float) -> None:
    """Draw how far each machine of the example is, over time."""
    times = look * np.arange(example.places.shape[1])
    for row, name in enumerate(example.names):
        axes.plot(times, example.places[row], color=LINES[row], label=name)
    axes.set(xlabel="time [s]", ylabel="along the way [m]")
    axes.legend(loc="lower right")


def _shares(axes: "Axes", machines: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw how far every machine goes, as a share of what the told one does."""
    names = [name for name in machines if machines[name]["share"] is not None][::-1]
    middle, low, high = (np.array([machines[name][key] for name in names]) for key in ("share", "low", "high"))
    rows = np.arange(len(names))
    axes.barh(rows, middle, xerr=np.abs([middle - low, high - middle]), color=COLOURS[4], error_kw={"linewidth": 0.8})
    axes.set_yticks(rows, names)
    axes.set(xlabel="distance, of the told one's")
    axes.axvline(1.0, color=DARK, linewidth=0.6, linestyle=":")


def _delays(axes: "Axes", events: Sequence[Record], look: float) -> None:
    """Share of the changes that are noticed after some time."""
    for row, name in enumerate(dict.fromkeys(row["machine"] for row in events)):
        own = select(events, machine=name)
        delays = np.sort([look * event["looks"] for event in own if event["looks"] is not None])
        axes.step(delays, np.arange(1, len(delays) + 1) / len(own), where="post", color=LINES[1 + row], label=name)
    axes.set(xlabel="time since the change [s]", ylabel="changes noticed [share]", ylim=(0, 1))
    if events:
        axes.legend(loc="lower right")
