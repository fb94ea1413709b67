"""Pages of sweeps, of training and of the study of interference: settings, tables, figures."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS
from optim.experiments.tables import read_table
from optim.plots.curves import draw_share_solved
from optim.report.charts import chart, picture_of
from optim.report.markup import Html, Section, code, facts, number, paragraph, picture, side_by_side, table, tiles
from optim.studies.chapter2.evolution import KIND as INTERFERENCE
from optim.studies.chapter2.study import PICTURES, PICTURES_OF_TWO
from optim.studies.chapter3.sensor_placement import notable_designs
from optim.studies.chapter3.sweep_table import SweepTable, overlaps_of, read_sweep_table
from optim.studies.chapter4.training_table import read_training_table
from optim.wording import counted
from robots.braitenberg import VehicleBody
from robots.braitenberg.sweeps import holds_sweep
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap
from taichi_sim.base.arrays import Bytes
from taichi_sim.base.files import read_text
from taichi_sim.base.results_folder import read_settings

MOST_BODIES, MOST_MATRICES = 30, 6
Page = tuple[str, list[Html], list[Section], dict[str, Any]]  # title, lead, sections, the same for machines


def study_of(folder: Path) -> Callable[[Path], Page] | None:
    """The function that makes the page of a study's folder; None for other folders."""
    if holds_sweep(folder):
        return sweep_page
    if (folder / "training.json").is_file():
        return training_page
    if (folder / "runs" / f"{INTERFERENCE}.json").is_file():
        return interference_page
    return None


def sweep_page(folder: Path) -> Page:
    """Bodies by their metrics, and success matrices of the most notable; raises ValueError for a sweep of none."""
    found = read_sweep_table(folder)
    every = np.argsort(-found.learnability, kind="stable")[:MOST_BODIES]
    names = notable_designs(found)
    shown = {**names, **{int(d): f"design {d}" for d in found.designs[every]}}
    designs = list(shown)[:MOST_MATRICES]
    overlaps = overlaps_of([VehicleBody.published(d) for d in designs], found.settings, folder)
    matrices = [
        _success_matrix(one, _matrix_caption(found, d, names.get(d))) for d, one in zip(designs, overlaps, strict=True)
    ]
    rows = [
        (
            f"design {found.designs[n]}",
            number(int(found.solving_all[n]), 0),
            number(int(found.solving_any[n]), 0),
            number(float(found.learnability[n]), 5),
            number(float(found.interference[n]), 5),
        )
        for n in every.tolist()
    ]
    part = "" if len(rows) == len(found.designs) else f", the best {len(rows)} of {len(found.designs)} by M_L"
    counts = {"bodies": len(found.designs), "controllers each": found.settings.weights**2}
    lead = [
        paragraph(
            "Every controller on a grid of two weights, in bodies of Braitenberg vehicles, in four environments.",
            "lead",
        ),
        tiles((name, number(count, 0)) for name, count in counts.items()),
    ]
    header = ("Body", "Solve all", "Solve any", "M_L", "M_CI")
    meaning = (
        "M_L is the share of all controllers that solve every environment, M_CI their share of those that solve any."
    )
    sections = [
        Section("Bodies", [table(f"Controllers that succeed{part}", header, rows), paragraph(meaning)]),
        Section("Success matrices", [side_by_side(matrices)]),
        _settings(asdict(found.settings), folder),
    ]
    return f"Sweep {folder.resolve().name}", lead, sections, {"kind": "sweep", **counts, "matrices": designs}


def _matrix_caption(found: SweepTable, design: int, name: str | None) -> str:
    one = found.rows([design])
    known = f" ({name})" if name else ""
    return (
        f"Design {design}{known}: {one.solving_all[0]} of {found.settings.weights**2} controllers solve all "
        "environments"
    )


