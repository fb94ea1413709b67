"""Experiments before and after a fit, beside what was measured."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from optim.studies.figures import COLOURS, PAGE, figure, legend_above
from robots.calibration import Experiment

COLUMNS, HEIGHT = 4, 1.9  # panels in a row; height of a row [in]


def save_calibration(experiments: Sequence[Experiment], predictions: ArrayLike, path: Path) -> None:
    """A panel for each experiment: measured points, with standard deviations if given, and the simulation twice.

    Args:
        experiments: with what was measured.
        predictions: of all points before and after, shape (2, N).
        path: of the picture.
    """
    parts = np.split(np.asarray(predictions), np.cumsum([len(e.values) for e in experiments])[:-1], axis=1)
    columns = min(COLUMNS, len(experiments))
    rows = -(-len(experiments) // columns)
    with figure(path, PAGE * columns / COLUMNS, HEIGHT * rows + 0.3, nrows=rows, ncols=columns) as (drawn, panels):
        for axes in panels.flat[len(experiments) :]:
            axes.set_visible(False)
        for axes, experiment, (before, after) in zip(panels.flat, experiments, parts, strict=False):
            whole = not np.isfinite(experiment.at).all()  # values of whole gaits have no place on an axis
            at = np.arange(1.0, len(before) + 1) if whole else experiment.at
            order = np.argsort(at)
            handles = [
                axes.errorbar(at, experiment.values, experiment.deviations, fmt="o", ms=3, color=COLOURS[7], lw=0.8,
                              label="measured", zorder=3),
                *axes.plot(at[order], before[order], ".--", ms=3, color=COLOURS[1], label="before"),
                *axes.plot(at[order], after[order], ".-", ms=3, color=COLOURS[0], label="after"),
            ]  # fmt: skip
            axes.set_title(experiment.title, fontsize=7)
            axes.set(xlabel="number" if whole else experiment.axis, ylabel=experiment.quantity)
            axes.ticklabel_format(scilimits=(-2, 4))
        legend_above(drawn, handles)
