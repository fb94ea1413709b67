"""Learnability and interference of the soft robot: shapes and orientations, by what sampled gaits do in them.

Source: Powers 2021 dissertation, chapters 4 and 6: M_L and M_CI, found in vehicles, are proposed for complex robots,
too. There a body is a place of sensors and a controller two weights; here a body is a core pressure and an orientation,
a controller is a gait, and the environments are flat ground and a hill.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import PAGE, caption, figure, letter
from optim.experiments.results import Budget, Progress, cached_in_turn, write_summary
from optim.experiments.study import Study
from optim.measures.overlap import interference, learnability
from optim.measures.statistics import spearman, wilson
from optim.studies.chapter5.gaits import Case, Robot
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import ROWS, GaitSchedule
from robots.inflatable.simulation import travel_directions
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.results_folder import ResultsFolder

KIND = "soft-robot-metrics"
ONE_RUN = Robot(precision="f32", copies=1, noise=0.0)
COLUMNS = 8  # of a gait, played twice, as published
# Least speed on flat ground and on the hill that counts as success [BL/s]. For measure: inching has 0.06 and 0.02, the
# mean of searched gaits 0.09 and 0.00, and a robot that slides back by 0.01 has lost a fifth of its length in the end.
THRESHOLDS = {"lenient": (0.01, -0.01), "climbing": (0.02, 0.0), "strict": (0.05, 0.005)}
LEAST_BODIES = 10  # of fewer an interval and a p of their correlation say nothing
HEADER = (
    *("pressure", "orientation", "threshold", "flat_least", "hill_least", "gaits", "failed", "flat", "hill", "both"),
    *(f"{metric}{end}" for metric in ("M_L", "M_CI") for end in ("", "_low", "_high")),
)


@dataclass(frozen=True)
class SoftRobotMetrics:
    """Settings.

    Attributes:
        pressures: of the core [Pa], ascending.
        orientations: [degrees], ascending.
        gaits: sampled, the same ones in every body: every frequency and offset of every actuator equally likely.
        slope: of the hill [degrees].
        seed: of the sample.
        robot: how it is simulated; one copy, without noise.
    """

    pressures: tuple[float, ...] = (0.0, 3e3, 6e3, 9e3, 12e3)
    orientations: tuple[float, ...] = (0.0, 22.5, 45.0, 67.5, 90.0)
    gaits: int = 512
    slope: float = 15.0
    seed: int = 1
    robot: Robot = ONE_RUN

    def __post_init__(self) -> None:
        checks.integer("gaits", self.gaits, 1, 100_000)
        checks.integer("seed", self.seed, 0)
        if self.robot.copies != 1 or self.robot.noise:
            raise ValueError(
                f"robot: {self.robot.copies} copies with noise of {self.robot.noise:g} m are not allowed; "
                "give 1 without noise"
            )
        object.__setattr__(self, "slope", checks.number("slope", Terrain(self.slope).slope, 0.1, 45.0, "degrees"))
        for name in ("pressures", "orientations"):
            values = getattr(self, name)
            if not values or np.any(np.diff(values) <= 0):
                raise ValueError(f"{name}: {values} are not allowed; give at least one, ascending")
        for body in self.bodies:
            InflatableDesign(*body, GaitSchedule(np.zeros((ROWS, COLUMNS), bool)))  # refuses what is not allowed

    @property
    def bodies(self) -> list[tuple[float, float]]:
        """Pressure and orientation of each body."""
        return [(pressure, orientation) for pressure in self.pressures for orientation in self.orientations]

    @property
    def schedules(self) -> list[GaitSchedule]:
        """The gaits."""
        codes = np.random.default_rng(self.seed).integers(0, COLUMNS, (self.gaits, 2, ROWS), endpoint=True)
        return [GaitSchedule.from_codes(f, phi, COLUMNS) for f, phi in codes]


SCALES: Mapping[Budget, SoftRobotMetrics] = {
    "small": SoftRobotMetrics((0.0, 12e3), (0.0, 90.0), gaits=32),
    "medium": SoftRobotMetrics((0.0, 6e3, 12e3), (0.0, 45.0, 90.0), gaits=128),
    "full": SoftRobotMetrics(),
}


def study(
    folder: Path, settings: SoftRobotMetrics, progress: Progress = None, threads: int | None = None
) -> dict[str, Any]:
    """Write a table, heat maps and all numbers; more bodies may follow in the same folder.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    about = {name: getattr(settings, name) for name in ("gaits", "slope", "seed")}
    parts = ResultsFolder(folder, KIND, {**about, "robot": settings.robot.describe()})
    flat = [(f"flat_{pressure:g}", partial(on_flat, settings, pressure, threads)) for pressure in settings.pressures]
    hill = [(f"hill_{body[0]:g}_{body[1]:g}", partial(on_hill, settings, body, threads)) for body in settings.bodies]
    found = cached_in_turn(parts, "speeds", [*flat, *hill], progress)
    ways, climbs = np.array(found[: len(flat)]), np.array(found[len(flat) :])
    level = (travel_directions(np.array(settings.orientations)) @ ways).reshape(climbs.shape)
    rows = rows_of(settings.bodies, np.stack([level, climbs], axis=1))
    summary = {
        **about,
        "thresholds": {name: list(least) for name, least in THRESHOLDS.items()},
        "correlations": correlations(rows),
        "rows": rows,
    }
    write_summary(folder, "metrics", summary)
    draw(rows, folder / "metrics.png")
    return summary


