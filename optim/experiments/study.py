"""Studies: experiments that ``morpholab reproduce`` runs to repeat or extend something published."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import Any

from optim.experiments.results import Budget, Progress, scale_of


@dataclass(frozen=True)
class Study:
    """A study that repeats or extends something published.

    ``run`` is called as ``run(folder, settings, progress)``:

    * ``folder`` takes the results; it is new, or that of a study with equal settings, which continues where it ended.
      A folder of something else is refused by a ValueError, before any work.
    * ``settings`` are any, those in ``scales`` or others.
    * ``progress`` is called with the fraction done; it may be None.
    * ``threads``, where ``run`` takes it, are CPU threads, all available if None; they change no result.

    It writes ``summary.json`` or a table, and figures; where it returns anything, that is what ``summary.json`` holds.
    If ``run`` takes ``sweep_folder``, it reads bodies from a sweep there; if it takes ``jobs``, so many of its parts go
    on at the same time.

    Attributes:
        title: the question of the study, in a line.
        source: where that was published, such as ``"chapter 4"``.
        scales: settings by budget; ``"small"`` and ``"full"`` at least.
        run: does the study.
        writes: files in its folder, beside raw results.
        cost: what ``"full"`` takes, where that is hours.
    """

    title: str
    source: str
    scales: Mapping[Budget, Any]
    run: Callable[..., Any]
    writes: tuple[str, ...]
    cost: str = ""

    @property
    def options(self) -> set[str]:
        """Options among ``"sweep_folder"`` and ``"jobs"`` that ``run`` takes."""
        return {"sweep_folder", "jobs"} & set(signature(self.run).parameters)

    def reproduce(self, folder: Path, budget: str = "full", progress: Progress = None, **options: Any) -> None:
        """Run the study, or continue it where its folder ended.

        Args:
            folder: new, or that of the same study.
            budget: ``"small"``, to see that it works, ``"full"``, or ``"medium"``, where the study has that.
            progress: called with the fraction done.
            options: some of :attr:`options`, by name.

        Raises:
            ValueError: if the study does not have the budget, or the folder holds something else.
        """
        self.run(folder, scale_of(budget, self.scales), progress, **options)


@dataclass(frozen=True)
class StudySection:
    """A part of what a report tells of a study: a table, pictures, or both.

    Attributes:
        title: heading.
        caption: of the table.
        header: names of the table's columns.
        rows: of the table; the first cell of each is its name.
        digits: of the table's numbers.
        note: what its columns mean.
        charts: functions that draw on axes of matplotlib, by what they show.
        size: width and height of the charts [in].
        pictures: PNG files, by what they show.
    """

    title: str
    caption: str = ""
    header: Sequence[str] = ()
    rows: Sequence[Sequence[str | int | float | None]] = ()
    digits: int = 4
    note: str = ""
    charts: Mapping[str, Callable[[Any], None]] = field(default_factory=dict)
    size: tuple[float, float] = (3.7, 3.0)
    pictures: Mapping[str, Path] = field(default_factory=dict)


@dataclass(frozen=True)
class StudyReport:
    """What a report tells of a study's folder.

    Attributes:
        kind: what the study is, in a word.
        lead: what was done, in a sentence.
        counts: what matters most, by name.
        settings: of the study, by name.
        sections: tables and pictures.
        document: more for machines, beside kind and counts.
    """

    kind: str
    lead: str
    counts: Mapping[str, int]
    settings: Mapping[str, Any]
    sections: Sequence[StudySection]
    document: Mapping[str, Any] = field(default_factory=dict)
