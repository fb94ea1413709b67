"""Changing shape beside changing control only: the searches of chapter 5, the gaits made by hand, and their table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.experiments.results import Budget, Progress, check_folder, part_of, write_json
from optim.experiments.study import Study
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

    For the arguments see :class:`optim.experiments.study.Study`.
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


STUDY = Study(
    title="searches for gaits on flat ground and up a hill, with shape, orientation and control free or fixed",
    source="chapter 5, table of simulation results and figure of searches",
    scales=SCALES,
    run=study,
    writes=("table.md", "table.csv", "curves.png", "curves.csv", "summary.json", "runs"),
    cost="10 h of two cores for each of 8 rows",
)
