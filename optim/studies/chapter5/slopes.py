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

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, COLUMN, figure, legend_above
from optim.experiments.results import Progress, write_summary
from optim.experiments.study import Study
from optim.experiments.tables import markdown, page
from optim.measures.statistics import bootstrap_means
from optim.plots import draw_band
from optim.studies.chapter5.gaits import Case, GaitRuns, kept_speeds, shown, spread
from robots.inflatable.design import INCHING, ROLLING
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

NAME = "slope-sweep"
GAITS = {"rolling": ROLLING, "inching": INCHING}
LEAST_COPIES = 5  # of fewer a bootstrap interval is hardly more than their range


@dataclass(frozen=True)
class SlopeSweep:
    """Slopes that are climbed, and the robot that climbs them."""

    slopes: tuple[float, ...] = tuple(map(float, range(16)))  # ascending, at least two [degrees]
    robot: GaitRuns = field(default_factory=GaitRuns)  # that rolls and inches

    def __post_init__(self) -> None:
        slopes = [Terrain(slope).slope for slope in self.slopes]
        if len(slopes) < 2 or np.any(np.diff(slopes) <= 0):
            raise ValueError(f"slopes: {self.slopes} are not allowed; give at least two, ascending")
        object.__setattr__(self, "slopes", tuple(slopes))


def study(folder: Path, settings: SlopeSweep, progress: Progress = None, threads: int | None = None) -> dict[str, Any]:
    """Write a table, a figure, the transition and all numbers."""
    slopes, robot = settings.slopes, settings.robot
    parts = ResultsFolder(folder, NAME, {"slopes": slopes, "robot": robot.describe()})
    cases = [Case(design, Terrain(slope)) for slope in slopes for design in GAITS.values()]
    return _report(folder, slopes, robot.speeds_in_parts(cases, parts, threads, progress))


def rewrite(data: Data, folder: Path) -> None:
    """Write all that the study writes from the speeds that its folder keeps."""
    slopes = data.kept(NAME, lambda settings: SlopeSweep(tuple(settings["slopes"])).slopes)
    _report(folder, slopes, kept_speeds(data, len(slopes) * len(GAITS)))


def _report(folder: Path, slopes: Sequence[float], played: Floats) -> dict[str, Any]:
    """Write what follows from the speeds of both gaits on each slope, of shape (cases, copies)."""
    speeds = played.reshape(len(slopes), len(GAITS), -1)
    rows = [
        {"slope": slope, "gait": gait, **spread(copies)}
        for slope, both in zip(slopes, speeds, strict=True)
        for gait, copies in zip(GAITS, both, strict=True)
    ]
    place = transition(slopes, speeds[:, 0], speeds[:, 1])
    unknown = [slope for slope, told in zip(slopes, known_at(speeds), strict=True) if not told]
    summary = {"transition": place, "unknown": unknown, "rows": rows}
    write_summary(folder, "slopes", summary, text_of(summary))
    draw(slopes, speeds, place, folder / "slopes.png")
    return summary


def transition(slopes: Sequence[float], rolling: ArrayLike, inching: ArrayLike) -> dict[str, Any] | None:
    """The slope from which on inching is faster, by the means of the copies, linear between slopes.

    Slopes at which all copies of a gait diverged are left out.

    Args:
        slopes: ascending, shape (S,) [degrees].
        rolling, inching: speeds, shape (S, copies); NaN of copies that diverged.

    Returns:
        ``slope``, the 95 % bootstrap interval ``low`` to ``high`` over the copies that are there at every slope, the
        slopes ``between`` which it was interpolated, and the share of resamples that ``cross``; without an interval
        and a share where fewer than ``LEAST_COPIES`` are. None if inching does not overtake.
    """
    both = np.stack([np.asarray(rolling, float), np.asarray(inching, float)], axis=1)
    told = known_at(both)
    known_slopes, both = np.asarray(slopes, float)[told], both[told]
    means = np.nanmean(both, axis=2)
    if (found := crossing(known_slopes, means[:, 0] - means[:, 1])) is None:
        return None
    place, *between = found
    ahead = both[:, 0] - both[:, 1]
    ahead = ahead[:, ~np.isnan(ahead).any(axis=0)]
    if ahead.shape[1] < LEAST_COPIES:
        return {"slope": place, "low": None, "high": None, "between": between, "cross": None}
    resampled = [crossing(known_slopes, each) for each in bootstrap_means(ahead.T)]
    known = np.array([each[0] for each in resampled if each is not None])
    low, high = np.percentile(known, [2.5, 97.5]).tolist() if known.size else (None, None)
    return {"slope": place, "low": low, "high": high, "between": between, "cross": known.size / len(resampled)}


def known_at(speeds: Floats) -> Bools:
    """Which slopes have a copy of every gait that did not diverge, shape (S,); speeds have shape (S, gaits, copies)."""
    return np.all(~np.isnan(speeds).all(axis=2), axis=1)


def crossing(slopes: Sequence[float] | Floats, ahead: Floats) -> tuple[float, float, float] | None:
    """Find the slope at which a positive difference, (S,), becomes negative, and those beside it; None without."""
    negative = np.flatnonzero(ahead < 0)
    if not negative.size or negative[0] == 0:
        return None
    n = int(negative[0])
    share = ahead[n - 1] / (ahead[n - 1] - ahead[n])
    return float(slopes[n - 1] + share * (slopes[n] - slopes[n - 1])), float(slopes[n - 1]), float(slopes[n])


def text_of(summary: Mapping[str, Any]) -> str:
    """The page: the table, and where the transition is."""
    cells: dict[float, list[str]] = {}
    for row in summary["rows"]:
        cells.setdefault(row["slope"], [f"{row['slope']:g}"]).append(shown(row))
    found, unknown = summary["transition"], ", ".join(f"{slope:g}" for slope in summary["unknown"])
    remark = "Inching does not overtake rolling between these slopes."
    if found is not None:
        interval = "" if found["low"] is None else f" [{found['low']:.2f}, {found['high']:.2f}]"
        between = "interpolated between {:g} and {:g}".format(*found["between"])
        remark = f"Inching overtakes rolling at {found['slope']:.2f} degrees{interval}, {between}."
    if unknown:
        remark += f" Left out: {unknown} degrees, where all copies of a gait diverged."
    return page(
        "Speeds uphill [body lengths/s]: mean ± standard deviation of copies whose starts differ by noise.",
        markdown(("slope [degrees]", *GAITS), "r" * (1 + len(GAITS)), cells.values()),
        remark,
    )


def draw(slopes: Sequence[float], speeds: Floats, found: Mapping[str, Any] | None, path: Path) -> None:
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
            label = f"transition, {found['slope']:.1f} degrees"
            axes.axvline(found["slope"], color="0.4", ls=":", lw=0.9, label=label)
            if found["low"] is not None:
                axes.axvspan(found["low"], found["high"], color="0.6", alpha=0.25, linewidth=0)
        axes.set(xlabel="slope [degrees]", ylabel="speed uphill [BL/s]")
        legend_above(drawn, axes.get_legend_handles_labels()[0])


STUDY = Study(
    title="rolling and inching up slopes, and the slope at which inching overtakes",
    source="chapter 5, transition of gaits",
    scales={
        "small": SlopeSweep((0.0, 3.0, 6.0, 9.0, 12.0, 15.0), GaitRuns(copies=2)),
        "medium": SlopeSweep(robot=GaitRuns(copies=2)),
        "full": SlopeSweep(),
    },
    run=study,
    rewrite=rewrite,
    writes=("slopes.md", "slopes.csv", "slopes.png", "summary.json"),
)
