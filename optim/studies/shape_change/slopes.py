"""At which slope a flat robot that inches overtakes a round one that rolls.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot": a transition regime in which the ideal
shape and gait switch; its hardware rolled up to about 9 degrees and inched up to about 14.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import bootstrap_means
from optim.plots import draw_band
from optim.studies.figures import COLOURS, COLUMN, figure, legend_above
from optim.studies.results import Budget, Progress, write_summary
from optim.studies.shape_change.gaits import Case, Floats, Robot, shown, speeds_in_parts, spread
from robots.inflatable import INCHING, ROLLING
from robots.results_folder import ResultsFolder
from robots.terrain import Terrain

KIND = "slope-sweep"
GAITS = {"rolling": ROLLING, "inching": INCHING}
HEADER = ("slope", "gait", "mean", "deviation", "lowest", "highest", "copies", "diverged")


@dataclass(frozen=True)
class SlopeSweep:
    """Settings.

    Attributes:
        slopes: ascending, at least two [degrees].
        robot: that rolls and inches.
    """

    slopes: tuple[float, ...] = tuple(map(float, range(16)))
    robot: Robot = field(default_factory=Robot)

    def __post_init__(self) -> None:
        slopes = [Terrain(slope).slope for slope in self.slopes]
        if len(slopes) < 2 or np.any(np.diff(slopes) <= 0):
            raise ValueError(f"slopes: {self.slopes} are not allowed; give at least two, ascending")
        object.__setattr__(self, "slopes", tuple(slopes))


SCALES: Mapping[Budget, SlopeSweep] = {
    "small": SlopeSweep((0.0, 3.0, 6.0, 9.0, 12.0, 15.0), Robot(copies=2)),
    "medium": SlopeSweep(robot=Robot(copies=2)),
    "full": SlopeSweep(),
}


def study(folder: Path, settings: SlopeSweep, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a table, a figure, the transition and all numbers.

    For the arguments see :class:`optim.studies.catalogue.Item`.
    """
    parts = ResultsFolder(folder, KIND, {"slopes": settings.slopes, "robot": settings.robot.describe()})
    cases = [Case(design, Terrain(slope)) for slope in settings.slopes for design in GAITS.values()]
    found = speeds_in_parts(settings.robot, cases, parts, threads, progress)
    speeds = found.reshape(len(settings.slopes), len(GAITS), settings.robot.copies)
    rows = [
        {"slope": slope, "gait": gait, **spread(copies)}
        for slope, both in zip(settings.slopes, speeds, strict=True)
        for gait, copies in zip(GAITS, both, strict=True)
    ]
    place = transition(settings.slopes, speeds[:, 0], speeds[:, 1])
    summary = {"transition": place, "rows": rows}
    write_summary(folder, "slopes", HEADER, summary, page(settings, summary))
    draw(settings.slopes, speeds, place, folder / "slopes.png")
    return summary


def transition(slopes: Sequence[float], rolling: ArrayLike, inching: ArrayLike) -> dict[str, Any] | None:
    """The slope from which on inching is faster, by the means of the copies, linear between slopes.

    Args:
        slopes: ascending, shape (S,) [degrees].
        rolling: speeds, shape (S, copies); NaN of copies that diverged.
        inching: likewise.

    Returns:
        ``slope``, the 95 % bootstrap interval ``low`` to ``high`` over the copies, the slopes ``between`` which it
        was interpolated, and the share of resamples that ``cross``; None if inching does not overtake.
    """
    ahead = np.asarray(rolling, float) - np.asarray(inching, float)
    ahead = ahead[:, ~np.isnan(ahead).any(axis=0)]  # a copy counts that is there at every slope
    if not ahead.size or (found := crossing(slopes, ahead.mean(axis=1))) is None:
        return None
    place, *between = found
    resampled = [crossing(slopes, means) for means in bootstrap_means(ahead.T)]
    known = np.array([each[0] for each in resampled if each is not None])
    low, high = np.percentile(known, [2.5, 97.5]).tolist() if known.size else (place, place)
    return {"slope": place, "low": low, "high": high, "between": between, "cross": known.size / len(resampled)}


def crossing(slopes: Sequence[float], ahead: Floats) -> tuple[float, float, float] | None:
    """Where a difference, shape (S,), that is positive first becomes negative, and the slopes before and after.

    None if it never does.
    """
    negative = np.flatnonzero(ahead < 0)
    if not negative.size or negative[0] == 0:
        return None
    n = int(negative[0])
    share = ahead[n - 1] / (ahead[n - 1] - ahead[n])
    return float(slopes[n - 1] + share * (slopes[n] - slopes[n - 1])), float(slopes[n - 1]), float(slopes[n])


def page(settings: SlopeSweep, summary: dict[str, Any]) -> str:
    """The table as Markdown."""
    lines = ["Speeds uphill [body lengths/s]: mean ± standard deviation of copies whose starts differ by noise.", "",
             f"| slope [degrees] | {' | '.join(GAITS)} |", f"| ---: |{' ---: |' * len(GAITS)}"]  # fmt: skip
    for slope in settings.slopes:
        here = [shown(row) for row in summary["rows"] if row["slope"] == slope]
        lines.append(f"| {slope:g} | {' | '.join(here)} |")
    return "\n".join([*lines, "", _sentence(summary["transition"])]) + "\n"


def _sentence(found: dict[str, Any] | None) -> str:
    if found is None:
        return "Inching does not overtake rolling between these slopes."
    low, high = found["between"]
    return (f"Inching overtakes rolling at {found['slope']:.2f} degrees [{found['low']:.2f}, {found['high']:.2f}], "
            f"interpolated between {low:g} and {high:g}.")  # fmt: skip


def draw(slopes: Sequence[float], speeds: Floats, found: dict[str, Any] | None, path: Path) -> None:
    """Speeds of both gaits against the slope: mean, range of the copies, and the transition."""
    with figure(path, COLUMN, 2.8) as (drawn, panels):
        axes = panels[0, 0]
        axes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
        for number, gait in enumerate(GAITS):
            copies = np.ma.masked_invalid(speeds[:, number])
            low, high, mean = (getattr(copies, name)(axis=1).filled(np.nan) for name in ("min", "max", "mean"))
            draw_band(axes, slopes, mean, low, high, colour=COLOURS[number], label=gait)
            axes.plot(slopes, mean, "o", markersize=2.5, color=COLOURS[number])
        if found:
            axes.axvline(found["slope"], color="0.4", linestyle=":", linewidth=0.9,
                         label=f"transition, {found['slope']:.1f} degrees")  # fmt: skip
            axes.axvspan(found["low"], found["high"], color="0.6", alpha=0.25, linewidth=0)
        axes.set(xlabel="slope [degrees]", ylabel="speed uphill [BL/s]")
        legend_above(drawn, axes.get_legend_handles_labels()[0])
