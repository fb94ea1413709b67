"""Catastrophic interference in legged, wheeled and whegged robots: chapter 2 of the dissertation.

Nine treatments, three robots times three ways to combine environments, are trained by parallel hill climbers; tables M1
to M4, tests and pictures say which of them suffer when what helps in one environment harms in another.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from optim.experiments.data import Data
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Count, Settings, Study, StudyReport, StudySection
from optim.experiments.tables import read_table, select
from optim.studies.chapter2.champions import COLUMNS as ALONE
from optim.studies.chapter2.champions import (
    champions_of,
    read_traces,
    traces_of,
    train_alone,
    write_alone,
    write_champions,
)
from optim.studies.chapter2.curves import all_mutations, curves_of, read_curves, write_curves
from optim.studies.chapter2.evolution import KIND, by_treatment, evolve
from optim.studies.chapter2.likeness import COLUMNS as LIKENESS
from optim.studies.chapter2.likeness import QUANTITIES, likeness, write_likeness
from optim.studies.chapter2.settings import LIGHTS, ROBOTS, Interference, Lights, Treatment, treatments
from optim.studies.chapter2.tables import COLUMNS as RUNS
from optim.studies.chapter2.tables import Cells, cells_of, measure, rows_of, write_tables
from robots.robot import part_of
from taichi_sim.base.files import make_folder, read_text
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.results_folder import read_settings

TABLES = (
    *("tables.md", "tables.csv", "runs.csv", "tests.csv", "curves.csv"),
    *("likeness.md", "likeness.csv", "summary.json", "champions"),
)
PICTURES = {
    "curves.png": "Worst distance and fitness over generations, mean of runs with 95 % bands",
    "traces.png": "Paths of a typical champion of each treatment, from above",
}
PICTURES_OF_TWO = {
    "changes.png": "What beneficial mutations change in two environments",
    "changes-of-champions.png": "The same along the lines of champions",
}
# Experiments in folders, of so many environments each: those of the study, of two environments with all published
# generations, and of climbers led by gradients.
ENVIRONMENTS = {"two": 2, "four": 4, "at-3000": 2, "gradient": 2}
DRAWN = (".png", ".npz", ".csv.gz")  # a picture, and what it shows


@dataclass(frozen=True)
class Effort(Settings):
    """How much a study does."""

    population: Count  # climbers of a run
    runs: Count  # of each treatment
    generations: Count  # of each run
    runs_alone: Count  # of each robot that is trained on a light alone
    generations_alone: Count  # of each of these


def train(
    settings: Interference,
    chosen: Sequence[Treatment],
    runs: int,
    generations: int,
    out: Path,
    *,
    figures: bool = False,
    threads: int | None = None,
    progress: Progress = None,
) -> dict[str, Any]:
    """Train treatments as :func:`evolve` does, and write tables, and pictures if asked for; return ``summary.json``."""
    drawn = [str(Path(name).with_suffix(suffix)) for name in (PICTURES | PICTURES_OF_TWO) for suffix in DRAWN]
    check_folder(out, (*TABLES, *drawn, "runs", "alone", "alone.csv"))
    found = by_treatment(evolve(settings, chosen, runs, generations, out / "runs", threads, progress))
    about = {**asdict(settings), "runs": runs, "generations": generations}
    summary = write_tables(rows_of(found), len(settings.lights), out, about)
    champions = champions_of(settings, found, threads)
    write_champions(champions, out / "champions")
    _add_likeness(summary, likeness(champions, settings, threads), out)
    curves = curves_of(found)
    write_curves(curves, out / "curves.csv")
    if figures:
        from optim.studies.chapter2.figures import draw_changes, draw_curves, draw_traces

        draw_curves(curves, out / "curves.png")
        draw_traces(traces_of(champions), settings.lights, out / "traces.png")
        if len(settings.lights) == 2:
            draw_changes(all_mutations(found), out / "changes.png")
            draw_changes(all_mutations(found, measure(found)), out / "changes-of-champions.png")
    return summary


def _add_likeness(summary: dict[str, Any], found: Mapping[str, Cells], out: Path) -> None:
    """Write tables of likeness, and ``summary.json`` again, with what they tell."""
    summary["likeness"] = write_likeness(found, out)
    write_json(out / "summary.json", summary)


def files_of(settings: Interference, figures: bool) -> list[str]:
    """Names of what :func:`train` writes, beside raw results."""
    two = PICTURES_OF_TWO if len(settings.lights) == 2 else {}
    return [*TABLES, *((*PICTURES, *two) if figures else ())]


def study(folder: Path, settings: Effort, progress: Progress = None) -> None:
    """Run the nine treatments in two and in four environments, and each robot on each light alone.

    Writes ``two`` and ``four``, with tables and pictures each, and ``alone.csv``.
    """
    check_folder(folder, ("two", "four", "alone", "alone.csv", "summary.json"))
    for n, name in enumerate(("two", "four")):
        environments = ENVIRONMENTS[name]
        world = Interference(LIGHTS[environments], settings.population)
        effort, share = (settings.runs, settings.generations), part_of(progress, n, 3)
        train(world, treatments(), *effort, folder / name, figures=True, progress=share)
    effort, share = (settings.runs_alone, settings.generations_alone), part_of(progress, 2, 3)
    alone = train_alone(world, tuple(ROBOTS), *effort, folder, progress=share)  # on each of the four lights
    write_json(folder / "summary.json", {"alone": alone})


def rewrite(data: Data, folder: Path) -> None:
    """Write tables and pictures of each experiment that has a folder with the table of its runs, and each light alone.

    Pictures are those whose numbers are there: what climbers kept, and the paths of champions, are in no table of runs.
    """
    for name, environments in ENVIRONMENTS.items():
        part, told = Data(data.folder / name), folder / name
        if not part.has("runs.csv"):
            continue
        make_folder(told)
        runs = part.records("runs.csv", RUNS)
        summary = write_tables(runs, environments, told, {"runs": 1 + max(row["run"] for row in runs)})
        if part.has("likeness.csv"):
            rows = part.records("likeness.csv", LIKENESS)
            found = {quantity: cells_of(select(rows, quantity=quantity), "value") for quantity in QUANTITIES}
            _add_likeness(summary, found, told)
        _draw(part, LIGHTS[environments], told)
    alone = write_alone(data.records("alone.csv", ALONE), folder)
    write_json(folder / "summary.json", {"alone": alone})


def _draw(data: Data, lights: Lights, out: Path) -> None:
    """Draw the pictures whose numbers are in a folder."""
    from optim.studies.chapter2.figures import draw_changes, draw_curves, draw_traces, read_changes

    if data.has("curves.csv"):
        curves = read_curves(data)
        write_curves(curves, out / "curves.csv")
        draw_curves(curves, out / "curves.png")
    if data.has("traces.csv"):
        draw_traces(read_traces(data, len(lights)), lights, out / "traces.png")
    for name in PICTURES_OF_TWO if len(lights) == 2 else ():
        if (data.folder / (numbers := str(Path(name).with_suffix(".npz")))).is_file():
            draw_changes(read_changes(data, numbers), out / name)


STUDY = Study(
    title="which robots, trained in several environments, suffer when what helps in one harms in another",
    source="chapter 2, tables M1 to M4 and figures",
    scales={"small": Effort(20, 3, 40, 2, 40), "full": Effort(100, 30, 3000, 5, 400)},  # full: as published
    run=study,
    rewrite=rewrite,
    writes=(
        *(f"two/{name}" for name in ("tables.md", *PICTURES_OF_TWO, *PICTURES)),
        *(f"four/{name}" for name in ("tables.md", *PICTURES)),
        "alone.csv",
    ),
    cost="65 h of CPU time for two environments, 80 for four",
)


def report(folder: Path) -> StudyReport:
    """What a report tells of a study of interference; raises ValueError if it is not complete."""
    summary = folder / "summary.json"
    if not summary.is_file():
        raise ValueError(f"run: {folder} is a study of interference that has no tables yet; run its command to the end")
    settings, (header, rows) = read_settings(folder / "runs", KIND), read_table(folder / "tables.csv")
    try:
        record = parse_json(read_text(summary))
        counts = {name: int(record[name]) for name in ("runs", "generations", "population")}
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{summary}: is not the summary of a study of interference") from None
    named = [(" ".join(row[:4]), row[4], *(float(cell) if cell else None for cell in row[5:])) for row in rows]
    table = StudySection("Measures", "M1 to M4", [" ".join(header[:4]), *header[4:]], named, digits=3)
    shown = PICTURES | PICTURES_OF_TWO
    pictures = {words: folder / name for name, words in shown.items() if (folder / name).is_file()}
    return StudyReport(
        "interference",
        "Quadrupeds trained to reach the light in several environments, and how what helps in one harms in another.",
        counts,
        settings,
        [table, *([StudySection("Pictures", pictures=pictures)] if pictures else [])],
    )
