"""Learnability and interference of the soft robot: shapes and orientations, by what sampled gaits do in them.

Source: Powers 2021 dissertation, chapters 4 and 6: M_L and M_CI, found in vehicles, are proposed for complex robots,
too. There a body is a place of sensors and a controller two weights; here a body is a core pressure and an orientation,
a controller is a gait, and the environments are flat ground and a hill.
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from optim.experiments.allowed import Allowed
from optim.experiments.data import Data
from optim.experiments.figures import PAGE, caption, figure
from optim.experiments.results import Progress, computed_arrays, write_summary
from optim.experiments.study import Settings, Study, Whole
from optim.experiments.tables import Record, column, distinct, select
from optim.measures.overlap import learnability, resistance
from optim.measures.statistics import spearman, wilson
from optim.studies.chapter5.gaits import Case, GaitRuns, Uphill
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import ROWS, GaitSchedule
from robots.inflatable.simulation import travel_directions
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

NAME = "soft-robot-metrics"
COLUMNS = 8  # of a gait, played twice, as published
# Least speed on flat ground and on the hill that counts as success [BL/s]. For measure: inching has 0.06 and 0.02, the
# mean of searched gaits 0.09 and 0.00, and a robot that slides back by 0.01 has lost a fifth of its length in the end.
THRESHOLDS = {"lenient": (0.01, -0.01), "climbing": (0.02, 0.0), "strict": (0.05, 0.005)}
SAMPLE = ("gaits", "slope", "seed")  # settings that say what is tried in every body
LEAST_BODIES = 10  # of fewer an interval and a p of their correlation say nothing


@dataclass(frozen=True)
class SoftRobotMetrics(Settings):
    """Bodies whose metrics are found, the gaits that are tried in them, and the hill."""

    fixed: ClassVar = ("robot.copies", "robot.noise", "robot.seed")  # each gait is played once, from rest
    pressures: tuple[float, ...] = (0.0, 3e3, 6e3, 9e3, 12e3)  # of the core [Pa], ascending
    orientations: tuple[float, ...] = (0.0, 22.5, 45.0, 67.5, 90.0)  # [degrees], ascending
    # sampled, the same ones in every body: every frequency and offset of every actuator equally likely
    gaits: Annotated[int, partial(checks.integer, low=1, high=100_000)] = 512
    slope: Uphill = 15.0  # of the hill [degrees]
    seed: Whole = 1  # of the sample
    robot: GaitRuns = GaitRuns(precision="f32", copies=1, noise=0.0)  # noqa: RUF009 (immutable)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.robot.copies != 1 or self.robot.noise:
            raise ValueError(
                f"robot: {self.robot.copies} copies with noise of {self.robot.noise:g} m are not allowed; "
                "give 1 without noise"
            )
        for name in ("pressures", "orientations"):
            values = getattr(self, name)
            if not values or np.any(np.diff(values) <= 0):
                raise ValueError(f"{name}: {values} are not allowed; give at least one, ascending")
        for body in self.bodies:
            InflatableDesign(*body, GaitSchedule(np.zeros((ROWS, COLUMNS), bool)))  # refuses what is not allowed

    @property
    def sample(self) -> dict[str, Any]:
        """What is tried in every body: gaits and how they are drawn, and the hill."""
        return {name: getattr(self, name) for name in SAMPLE}

    @property
    def bodies(self) -> list[tuple[float, float]]:
        """Pressure and orientation of each body."""
        return [(pressure, orientation) for pressure in self.pressures for orientation in self.orientations]

    @property
    def schedules(self) -> list[GaitSchedule]:
        """The gaits."""
        codes = np.random.default_rng(self.seed).integers(0, COLUMNS, (self.gaits, 2, ROWS), endpoint=True)
        return [GaitSchedule.from_codes(f, phi, COLUMNS) for f, phi in codes]

    def cases(self, pressure: float, orientation: float, terrain: Terrain) -> list[Case]:
        """All gaits in a body on a terrain."""
        return [Case(InflatableDesign(pressure, orientation, schedule), terrain) for schedule in self.schedules]


def study(
    folder: Path, settings: SoftRobotMetrics, progress: Progress = None, threads: int | None = None
) -> dict[str, Any]:
    """Write a table, heat maps and all numbers; more bodies may follow in the same folder."""
    results = ResultsFolder(folder, NAME, {**settings.sample, "robot": settings.robot.describe()})
    flat = {_flat_part(pressure): partial(on_flat, settings, pressure, threads) for pressure in settings.pressures}
    hill = {_hill_part(*body): partial(on_hill, settings, body, threads) for body in settings.bodies}
    allowed = dict.fromkeys(flat, Allowed((2, settings.gaits), failed=np.nan))
    allowed |= dict.fromkeys(hill, Allowed((settings.gaits,), failed=np.nan))
    found = computed_arrays(results, "speeds", flat | hill, progress, allowed)
    return _report(folder, settings, found[: len(flat)], found[len(flat) :])


def rewrite(data: Data, folder: Path) -> None:
    """Write all that the study writes from the speeds that its folder keeps, of all bodies that it has begun."""
    bodies = _begun(data)
    settings = data.kept(NAME, lambda kept: SoftRobotMetrics(*bodies, *(kept[name] for name in SAMPLE)))
    flat = [data.array(_flat_part(pressure), "speeds", "f2") for pressure in settings.pressures]
    hill = [data.array(_hill_part(*body), "speeds", "f1") for body in settings.bodies]
    for speeds in (*flat, *hill):
        if speeds.shape not in ((2, settings.gaits), (settings.gaits,)):
            raise ValueError(f"{data.folder}: a part has speeds of shape {speeds.shape}, not of {settings.gaits} gaits")
    _report(folder, settings, flat, hill)


def _begun(data: Data) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pressures and orientations of which a folder has parts."""
    names = " ".join(path.name for path in data.folder.glob("*.npz"))
    on_hill = re.findall(r"\bhill_([\d.]+)_([\d.]+)-", names)
    if not on_hill:
        raise ValueError(
            f"{data.folder}: it has no part on the hill (hill_PRESSURE_ORIENTATION), so there is no metric"
        )
    pressures = {float(pressure) for pressure, _ in on_hill} | set(map(float, re.findall(r"\bflat_([\d.]+)-", names)))
    return tuple(sorted(pressures)), tuple(sorted({float(orientation) for _, orientation in on_hill}))


