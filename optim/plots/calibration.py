"""Plots of a calibration: simulated experiments before and after the fit, beside the measurements."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from robots.calibration import Experiment

HANDY = {"[m]": ("[mm]", 1e3), "[m/s]": ("[mm/s]", 1e3), "[Pa]": ("[kPa]", 1e-3)}  # units of the pictures
MEASURED: Any = {"fmt": "o", "ms": 3, "color": COLOURS[7], "lw": 0.8, "label": "measured", "zorder": 3}
COLUMNS, HEIGHT = 4, 1.9  # panels in a row; height of a row [in]


def save_calibration(experiments: Sequence[Experiment], predictions: ArrayLike, path: Path) -> None:
    """Plot experiments with their measurements, a panel each, and their simulation before and after the fit, (2, N)."""
    parts = np.split(np.asarray(predictions), np.cumsum([len(e.values) for e in experiments])[:-1], axis=1)
    columns = min(COLUMNS, len(experiments))
    rows = -(-len(experiments) // columns)
    shape: Any = {"nrows": rows, "ncols": columns, "letters": False}
    with figure(path, PAGE * columns / COLUMNS, HEIGHT * rows + 0.3, **shape) as (drawn, panels):
        for axes in panels.flat[len(experiments) :]:
            axes.set_visible(False)
        for axes, experiment, (before, after) in zip(panels.flat, experiments, parts, strict=False):
            whole = not np.isfinite(experiment.at).all()  # values of whole gaits have no place on an axis
            xlabel, along = ("number", 1.0) if whole else _handy(experiment.axis)
            ylabel, up = _handy(experiment.quantity)
            at = np.arange(1.0, len(before) + 1) if whole else along * experiment.at
            order = np.argsort(at)
            noise = None if experiment.deviations is None else up * experiment.deviations
            handles = [
                axes.errorbar(at, up * experiment.values, noise, **MEASURED),
                *axes.plot(at[order], up * before[order], ".--", ms=3, color=COLOURS[1], label="before"),
                *axes.plot(at[order], up * after[order], ".-", ms=3, color=COLOURS[0], label="after"),
            ]
            axes.set_title(experiment.title, fontsize=7)
            axes.set(xlabel=xlabel, ylabel=ylabel)
        legend_above(drawn, handles)


def _handy(label: str) -> tuple[str, float]:
    """Label with a more readable unit, and the factor that converts numbers to this unit."""
    for unit, (handy, factor) in HANDY.items():
        if label.endswith(unit):
            return label.replace(unit, handy), factor
    return label, 1.0