def training_page(folder: Path) -> Page:
    """Evaluations that methods needed; raises ValueError without their table."""
    settings, found = read_settings(folder, "training"), read_training_table(folder / "runs.csv")
    budget = int(found.evaluations.max()) if "budget" not in settings else int(settings["budget"])
    methods = list(zip(found.methods, found.evaluations, found.solved, strict=True))
    rows = [
        (
            name,
            number(solved.size, 0),
            number(int(solved.sum()), 0),
            number(float(spent.mean()), 1),
            number(float(np.median(spent)), 1),
        )
        for name, spent, solved in methods
    ]

    def draw(axes: Any) -> None:
        for (name, spent, solved), colour in zip(methods, COLOURS, strict=False):
            draw_share_solved(axes, spent[solved], solved.size, budget, color=colour, label=name)
        axes.set_ylabel("share of runs with all solved")

    alt = f"Share of runs of {counted(len(methods), 'method')} that solve all environments, against evaluations"
    drawn = chart(draw, alt, size=(5, 3))
    header = ("Method", "Runs", "Solve all", "Evaluations, mean", "Median")
    lead = [
        paragraph("Evaluations until a controller solves all four environments, in bodies of vehicles.", "lead"),
        tiles([("bodies", number(len(found.designs), 0)), ("methods", number(len(methods), 0))]),
    ]
    sections = [
        Section("Methods", [table("Runs of each method", header, rows), picture(drawn, alt, "narrow")]),
        _settings(settings, folder),
    ]
    document = {"kind": "training", "bodies": len(found.designs), "methods": list(found.methods)}
    return f"Training {folder.resolve().name}", lead, sections, document


def interference_page(folder: Path) -> Page:
    """Measures of all treatments and the pictures that there are; raises ValueError for a study not complete."""
    if not (folder / "summary.json").is_file():
        raise ValueError(f"run: {folder} is a study of interference that has no tables yet; run its command to the end")
    settings = read_settings(folder / "runs", INTERFERENCE)
    header, rows = read_table(folder / "tables.csv")
    pictures = [
        picture(picture_of((folder / name).read_bytes(), words), words)
        for name, words in zip((*PICTURES, *PICTURES_OF_TWO), PICTURE_NAMES, strict=True)
        if (folder / name).is_file()
    ]
    counts = _counts(folder / "summary.json")
    lead = [
        paragraph(
            "Quadrupeds trained to reach the light in several environments, and how what helps in one harms in "
            "another.",
            "lead",
        ),
        tiles((name, number(count, 0)) for name, count in counts.items()),
    ]
    named = [
        (" ".join(row[:4]), row[4], *(number(float(cell) if cell else None, 3) for cell in row[5:])) for row in rows
    ]
    sections = [
        Section("Measures", [table("M1 to M4", [" ".join(header[:4]), *header[4:]], named)]),
        *([Section("Pictures", pictures)] if pictures else []),
        _settings(settings, folder),
    ]
    return f"Interference {folder.resolve().name}", lead, sections, {"kind": "interference", **counts}


def _counts(path: Path) -> dict[str, int]:
    """Runs, generations and climbers of a study of interference; raises ValueError for another file."""
    try:
        summary = json.loads(read_text(path))
        return {name: int(summary[name]) for name in ("runs", "generations", "population")}
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{path}: is not the summary of a study of interference") from None


PICTURE_NAMES = (
    "Worst distance and fitness over generations, mean of runs with 95 % bands",
    "Paths of a typical champion of each treatment, from above",
    "What beneficial mutations change in two environments",
    "The same along the lines of champions",
)


def _settings(settings: Mapping[str, Any], folder: Path) -> Section:
    """Settings and files of a study."""
    rows = [
        (name.replace("_", " "), json.dumps(value) if isinstance(value, dict | list) else str(value))
        for name, value in settings.items()
    ]
    found = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    shown = [(code(path.name), number(path.stat().st_size, 0)) for path in found[:60]]
    return Section(
        "Settings and files", [facts("Settings", rows), table(f"Files of {folder}", ("File", "Bytes"), shown)]
    )


def _success_matrix(overlap: Bytes, alt: str) -> Html:
    """A success matrix with its colours beside it."""

    def draw(axes: Any) -> None:
        add_overlap_bar(axes.figure, draw_overlap(axes, overlap), [axes])

    return picture(chart(draw, alt, size=(3.7, 3.0)), alt)
