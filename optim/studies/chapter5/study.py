"""Changing shape beside changing control only: the searches of chapter 5, the gaits made by hand, and their table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.experiments.results import Budget, Progress, check_folder, part_of, write_json
from optim.studies.chapter5.champions import KIND, Played, open_played, play_by_hand, play_found, played_before
from optim.studies.chapter5.comparison import summarise
from optim.studies.chapter5.costs import Costs
from optim.studies.chapter5.curves import write_curves
from optim.studies.chapter5.experiments import Found, ShapeChange, read, search
from optim.studies.chapter5.table import write_tables

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

    For the arguments see :class:`optim.studies.catalogue.Item`.
    """
    check_folder(folder, (*FILES, RUNS, KIND))
    beside = open_played(settings, folder)
    costs = Costs(folder / "costs.jsonl")
    total = BEFORE + SEARCHES + AFTER
    by_hand = play_by_hand(settings, beside, costs, threads, part_of(progress, 0, total, BEFORE))

    def write(found: Mapping[str, Found], played: Played) -> dict[str, Any]:
        summary = summarise(settings, found, played)
        summary["seconds"] = costs.total()
        write_tables(summary, folder)
        write_json(folder / "summary.json", summary)
        write_curves(summary, folder / "curves.png")
        return summary

    def after_round() -> None:
        found = read(settings, folder / RUNS)
        write(found, played_before(found, by_hand, beside))

    search(settings, folder / RUNS, costs, after_round, threads, part_of(progress, BEFORE, total, SEARCHES))
    found = read(settings, folder / RUNS)
    rest = part_of(progress, BEFORE + SEARCHES, total, AFTER)
    return write(found, play_found(settings, found, by_hand, beside, costs, threads, rest))
