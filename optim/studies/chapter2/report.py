"""What a report tells of a folder of training quadrupeds: measures of all treatments, and pictures."""

import json
from pathlib import Path

from optim.experiments.study import StudyReport, StudySection
from optim.experiments.tables import read_table
from optim.studies.chapter2.evolution import KIND
from optim.studies.chapter2.study import PICTURES, PICTURES_OF_TWO
from taichi_sim.base.files import read_text
from taichi_sim.base.results_folder import read_settings

SHOWN = dict(
    zip(
        (*PICTURES, *PICTURES_OF_TWO),
        (
            "Worst distance and fitness over generations, mean of runs with 95 % bands",
            "Paths of a typical champion of each treatment, from above",
            "What beneficial mutations change in two environments",
            "The same along the lines of champions",
        ),
        strict=True,
    )
)


def report(folder: Path) -> StudyReport:
    """What a report tells of a study of interference.

    Raises:
        ValueError: if it is not complete.
    """
    summary = folder / "summary.json"
    if not summary.is_file():
        raise ValueError(f"run: {folder} is a study of interference that has no tables yet; run its command to the end")
    settings, (header, rows) = read_settings(folder / "runs", KIND), read_table(folder / "tables.csv")
    try:
        record = json.loads(read_text(summary))
        counts = {name: int(record[name]) for name in ("runs", "generations", "population")}
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{summary}: is not the summary of a study of interference") from None
    named = [(" ".join(row[:4]), row[4], *(float(cell) if cell else None for cell in row[5:])) for row in rows]
    table = StudySection("Measures", "M1 to M4", [" ".join(header[:4]), *header[4:]], named, digits=3)
    pictures = {words: folder / name for name, words in SHOWN.items() if (folder / name).is_file()}
    return StudyReport(
        "interference",
        "Quadrupeds trained to reach the light in several environments, and how what helps in one harms in another.",
        counts,
        settings,
        [table, *([StudySection("Pictures", pictures=pictures)] if pictures else [])],
    )
