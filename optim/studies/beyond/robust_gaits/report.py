"""Tables, page and figure of gaits for a real floor, from the records of waves and draws."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure
from optim.experiments.results import write_json
from optim.experiments.tables import MISSING, Record, cell, distinct, markdown, page, select, write_records
from optim.studies.beyond.robust_gaits.settings import NAME, file_of
from optim.studies.beyond.robust_gaits.theory import inching_text
from robots.inflatable.design import InflatableDesign, load_design
from robots.uncertainty import summary
from taichi_sim.base.files import write_text

SCREEN, DRAWS, RIG, GAITS = "screen.csv", "draws.csv", "rig.csv", "gaits"
INCHING_BOUNDS = "inching.md"
SPEEDS_TOLD = ("nominal", "mean", "95 % interval", "worst", "climb")
SCREENED: dict[str, Kind] = {
    "slope": float,
    "levels": str,
    "full": int,
    "settling": float,
    "speed": float,
}
DRAWN: dict[str, Kind] = {
    "gait": str,
    "slope": float,
    "precision": str,
    "draw": int,
    "speed": float,
}
PLAYED: dict[str, Kind] = {
    "gait": str,
    "slope": float,
    "precision": str,
    "rig": str,
    "without_lag": float,
    "with_lag": float,
}


def rewrite(data: Data, folder: Path) -> None:
    """Write table, page, figure and summary from the tables of waves and draws, and from gaits.

    Nothing is told of the settings where their file is missing, nor of the bladders of a gait whose file is.
    """
    screened, draws = data.records(SCREEN, SCREENED), data.records(DRAWS, DRAWN)
    for name in distinct(draws, "gait"):
        if not any(row["draw"] >= 0 for row in select(draws, gait=name)):
            raise ValueError(f"{data.folder / DRAWS}: gait {name} has no held-out draw (draw: at least 0)")
        if Path(file_of(name)).name != file_of(name):
            raise ValueError(f"{data.folder / DRAWS}: gait {name!r} is not allowed; it names no file")
    files = {name: data.folder / GAITS / f"{file_of(name)}.json" for name in distinct(draws, "gait")}
    settings = data.kept(NAME, dict) if data.has(f"{NAME}.json") else {}
    designs = {name: load_design(path) for name, path in files.items() if path.exists()}
    rig = data.records(RIG, PLAYED) if data.has(RIG) else []
    report(folder, settings, screened, draws, designs, rig)


def report(
    folder: Path,
    settings: Mapping[str, Any],
    screened: Sequence[Record],
    draws: Sequence[Record],
    designs: Mapping[str, InflatableDesign],
    rig: Sequence[Record] = (),
) -> None:
    """Write what follows from the records: table, page, figure and summary; and what statics allows.

    Settings are those of the study as it describes them, as far as they are known, and so are the designs of gaits.
    """
    rows = [summary_row(select(draws, gait=name), designs.get(name)) for name in distinct(draws, "gait")]
    write_records(folder / "speeds.csv", rows)
    best = [
        {"slope": slope, "full": full, **max(mine, key=lambda row: row["speed"])}
        for slope in distinct(screened, "slope")
        for full in sorted(distinct(screened, "full"))
        if (mine := select(screened, slope=slope, full=full))
    ]
    write_json(folder / "summary.json", {**settings, "rows": rows, "screened": best})
    write_text(folder / "table.md", text_of(settings, rows, best, rig))
    write_text(folder / INCHING_BOUNDS, inching_text(settings))
    draw(rows, draws, folder / "robust.png")


def summary_row(mine: Sequence[Record], design: InflatableDesign | None = None) -> dict[str, Any]:
    """A gait in a line, of its draws; one that diverged counts as standing still."""
    speeds = np.nan_to_num([row["speed"] for row in mine if row["draw"] >= 0])
    nominal = next((row["speed"] for row in mine if row["draw"] < 0 and math.isfinite(row["speed"])), None)
    found = summary(speeds.tolist(), 0.2) if len(speeds) > 1 else {}
    told = {key: found.get(key) for key in ("mean", "mean_low", "mean_high", "worst", "sd")}
    return {
        **{key: mine[0][key] for key in ("gait", "slope", "precision")},
        "nominal": nominal,
        **told,
        "forward": float((speeds > 0).mean()),
        "full": None if design is None else float(design.schedule.inflation.sum(axis=0).max()),
        "n": len(speeds),
    }


def speed_cells(row: Record) -> tuple[str, ...]:
    """What tables tell of a gait's speeds, under the headers ``SPEEDS_TOLD``."""
    interval = MISSING if row["mean"] is None else f"{row['mean_low']:.4f} to {row['mean_high']:.4f}"
    climbs = f"{100 * row['forward']:.0f} %"
    return cell(row["nominal"]), cell(row["mean"]), interval, cell(row["worst"]), climbs


