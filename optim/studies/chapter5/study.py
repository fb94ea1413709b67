"""Changing shape beside changing control only: the searches of chapter 5, the gaits made by hand, and their table."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, letter
from optim.experiments.results import Budget, Costs, Progress, check_folder, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.plots import draw_band
from optim.studies.chapter5.champions import KIND, Played, Player
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, ROWS, Found, ShapeChange, read, search
from optim.studies.chapter5.table import summarise, write_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes


RUNS = "runs"
FILES = ("table.md", "table.csv", "summary.json", "curves.png", "curves.csv", "costs.jsonl")
SCALES: Mapping[Budget, ShapeChange] = {
    "small": ShapeChange(climbers=16, generations=1, geometry="small", repeats=1, copies=4, others=8),
    "medium": ShapeChange(generations=1),  # of random starts
    "full": ShapeChange(),  # as published; goes on in a folder of "medium"
}
BEFORE, SEARCHES, AFTER = 1, 16, 3  # shares of the progress


def study(folder: Path, settings: ShapeChange, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a run folder for each experiment in ``runs``, the table, curves and all numbers, after every generation.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    check_folder(folder, (*FILES, RUNS, KIND))
    costs = Costs(folder / "costs.jsonl")
    player = Player.open(settings, folder, costs, threads)
    total = BEFORE + SEARCHES + AFTER
    by_hand = player.by_hand(part_of(progress, 0, total, BEFORE))

    def write(found: Mapping[str, Found], played: Played) -> dict[str, Any]:
        summary = summarise(settings, found, played)
        summary["seconds"] = costs.total()
        write_tables(summary, folder)
        write_json(folder / "summary.json", summary)
        write_curves(summary, folder / "curves.png")
        return summary

    def after_round() -> None:
        found = read(settings, folder / RUNS)
        write(found, player.before(found, by_hand))

    search(settings, folder / RUNS, costs, after_round, threads, part_of(progress, BEFORE, total, SEARCHES))
    found = read(settings, folder / RUNS)
    rest = part_of(progress, BEFORE + SEARCHES, total, AFTER)
    return write(found, player.found(found, by_hand, rest))


PANELS = {"flat": "flat ground", "hill": "hill"}
# Fastest gaits made by hand on either terrain, drawn as levels; rolling would leave the hill's panel.
BY_HAND = {"flat": ("rolling by hand", "inching by hand"), "hill": ("inching by hand",)}


def write_curves(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the curves, and write their numbers as CSV beside the picture.

    Args:
        summary: see ``optim.studies.chapter5.table.summarise``.
        path: of the picture.
    """
    from matplotlib.ticker import MaxNLocator

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
                    _draw(axes, curves[experiment.name], COLOURS[ROWS.index(experiment.row)])
            for name in BY_HAND[place]:
                if (level := hands.get(name, {}).get(f"{place}_max")) is not None:
                    axes.axhline(level, color="0.5", linewidth=0.8, linestyle=":")
                    place_of: Any = {"xycoords": ("axes fraction", "data"), "va": "center"}
                    axes.annotate(name.replace(" by", "\nby"), (1.01, level), fontsize=6, color="0.35", **place_of)
            where = title if place == FLAT else f"{title}, {summary['settings']['slope']:g} degrees"
            axes.set(xlabel="generation", ylabel=f"speed, {where} [BL/s]")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        letter(panels)
        _legend(drawn, [name for name in ROWS if any(e.row == name and e.name in curves for e in EXPERIMENTS)])


def _draw(axes: "Axes", curve: Mapping[str, Any], colour: str) -> None:
    mean, low, high, best = (np.array(curve[name], float) for name in ("mean", "low", "high", "max"))
    generations = np.arange(len(mean))
    draw_band(axes, generations, mean, low, high, colour=colour)
    axes.plot(generations, best, color=colour, linestyle="--", linewidth=0.8)
    axes.plot(generations[-1:], mean[-1:], "o", markersize=2.5, color=colour)


def _legend(drawn: Any, rows: list[str]) -> None:
    from matplotlib.lines import Line2D

    searches = [Line2D([], [], color=COLOURS[ROWS.index(row)], label=row) for row in rows]
    mean = Line2D([], [], color="0.3", label="mean of climbers, 95 % band")
    maximum = Line2D([], [], color="0.3", linestyle="--", linewidth=0.8, label="maximum")
    drawn.legend(handles=[*searches, mean, maximum], loc="outside upper center", ncols=3)


STUDY = Study(
    title="searches for gaits on flat ground and up a hill, with shape, orientation and control free or fixed",
    source="chapter 5, table of simulation results and figure of searches",
    scales=SCALES,
    run=study,
    writes=("table.md", "table.csv", "curves.png", "curves.csv", "summary.json", "runs"),
    cost="10 h of two cores for each of 8 rows",
)
