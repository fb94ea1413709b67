"""Tables M1 to M4 of the study of interference, beside the published ones.

Source: dissertation, chapter 2, "Results": the four tables of means; Mann-Whitney tests between all cells of a row and
all of a column, 18 of nine treatments, Bonferroni's correction. Standard deviations and the means of four environments
are those of the experiment's own records.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.data import Kind
from optim.experiments.results import write_json
from optim.experiments.tables import MISSING, Record, column, distinct, markdown, select, write_records, write_table
from optim.measures.catastrophic_interference import RunMeasures, measure_run, measure_run_as_computed
from optim.measures.statistics import bonferroni, effect, mean_band
from optim.studies.chapter2.evolution import Runs
from optim.studies.chapter2.settings import ROBOTS, Place, Treatment
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text

Cells = dict[Place, Floats]
SIGNIFICANT = 0.05

MEASURES = {
    "M1": "worst distance of the champion [m]",
    "M2": "angle of beneficial mutations from the diagonal [degrees]",
    "M3": "length of beneficial mutations [m]",
    "M4": "beneficial mutations that are better in every environment [%]",
}
DEFINITIONS = ("defined", "computed")
COLUMNS: dict[str, Kind] = {  # of ``runs.csv``
    "definition": DEFINITIONS,
    "fitness": str,
    "robot": tuple(ROBOTS),
    "run": int,
    "champion": int,
    **dict.fromkeys(MEASURES, float),
    "changes": int,
}


def _grid(*numbers: float) -> dict[Place, float]:
    """Numbers of the nine treatments, row by row."""
    return dict(zip(product(("sum", "product", "min"), ("legged", "wheeled", "whegged")), numbers, strict=True))


PUBLISHED: Mapping[tuple[int, str], Mapping[Place, float]] = {
    (2, "M1"): _grid(8.181, 8.386, 5.915, 6.530, 3.593, 1.234, 5.827, 3.575, 1.296),
    (2, "M2"): _grid(71.035, 73.362, 72.640, 66.292, 71.090, 66.895, 57.843, 58.226, 48.844),
    (2, "M3"): _grid(1.734, 3.209, 4.971, 1.889, 3.372, 5.341, 1.164, 2.411, 2.001),
    (2, "M4"): _grid(25.655, 22.903, 30.824, 22.973, 22.167, 26.981, 49.519, 48.674, 54.332),
    (4, "M1"): _grid(9.77, 10.72, 11.07, 9.52, 9.13, 6.76, 8.02, 7.95, 6.15),
}
PUBLISHED_DEVIATION = {(2, "M1"): _grid(1.55, 2.44, 2.29, 1.20, 1.62, 0.54, 0.68, 1.07, 0.45)}


def measure(found: Runs, definition: str = "defined") -> dict[Treatment, list[RunMeasures]]:
    """M1 to M4 of each run, as defined or as computed."""
    if definition == "defined":
        return {t: [measure_run(s["climber"], s["distance"]) for s in states] for t, states in found.items()}
    with np.errstate(divide="ignore"):
        return {
            t: [measure_run_as_computed(s["climber"], s["distance"], s["light"] ** -0.5) for s in states]
            for t, states in found.items()
        }


def rows_of(found: Runs) -> list[Record]:
    """M1 to M4 of each run, as defined and as computed: the rows of ``runs.csv``."""
    rows: list[Record] = []
    for definition in DEFINITIONS:
        for treatment, each in measure(found, definition).items():
            for run, m in enumerate(each):
                numbers = m.champion, m.worst, m.angle, m.length, 100 * m.share, m.changes
                cells = definition, *treatment.place, run, *numbers
                rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


def cells_of(rows: Iterable[Record], name: str) -> Cells:
    """By row and robot, the numbers of a column, without those that are not finite, as of runs that have none."""
    parts: dict[Place, list[Record]] = {}
    for row in rows:
        parts.setdefault((row["fitness"], row["robot"]), []).append(row)
    numbers = {place: column(part, name) for place, part in parts.items()}
    return {place: values[np.isfinite(values)] for place, values in numbers.items()}


def compare_cells(cells: Cells) -> list[dict[str, Any]]:
    """Two-sided Mann-Whitney tests of all pairs of several values in a row or column, corrected for their number."""
    pairs = [(a, b) for a, b in combinations(cells, 2) if (a[0] == b[0]) != (a[1] == b[1])]
    known = [(a, b) for a, b in pairs if min(len(cells[a]), len(cells[b])) > 1]
    effects = [effect(cells[a], cells[b]) for a, b in known]
    corrected = bonferroni([each.p for each in effects])
    return [
        {
            "first": list(a),
            "second": list(b),
            "difference": each.difference,
            "interval": [each.low, each.high],
            "A12": each.superiority,
            "p": each.p,
            "p_bonferroni": p,
            "significant": p < SIGNIFICANT,
        }
        for (a, b), each, p in zip(known, effects, corrected, strict=True)
    ]


def summarise(cells: Cells, name: str, environments: int) -> list[dict[str, Any]]:
    """A row for each treatment: number of runs, mean, standard deviation, 95 % bootstrap interval, published values."""
    rows = []
    for place, values in cells.items():
        several = len(values) > 1
        row = {"measure": name, "fitness": place[0], "robot": place[1], "runs": len(values)}
        row["mean"] = float(values.mean()) if len(values) else None
        row["deviation"] = float(values.std(ddof=1)) if several else None
        row["low"], row["high"] = map(float, mean_band(values)) if several else (None, None)
        for key, known in (("published", PUBLISHED), ("published_deviation", PUBLISHED_DEVIATION)):
            row[key] = known.get((environments, name), {}).get(place)
        rows.append(row)
    return rows


def write_tables(runs: Sequence[Record], environments: int, out: Path, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``tables.md``, ``tables.csv``, ``runs.csv``, ``tests.csv`` and ``summary.json``; return the last.

    Runs are the rows of ``runs.csv``.
    """
    rows, tests, text, definitions = list[Any](), [], list[str](), {}
    for definition in DEFINITIONS:
        cells = {name: cells_of(select(runs, definition=definition), name) for name in MEASURES}
        part: dict[str, Any] = {
            "cells": [row for name in MEASURES for row in summarise(cells[name], name, environments)],
            "tests": {name: compare_cells(cells[name]) for name in MEASURES},
        }
        definitions[definition] = part
        rows += [{"definition": definition, **row} for row in part["cells"]]
        for name, pairs in part["tests"].items():
            for t in pairs:
                pair = " ".join(t["first"]), " ".join(t["second"])
                effects = t["difference"], *t["interval"], t["A12"], t["p"], t["p_bonferroni"]
                tests.append((definition, name, *pair, *effects))
        text += _readable(part, definition)
    write_records(out / "tables.csv", rows)
    write_records(out / "runs.csv", runs)
    header = ("definition", "measure", "first", "second", "difference", "low", "high", "A12", "p", "p_bonferroni")
    write_table(out / "tests.csv", header, tests)
    write_text(out / "tables.md", "\n".join(text) + "\n")
    summary = {**about, "definitions": definitions}
    write_json(out / "summary.json", summary)
    return summary