def _flat_part(pressure: float) -> str:
    """Name of the part of a body on flat ground."""
    return f"flat_{pressure:g}"


def _hill_part(pressure: float, orientation: float) -> str:
    """Name of the part of a body on the hill."""
    return f"hill_{pressure:g}_{orientation:g}"


def _report(folder: Path, settings: SoftRobotMetrics, flat: Sequence[Floats], hill: Sequence[Floats]) -> dict[str, Any]:
    """Write what follows from the speeds, by pressure on flat ground and by body on the hill."""
    ways, climbs = np.array(flat), np.array(hill)
    level = (travel_directions(np.array(settings.orientations)) @ ways).reshape(climbs.shape)
    rows = rows_of(settings.bodies, np.stack([level, climbs], axis=1))
    thresholds = {name: list(least) for name, least in THRESHOLDS.items()}
    summary = {**settings.sample, "thresholds": thresholds, "correlations": correlations(rows), "rows": rows}
    write_summary(folder, "metrics", summary)
    draw(rows, folder / "metrics.png")
    return summary


def on_flat(settings: SoftRobotMetrics, pressure: float, threads: int | None, progress: Progress) -> Floats:
    """Speeds of all gaits on flat ground along 0 and 90 degrees, shape (2, gaits); NaN of those that diverged.

    There a robot goes its way whatever its orientation, which only says what counts as ahead: one run is enough.
    """
    robot = settings.robot
    counted = nominal_steps(2 * COLUMNS, robot.actuation) * robot.geometry.time_step
    played = robot.play(settings.cases(pressure, 0.0, Terrain()), threads, progress)
    return np.asarray(played.displacement, float).T / (robot.geometry.body_length * counted)


def on_hill(settings: SoftRobotMetrics, body: tuple[float, float], threads: int | None, progress: Progress) -> Floats:
    """Speeds of all gaits up the hill in a body, shape (gaits,); NaN of those that diverged."""
    return settings.robot.speeds(settings.cases(*body, Terrain(settings.slope)), threads, progress)[:, 0]


