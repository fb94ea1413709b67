"""How inching on flat ground depends on the friction of sliding and of gripping feet.

Source: Powers 2021 dissertation, ch. 5, figure "friction", d (the difference of the two) and e (their mean).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.results import Progress, write_summary
from optim.experiments.study import Study
from optim.experiments.tables import cell, markdown, page
from optim.studies.chapter5.gaits import Case, GaitRuns, kept_speeds, shown, spread
from robots.inflatable.design import INCHING
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

NAME = "friction-sweeps"
Point = tuple[str, float, float, float]  # sweep, friction of sliding and of gripping feet, published speed
Points = Mapping[str, Sequence[tuple[float, float, float]]]  # by sweep: (low, high) friction, published speed
FRICTION: Points = {
    "difference": (
        *((0.0001, 2.0, 0.0603), (0.2, 1.8, 0.0450), (0.4, 1.6, 0.0338), (0.6, 1.4, 0.0223), (0.8, 1.2, 0.0154)),
        *((0.93, 1.07, 0.0032), (1.0, 1.0, -0.0114)),
    ),
    "mean": ((0.13, 2.13, 0.0485), (0.4, 2.4, 0.0280), (0.8, 2.8, 0.0141), (1.2, 3.2, 0.0043), (2.0, 4.0, -0.0014)),
}
AXES = {
    "difference": "difference of friction, gripping - sliding",
    "mean": "mean friction of gripping and sliding",
}
TOLERANCE = 0.004  # BL/s: how far the original program's own builds are apart, with some room


@dataclass(frozen=True)
class FrictionSweeps:
    """Frictions of feet, and the robot that inches with them."""

    fixed: ClassVar = ("robot.actuation.high_friction", "robot.actuation.low_friction")  # what it sweeps
    robot: GaitRuns = field(default_factory=GaitRuns)  # that inches
    # of each sweep: friction of sliding and of gripping feet, and the published speed [body lengths/s]. Each replaces
    # the robot's own everywhere: skin, seams and feet; bladders have a third of the higher one
    points: Points = field(default_factory=lambda: FRICTION)

    def __post_init__(self) -> None:
        for name, points in self.points.items():
            if name not in AXES:
                raise ValueError(f"points: sweep {name!r} is unknown; choose of {', '.join(AXES)}")
            if not points:
                raise ValueError(f"points: sweep {name} has none; give at least one")

    @property
    def listed(self) -> list[Point]:
        """All points, in the order in which they are played."""
        return [(name, *point) for name, points in self.points.items() for point in points]


def study(
    folder: Path, settings: FrictionSweeps, progress: Progress = None, threads: int | None = None
) -> dict[str, Any]:
    """Write a table and a figure of both sweeps, and all numbers."""
    points = settings.listed
    cases = [Case(INCHING, Terrain(high_friction=high, low_friction=low)) for _, low, high, _ in points]
    about = {"robot": settings.robot.describe(), "cases": [case.describe() for case in cases]}
    parts = ResultsFolder(folder, NAME, about)
    return _report(folder, points, settings.robot.speeds_in_parts(cases, parts, threads, progress))


def rewrite(data: Data, folder: Path) -> None:
    """Write all that the study writes from the speeds that its folder keeps."""
    points = data.kept(NAME, _points_of)
    _report(folder, points, kept_speeds(data, len(points)))


def _points_of(settings: Mapping[str, Any]) -> list[Point]:
    """The points that were played: what is published of the friction of each case."""
    published = {(low, high): (name, low, high, speed) for name, low, high, speed in FrictionSweeps().listed}
    points = list[Point]()
    if not settings["cases"]:
        raise ValueError("cases: none is there; give at least one")
    for case in settings["cases"]:
        ground = checks.table("terrain", case["terrain"])
        if (key := (ground["low_friction"], ground["high_friction"])) not in published:
            raise ValueError(f"cases: friction of {key[0]} and {key[1]} is none of the published points")
        points.append(published[key])
    return points


def _report(folder: Path, points: Sequence[Point], speeds: Floats) -> dict[str, Any]:
    """Write what follows from the speeds, of shape (points, copies)."""
    rows = rows_of(points, speeds)
    worst = largest_deviation(rows)
    summary = {"largest_deviation": worst, "tolerance": TOLERANCE, "rows": rows}
    write_summary(folder, "friction", summary, text_of(rows, worst))
    draw(rows, speeds, folder / "friction.png")
    return summary


def rows_of(points: Sequence[Point], speeds: Floats) -> list[dict[str, Any]]:
    """A row for each point, of speeds of shape (points, copies)."""
    rows = []
    for (sweep, low, high, published), copies in zip(points, speeds, strict=True):
        found = spread(copies)
        away = None if found["mean"] is None else found["mean"] - published
        row = {"sweep": sweep, "low": low, "high": high, **found, "published": published}
        rows.append({**row, "deviation_from_published": away})
    return rows


def largest_deviation(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """The point farthest from the published speed; None where every copy diverged."""
    known = [row for row in rows if row["deviation_from_published"] is not None]
    if not known:
        return None
    row = max(known, key=lambda row: abs(row["deviation_from_published"]))
    within = sum(abs(each["deviation_from_published"]) <= TOLERANCE for each in known)
    away = row["deviation_from_published"]
    return {"low": row["low"], "high": row["high"], "difference": away, "within": within, "of": len(rows)}


def text_of(rows: Sequence[Mapping[str, Any]], worst: Mapping[str, Any] | None) -> str:
    """The page: the table, and the point of the largest deviation, if there is any."""
    cells = []
    for row in rows:
        away = row["deviation_from_published"]
        difference = cell(away if away is None else round(away, 4) + 0.0, "+.4f")
        friction = f"{row['low']:g}", f"{row['high']:g}"
        cells.append((row["sweep"], *friction, shown(row), f"{row['published']:.4f}", difference))
    return page(
        "Inching on flat ground [body lengths/s]: mean ± standard deviation of copies whose starts differ by noise.",
        markdown(("sweep", "sliding", "gripping", "speed", "published", "difference"), "lrrrrr", cells),
        f"Largest difference: {worst['difference']:+.4f} at ({worst['low']:g}, {worst['high']:g}); "
        f"{worst['within']} of {worst['of']} points are within {TOLERANCE:g}."
        if worst
        else "",
    )


def draw(rows: Sequence[Mapping[str, Any]], speeds: Floats, path: Path) -> None:
    """Speeds against the difference and the mean of the two frictions, copies as points, beside the published ones."""
    played = [(row, copies) for row, copies in zip(rows, speeds, strict=True)]
    with figure(path, PAGE, 2.8, ncols=len(AXES), sharey=True) as (drawn, panels):
        for axes, (sweep, label) in zip(panels.flat, AXES.items(), strict=True):
            found = [pair for pair in played if pair[0]["sweep"] == sweep]
            if sweep == "mean":  # the published figure has the robot's own friction, the base of both, in both
                found = [pair for pair in played if pair[0]["sweep"] == "difference"][:1] + found
            low, high, means, published = (
                np.array([row[name] for row, _ in found], float) for name in ("low", "high", "mean", "published")
            )
            x = high - low if sweep == "difference" else (low + high) / 2
            axes.axhline(0.0, color="0.8", linewidth=0.6, zorder=0)
            ours = axes.plot(x, means, marker="o", markersize=3.5, color=COLOURS[0], label="here, mean of copies")
            for each, (_, copies) in zip(x, found, strict=True):
                dots = axes.plot([each] * len(copies), copies, ".", markersize=2.5, color=COLOURS[4], label="each copy")
            theirs = axes.plot(x, published, "s--", ms=3.5, mfc="none", color=COLOURS[1], label="published")
            axes.set_xlabel(label)
        panels[0, 0].set_ylabel("speed of inching [BL/s]")
        legend_above(drawn, [*ours, *dots, *theirs])


STUDY = Study(
    title="inching on flat ground with other friction of sliding and gripping feet",
    source="chapter 5, figure of friction, d and e",
    scales={"small": FrictionSweeps(GaitRuns(copies=2)), "full": FrictionSweeps()},
    run=study,
    rewrite=rewrite,
    writes=("friction.md", "friction.csv", "friction.png", "summary.json"),
)
