"""What the study writes: correlations of metrics and evaluations, how well held-out bodies are foretold, a picture."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure, note
from optim.experiments.results import write_json
from optim.experiments.tables import Record, cell, column, markdown, page
from optim.measures.statistics import Correlation, spearman
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

METRICS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$", "felt": "homeostasis", "voxels": "voxels"}
LEAST = 10  # bodies of which a correlation says something


def correlations(rows: Sequence[Record], learners: Sequence[str]) -> dict[tuple[str, str], Correlation]:
    """Rank correlation of every metric with the mean evaluations of every kind of learning, over bodies."""
    found = {}
    for metric in METRICS:
        for learner in learners:
            x, y = column(rows, metric), column(rows, learner)
            known = np.isfinite(x) & np.isfinite(y)
            found[metric, learner] = spearman(x[known], y[known], "two-sided")
    return found


def foretold(rows: Sequence[Record], learner: str) -> Correlation:
    """How well held-out bodies are foretold: rank correlation of a fit's evaluations with those that were needed.

    The fit is linear in the logarithms of M_L and M_CI, with one added to both counts, made on every second body.
    """
    trained, held = rows[::2], rows[1::2]

    def inputs(part: Sequence[Record]) -> Floats:
        every, some = column(part, "all") + 1, column(part, "any") + 1
        return np.column_stack([np.ones(len(part)), np.log(every), np.log(some)])

    known = np.log(column(trained, learner))
    weights = np.linalg.lstsq(inputs(trained), known, rcond=None)[0]
    return spearman(inputs(held) @ weights, column(held, learner), "two-sided")


def write_report(
    folder: Path, rows: Sequence[Record], learners: Mapping[str, str], settings: Mapping[str, Any]
) -> None:
    """Write ``table.md``, ``summary.json`` and ``evaluations.png``."""
    found = correlations(rows, tuple(learners))
    held = {name: foretold(rows, name) for name in learners}
    pairs = [
        [METRICS[metric].strip("$").replace("{CI}", "CI"), *(_told(found[metric, name]) for name in learners)]
        for metric in METRICS
    ]
    pairs.append(["foretold by M_L and M_CI, held-out bodies", *(_told(held[name]) for name in learners)])
    needs = [
        [title, cell(float(column(rows, name).mean()), ".1f"), int(column(rows, f"{name}_solved").sum())]
        for name, title in learners.items()
    ]
    metrics = spearman(column(rows, "M_L"), column(rows, "M_CI"), "two-sided")
    count = len(rows)
    write_text(
        folder / "table.md",
        page(
            f"Rank correlations over {count} bodies of metrics with the mean evaluations that learning needs, with "
            f"95 % intervals; of M_L and M_CI with each other {_told(metrics)}.",
            markdown(["metric", *learners.values()], "l" + "r" * len(learners), pairs),
            f"Evaluations until one succeeded in all worlds, {settings['repetitions']} repetitions in each body:",
            markdown(["learning", "mean evaluations", "runs that succeeded"], "lrr", needs),
        ),
    )
    summary = {
        "settings": dict(settings),
        "bodies": count,
        "metrics": asdict(metrics),
        "correlations": {f"{metric} {name}": asdict(one) for (metric, name), one in found.items()},
        "held_out": {name: asdict(one) for name, one in held.items()},
    }
    write_json(folder / "summary.json", summary)
    _draw(folder / "evaluations.png", rows, learners, found)


def _told(found: Correlation) -> str:
    """A correlation with its interval."""
    if found.r is None or found.low is None or found.high is None:
        return "-"
    return f"{found.r:.2f} ({found.low:.2f} to {found.high:.2f})"


def _draw(
    path: Path,
    rows: Sequence[Record],
    learners: Mapping[str, str],
    found: Mapping[tuple[str, str], Correlation],
) -> None:
    """A column for each kind of learning, a row for each metric; a point for each body."""
    shown = ("M_L", "M_CI", "felt")
    with figure(path, PAGE, 5.0, nrows=len(shown), ncols=len(learners), sharex="row", sharey="col") as (_, panels):
        for axes_row, metric in zip(panels, shown, strict=True):
            for axes, name in zip(axes_row, learners, strict=True):
                x, y = column(rows, metric), column(rows, name)
                known = np.isfinite(x) & np.isfinite(y)
                axes.scatter(x[known], y[known], s=9, color=COLOURS[0], alpha=0.6, linewidths=0)
                axes.set_xlabel(METRICS[metric])
                if (one := found[metric, name]).r is not None and len(rows) >= LEAST:
                    note(axes, f"$r_s = {one.r:.2f}$", 0.95)
            axes_row[0].set_ylabel("mean evaluations")
        for axes, title in zip(panels[0], learners.values(), strict=True):
            caption(axes, title)