def on_flat(settings: SoftRobotMetrics, pressure: float, threads: int | None, progress: Progress) -> Floats:
    """Speeds of all gaits on flat ground along 0 and 90 degrees, shape (2, gaits); NaN of those that diverged.

    There a robot goes its way whatever its orientation, which only says what counts as ahead: one run is enough.
    """
    robot, cases = settings.robot, [Case(design, Terrain()) for design in _designs(settings, pressure, 0.0)]
    counted = nominal_steps(2 * COLUMNS, robot.actuation) * robot.geometry.time_step
    way = np.asarray(robot.play(cases, threads, progress).displacement, float).T
    return way / (robot.geometry.body_length * counted)


def on_hill(settings: SoftRobotMetrics, body: tuple[float, float], threads: int | None, progress: Progress) -> Floats:
    """Speeds of all gaits up the hill in a body, shape (gaits,); NaN of those that diverged."""
    cases = [Case(design, Terrain(settings.slope)) for design in _designs(settings, *body)]
    return settings.robot.speeds(cases, threads, progress)[:, 0]


def _designs(settings: SoftRobotMetrics, pressure: float, orientation: float) -> list[InflatableDesign]:
    return [InflatableDesign(pressure, orientation, schedule) for schedule in settings.schedules]


def solved(speeds: Floats, least: tuple[float, float]) -> Bools:
    """Whether each gait succeeds in each environment, of speeds of the same shape (..., 2, gaits)."""
    succeeds: Bools = np.nan_to_num(speeds, nan=-np.inf) >= np.array(least)[:, None]
    return succeeds


def rows_of(bodies: Sequence[tuple[float, float]], speeds: Floats) -> list[dict[str, Any]]:
    """A row for each threshold and body, of speeds of shape (bodies, 2, gaits); intervals are 95 % (Wilson).

    Where no gait succeeds anywhere, there is no M_CI.
    """
    rows = []
    for name, least in THRESHOLDS.items():
        for (pressure, orientation), here, succeeds in zip(bodies, speeds, solved(speeds, least), strict=True):
            count = succeeds.sum(axis=0)
            both, either = int((count == 2).sum()), int((count >= 1).sum())
            resists = (float(interference(count[None], 2)), *wilson(both, either)) if either else (None,) * 3
            learns = float(learnability(count[None], 2)), *wilson(both, len(count))
            failed, succeeded = int(np.isnan(here).any(axis=0).sum()), succeeds.sum(axis=1).tolist()
            counts = len(count), failed, *succeeded, both
            values = (pressure, orientation, name, *least, *counts, *learns, *resists)
            rows.append(dict(zip(HEADER, values, strict=True)))
    return rows


def correlations(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Correlate M_L and M_CI over the bodies that have both, by threshold (Spearman); in vehicles they agree.

    With fewer than ``LEAST_BODIES`` only the coefficient is given.
    """
    found = {}
    for name in THRESHOLDS:
        here = [row for row in rows if row["threshold"] == name and row["M_CI"] is not None]
        one = asdict(spearman([row["M_L"] for row in here], [row["M_CI"] for row in here], "two-sided"))
        found[name] = one if len(here) >= LEAST_BODIES else {**one, "low": None, "high": None, "p": None}
    return found


METRICS = {"M_L": "learnability $M_L$", "M_CI": "resistance to\ninterference $M_{CI}$"}


def draw(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """A row for each metric, a column for each threshold; pressure across, orientation upwards.

    A body has no M_CI, "none", where no gait succeeds anywhere.

    Args:
        rows: see ``optim.studies.chapter5.metrics.rows_of``.
        path: of the picture.
    """
    pressures, orientations, thresholds = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("pressure", "orientation", "threshold")
    )
    height = 2 * (0.9 + 0.32 * len(orientations))
    with figure(path, PAGE, height, nrows=2, ncols=len(thresholds), sharex=True, sharey=True) as (drawn, panels):
        for line, (metric, title) in zip(panels, METRICS.items(), strict=True):
            most = max((row[metric] for row in rows if row[metric] is not None), default=0.0) or 1.0
            for axes, threshold in zip(line, thresholds, strict=True):
                here = [row for row in rows if row["threshold"] == threshold]
                values = np.array([row[metric] for row in here], float).reshape(len(pressures), len(orientations)).T
                image = axes.imshow(values, origin="lower", aspect="auto", cmap="cividis", vmin=0.0, vmax=most)
                for (y, x), value in np.ndenumerate(values):
                    text = "none" if np.isnan(value) else f"{value:.2g}"
                    colour = "white" if value < most / 2 else "black"
                    axes.annotate(text, (x, y), ha="center", va="center", fontsize=6, color=colour)
                axes.set_xticks(range(len(pressures)), [f"{pressure / 1e3:g}" for pressure in pressures])
                axes.set_yticks(range(len(orientations)), [f"{orientation:g}" for orientation in orientations])
            drawn.colorbar(image, ax=line.tolist(), label=title)
        for axes, threshold in zip(panels[0], thresholds, strict=True):
            least = next((row["flat_least"], row["hill_least"]) for row in rows if row["threshold"] == threshold)
            caption(axes, f"{threshold}: {least[0]:g}, {least[1]:g} BL/s")
        for axes in panels[-1]:
            axes.set_xlabel("core pressure [kPa]")
        for axes in panels[:, 0]:
            axes.set_ylabel("orientation [degrees]")
        letter(panels)


STUDY = Study(
    title="learnability and interference of shapes and orientations of the soft robot, by sampled gaits",
    source="chapters 4 and 6, metrics of complex robots",
    scales=SCALES,
    run=study,
    writes=("metrics.csv", "metrics.png", "summary.json"),
    cost="20 h of two cores",
)
