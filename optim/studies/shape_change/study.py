"""Changing shape beside changing control only: the searches of chapter 5, the gaits made by hand, and their table."""

from pathlib import Path
from typing import Any

from optim.studies.results import Budget, Progress, check_folder, part_of, scale_of, write_json
from optim.studies.shape_change.champions import KIND, Played, open_played, play_by_hand, play_found
from optim.studies.shape_change.comparison import summarise
from optim.studies.shape_change.costs import Costs
from optim.studies.shape_change.curves import write_curves
from optim.studies.shape_change.experiments import ShapeChange, read, search
from optim.studies.shape_change.table import write_tables

RUNS = "runs"
FILES = ("table.md", "table.csv", "summary.json", "curves.png", "curves.csv", "costs.jsonl")
SCALES: dict[Budget, ShapeChange] = {
    "small": ShapeChange(climbers=16, generations=1, geometry="small", repeats=1, copies=4, others=8),
    "medium": ShapeChange(generations=1),
    "full": ShapeChange(),
}
BEFORE, SEARCHES, AFTER = 1, 16, 3  # shares of the progress


def run(folder: Path, budget: str = "full", progress: Progress = None) -> None:
    """The searches and gaits: a table, curves, all numbers. Resumable; ``"full"`` goes on in a folder of ``"medium"``.

    Args:
        folder: takes a run folder for each experiment in ``runs``, the table, curves and ``summary.json``.
        budget: ``"small"`` (half the robot, its gaits played once, 16 climbers, 1 generation), ``"medium"`` (60
            climbers, random starts and 1 generation) or ``"full"`` (60 climbers, 200 generations, as published).
        progress: called with the fraction done.

    Raises:
        ValueError: in one line, for an unknown budget or a folder of something else.
    """
    study(folder, scale_of(budget, SCALES), progress)


def study(folder: Path, settings: ShapeChange, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """The same with any settings; returns what ``summary.json`` holds. Tables are written after every generation."""
    check_folder(folder, (*FILES, RUNS, KIND))
    beside = open_played(settings, folder)
    costs = Costs(folder / "costs.jsonl")
    total = BEFORE + SEARCHES + AFTER
    by_hand = play_by_hand(settings, beside, costs, threads, part_of(progress, 0, total, BEFORE))

    def write(played: Played) -> dict[str, Any]:
        summary = summarise(settings, read(settings, folder / RUNS), played)
        summary["seconds"] = costs.total()
        write_tables(summary, folder)
        write_json(folder / "summary.json", summary)
        write_curves(summary, folder / "curves.png")
        return summary

    search(settings, folder / RUNS, costs, lambda: write(Played(by_hand)), threads,
           part_of(progress, BEFORE, total, SEARCHES))  # fmt: skip
    found = read(settings, folder / RUNS)
    rest = part_of(progress, BEFORE + SEARCHES, total, AFTER)
    return write(play_found(settings, found, by_hand, beside, costs, threads, rest))
