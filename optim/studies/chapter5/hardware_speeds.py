"""Speeds measured on hardware, and tables and a figure of simulated ones beside them, with what reconciles both."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optim.experiments.figures import COLOURS, PAGE, figure, legend_above
from optim.experiments.tables import MISSING, cell, markdown, page
from optim.measures.statistics import known_mean
from robots.inflatable.actuation import WEIGHTS
from robots.inflatable.design import INCHING, ROLLING, InflatableDesign
from robots.world import FLOORS, Terrain

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


def rows_of(copies: Sequence[Row]) -> list[dict[str, Any]]:
    """Means of copies with 95 % intervals, by condition and parameters, beside the measured speeds."""
    names = (*SHARED, "condition", "pressure", "measured")
    found: dict[tuple[Any, ...], list[float]] = {}
    for copy in copies:
        found.setdefault(tuple(copy[name] for name in names), []).append(copy["speed"])
    rows = []
    for key, speeds in found.items():
        known = [speed for speed in speeds if math.isfinite(speed)]
        means = known_mean(known)
        row = dict(zip(names, key, strict=True))
        ratio = None if means["mean"] is None else means["mean"] / row["measured"]
        rows.append({**row, "n": len(known), **means, "ratio": ratio})
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
