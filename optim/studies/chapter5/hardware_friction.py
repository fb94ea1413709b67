"""Speeds that were measured on the physical robot, beside those of the simulated one on the same floors.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot": speeds, floors and slope. It names no floor
for rolling; its robot ran "primarily on wood".
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.results import Progress, computed_arrays, write_summary
from optim.experiments.study import Settings, Study
from optim.experiments.tables import Record, write_records
from optim.studies.chapter5.gaits import Case, GaitRuns
from optim.studies.chapter5.hardware_speeds import (
    AGREES,
    MEASURED,
    MEASURED_FEET,
    SIMULATOR,
    Measurement,
    draw,
    effects_of,
    rows_of,
    sets_of,
    text_of,
)
from robots.hardware import gait_table, rig_play
from robots.hardware.rig import PRESETS
from robots.hardware.rig_play import Play
from robots.inflatable.actuation import WEIGHTS
from robots.world import Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

COPIES = "copies.csv"
COLUMNS: dict[str, Kind] = {
    "weight": WEIGHTS,
    "condition": tuple(measured.name for measured in MEASURED),
    **dict.fromkeys(("ground", "timing"), str),
    **dict.fromkeys(("inflation", "pressure", "measured", "speed"), float),
}


def _shares(field_name: str, value: Any) -> tuple[float, ...]:
    return tuple(checks.number(field_name, each, 0.1, 1.0) for each in _several(field_name, value))


def _pressures(field_name: str, value: Any) -> tuple[float, ...]:
    return tuple(checks.number(field_name, each, 1.0, 15e3, "Pa") for each in _several(field_name, value))


def _weights(field_name: str, value: Any) -> tuple[str, ...]:
    return tuple(checks.choice(field_name, each, WEIGHTS) for each in _several(field_name, value))


def _rigs(field_name: str, value: Any) -> tuple[str, ...]:
    return tuple(checks.choice(field_name, each, PRESETS) for each in _several(field_name, value)) if value else ()


def _grounds(field_name: str, value: Any) -> dict[str, dict[str, float]]:
    if not isinstance(value, Mapping) or not value:
        raise ValueError(f"{field_name}: {value!r} is not allowed; give at least one, by its name")
    known = [each.name for each in fields(Terrain) if each.name not in ("slope", "folder")]
    for changes in value.values():
        for name in changes:
            checks.choice(field_name, name, known)
        Terrain(**changes)
    return {name: dict(changes) for name, changes in value.items()}


def _several(field_name: str, value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple) or not value or len(set(value)) < len(value):
        raise ValueError(f"{field_name}: {value!r} is not allowed; give one or more different values")
    return tuple(value)


@dataclass(frozen=True)
class HardwareFriction(Settings):
    """What was not measured, with the values that are tried, and the robot that plays the gaits."""

    fixed: ClassVar = tuple(f"robot.actuation.{name}" for name in ("weight", "high_friction", "low_friction"))
    robot: GaitRuns = field(default_factory=lambda: GaitRuns(precision="f32", copies=4))
    weights: Annotated[tuple[str, ...], _weights] = WEIGHTS  # of bladders
    inflations: Annotated[tuple[float, ...], _shares] = (0.6, 0.9, 1.0)  # shares of a bladder's full stroke
    pressures: Annotated[tuple[float, ...], _pressures] = (8e3, 12e3)  # of the core while the robot rolls [Pa]
    # by name, fields of the terrain beside the measured friction of feet, or instead of it
    grounds: Annotated[Mapping[str, Mapping[str, float]], _grounds] = field(default_factory=lambda: {MEASURED_FEET: {}})
    # that play the gaits as tables, with the last of these strokes and pressures
    rigs: Annotated[tuple[str, ...], _rigs] = ("dissertation", "dissertation-lag")

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values: settings, and what is simulated."""
        played = [Case(m.gait, m.terrain).describe() for m in MEASURED]
        return {**super().describe(), "robot": self.robot.describe(), "measured": played}


def study(
    folder: Path, settings: HardwareFriction, progress: Progress = None, threads: int | None = None
) -> dict[str, Any]:
    """Write speeds of all copies, the table beside the measured ones, a figure, and which parameters agree."""
    parts = ResultsFolder(folder, "hardware-friction", settings.describe())
    batches = _batches(settings)
    compute = {batch.name: partial(batch.speeds, settings.robot, threads) for batch in batches}
    allowed = {batch.name: settings.robot.allowed_speeds(len(batch.cases)) for batch in batches}
    speeds = computed_arrays(parts, "speeds", compute, progress, allowed)
    copies = [
        {**about, "copy": copy, "speed": float(speed)}
        for batch, found in zip(batches, speeds, strict=True)
        for about, each in zip(batch.rows, found, strict=True)
        for copy, speed in enumerate(each)
    ]
    write_records(folder / COPIES, copies)
    return _report(folder, copies)


