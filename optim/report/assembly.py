"""From folders to a page: of runs, and of studies, which the registry of their reports tells of."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress
from optim.experiments.study import StudyReport, StudySection
from optim.report.compared import comparison_sections
from optim.report.markup import (
    Html,
    Section,
    charted,
    code,
    facts,
    paragraph,
    picture,
    picture_of,
    side_by_side,
    table,
    tiles,
)
from optim.report.markup import page as page_of
from optim.report.one_run import OneRun, files_of
from optim.runs.comparable import check_comparable
from optim.runs.comparison import Axis
from optim.runs.history import read_histories, runs_below
from optim.studies.catalogue import REPORTS
from optim.wording import spoken_size
from robots.hardware import PneumaticRig
from robots.robot import Replay
from robots.view.motion import Motion
from robots.view.player import MOST_MOTIONS, embedded, page

MOST_BYTES = 15_000_000  # of a page, so that it can be mailed
PLAYER = Html("<!-- player -->")  # where it goes in the page
FOOT = "Made by morpholab report. This page is one file and needs no network."


@dataclass(frozen=True)
class ReportSettings:
    """What a report shall have."""

    player: bool = True  # whether the best design is simulated again and can be played
    frames: int = 400  # of each motion, about
    rig: PneumaticRig | None = None  # that is to play the gait; the default one if None
    axis: Axis = "evaluations"  # by which several runs are compared


@dataclass(frozen=True)
class Built:
    """A page."""

    text: str  # of the file
    document: dict[str, Any]  # what it says, for machines
    notes: list[str] = field(default_factory=list)  # on what is not as asked for, a line each
    left_out: list[str] = field(default_factory=list)  # why runs could not be read, a line each


def build(paths: Sequence[Path], settings: ReportSettings, progress: Progress) -> Built:
    """The page of a run, of several that are judged alike, or of one study, in folders, or in folders of such.

    Raises ValueError for what cannot be reported, before anything is simulated.
    """
    for path in paths:
        if read := study_of(path):
            if len(paths) > 1:
                raise ValueError(f"run: {path} is a study; report it alone")
            if settings.rig:
                raise ValueError(f"rig: {path} is a study, in which a rig plays no gait; leave it out")
            _check_compared(path, settings)
            told = read(path)
            return Built(study_page(told, path, FOOT), {"kind": told.kind, **told.counts, **told.document})
    runs, damaged = read_histories(_runs(paths), OneRun.of)
    if settings.rig and not runs[0].subject.plays_on_rigs:
        raise ValueError(f"rig: no rig plays designs of {runs[0].history.path}; leave it out")
    if len(runs) == 1:
        if paths == [runs[0].history.path] and not damaged:
            _check_compared(paths[0], settings)
        built = _page(runs[0], runs[0].title, [*runs[0].lead, *map(_left_out, damaged)], ([], {}), settings, progress)
        return replace(built, left_out=damaged)
    check_comparable([run.history for run in runs])
    sections, document = comparison_sections(runs, settings.axis)
    best = max(runs, key=lambda run: (run.last.best is not None, run.last.best or 0))
    title = f"{len(runs)} runs: {best.subject.title}"
    lead = [paragraph(f"The best design is that of {best.history.path}, and the numbers here are that run's.", "lead")]
    lead += [*best.lead[1:], *map(_left_out, damaged)]
    return replace(_page(best, title, lead, (sections, {"comparison": document}), settings, progress), left_out=damaged)


def _check_compared(path: Path, settings: ReportSettings) -> None:
    """Refuse an axis by which nothing is compared."""
    if settings.axis != ReportSettings.axis:
        raise ValueError(f"by: {path} is not compared with others; leave it out")


def _left_out(reason: str) -> Html:
    """What a page says of a run that cannot be read."""
    return paragraph(f"{reason}; the run is left out", "note")


def _runs(paths: Sequence[Path]) -> list[Path]:
    """Run folders; a ValueError that says what can be reported if there are none."""
    try:
        return runs_below(paths)
    except ValueError as error:
        able = "a report takes folders of runs, or one of a sweep, of training, of interference or of measure"
        raise ValueError(f"{error}; {able}") from None


def _page(
    run: OneRun,
    title: str,
    lead: Sequence[Html],
    compared: tuple[Sequence[Section], dict[str, Any]],
    settings: ReportSettings,
    progress: Progress,
) -> Built:
    """The page of a run, after sections that compare several, given as markup and for machines."""
    before, more = compared
    replays, best, point, notes = list[Replay](), None, run.best_point, list[str]()
    if point is not None:
        refused = run.subject.unplayable(run.history) if settings.player else ""
        if refused:
            notes.append(f"{refused}; the player is left out")
        elif settings.player:
            replays = run.subject.replays(point, settings.frames, progress)
            notes += filter(None, [run.subject.unshown(point)])
        best = run.subject.best(run.last, point, replays, settings.rig)
        best = replace(best, content=[PLAYER, *best.content])
    shown = [replay.motion for replay in replays[:MOST_MOTIONS]]
    if len(shown) < len(replays):
        notes.append(f"the player shows {MOST_MOTIONS} of {len(replays)} motions")
    sections = run.sections(best, "The best run" if before else "The run")
    around = page_of(title, lead, [*before, *sections], FOOT)
    while True:
        text = around.replace(PLAYER, _player(shown) if shown else "")
        size, frames = len(text.encode()), max((len(motion.times) for motion in shown), default=0)
        if size <= MOST_BYTES or frames <= 2:
            break
        shown = [motion.every(2) for motion in shown]
        notes.append(
            f"with {frames} frames the page had {spoken_size(size)}, more than {spoken_size(MOST_BYTES)}: "
            "every other is left"
        )
    document = {
        "kind": "run",
        "folder": str(run.history.path),
        "state": run.state,
        "damages": run.damages,
        "generation": run.last.generation,
        "evaluations": run.last.evaluations,
        "best": run.last.best,
        "design": best.document if best else None,
        "frames": frames,
        **more,
    }
    return Built(text, document, notes)


def _player(motions: Sequence[Motion]) -> Html:
    """The player, for screens."""
    element = Html(embedded(page(motions), title="Player: the best design in motion"))
    words = "The best design in motion: drag to orbit, space to play. Simulated again when this page was made."
    return picture(element, words, "player")


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
    return page_of(f"{told.kind.capitalize()} {folder.resolve().name}", lead, [*sections, settings], foot)


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
