"""What the study writes: correlations of metrics and evaluations, how well held-out bodies are foretold, a picture."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure, headroom, note
from optim.experiments.results import write_json
from optim.experiments.tables import Record, column, markdown, mean_with_interval, page
from optim.measures.statistics import Correlation, reliability, spearman
from optim.studies.beyond.body_and_learning.learning import single_runs, succeeded
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

METRICS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$", "felt": "distance (homeostasis)", "voxels": "voxels"}
LEAST = 10  # bodies of which a correlation says something


def correlations(rows: Sequence[Record], learners: Sequence[str]) -> dict[tuple[str, str], Correlation]:
    """Rank correlation of every metric with the mean evaluations of every kind of learning, over bodies."""
    return {(metric, learner): between(rows, metric, learner) for metric in METRICS for learner in learners}


def between(rows: Sequence[Record], one: str, other: str) -> Correlation:
    """Rank correlation of two columns, over the bodies in which both are known."""
    x, y = column(rows, one), column(rows, other)
    known = np.isfinite(x) & np.isfinite(y)
    return spearman(x[known], y[known], "two-sided")


def possible(rows: Sequence[Record], metric: str, learner: str) -> tuple[float, float] | None:
    """Least and greatest rank correlation that a metric could have if bodies without it had it.

    Each of them has the least or the greatest value of all. None if no body lacks it, or only one has it.
    """
    x, y = column(rows, metric), column(rows, learner)
    known = np.isfinite(x)
    if known.all() or known.sum() < 2:
        return None
    least, greatest, slow = np.min(x[known]) - 1, np.max(x[known]) + 1, y > np.median(y)
    ends = (np.where(known, x, np.where(slow == rising, greatest, least)) for rising in (False, True))
    low, high = (spearman(values, y, "two-sided").r for values in ends)
    return None if low is None or high is None else (low, high)


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
        _line(METRICS[metric].strip("$").replace("{CI}", "CI"), [found[metric, name] for name in learners])
        for metric in METRICS
    ]
    pairs.append(_line("foretold by M_L and M_CI, held-out bodies", list(held.values())))
    needs = [
        [title, mean_with_interval(column(rows, name), ".1f"), succeeded(rows, name, settings["repetitions"])]
        for name, title in learners.items()
    ]
    metrics, alike = between(rows, "M_L", "M_CI"), between(rows, "M_L", "felt")
    write_text(
        folder / "table.md",
        page(
            "Rank correlations over n bodies of metrics with the mean evaluations that learning needs, with 95 % "
            f"intervals; of M_L and M_CI with each other {_with_interval(metrics)}, n = {metrics.n}; of M_L and the "
            f"distance {_with_interval(alike)}, n = {alike.n}.",
            markdown(["metric", "n", *learners.values()], "lr" + "r" * len(learners), pairs),
            _left_out(rows, learners),
            f"Evaluations until one succeeded in all worlds, {settings['repetitions']} repetitions in each of "
            f"{len(rows)} bodies, means with 95 % intervals over bodies:",
            markdown(["learning", "mean evaluations", "runs that succeeded"], "lrr", needs),
            *_spread(rows, learners),
        ),
    )
    summary = {
        "settings": dict(settings),
        "bodies": len(rows),
        "metrics": asdict(metrics),
        "correlations": {f"{metric} {name}": asdict(one) for (metric, name), one in found.items()},
        "held_out": {name: asdict(one) for name, one in held.items()},
    }
    write_json(folder / "summary.json", summary)
    _draw(folder / "evaluations.png", rows, learners, found)


def _line(title: str, over: Sequence[Correlation]) -> list[str]:
    """The cells of a metric: its title, of how many bodies its correlations are, and these."""
    least, most = min(one.n for one in over), max(one.n for one in over)
    return [title, f"{least}" if least == most else f"{least} to {most}", *map(_with_interval, over)]


def _left_out(rows: Sequence[Record], learners: Mapping[str, str]) -> str:
    """Which bodies the row of homeostasis lacks, and what they could change of it; empty if it lacks none."""
    missing = int(np.isnan(column(rows, "felt")).sum())
    found = {title: possible(rows, "felt", name) for name, title in learners.items()}
    ranges = ", ".join(f"{each[0]:.2f} to {each[1]:.2f} ({title})" for title, each in found.items() if each)
    told = [
        f"The distance (homeostasis) is unknown in {missing} of {len(rows)} bodies, as fewer than two of their drawn "
        "controllers succeed in all worlds; they are left out of its row.",
        f"Were it the least or the greatest of all in each of them, correlations could be {ranges}.",
    ]
    return " ".join(told[: bool(missing) + bool(ranges)])


def _spread(rows: Sequence[Record], learners: Mapping[str, str]) -> list[str | list[str]]:
    """How far runs differ within a body and between bodies, of rows that keep single runs; else nothing."""
    found = {title: single_runs(rows, name) for name, title in learners.items()}
    known = {title: reliability(runs) for title, runs in found.items() if runs is not None and min(runs.shape) > 1}
    if not known:
        return []
    lines = [
        [
            title,
            f"{each.within:.1f}",
            "-" if each.single is None else f"{each.single:.2f} ({each.low:.2f} to {each.high:.2f})",
            "-" if each.mean is None else f"{each.mean:.2f}",
        ]
        for title, each in known.items()
    ]
    heads = ["learning", "deviation within a body", "share between bodies", "of means"]
    return [
        "How reliable evaluations are: their standard deviation between runs in one body, the share of the variance "
        "of a run that is between bodies (ICC(1), with a 95 % interval that takes runs as normal), and that of the "
        "mean of a body's runs. The less it is, the more noise weakens correlations with these means:",
        markdown(heads, "lrrr", lines),
    ]


def _with_interval(found: Correlation) -> str:
    """Text of a correlation with its interval; a dash if it has none."""
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
                if (one := found[metric, name]).r is not None and one.n >= LEAST:
                    note(axes, f"$r_s = {one.r:.2f}$, n = {one.n}", 0.95)
            axes_row[0].set_ylabel("mean evaluations")
        for axes, title in zip(panels[0], learners.values(), strict=True):
            caption(axes, title)
            headroom(axes)  # of the whole column, which shares it
