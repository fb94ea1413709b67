"""The page's sections of one run."""

import contextlib
import math
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from optim.plots.curves import draw_best, draw_run
from optim.problem import Objective
from optim.report.front import front_section
from optim.report.markup import (
    Html,
    Section,
    Text,
    charted,
    code,
    facts,
    folded,
    joined,
    listing,
    number,
    paragraph,
    side_by_side,
    table,
    tiles,
)
from optim.report.robot_run import Best, Subject, subject_of
from optim.runs.folder import ENVIRONMENT
from optim.runs.generation import Generation
from optim.runs.history import History, begun
from optim.runs.robust import checked_robust, read_robust
from optim.space import Variable
from optim.wording import spoken_duration
from robots.uncertainty import interval_of
from taichi_sim.base import files
from taichi_sim.base.arrays import Floats
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.results_folder import BEST_DESIGN
from taichi_sim.base.short_text import counted

MOST_ROWS = 60  # of the table of generations
FILES = {
    "config.toml": "every setting, sealed by a checksum",
    "environment.json": "versions, machine, command line",
    "log.jsonl": "a line a generation: scores and the best design",
    "timing.jsonl": "a line a generation: how long it took",
    "checkpoint.npz": "where the run goes on",
    "checkpoint.previous.npz": "the checkpoint before",
    BEST_DESIGN: "the best design",
    "front.json": "the designs of the front, or the elites",
    "gait.csv": "pressures of the best gait, for the rig",
    "robust.json": "the best design over draws that the search never saw",
    "products.json": "which files were made of the best design",
}


