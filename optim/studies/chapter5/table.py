"""The table of chapter 5 beside the published one: its rows, tests between experiments, Markdown and CSV."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from optim.experiments.tables import markdown, write_table
from optim.measures.statistics import effect, mean_band, welch
from optim.studies.chapter5.champions import PLACES, Played
from optim.studies.chapter5.experiments import EXPERIMENTS, FLAT, HILL, PARTS, ROWS, Found, ShapeChange
from optim.studies.chapter5.gaits import shown, spread
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

FLAT_MEAN, FLAT_MAX, HILL_MEAN, HILL_MAX, COMBINED = "flat_mean", "flat_max", "hill_mean", "hill_max", "combined_max"
COLUMNS = (FLAT_MEAN, FLAT_MAX, HILL_MEAN, HILL_MAX, COMBINED)

# Of changing shape by hand the text says 0.0998, its own numbers 0.09995. Of the control experiment, rolling on the
# hill, the text gives no number; those here are of the run, in which only the start was as the text says.
TABLE: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "orientation, shape, control": dict(zip(COLUMNS, (0.0791, 0.1888, 0.0023, 0.0158, 0.1023), strict=True)),
        "shape, control": dict(zip(COLUMNS, (0.0945, 0.2000, -0.0032, -0.0004, 0.0998), strict=True)),
        "control": dict(zip(COLUMNS, (0.0921, 0.1576, -0.0087, -0.0023, 0.0777), strict=True)),
        "rolling by hand": {FLAT_MAX: 0.1753, HILL_MAX: -0.5743, COMBINED: -0.1995},
        "inching by hand": {FLAT_MAX: 0.0603, HILL_MAX: 0.0246, COMBINED: 0.0424},
        "changing shape by hand": {FLAT_MAX: 0.1753, HILL_MAX: 0.0246, COMBINED: 0.0998},
        "rolling on the hill, as run": {HILL_MEAN: 0.0026, HILL_MAX: 0.0282},
    }
)

OPEN = f"{'-'.join(PARTS)}-{HILL}"  # the experiment that rolling on the hill is held against
CHANGING = "changing shape by hand"


def summarise(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> dict[str, Any]:
    """Everything the study says, ready for JSON.

    Args:
        settings: of the study.
        found: by experiment, as far as they have come.
        played: gaits beside them.
    """
    return {
        "settings": asdict(settings),
        "rows": [*_searched(settings, found, played), *_by_hand(played)],
        "played": played.generation,
        "tests": tests(found),
        "curves": {name: curve(one.scores) for name, one in found.items()},
    }


def _searched(settings: ShapeChange, found: Mapping[str, Found], played: Played) -> Iterator[dict[str, Any]]:
    for name in ROWS:
        row: dict[str, Any] = {"row": name, "evaluations": 0, "generations": None, "climbers": settings.climbers}
        for experiment in (e for e in EXPERIMENTS if e.row == name and e.name in found):
            one, place = found[experiment.name], experiment.place
            row["evaluations"] += one.evaluations
            row["generations"] = len(one.scores) - 1
            row[f"{place}_mean"] = float(one.final.mean()) if one.final.size else None
            row[f"{place}_max"] = float(one.final.max()) if one.final.size else None
            if experiment.name in played.again:
                row[f"{place}_max_again"] = spread(played.again[experiment.name])
        row[COMBINED] = _mean(row.get("flat_max"), row.get("hill_max"))
        row["one_design"] = best_on_both(
            {e.place: played.elsewhere[e.name] for e in EXPERIMENTS if e.row == name and e.name in played.elsewhere}
        )
        yield {**row, "published": dict(TABLE.get(name, {}))}


def _by_hand(played: Played) -> Iterator[dict[str, Any]]:
    gaits = {name: {place: spread(copies[place]) for place in PLACES} for name, copies in played.by_hand.items()}
    if gaits:
        rolling, inching = gaits.values()
        gaits[CHANGING] = {FLAT: rolling[FLAT], HILL: inching[HILL]}
    for name, places in gaits.items():
        speeds = {place: places[place]["mean"] for place in PLACES}
        combined = _mean(*speeds.values())
        one = None if name == CHANGING or combined is None else {"combined": combined, **speeds, "found_on": None}
        yield {
            "row": name,
            "evaluations": sum(int(places[place]["copies"] or 0) for place in PLACES),
            "generations": None,
            **{f"{place}_max": speeds[place] for place in PLACES},
            **{f"{place}_max_again": places[place] for place in PLACES},
            COMBINED: combined,
            "one_design": one,
            "published": dict(TABLE[name]),
        }


def best_on_both(elsewhere: Mapping[str, Floats]) -> dict[str, Any] | None:
    """The design that is fastest in the mean of both terrains.

    Args:
        elsewhere: by the terrain on which designs were found, their speeds there and on the other one, shape (2, n).

    Returns:
        Its speeds and where it was found; None if there is none that did not fail.
    """
    best: dict[str, Any] | None = None
    for place, (own, other) in elsewhere.items():
        means = np.nan_to_num((own + other) / 2, nan=-np.inf)
        index = int(np.argmax(means))
        if np.isfinite(means[index]) and (best is None or means[index] > best["combined"]):
            speeds = (own, other) if place == FLAT else (other, own)
            flat, hill = (float(values[index]) for values in speeds)
            best = {"combined": float(means[index]), FLAT: flat, HILL: hill, "found_on": place}
    return best


def tests(found: Mapping[str, Found]) -> list[dict[str, Any]]:
    """Rolling on the hill, in both readings, against the experiment in which all was free and random: Welch's t-test.

    The authors tested this pair so. Positive t and differences say that the open experiment found faster designs. Where
    both search the same variables, climber n of one draws the same random numbers for them as climber n of the other,
    which the test does not know: ``paired`` is the mean difference of such pairs, with its 95 % bootstrap interval;
    None elsewhere, and of other numbers of climbers.
    """
    if OPEN not in found:
        return []
    open_scores, results = found[OPEN].final, []
    for experiment in EXPERIMENTS[-2:]:
        if experiment.name not in found:
            continue
        control = found[experiment.name].final
        if min(len(control), len(open_scores)) > 1:
            test, size = welch(control, open_scores), effect(control, open_scores)
            alike = experiment.free == PARTS
            paired = _paired(found[experiment.name].scores[-1], found[OPEN].scores[-1]) if alike else None
            about = {"control": experiment.name, "open": OPEN, "climbers": [len(control), len(open_scores)]}
            results.append({**about, "welch": asdict(test), "effect": asdict(size), "paired": paired})
    return results


def _paired(control: Floats, open_scores: Floats) -> dict[str, float] | None:
    """Mean difference between climbers and their counterparts, where neither has failed."""
    if len(control) != len(open_scores):
        return None
    apart = (open_scores - control)[~np.isnan(open_scores + control)]
    if not apart.size:
        return None
    low, high = mean_band(apart)
    return {"climbers": len(apart), "difference": float(apart.mean()), "low": float(low), "high": float(high)}


def curve(scores: Floats) -> dict[str, list[float | None]]:
    """Mean, its 95 % bootstrap band, and maximum of climbers over generations; scores of shape (G + 1, C).

    In each generation the climbers count that have found anything by then; None where none has.
    """
    points = [_spread(row[~np.isnan(row)]) for row in scores]
    return {name: [point[name] for point in points] for name in ("mean", "low", "high", "max")}


def _spread(scores: Floats) -> dict[str, float | None]:
    if not scores.size:
        return dict.fromkeys(("mean", "low", "high", "max"))
    low, high = mean_band(scores)
    return {"mean": float(scores.mean()), "low": float(low), "high": float(high), "max": float(scores.max())}


def _mean(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else (a + b) / 2


AGAIN = ("flat_max_again", "hill_max_again")
BUDGET = ("free to change", "climbers x generations", "evaluations")
SPEEDS = (
    *("flat mean", "flat max", "hill mean", "hill max"),
    *("combined max, two designs", "best single design (flat, hill)"),
)
HEADER = (
    *("row", "climbers", "generations", "evaluations"),
    *(name for c in COLUMNS for name in (c, f"{c}_published")),
    *(f"one_design_{name}" for name in ("combined", "flat", "hill", "found_on")),
    *(f"{name}_{part}" for name in AGAIN for part in ("mean", "deviation", "copies", "diverged")),
)


def write_tables(summary: Mapping[str, Any], folder: Path) -> None:
    """Write ``table.csv`` and ``table.md``.

    Args:
        summary: see ``optim.studies.chapter5.table.summarise``.
        folder: takes them.
    """
    write_table(folder / "table.csv", HEADER, [_record(row) for row in summary["rows"]])
    write_text(folder / "table.md", page(summary))


def _record(row: Mapping[str, Any]) -> tuple[Any, ...]:
    speeds = (value for column in COLUMNS for value in (row.get(column), row["published"].get(column)))
    one = row["one_design"] or {}
    again = ((row.get(name) or {}).get(part) for name in AGAIN for part in ("mean", "deviation", "copies", "diverged"))
    budget = row["row"], row.get("climbers"), row["generations"], row["evaluations"]
    return *budget, *speeds, *(one.get(name) for name in ("combined", "flat", "hill", "found_on")), *again


def page(summary: Mapping[str, Any]) -> str:
    """Speeds with the published ones in brackets, the best designs again, and the tests."""
    settings, rows = summary["settings"], summary["rows"]
    times = {1: "once", 2: "twice"}.get(settings["repeats"], f"{settings['repeats']} times")
    lines = [
        f"Speeds [body lengths/s] on flat ground and up {settings['slope']:g} degrees; published values in brackets. "
        f"Robot: {settings['geometry']}, 8 columns played {times}; published: 60 climbers, 200 "
        "generations, 24,120 evaluations a row, 12,060 of those on the hill alone.",
        "",
        *markdown((*BUDGET, *SPEEDS), "llrrrrrrr", map(_cells, rows)),
        "",
        "Rows of searches: mean and maximum over the climbers' best designs, as the search saw them, one run in f32 "
        "each. Combined: the mean of a row's maxima on both terrains, which are two designs, as published; beside it, "
        f"the best mean of one design, of the {settings['others']} best of each terrain simulated on the other. "
        f"Gaits by hand: mean of {settings['copies']} runs in f64 whose starts differ by noise.",
        "",
        *_again(rows, _older(summary)),
        *_tests(summary["tests"]),
    ]
    return "\n".join(lines) + "\n"


def _again(rows: Sequence[Mapping[str, Any]], older: str) -> list[str]:
    found = [row for row in rows if any(row.get(name) for name in AGAIN)]
    if not found:
        return []
    cells = [(row["row"], *(shown(row[n]) if row.get(n) else "–" for n in AGAIN)) for row in found]
    title = "Fastest designs again: mean ± standard deviation of runs in f64 whose starts differ by noise." + older
    return [title, "", *markdown(("free to change", "flat", "hill"), "lrr", cells), ""]


def _older(summary: Mapping[str, Any]) -> str:
    """A sentence for tables whose designs were played before the searches went on; else empty."""
    played = summary["played"]
    if played is None or all(row["generations"] in (None, played) for row in summary["rows"]):
        return ""
    return f" They, and the best single designs, are those after generation {played}; the searches have gone on."


def _tests(tests: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = []
    for test in tests:
        welch, size = test["welch"], test["effect"]
        value = "nothing varies" if welch["t"] is None else f"t = {welch['t']:.2f}, p = {welch['p']:.3g}"
        lines.append(
            f"- {test['open']} against {test['control']} ({' and '.join(map(str, reversed(test['climbers'])))} "
            f"climbers): mean difference {size['difference']:+.4f} [{size['low']:+.4f}, {size['high']:+.4f}] BL/s; "
            f"Welch's t-test: {value}"
        )
        if paired := test["paired"]:
            lines[-1] += (
                f"; {paired['climbers']} pairs that drew the same numbers: {paired['difference']:+.4f} "
                f"[{paired['low']:+.4f}, {paired['high']:+.4f}]"
            )
    return ["Whether shape has to change: rolling on the hill against the search with all free.", "", *lines] * bool(
        lines
    )


def _cells(row: Mapping[str, Any]) -> list[str]:
    """The cells of a row on the page."""
    budget = f"{row['climbers']} x {row['generations']}" if "climbers" in row else "by hand"
    one = row["one_design"]
    best = "–" if one is None else f"{one['combined']:.4f} ({one['flat']:.4f}, {one['hill']:.4f})"
    speeds = [_beside(row.get(column), row["published"].get(column)) for column in COLUMNS]
    return [row["row"], budget, f"{row['evaluations']:,}", *speeds, best]


def _beside(value: float | None, published: float | None) -> str:
    text = "–" if value is None else f"{value:.4f}"
    return text if published is None else f"{text} ({published:.4f})"
