"""Pictures of runs."""

from collections.abc import Sequence
from pathlib import Path

from optim.runs.comparison import Curve


def save_curves(curves: Sequence[Curve], axis: str, path: Path) -> None:
    """Mean best score of each group with its 95 % bootstrap band, and every unit as a thin line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for number, curve in enumerate(curves):
        colour, (mean, low, high) = f"C{number}", curve.band()
        axes.plot(curve.x, curve.scores.T, color=colour, linewidth=0.4, alpha=0.25, drawstyle="steps-post")
        axes.fill_between(curve.x, low, high, color=colour, alpha=0.25, step="post", linewidth=0)
        label = f"{curve.label}\n(mean of {len(curve.scores)} {curve.unit})"
        axes.plot(curve.x, mean, color=colour, linewidth=2, drawstyle="steps-post", label=label)
    axes.set_xlabel({"seconds": "time [s]"}.get(axis, axis))
    axes.set_ylabel("best score so far")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)