@dataclass(frozen=True)
class OneRun:
    """A run that is to be reported."""

    history: History  # what it has done
    subject: Subject  # what it designs

    @classmethod
    def of(cls, history: History) -> "OneRun":
        """The run of a history; raises ValueError if it has no complete generation, or an unknown problem."""
        begun(history)
        return cls(history, subject_of(history.path, history.config))

    @property
    def title(self) -> str:
        """The folder, and what was designed."""
        return f"{self.history.path.resolve().name}: {self.subject.title}"

    @property
    def state(self) -> str:
        """``"finished"``, ``"running"`` or ``"interrupted"``."""
        return self.history.state.replace("stopped", "interrupted")

    @property
    def last(self) -> Generation:
        """The last generation."""
        return self.history.generations[-1]

    @property
    def best_point(self) -> Floats | None:
        """The best point, shape (D,); None if every evaluation has failed."""
        return None if self.last.best_point is None else self.subject.problem.space.from_dict(self.last.best_point)

    @property
    def lead(self) -> list[Html]:
        """The first lines and numbers of a run's page: the best score, and how far the run is."""
        last, score, known = self.last, self.subject.score, [s for s in self.history.seconds if not math.isnan(s)]
        said = {
            "finished": "It has finished.",
            "running": "It is still running.",
            "interrupted": f"It was interrupted after generation {last.generation} of {self._planned}.",
        }[self.state]
        best = number(last.best, 4, score.unit)
        found = Html("Every evaluation has failed.")
        if last.best is not None:
            found = joined([f"The best {score.name} found is ", best, "."], "")
        return [
            paragraph(joined([found, said], " "), "lead"),
            *(paragraph(damage, "note") for damage in self.damages),
            tiles(
                [
                    (f"best {score.name}", best),
                    ("evaluations", last.evaluations),
                    ("wall time", spoken_duration(sum(known)) if known else None),
                    ("state", self.state),
                ]
            ),
        ]

    @property
    def damages(self) -> list[str]:
        """What is wrong with its files that can still be read, a line each; none as a rule.

        What makes a run unreadable is an error of ``read_history``.
        """
        history, problem, best = self.history, self.subject.problem, self.best_point
        if history.found is None:
            return []
        _, record, others = history.found
        told = [f"{name} is unusable ({reason}); the one before is used" for name, reason in others.items()]
        if files.sha256(_content(history.path / ENVIRONMENT)) != record.environment:
            told.append(f"{ENVIRONMENT} is not as it was written; versions and machine may not be the run's")
        if np.isnan(history.seconds).any():
            told.append("timing.jsonl is not as it was written; not all times are known")
        try:
            checked_robust(history.path)
        except ValueError as error:
            told.append(f"{str(error).removeprefix(f'{history.path}/')}; it is left out")
        if best is not None and not history.running:  # else it may be newer than what was read
            only_its_file_saves = contextlib.suppress(NotImplementedError)  # a problem of the user's own
            with tempfile.TemporaryDirectory() as folder, only_its_file_saves:
                problem.save(best, Path(folder) / BEST_DESIGN)
                if _content(history.path / BEST_DESIGN) != _content(Path(folder) / BEST_DESIGN):
                    told.append("best.json is not the best design of the log; the log's is shown here")
        return told

    def sections(self, best: Best | None, name: str) -> list[Section]:
        """Sections of the page, the first by its name; without a best design if every evaluation has failed."""
        parts = [Section(name, self._run()), Section("How the search went", self._search())]
        if best is not None:
            parts.append(Section("The best design", best.content))
            parts += best.sections
        if robust := read_robust(self.history.path):
            parts.append(Section("The best design over held-out draws", [_robust(robust)]))
        front = front_section(self.history, self.subject)
        return [*parts, *([front] if front else []), Section("How to reproduce", self._reproduce())]

    @property
    def _planned(self) -> int:
        """Generations that the run shall have, after the starts."""
        return int(self.history.config["generations"])

    def _run(self) -> list[Html]:
        history, last, config = self.history, self.last, dict(self.history.config["method"])
        name, seed = config.pop("name"), config.pop("seed", None)
        settings = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in sorted(config.items()))
        failed = sum(generation.failed for generation in history.generations)
        rows: list[tuple[str, Text]] = [
            *self.subject.facts,
            ("Method", name),
            ("Settings", settings or "the method's own"),
            ("Seed", str(seed) if seed is not None else None),
            ("Generations", f"{last.generation} of {self._planned}, after the starts"),
            ("Evaluations", joined([last.evaluations, f" ({failed} failed)"], "")),
            ("Wall time", self._time()),
            ("State", self.state),
            *self._machine(),
        ]
        return [facts("Settings and surroundings", rows), folded("Free variables", self._variables())]

    def _time(self) -> Text:
        seconds = np.array(self.history.seconds)
        known = seconds[~np.isnan(seconds)]
        if not len(known):
            return None
        part = "" if len(known) == len(seconds) else f", of {len(known)} of {counted(len(seconds), 'generation')}"
        middle = float(np.median(known))
        pace = f"{middle:.1f}" if middle >= 10 else f"{middle:.3g}"
        pace += f" s a generation (median){part}"
        ended = f"; the last ended at {self.history.finished}" if self.history.finished else ""
        return joined([number(float(known.sum()), 1, "s"), f", {pace}{ended}"], "")

    def _machine(self) -> list[tuple[str, Text]]:
        about = self._environment()
        told = ", ".join(f"{name} {version}" for name, version in (about.get("versions") or {}).items() if version)
        machine = ", ".join(str(about[name]) for name in ("processor", "platform") if about.get(name))
        cores = f", {about['cpu_count']} CPUs" if about.get("cpu_count") else ""
        return [("Versions", told or None), ("Machine", machine + cores if machine else None)]

    def _environment(self) -> dict[str, Any]:
        """What the run ran on, as far as that can be read."""
        try:
            found = parse_json(_content(self.history.path / ENVIRONMENT))
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}

    def _variables(self) -> Html:
        variables, rows = self.subject.problem.space.variables, []
        for (_, low, high, kind), group in groupby(variables, key=_like):
            first, *others = (variable.name for variable in group)
            name = f"{first} to {others[-1]}" if others else first
            rows.append((name, f"{low:g} to {high:g}", kind, 1 + len(others)))
        return table(counted(len(variables), "variable"), ("Variables", "Range", "Kind", "Count"), rows)

    def _search(self) -> list[Html]:
        generations, score, curves = self.history.generations, self.subject.score, self.subject.curves

        def scores(axes: Any) -> None:
            draw_run(axes, generations)
            axes.set_ylabel(score.label)

        def details(axes: Any) -> None:
            draw_best(axes, generations, curves)
            one, *others = curves.values()
            several = f"of the best design [{score.unit}]" if score.unit else "of the best design"
            axes.set_ylabel(several if others else one)

        climbers, told = self.last.scores, ", ".join(curves.values())
        lines = f"; thin lines are of {counted(len(climbers), 'climber')}" if climbers else ""
        alt = f"Best and mean {score.name} over {counted(len(generations) - 1, 'generation')}"
        parts = [charted(scores, alt, f"Best so far and mean of what the search keeps{lines}.")]
        if curves:
            alt = f"The best design over generations: {told}"
            parts.append(charted(details, alt, f"What the best design so far does: {told}."))
        return [side_by_side(parts), folded("The curves as a table", self._generations())]

    def _generations(self) -> Html:
        generations, curves = self.history.generations, self.subject.curves
        chosen = np.unique(np.linspace(0, len(generations) - 1, min(len(generations), MOST_ROWS)).round().astype(int))
        rows = []
        for one, seconds in ((generations[n], self.history.seconds[n]) for n in chosen.tolist()):
            scores = (number(value) for value in (one.best, one.mean, one.median))
            extra = (number((one.best_details or {}).get(name)) for name in curves)
            rows.append((one.generation, one.evaluations, *scores, one.failed, number(seconds, 1), *extra))
        named = "Generation", "Evaluations", "Best", "Mean", "Median", "Failed", "Time [s]"
        part = "" if len(rows) == len(generations) else f", {len(rows)} of {len(generations)}; log.jsonl has all"
        return table(f"Generations{part}", (*named, *curves.values()), rows)

    def _reproduce(self) -> list[Html]:
        folder, about = self.history.path, self._environment()
        lines = [("The run, as it was started", _as_typed(str(about["command"])))] if about.get("command") else []
        lines += self.subject.commands(folder, self.best_point)
        lines.append(("This page", f"morpholab report {shlex.quote(str(folder))} --out report.html"))
        same = "In f64 on one kind of machine the same settings give the same bits; in f32 too, with the same versions."
        return [listing(lines), paragraph(same), self._files()]

    def _files(self) -> Html:
        rows = []
        for path in files_of(self.history.path):
            digest = code(files.sha256(path.read_bytes())[:12])
            rows.append((code(path.name), FILES.get(path.name, _guessed(path)), path.stat().st_size, digest))
        header = ("File", "What it holds", "Bytes", "SHA-256, first 12")
        return table(f"Files of {self.history.path}", header, rows)


