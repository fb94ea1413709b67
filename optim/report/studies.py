"""Pages of studies: what the registry of their reports tells, with their settings and files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from optim.experiments.study import StudyReport, StudySection
from optim.report.charts import charted, picture_of
from optim.report.markup import Html, Section, code, facts, page, paragraph, picture, side_by_side, table, tiles
from optim.report.one_run import files_of
from optim.studies.catalogue import REPORTS

MOST_FILES = 60


def study_of(folder: Path) -> Callable[[Path], StudyReport] | None:
    """The function that tells of the study in a folder, known by its file of settings; None for other folders."""
    for name in REPORTS:
        if any((settings / f"{name}.json").is_file() for settings in (folder, folder / "runs")):
            return REPORTS[name]
    return None


def study_page(told: StudyReport, folder: Path, foot: str) -> str:
    """The page of a study in a folder."""
    lead = [paragraph(told.lead, "lead"), tiles(told.counts.items())]
    sections = [Section(part.title, _content(part)) for part in told.sections]
    settings = Section("Settings and files", [_settings(told.settings), _files(folder)])
    return page(f"{told.kind.capitalize()} {folder.resolve().name}", lead, [*sections, settings], foot)


def _content(part: StudySection) -> list[Html]:
    content = [table(part.caption, part.header, part.rows, part.digits)] if part.rows else []
    if part.note:
        content.append(paragraph(part.note))
    content += [picture(picture_of(path.read_bytes(), words), words) for words, path in part.pictures.items()]
    drawn = [charted(draw, words, size=part.size) for words, draw in part.charts.items()]
    return [*content, *([side_by_side(drawn)] if drawn else [])]


def _settings(settings: Mapping[str, Any]) -> Html:
    rows = [
        (name.replace("_", " "), json.dumps(value) if isinstance(value, dict | list) else str(value))
        for name, value in settings.items()
    ]
    return facts("Settings", rows)


def _files(folder: Path) -> Html:
    rows = [(code(path.name), path.stat().st_size) for path in files_of(folder)[:MOST_FILES]]
    return table(f"Files of {folder}", ("File", "Bytes"), rows)