def text_of(settings: Mapping[str, Any], rows: Sequence[Record], best: Sequence[Record], rig: Sequence[Record]) -> str:
    """The page: every gait under the held-out draws, on the rig, and the best waves by how many bladders are full."""
    header = ("gait", "precision", *SPEEDS_TOLD, "full bladders", "n")
    table = [(row["gait"], row["precision"], *speed_cells(row), cell(row["full"], ".1f"), row["n"]) for row in rows]
    waved = [(f"{r['slope']:g}°", r["full"], r["levels"], f"{r['settling']:g}", cell(r["speed"])) for r in best]
    floor = f" on {settings['floor']}" if "floor" in settings else ""
    if "friction" in settings:
        floor = " on a floor of friction {:g} of sliding and {:g} of gripping feet".format(*settings["friction"])
    capped = f"; searches kept to {settings['most_full']}" if settings.get("capped") else ""
    uncertain = f" of {settings['uncertain']}" if "uncertain" in settings else ""
    return page(
        f"Speeds{floor} with bladders that weigh, under {rows[0]['n']} draws{uncertain} that no search has seen "
        "[body lengths/s of the time simulated, no pneumatic lag]. Robust: searched for the worst of draws; nominal: "
        "at the same cost without. Climb: the share of draws that go forward. Full bladders: the sum of levels, at "
        f"most{capped}.",
        markdown(header, "llrrrrrrr", table),
        *_rig_text(rig, {row["gait"]: row["nominal"] for row in rows}),
        "Best waves without draws, by how many bladders are full at a time; levels of a bladder in 8 columns.",
        markdown(("slope", "full", "levels", "settling", "speed"), "rrlrr", waved),
    )


def _rig_text(rig: Sequence[Record], nominal: Mapping[str, float | None]) -> list[str | list[str]]:
    """What the page says of gaits on the rig, if any were played on it."""
    if not rig:
        return []
    played = [
        (r["gait"], r["precision"], cell(nominal.get(r["gait"])), cell(r["without_lag"]), cell(r["with_lag"]))
        for r in rig
    ]
    return [
        f"As the rig {rig[0]['rig']} plays them where nothing is uncertain: designed, in the rig's own time without "
        "the lag of its lines, and with it.",
        markdown(("gait", "precision", "designed", "without lag", "with lag"), "llrrr", played),
    ]


def draw(rows: Sequence[Record], draws: Sequence[Record], path: Path) -> None:
    """Draw the speed of every gait in every draw, a panel a slope; a gait's kind has its colour on every slope."""
    rows = [row for row in rows if " on " not in row["gait"]]
    slopes = sorted({row["slope"] for row in rows})
    kinds = {row["gait"]: row["gait"].replace(f" {row['slope']:g}°", "") for row in rows}
    colours = {kind: COLOURS[n % len(COLOURS)] for n, kind in enumerate(dict.fromkeys(kinds.values()))}
    most = max(sum(row["slope"] == slope for row in rows) for slope in slopes)
    with figure(path, PAGE, 3.0, ncols=len(slopes), sharey=True) as (_, panels):
        for axes, slope in zip(panels[0], slopes, strict=True):
            here = [row["gait"] for row in rows if row["slope"] == slope]
            for place, gait in enumerate(here):
                each = [row["speed"] for row in select(draws, gait=gait) if row["draw"] >= 0]
                spread = place + 0.3 * (np.arange(len(each)) / max(len(each) - 1, 1) - 0.5)
                axes.plot(spread, each, ".", markersize=2, color=colours[kinds[gait]])
            axes.axhline(0, color="0.7", linewidth=0.6, zorder=0)
            middle = (len(here) - 1) / 2
            axes.set_xlim(middle - most / 2, middle + most / 2)
            axes.set_xticks(range(len(here)), [kinds[gait].replace(", ", ",\n") for gait in here], rotation=90)
            axes.set_title(f"{slope:g}°")
        panels[0, 0].set_ylabel("speed [BL/s]")
