"""Curves of searches: scores of one run over its generations, and of groups of runs over their costs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.figures import COLOURS
from optim.runs.comparison import Axis, Curve, spoken_axis
from optim.runs.generation import Generation
from taichi_sim.base.arrays import Floats
from taichi_sim.base.short_text import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

END: dict[str, Any] = {"marker": "o", "markersize": 3.5, "markevery": [-1]}  # where a step would not be seen
LINES: dict[str, Any] = {"linewidth": 1.8, "drawstyle": "steps-post", **END}
DRAWN = 1e300  # largest number that is drawn: the ends of an axis must have a finite distance
UNIT_LINES: dict[str, Any] = {"linewidth": 0.5, "alpha": 0.35, "drawstyle": "steps-post"}


def drawable(axes: "Axes", values: "ArrayLike | Sequence[Any]") -> Floats:
    """The values, with NaN for those that are too large to be drawn, which the axes then tell; None is NaN, too."""
    found = np.array(values, float)
    vast = abs(found) > DRAWN
    if vast.any():
        axes.set_title(f"what is beyond {DRAWN:g} is not drawn", fontsize="small")
    return np.where(vast, np.nan, found)


def draw_run(axes: "Axes", generations: Sequence[Generation]) -> None:
    """Draw a run's best score so far, the mean score of what its search keeps, and each climber as a thin line.

    Scores are missing as long as every evaluation has failed; there must be one generation at least.
    """
    x = [generation.generation for generation in generations]
    climbers = all(generation.scores is not None for generation in generations)
    if climbers:
        scores = drawable(axes, [generation.scores for generation in generations])
        axes.plot(x, scores, color=COLOURS[1], **UNIT_LINES)
    kept = "mean of the climbers" if climbers else "mean of what the search keeps"
    for label, colour, name in ((kept, COLOURS[1], "mean"), ("best", COLOURS[0], "best")):
        values = drawable(axes, [getattr(generation, name) for generation in generations])
        axes.plot(x, values, color=colour, label=label, **LINES)
    _by_generation(axes)


def draw_best(axes: "Axes", generations: Sequence[Generation], details: Mapping[str, str]) -> None:
    """Draw details of the best design so far, such as speeds: names in ``best_details``, and labels in the legend."""
    for (name, label), colour in zip(details.items(), COLOURS[2:] + COLOURS[:2], strict=False):
        values = drawable(axes, [(g.best_details or {}).get(name) for g in generations])
        axes.plot([g.generation for g in generations], values, color=colour, label=label, **LINES)
    _by_generation(axes)


def _by_generation(axes: "Axes") -> None:
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("generation")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if axes.get_xlim()[1] < 1:
        axes.set_xlim(-0.5, 0.5)


def draw_band(
    axes: "Axes",
    x: ArrayLike,
    mean: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    *,
    colour: str,
    label: str = "",
    steps: bool = False,
) -> None:
    """Draw a mean and the band of its interval at P places, shape (P,) each; NaN leaves a gap.

    With ``steps``, values hold until the next place; otherwise they are joined.
    """
    axes.plot(x, mean, color=colour, label=label or None, drawstyle="steps-post" if steps else "default")
    axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0, step="post" if steps else None)


def draw_curves(axes: "Axes", curves: Sequence[Curve], axis: Axis) -> None:
    """Draw the mean best score of each group with its 95 % band, and every unit as a thin line.

    Curves and their axis are those of ``optim.runs.comparison``.
    """
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        axes.plot(curve.x, curve.scores.T, color=colour, **UNIT_LINES)
        label = f"{printable(curve.label)}\n(mean of {len(curve.scores)} {curve.unit})"
        draw_band(axes, curve.x, *curve.band(), colour=colour, label=label, steps=True)
    # The band of two units hides all else by its width, so axes go no further beyond the units than these differ.
    scores = np.concatenate([curve.scores[np.isfinite(curve.scores)] for curve in curves])
    if scores.size and (room := np.ptp(scores)) > 0:
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, scores.min() - room), min(high, scores.max() + room))
    axes.set_xlabel("time [s]" if axis == "seconds" else spoken_axis(curves, axis))


def draw_share_solved(axes: "Axes", evaluations: ArrayLike, trials: int, budget: int, **line: Any) -> None:
    """Draw the share of trials that have reached their goal over evaluations: those of each success, and the budget."""
    x = np.concatenate([[0], np.sort(np.asarray(evaluations)), [budget]])
    y = np.append(np.arange(len(x) - 1), len(x) - 2) / trials
    axes.step(x, y, where="post", **line)
    axes.set(xlabel="evaluations", xlim=(0, budget), ylim=(0, 1.02))


def save_curves(curves: Sequence[Curve], axis: Axis, path: Path, score: str = "score") -> None:
    """Write the picture of :func:`draw_curves`; the suffix of the path chooses the format, ``score`` names the axis."""
    from matplotlib.figure import Figure

    from robots.view.picture import save_picture

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.add_subplot()
    draw_curves(axes, curves, axis)
    axes.set_ylabel(f"best {score} so far")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize="small")
    save_picture(figure, path)