def _robust(judged: Mapping[str, Mapping[str, Any]]) -> Html:
    """A table of what the best design does where something is uncertain, by draws that the search never saw."""
    rows: list[tuple[Text, ...]] = []
    for world, found in judged.items():
        if found.get("failed"):
            rows.append((world, f"{found['failed']} of {found['draws']} draws failed", None, None, None))
            continue
        names = {"mean": "mean", "cvar": f"CVaR {found['share']:g}", "worst": "worst"}
        for name, told in names.items():
            rows.append((world, told, *map(number, (found[name], *(interval_of(found, name) or (None, None))))))
    first = next(iter(judged.values()))
    what = f" of {Objective(first['measure'], first['unit']).label}" if "measure" in first else ""
    caption = f"{first['draws']} draws of {first['uncertain']}"
    return table(caption, ("World", f"Number{what}", "Value", "95 % from", "to"), rows)


def files_of(folder: Path) -> list[Path]:
    """Files in a folder by name, without hidden ones."""
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))


def _content(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


def _as_typed(command: str) -> str:
    """A command line with the program's own name."""
    words = shlex.split(command)
    return shlex.join(["morpholab", *words[1:]]) if words else ""


def _like(variable: Variable) -> tuple[str, float, float, str]:
    return variable.name.rstrip("0123456789_"), variable.low, variable.high, variable.kind


def _guessed(path: Path) -> str:
    if path.name.startswith("failed-"):
        return "designs that could not be evaluated"
    return "picture of the best gait" if path.suffix == ".png" else ""
