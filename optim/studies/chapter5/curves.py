"""The picture of the searches: speeds over generations on flat ground and on the hill.

Source: Powers 2021 dissertation, ch. 5, figure "sim_results", b and c.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, letter
from optim.experiments.tables import write_table
from optim.plots import draw_band
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, ROWS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANELS = {"flat": "flat ground", "hill": "hill"}
# Fastest gaits made by hand on either terrain, drawn as levels; rolling would leave the hill's panel.
BY_HAND = {"flat": ("rolling by hand", "inching by hand"), "hill": ("inching by hand",)}


def write_curves(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the curves, and write their numbers as CSV beside the picture.

    Args:
        summary: see ``optim.studies.chapter5.comparison.summarise``.
        path: of the picture.
    """
    curves = summary["curves"]
    rows = [
        (name, g, *values) for name, one in curves.items() for g, values in enumerate(zip(*one.values(), strict=True))
    ]
    write_table(path.with_suffix(".csv"), ("experiment", "generation", "mean", "low", "high", "max"), rows)
    hands = {row["row"]: row for row in summary["rows"] if "climbers" not in row}
    with figure(path, PAGE, 3.4, ncols=2) as (drawn, panels):
        for axes, (place, title) in zip(panels.flat, PANELS.items(), strict=True):
            for experiment in EXPERIMENTS:
                if experiment.place == place and experiment.name in curves:
                    colour = COLOURS[ROWS.index(experiment.row)]
                    _draw(axes, curves[experiment.name], colour)
            for name in BY_HAND[place]:
                if (level := hands.get(name, {}).get(f"{place}_max")) is not None:
                    axes.axhline(level, color="0.5", linewidth=0.8, linestyle=":")
                    axes.annotate(
                        name.replace(" by", "\nby"),
                        (1.01, level),
                        xycoords=("axes fraction", "data"),
                        fontsize=6,
                        color="0.35",
                        va="center",
                    )
            where = title if place == FLAT else f"{title}, {summary['settings']['slope']:g} degrees"
            axes.set(xlabel="generation", ylabel=f"speed, {where} [BL/s]")
            _whole_generations(axes)
        letter(panels)
        _legend(drawn, [name for name in ROWS if any(e.row == name and e.name in curves for e in EXPERIMENTS)])


def _draw(axes: "Axes", curve: Mapping[str, Any], colour: str) -> None:
    mean, low, high, best = (np.array(curve[name], float) for name in ("mean", "low", "high", "max"))
    generations = np.arange(len(mean))
    draw_band(axes, generations, mean, low, high, colour=colour)
    axes.plot(generations, best, color=colour, linestyle="--", linewidth=0.8)
    axes.plot(generations[-1:], mean[-1:], "o", markersize=2.5, color=colour)


def _whole_generations(axes: "Axes") -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def _legend(drawn: Any, rows: list[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=COLOURS[ROWS.index(row)], label=row) for row in rows]
    handles += [
        Line2D([], [], color="0.3", label="mean of climbers, 95 % band"),
        Line2D([], [], color="0.3", linestyle="--", linewidth=0.8, label="maximum"),
    ]
    drawn.legend(handles=handles, loc="outside upper center", ncols=3)
