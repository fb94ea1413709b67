"""The table of chapter 5 beside the published one, as Markdown and as CSV."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from optim.experiments.tables import write_table
from optim.studies.chapter5.gaits import shown
from optim.studies.chapter5.published import COLUMNS
from taichi_sim.base.files import write_text

AGAIN = ("flat_max_again", "hill_max_again")
HEADER = (
    "row",
    "climbers",
    "generations",
    "evaluations",
    *(name for c in COLUMNS for name in (c, f"{c}_published")),
    "one_design_combined",
    "one_design_flat",
    "one_design_hill",
    "one_design_found_on",
    *(f"{name}_{part}" for name in AGAIN for part in ("mean", "deviation", "copies", "diverged")),
)


def write_tables(summary: Mapping[str, Any], folder: Path) -> None:
    """Write ``table.csv`` and ``table.md``.

    Args:
        summary: see ``optim.studies.chapter5.comparison.summarise``.
        folder: takes them.
    """
    write_table(folder / "table.csv", HEADER, [_record(row) for row in summary["rows"]])
    write_text(folder / "table.md", page(summary))


def _record(row: Mapping[str, Any]) -> tuple[Any, ...]:
    speeds = (value for column in COLUMNS for value in (row.get(column), row["published"].get(column)))
    one = row["one_design"] or {}
    again = ((row.get(name) or {}).get(part) for name in AGAIN for part in ("mean", "deviation", "copies", "diverged"))
    return (
        row["row"],
        row.get("climbers"),
        row["generations"],
        row["evaluations"],
        *speeds,
        *(one.get(name) for name in ("combined", "flat", "hill", "found_on")),
        *again,
    )


def page(summary: Mapping[str, Any]) -> str:
    """Speeds with the published ones in brackets, the best designs again, and the tests."""
    settings, rows = summary["settings"], summary["rows"]
    lines = [
        f"Speeds [body lengths/s] on flat ground and up {settings['slope']:g} degrees; published values in brackets. "
        f"Robot: {settings['geometry']}, 8 columns played {_times(settings['repeats'])}; published: 60 climbers, 200 "
        "generations, 24,120 evaluations a row, 12,060 of those on the hill alone.",
        "",
        "| free to change | climbers x generations | evaluations | flat mean | flat max | hill mean | hill max | "
        "combined max, two designs | best single design (flat, hill) |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        cells = [_beside(row.get(column), row["published"].get(column)) for column in COLUMNS]
        lines.append("| " + " | ".join([row["row"], _budget(row), f"{row['evaluations']:,}", *cells, _one(row)]) + " |")
    lines += [
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
    lines = [
        "Fastest designs again: mean ± standard deviation of runs in f64 whose starts differ by noise." + older,
        "",
        "| free to change | flat | hill |",
        "| --- | ---: | ---: |",
    ]
    for row in found:
        lines.append("| " + " | ".join([row["row"], *(shown(row[n]) if row.get(n) else "–" for n in AGAIN)]) + " |")
    return [*lines, ""]


def _older(summary: Mapping[str, Any]) -> str:
    """What there is to say where designs were played before the searches went on."""
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


def _budget(row: Mapping[str, Any]) -> str:
    return f"{row['climbers']} x {row['generations']}" if "climbers" in row else "by hand"


def _beside(value: float | None, published: float | None) -> str:
    text = "–" if value is None else f"{value:.4f}"
    return text if published is None else f"{text} ({published:.4f})"


def _one(row: Mapping[str, Any]) -> str:
    one = row["one_design"]
    return "–" if one is None else f"{one['combined']:.4f} ({one['flat']:.4f}, {one['hill']:.4f})"


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
