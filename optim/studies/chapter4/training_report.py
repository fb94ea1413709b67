"""What a report tells of a folder of training: the evaluations that each method needed."""

from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS
from optim.experiments.study import StudyReport, StudySection
from optim.plots.curves import draw_share_solved
from optim.studies.chapter4.training_table import read_training_table
from optim.wording import counted
from taichi_sim.base.results_folder import read_settings


def report(folder: Path) -> StudyReport:
    """What a report tells of training.

    Raises:
        ValueError: if there is no table yet.
    """
    settings, found = read_settings(folder, "training"), read_training_table(folder / "runs.csv")
    budget = int(settings.get("budget", found.evaluations.max()))
    methods = list(zip(found.methods, found.evaluations, found.solved, strict=True))

    def draw(axes: Any) -> None:
        for (name, spent, solved), colour in zip(methods, COLOURS, strict=False):
            draw_share_solved(axes, spent[solved], solved.size, budget, color=colour, label=name)
        axes.set_ylabel("share of runs with all solved")

    words = f"Share of runs of {counted(len(methods), 'method')} that solve all environments, against evaluations"
    section = StudySection(
        "Methods",
        "Runs of each method",
        ("Method", "Runs", "Solve all", "Evaluations, mean", "Median"),
        [
            (name, solved.size, int(solved.sum()), float(spent.mean()), float(np.median(spent)))
            for name, spent, solved in methods
        ],
        digits=1,
        charts={words: draw},
        size=(5.0, 3.0),
    )
    return StudyReport(
        "training",
        "Evaluations until a controller solves all four environments, in bodies of vehicles.",
        {"bodies": len(found.designs), "methods": len(methods)},
        settings,
        [section],
        {"methods": list(found.methods)},
    )