def rows_of(bodies: Sequence[tuple[float, float]], speeds: Floats) -> list[dict[str, Any]]:
    """A row for each threshold and body, of speeds of shape (bodies, 2, gaits); intervals are 95 % (Wilson).

    Where no gait succeeds anywhere, there is no M_CI.
    """
    rows = []
    for name, least in THRESHOLDS.items():
        for (pressure, orientation), here in zip(bodies, speeds, strict=True):
            succeeds = np.nan_to_num(here, nan=-np.inf) >= np.array(least)[:, None]
            count = succeeds.sum(axis=0)
            both, either = int((count == 2).sum()), int((count >= 1).sum())
            learns = float(learnability(count[None], 2)), *wilson(both, len(count))
            resists = (float(resistance(count[None], 2)), *wilson(both, either)) if either else (None,) * 3
            row = {"pressure": pressure, "orientation": orientation, "threshold": name}
            row |= dict(zip(("flat_least", "hill_least"), least, strict=True))
            row |= {"gaits": len(count), "failed": int(np.isnan(here).any(axis=0).sum())}
            row |= {**dict(zip(("flat", "hill"), succeeds.sum(axis=1).tolist(), strict=True)), "both": both}
            for metric, values in (("M_L", learns), ("M_CI", resists)):
                row |= dict(zip((metric, f"{metric}_low", f"{metric}_high"), values, strict=True))
            rows.append(row)
    return rows


def correlations(rows: Sequence[Record]) -> dict[str, Any]:
    """Correlate M_L and M_CI over the bodies that have both, by threshold (Spearman); in vehicles they agree.

    With fewer than ``LEAST_BODIES`` only the coefficient is given.
    """
    found = {}
    for name in THRESHOLDS:
        here = [row for row in select(rows, threshold=name) if row["M_CI"] is not None]
        one = asdict(spearman(column(here, "M_L"), column(here, "M_CI"), "two-sided"))
        found[name] = one if len(here) >= LEAST_BODIES else {**one, "low": None, "high": None, "p": None}
    return found


METRICS = {"M_L": "learnability $M_L$", "M_CI": "resistance to\ninterference $M_{CI}$"}


def draw(rows: Sequence[Record], path: Path) -> None:
    """Draw a row for each metric, a column for each threshold; pressure across, orientation upwards.

    A body has no M_CI, "none", where no gait succeeds anywhere.
    """
    pressures, orientations = (distinct(rows, key) for key in ("pressure", "orientation"))
    height = 2 * (0.9 + 0.32 * len(orientations))
    with figure(path, PAGE, height, nrows=2, ncols=len(THRESHOLDS), sharex=True, sharey=True) as (drawn, panels):
        for line, (metric, title) in zip(panels, METRICS.items(), strict=True):
            most = np.nan_to_num(column(rows, metric)).max() or 1.0
            for axes, threshold in zip(line, THRESHOLDS, strict=True):
                values = column(select(rows, threshold=threshold), metric).reshape(len(pressures), -1).T
                image = axes.imshow(values, origin="lower", aspect="auto", cmap="cividis", vmin=0.0, vmax=most)
                for (y, x), value in np.ndenumerate(values):
                    text = "none" if np.isnan(value) else f"{value:.2g}"
                    colour = "white" if value < most / 2 else "black"
                    axes.annotate(text, (x, y), ha="center", va="center", fontsize=6, color=colour)
                axes.set_xticks(range(len(pressures)), [f"{pressure / 1e3:g}" for pressure in pressures])
                axes.set_yticks(range(len(orientations)), [f"{orientation:g}" for orientation in orientations])
            drawn.colorbar(image, ax=line.tolist(), label=title)
        for axes, (threshold, (flat, hill)) in zip(panels[0], THRESHOLDS.items(), strict=True):
            caption(axes, f"{threshold}: {flat:g}, {hill:g} BL/s")
        for axes in panels[-1]:
            axes.set_xlabel("core pressure [kPa]")
        for axes in panels[:, 0]:
            axes.set_ylabel("orientation [degrees]")


STUDY = Study(
    title="learnability and interference of shapes and orientations of the soft robot, by sampled gaits",
    source="chapters 4 and 6, metrics of complex robots",
    scales={
        "small": SoftRobotMetrics((0.0, 12e3), (0.0, 90.0), gaits=32),
        "medium": SoftRobotMetrics((0.0, 6e3, 12e3), (0.0, 45.0, 90.0), gaits=128),
        "full": SoftRobotMetrics(),
    },
    run=study,
    rewrite=rewrite,
    writes=("metrics.csv", "metrics.png", "summary.json"),
    cost="20 h of two cores",
)
