"""Changing shape beside changing control only: the searches of chapter 5, the gaits made by hand, and their table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure
from optim.experiments.results import Costs, Progress, check_folder, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.plots import draw_band
from optim.studies.chapter5.champions import KIND, Player
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, ROWS, ShapeChange, read, search
from optim.studies.chapter5.table import summarise, write_tables

RUNS = "runs"
FILES = ("table.md", "table.csv", "curves.png", "curves.csv", "summary.json", RUNS)


def study(folder: Path, settings: ShapeChange, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a run folder for each experiment in ``runs``, the table, curves and all numbers, after every generation."""
    check_folder(folder, (*FILES, KIND, "costs.jsonl"))
    costs = Costs(folder / "costs.jsonl")
    player = Player(settings, folder, costs, threads)

    def write() -> dict[str, Any]:
        found = read(settings, folder / RUNS)
        summary = summarise(settings, found, player.played(found))
        summary["seconds"] = costs.total()
        write_tables(summary, folder)
        write_json(folder / "summary.json", summary)
        write_curves(summary, folder / "curves.png")
        return summary

    player.play_by_hand(part_of(progress, 0, 20))
    search(settings, folder / RUNS, costs, write, threads, part_of(progress, 1, 20, 16))
    player.play_found(read(settings, folder / RUNS), part_of(progress, 17, 20, 3))
    return write()


# By terrain: its name, and the fastest gaits made by hand, drawn as levels; rolling would leave the hill's panel.
PANELS = {FLAT: ("flat ground", ("rolling by hand", "inching by hand")), HILL: ("hill", ("inching by hand",))}


def write_curves(summary: Mapping[str, Any], path: Path) -> None:
    """Draw the curves of a summary, and write their numbers as CSV beside the picture."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    curves = summary["curves"]
    rows = [
        (name, g, *values) for name, one in curves.items() for g, values in enumerate(zip(*one.values(), strict=True))
    ]
    write_table(path.with_suffix(".csv"), ("experiment", "generation", "mean", "low", "high", "max"), rows)
    levels = {
        (row["row"], place): row[f"{place}_max"] for row in summary["rows"] if "climbers" not in row for place in PANELS
    }
    known = [experiment for experiment in EXPERIMENTS if experiment.name in curves]
    with figure(path, PAGE, 3.4, ncols=2) as (drawn, panels):
        for axes, (place, (title, by_hand)) in zip(panels.flat, PANELS.items(), strict=True):
            for experiment in known:
                if experiment.place == place:
                    _draw(axes, curves[experiment.name], COLOURS[ROWS.index(experiment.row)])
            for name in by_hand:
                if (level := levels.get((name, place))) is not None:
                    axes.axhline(level, color="0.5", linewidth=0.8, linestyle=":")
                    place_of: Any = {"xycoords": ("axes fraction", "data"), "va": "center"}
                    axes.annotate(name.replace(" by", "\nby"), (1.01, level), fontsize=6, color="0.35", **place_of)
            where = title if place == FLAT else f"{title}, {summary['settings']['slope']:g} degrees"
            axes.set(xlabel="generation", ylabel=f"speed, {where} [BL/s]")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        searched = [name for name in ROWS if name in {experiment.row for experiment in known}]
        handles = [Line2D([], [], color=COLOURS[ROWS.index(row)], label=row) for row in searched]
        handles += [Line2D([], [], color="0.3", label="mean of climbers, 95 % band")]
        handles += [Line2D([], [], color="0.3", linestyle="--", linewidth=0.8, label="maximum")]
        drawn.legend(handles=handles, loc="outside upper center", ncols=3)


def _draw(axes: Any, curve: Mapping[str, Any], colour: str) -> None:
    mean, low, high, best = (np.array(curve[name], float) for name in ("mean", "low", "high", "max"))
    generations = np.arange(len(mean))
    draw_band(axes, generations, mean, low, high, colour=colour)
    axes.plot(generations, best, color=colour, linestyle="--", linewidth=0.8)
    axes.plot(generations[-1:], mean[-1:], "o", markersize=2.5, color=colour)


STUDY = Study(
    title="searches for gaits on flat ground and up a hill, with shape, orientation and control free or fixed",
    source="chapter 5, table of simulation results and figure of searches",
    scales={
        "small": ShapeChange(climbers=16, generations=1, geometry="small", repeats=1, copies=4, others=8),
        "medium": ShapeChange(generations=1),  # of random starts
        "full": ShapeChange(),  # as published; goes on in a folder of "medium"
    },
    run=study,
    writes=FILES,
    cost="10 h of two cores for each of 8 rows",
)