def _readable(part: Mapping[str, Any], definition: str) -> Iterator[str]:
    """Tables as Markdown: mean, deviation, interval, published mean; and which neighbours differ."""
    yield f"# As {definition}\n"
    for name, title in MEASURES.items():
        rows = select(part["cells"], measure=name)
        robots, cells = distinct(rows, "robot"), {(row["fitness"], row["robot"]): row for row in rows}
        yield f"## {name}: {title}\n"
        yield "Mean ± standard deviation, [95 % bootstrap interval, too narrow for few runs], published mean.\n"
        lines = [(way, *(_cell(cells.get((way, robot))) for robot in robots)) for way in distinct(rows, "fitness")]
        yield from markdown((name, *robots), "l" * (1 + len(robots)), lines)
        marked = [_mark(t["first"], t["second"]) for t in part["tests"][name] if t["significant"]]
        which = ": " * bool(marked) + "; ".join(marked)
        yield f"\nOf {len(part['tests'][name])} pairs, {len(marked)} differ at the 0.05 level (Bonferroni){which}.\n"


def _cell(row: Record | None) -> str:
    if row is None or row["mean"] is None:
        return MISSING
    text = f"{row['mean']:.2f}"
    if row["deviation"] is not None:
        text += f" ± {row['deviation']:.2f} [{row['low']:.2f}, {row['high']:.2f}]"
    return text if row["published"] is None else f"{text}, published {row['published']:.2f}"


def _mark(first: Sequence[str], second: Sequence[str]) -> str:
    """Two cells that differ: robots of a row by ↔, rows of a robot by ↕, as in the published tables."""
    if first[0] == second[0]:
        return f"{first[0]}: {first[1]} ↔ {second[1]}"
    return f"{first[1]}: {first[0]} ↕ {second[0]}"