def rewrite(data: Data, folder: Path) -> None:
    """Write tables, summary and figure from the table of copies."""
    copies = data.records(COPIES, COLUMNS)
    for copy in copies:
        checks.positive(f"{data.folder / COPIES}: measured", copy["measured"])
    _report(folder, copies)


def _report(folder: Path, copies: Sequence[Record]) -> dict[str, Any]:
    """Write what follows from the speeds of all copies."""
    rows = rows_of(copies)
    if not (sets := sets_of(rows)):
        conditions = "; ".join(measured.name for measured in MEASURED)
        raise ValueError(f"{COPIES}: no parameters have speeds in all conditions, which are {conditions}")
    write_records(folder / "sets.csv", sets)
    summary = {"agrees_within": AGREES, "best": sets[0], "sets": sets, "effects": effects_of(sets), "rows": rows}
    write_summary(folder, "hardware", summary, text_of(rows, sets))
    draw(rows, folder / "hardware.png")
    return summary


@dataclass(frozen=True)
class Batch:
    """Conditions that are simulated beside each other, with what rows say of them."""

    name: str
    weight: str
    inflation: float  # share of a bladder's full stroke
    ground: str
    changes: Mapping[str, Any]  # of the terrain
    cases: tuple[tuple[Measurement, float, str], ...]  # with the pressure of the core, and a rig or the simulator

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What rows say of each case."""
        shared = {"weight": self.weight, "inflation": self.inflation, "ground": self.ground}
        return [
            {**shared, "timing": timing, "condition": m.name, "pressure": pressure, "measured": m.speed}
            for m, pressure, timing in self.cases
        ]

    def speeds(self, robot: GaitRuns, threads: int | None, progress: Progress) -> Floats:
        """Speeds in the time simulated [body lengths/s], shape (cases, copies); NaN of what diverged."""
        usual = robot.actuation
        inflated = usual.deflated + self.inflation * (usual.inflated - usual.deflated)
        drive = replace(usual, weight=self.weight, inflated=inflated)
        designs = [replace(measured.gait, pressure=pressure) for measured, pressure, _ in self.cases]
        terrains = [replace(measured.terrain, **self.changes) for measured, *_ in self.cases]
        if self.cases[0][2] == SIMULATOR:
            cases = list(map(Case, designs, terrains))
            played = replace(robot, actuation=drive).play(cases, threads, progress)
        else:
            plays = [
                Play(gait_table(design, rig), rig, terrain, copy=copy)
                for design, terrain, (_, _, name) in zip(designs, terrains, self.cases, strict=True)
                for rig in [PRESETS[name]]
                for copy in range(robot.copies)
            ]
            played = rig_play.play_tables(
                plays,
                geometry=robot.geometry,
                actuation=drive,
                precision=robot.precision,
                perturbation=robot.noise,
                seed=robot.seed,
                threads=threads,
                progress=progress,
            )
        return np.asarray(played.speed_simulated, float).reshape(len(self.cases), robot.copies)


def _batches(settings: HardwareFriction) -> list[Batch]:
    """All that is simulated; the core is flat while the robot inches."""

    def cases(pressures: Sequence[float], timing: str) -> list[tuple[Measurement, float, str]]:
        return [(m, each, timing) for m in MEASURED for each in (pressures if m.gait.pressure else (0.0,))]

    own = tuple(cases(settings.pressures, SIMULATOR))
    drives = enumerate(product(settings.weights, settings.inflations, settings.grounds.items()))
    batches = [
        Batch(f"speeds_{number}", weight, inflation, *ground, own) for number, (weight, inflation, ground) in drives
    ]
    if settings.rigs:
        on_rigs = tuple(case for rig in settings.rigs for case in cases(settings.pressures[-1:], rig))
        for number, (weight, ground) in enumerate(product(settings.weights, settings.grounds.items())):
            batches.append(Batch(f"tables_{number}", weight, settings.inflations[-1], *ground, on_rigs))
    return batches


STUDY = Study(
    title="speeds measured on hardware, on wood and acrylic, beside simulated ones, and what reconciles them",
    source="chapter 5, transferring to a physical robot, and figure of friction, c",
    scales={
        "small": HardwareFriction(GaitRuns(precision="f32", copies=2), inflations=(1.0,), pressures=(12e3,), rigs=()),
        "medium": HardwareFriction(),
        "full": HardwareFriction(
            GaitRuns(precision="f32"), inflations=(0.4, 0.6, 0.8, 1.0), pressures=(6e3, 8e3, 10e3, 12e3, 14e3)
        ),
    },
    run=study,
    rewrite=rewrite,
    writes=("hardware.md", "hardware.csv", "sets.csv", COPIES, "hardware.png", "summary.json"),
)
