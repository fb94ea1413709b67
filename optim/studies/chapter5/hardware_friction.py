"""Speeds that were measured on the physical robot, beside those of the simulated one on the same floors.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot": speeds, floors and slope. It names no floor
for rolling; its robot ran "primarily on wood".
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.results import Progress, computed_arrays, write_summary
from optim.experiments.study import Settings, Study
from optim.experiments.tables import MISSING, cell, markdown, page, write_records
from optim.measures.statistics import mean_interval
from optim.studies.chapter5.gaits import Case, Robot, repeated
from robots.hardware import gait_table, rig_play
from robots.hardware.rig import PRESETS
from robots.hardware.rig_play import Play
from robots.inflatable.actuation import WEIGHTS
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign
from robots.world import FLOORS, Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.results_folder import ResultsFolder

AGREES = 1.5  # factor of the measured speed, either way, within which a simulated one agrees
MEASURED_FEET = "feet as measured"  # ground on which all else is as published
SIMULATOR = "simulator"  # strokes of the gait in the simulation's own time

SHARED = ("timing", "weight", "inflation", "ground")  # parameters of all conditions
PARAMETERS = (*SHARED, "pressure")
NAMED = dict(zip(PARAMETERS, ("timing", "weight of bladders", "stroke", "ground", "core pressure"), strict=True))

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Measurement:
    """A speed that was measured on hardware, and what is simulated for it."""

    name: str
    gait: InflatableDesign
    floor: str
    slope: float  # [degrees]
    speed: float  # measured [body lengths/s]

    @property
    def terrain(self) -> Terrain:
        """Ground with the friction of feet that was measured on the floor."""
        low, high = FLOORS[self.floor]
        return Terrain(self.slope, high, low)


MEASURED = (
    Measurement("inching, wood", INCHING, "wood", 0.0, 0.01),
    Measurement("inching, acrylic", INCHING, "acrylic", 0.0, 0.007),
    Measurement("rolling, wood", ROLLING, "wood", 0.0, 0.05),
    Measurement("inching up 14°, wood", INCHING, "wood", 14.0, 0.008),
)


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
    known = [each.name for each in fields(Terrain) if each.name != "slope"]
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

    robot: Robot = field(default_factory=lambda: Robot(precision="f32", copies=4))
    weights: Annotated[tuple[str, ...], _weights] = WEIGHTS  # of bladders
    inflations: Annotated[tuple[float, ...], _shares] = (0.6, 0.9, 1.0)  # shares of a bladder's full stroke
    pressures: Annotated[tuple[float, ...], _pressures] = (8e3, 12e3)  # of the core while the robot rolls [Pa]
    # by name, fields of the terrain beside the measured friction of feet, or instead of it
    grounds: Annotated[Mapping[str, Mapping[str, float]], _grounds] = field(default_factory=lambda: {MEASURED_FEET: {}})
    # that play the gaits as tables, once, with the last of these strokes and pressures
    rigs: Annotated[tuple[str, ...], _rigs] = ("dissertation", "dissertation-lag")

    def describe(self) -> dict[str, Any]:
        """Describe all settings, and what is simulated, for JSON."""
        played = [Case(m.gait, m.terrain).describe() for m in MEASURED]
        return {**super().describe(), "robot": self.robot.describe(), "measured": played}


def study(
    folder: Path, settings: HardwareFriction, progress: Progress = None, threads: int | None = None
) -> dict[str, Any]:
    """Write speeds of all copies, the table beside the measured ones, a figure, and which parameters agree."""
    parts = ResultsFolder(folder, "hardware-friction", settings.describe())
    batches = _batches(settings)
    compute = {batch.name: partial(batch.speeds, settings.robot, threads) for batch in batches}
    speeds = computed_arrays(parts, "speeds", compute, progress)
    copies = [
        {**about, "copy": copy, "speed": float(speed)}
        for batch, found in zip(batches, speeds, strict=True)
        for about, each in zip(batch.rows, found, strict=True)
        for copy, speed in enumerate(each)
    ]
    write_records(folder / "copies.csv", copies)
    rows = rows_of(copies)
    sets = sets_of(rows)
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

    def speeds(self, robot: Robot, threads: int | None, progress: Progress) -> Floats:
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
                Play(gait_table(repeated(design, 1), rig), rig, terrain, copy=copy)
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
            batches.append(Batch(f"rigs_{number}", weight, settings.inflations[-1], *ground, on_rigs))
    return batches


def rows_of(copies: Sequence[Row]) -> list[dict[str, Any]]:
    """Means of copies with 95 % intervals, by condition and parameters, beside the measured speeds."""
    names = (*SHARED, "condition", "pressure", "measured")
    found: dict[tuple[Any, ...], list[float]] = {}
    for copy in copies:
        found.setdefault(tuple(copy[name] for name in names), []).append(copy["speed"])
    rows = []
    for key, speeds in found.items():
        known = [speed for speed in speeds if math.isfinite(speed)]
        low, high = mean_interval(known) if len(known) > 1 else (None, None)
        mean = float(np.mean(known)) if known else None
        row = dict(zip(names, key, strict=True))
        ratio = None if mean is None else mean / row["measured"]
        rows.append({**row, "n": len(known), "mean": mean, "low": low, "high": high, "ratio": ratio})
    return rows


def sets_of(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """How well each set of parameters reproduces the speeds on flat ground, best first.

    ``factor`` is the largest of the factors by which simulated and measured speeds differ, None if a robot goes
    backwards. ``factor_rescaled`` is the same if all speeds are divided by one ``stretch``, chosen best: what is left
    however long the strokes of hardware took, as long as all took so much longer.
    """
    sets = []
    for parameters, mine in _by_parameters(rows):
        ratios = [mine[m.name]["ratio"] for m in MEASURED if not m.slope]
        logs = [math.log(ratio) if ratio is not None and ratio > 0 else math.nan for ratio in ratios]
        factor = math.exp(max(map(abs, logs))) if all(map(math.isfinite, logs)) else None
        middle = (max(logs) + min(logs)) / 2
        sets.append(
            {
                **parameters,
                **{m.name: mine[m.name]["mean"] for m in MEASURED},
                "factor": factor,
                "factor_rescaled": None if factor is None else math.exp(max(logs) - middle),
                "stretch": None if factor is None else math.exp(middle),
            }
        )
    return sorted(sets, key=lambda one: math.inf if one["factor"] is None else one["factor"])


def _by_parameters(rows: Sequence[Row]) -> Iterator[tuple[dict[str, Any], dict[str, Row]]]:
    """Each set of parameters with the rows of its conditions, by their names."""
    rolling = sorted({row["pressure"] for row in rows if row["pressure"]})
    for key in dict.fromkeys(tuple(row[name] for name in SHARED) for row in rows):
        for pressure in rolling:
            mine = {
                row["condition"]: row
                for row in rows
                if tuple(row[name] for name in SHARED) == key and row["pressure"] in (0.0, pressure)
            }
            if len(mine) == len(MEASURED):  # rigs play one pressure
                yield {**dict(zip(SHARED, key, strict=True)), "pressure": pressure}, mine


def effects_of(sets: Sequence[Row]) -> list[dict[str, Any]]:
    """What each parameter does to each speed: of sets that differ in it alone, the largest ratio of two speeds.

    1 tells that a measured speed says nothing of the parameter; None that some robot goes backwards.
    """
    effects = []
    for parameter in PARAMETERS:
        others = [name for name in PARAMETERS if name != parameter]
        groups: dict[tuple[Any, ...], list[Row]] = {}
        for one in sets:
            groups.setdefault(tuple(one[name] for name in others), []).append(one)
        several = [group for group in groups.values() if len(group) > 1]
        if not several:
            continue
        row: dict[str, Any] = {"parameter": parameter}
        for name in (measured.name for measured in MEASURED):
            speeds = [[each[name] or 0.0 for each in group] for group in several]
            forward = all(min(group) > 0 for group in speeds)
            row[name] = max(max(group) / min(group) for group in speeds) if forward else None
        effects.append(row)
    return effects


def text_of(rows: Sequence[Row], sets: Sequence[Row]) -> str:
    """The page: measured beside simulated speeds as published, all sets of parameters, and what they tell."""
    usual = [row for row in rows if _nominal(row)]
    header = ("condition", "timing", "weight", "measured", "simulated", "95 % interval", "n", "simulated / measured")
    table = [
        (
            row["condition"],
            row["timing"],
            row["weight"],
            f"{row['measured']:g}",
            cell(row["mean"]),
            MISSING if row["low"] is None else f"{row['low']:.4f} to {row['high']:.4f}",
            row["n"],
            cell(row["ratio"], ".2f"),
        )
        for row in usual
    ]
    scanned = [
        (
            *(each["timing"], each["weight"], each["ground"]),
            *(f"{each['inflation']:g}", f"{each['pressure'] / 1000:g}"),
            *(cell(each[m.name]) for m in MEASURED),
            *(cell(each[name], ".2f") for name in ("factor", "factor_rescaled", "stretch")),
        )
        for each in sets
    ]
    names = (
        "timing",
        "weight",
        "ground",
        "stroke",
        "core [kPa]",
        *(m.name for m in MEASURED),
        "factor",
        "rescaled",
        "stretch",
    )
    return page(
        "Speeds on hardware and in simulation [body lengths/s], as published otherwise: mean of copies whose starts "
        "differ by noise.",
        markdown(header, "lllrrrrr", table),
        "All parameters tried. Factor: the largest between simulated and measured speeds on flat ground. Rescaled: "
        "what is left of it if all simulated speeds are divided by the stretch, as if strokes took so much longer.",
        markdown(names, "lllrr" + "r" * (len(MEASURED) + 3), scanned),
        verdict(sets),
        "What each parameter does: the largest ratio of two speeds that differ in it alone. Where it is 1, a speed "
        "tells nothing of the parameter.",
        markdown(
            ("parameter", *(m.name for m in MEASURED)),
            "l" + "r" * len(MEASURED),
            [(NAMED[each["parameter"]], *(cell(each[m.name], ".2f") for m in MEASURED)) for each in effects_of(sets)],
        ),
    )


MISSING_INTERVAL = "–"


def _nominal(row: Row) -> bool:
    """Whether a row is of the published stroke and pressure."""
    usual = row["inflation"] == 1.0 and row["ground"] == MEASURED_FEET
    return bool(usual and row["pressure"] in (0.0, ROLLING.pressure))


def verdict(sets: Sequence[Row]) -> str:
    """Whether one set of parameters reproduces all speeds on flat ground, with and without a stretch of time."""
    known = [each for each in sets if each["factor"] is not None]
    if not known:
        return "No set of parameters goes forward in all conditions on flat ground."
    texts = []
    for name, when in (("factor", "As simulated"), ("factor_rescaled", "With all times stretched alike")):
        best = min(known, key=lambda each: each[name])
        within = sum(each[name] <= AGREES for each in known)
        texts.append(
            f"{when}, {within} of {len(sets)} sets are within a factor of {AGREES:g} of all speeds on flat ground; the "
            f"best, {best['weight']} weight, stroke {best['inflation']:g}, core {best['pressure'] / 1000:g} kPa, "
            f"{best['timing']}, is within {best[name]:.2f}."
        )
    climbing = [m.name for m in MEASURED if m.slope]
    up = sum(all((each[name] or 0.0) > 0 for name in climbing) for each in sets)
    return " ".join([*texts, f"Up the slope {up} of {len(sets)} go forward."])


def draw(rows: Sequence[Row], path: Path) -> None:
    """Ratios of simulated to measured speeds by condition, a point for each set of parameters."""
    with figure(path, PAGE, 2.6) as (drawn, panels):
        axes = panels[0, 0]
        axes.axhspan(1 / AGREES, AGREES, color="0.9", zorder=0, label=f"within a factor of {AGREES:g}")
        axes.axhline(1.0, color="0.6", linewidth=0.6)
        for place, measured in enumerate(MEASURED):
            for number, weight in enumerate(WEIGHTS):
                mine = [r["ratio"] for r in rows if (r["condition"], r["weight"]) == (measured.name, weight)]
                found = [ratio for ratio in mine if ratio is not None]
                label = f"{weight} weight" if place == 0 else None
                x = [place + 0.16 * number - 0.08] * len(found)
                axes.plot(x, found, "o", markersize=3.5, color=COLOURS[number], label=label)
        axes.set_xticks(range(len(MEASURED)), [m.name for m in MEASURED])
        axes.set_yscale("symlog", linthresh=0.5)
        axes.set_ylabel("simulated / measured speed")
        legend_above(drawn, axes.get_legend_handles_labels()[0])


STUDY = Study(
    title="speeds measured on hardware, on wood and acrylic, beside simulated ones, and what reconciles them",
    source="chapter 5, transferring to a physical robot, and figure of friction, c",
    scales={
        "small": HardwareFriction(Robot(precision="f32", copies=2), inflations=(1.0,), pressures=(12e3,), rigs=()),
        "medium": HardwareFriction(),
        "full": HardwareFriction(
            Robot(precision="f32"), inflations=(0.4, 0.6, 0.8, 1.0), pressures=(6e3, 8e3, 10e3, 12e3, 14e3)
        ),
    },
    run=study,
    writes=("hardware.md", "hardware.csv", "sets.csv", "copies.csv", "hardware.png", "summary.json"),
)
