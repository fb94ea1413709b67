"""The page's sections of one run."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from optim.plots.curves import draw_best, draw_run
from optim.problem import Objective
from optim.report.charts import chart
from optim.report.condition import damages, read_environment, state_of
from optim.report.front import front_section
from optim.report.markup import (
    Html,
    Section,
    Text,
    code,
    facts,
    folded,
    joined,
    listing,
    number,
    paragraph,
    picture,
    side_by_side,
    table,
    tiles,
)
from optim.report.robot_run import Best, RunSubject
from optim.runs.history import History
from optim.space import Variable
from optim.wording import counted, spoken_duration
from robots.hardware import PneumaticRig
from robots.robot import Replay
from taichi_sim.base import files

MOST_ROWS = 60  # of the table of generations
FILES = {
    "config.toml": "every setting, sealed by a checksum",
    "environment.json": "versions, machine, command line",
    "log.jsonl": "a line a generation: scores and the best design",
    "timing.jsonl": "a line a generation: how long it took",
    "checkpoint.npz": "where the run goes on",
    "checkpoint.previous.npz": "the checkpoint before",
    "best.json": "the best design",
    "front.json": "the designs of the front, or the elites",
    "gait.csv": "pressures of the best gait, for the rig",
    "products.json": "which files were made of the best design",
}


@dataclass(frozen=True)
class OneRun:
    """A run that is to be reported.

    Attributes:
        history: what it has done.
        kind: what it designs.
    """

    history: History
    kind: RunSubject

    @classmethod
    def of(cls, history: History) -> "OneRun":
        """The run of a history; a one-line ValueError without a complete generation or for an unknown problem."""
        if not history.generations:
            raise ValueError(f"run: {history.path} has no complete generation yet; continue it with --resume")
        return cls(history, RunSubject.of(history.path, history.config))

    @property
    def title(self) -> str:
        """The folder, and what was designed."""
        return f"{self.history.path.resolve().name}: {self.kind.title}"

    @property
    def lead(self) -> list[Html]:
        """What matters most."""
        history, last = self.history, self.history.generations[-1]
        (what, unit), known = self.kind.score, [s for s in history.seconds if not math.isnan(s)]
        said = {"finished": "It has finished.", "running": "It is still running."}.get(
            state_of(history),
            f"It was interrupted after generation {last.generation} of {history.config['generations']}.",
        )
        found = (
            joined([f"The best {what} found is ", number(last.best, 4, unit), "."], "")
            if last.best is not None
            else Html("Every evaluation has failed.")
        )
        return [
            paragraph(joined([found, said], " "), "lead"),
            *(paragraph(damage, "note") for damage in self.damages),
            tiles(
                [
                    (f"best {what}", number(last.best, 4, unit)),
                    ("evaluations", number(last.evaluations, 0)),
                    ("wall time", spoken_duration(sum(known)) if known else None),
                    ("state", state_of(history)),
                ]
            ),
        ]

    @property
    def damages(self) -> list[str]:
        """What is wrong with its files."""
        return damages(self.history, self.kind.problem)

    def sections(self, best: Best | None, player: Html | None, name: str) -> list[Section]:
        """All of them.

        Args:
            best: the best design; None if every evaluation has failed.
            player: its motion.
            name: of the first of them.
        """
        parts = [Section(name, self._run()), Section("How the search went", self._search())]
        if best is not None:
            parts.append(Section("The best design", [*([player] if player else []), *best.content]))
            parts += best.sections
        front = front_section(self.history, self.kind)
        return [*parts, *([front] if front else []), Section("How to reproduce", self._reproduce())]

    def best(self, replays: Sequence[Replay], rig: PneumaticRig | None) -> Best | None:
        """The best design, simulated again or not; None if every evaluation has failed."""
        last = self.history.generations[-1]
        if last.best_point is None:
            return None
        return self.kind.best(last, self.kind.problem.space.from_dict(last.best_point), replays, rig)

    def _run(self) -> list[Html]:
        history, config = self.history, dict(self.history.config["method"])
        name, seed = config.pop("name"), config.pop("seed", None)
        settings = [(key.replace("_", " "), str(value)) for key, value in sorted(config.items())]
        failed = sum(generation.failed for generation in history.generations)
        last = history.generations[-1]
        rows: list[tuple[str, Text]] = [
            *self.kind.facts,
            ("Method", name),
            ("Settings", joined((f"{key} {value}" for key, value in settings)) if settings else "the method's own"),
            ("Seed", str(seed) if seed is not None else None),
            ("Generations", f"{last.generation} of {history.config['generations']}, after the starts"),
            ("Evaluations", joined([number(last.evaluations, 0), f" ({failed} failed)"], "")),
            ("Wall time", self._time()),
            ("State", state_of(history)),
            *self._machine(),
        ]
        return [facts("Settings and surroundings", rows), folded("Free variables", self._variables())]

    def _time(self) -> Text:
        seconds = np.array(self.history.seconds)
        known = seconds[~np.isnan(seconds)]
        if not len(known):
            return None
        part = "" if len(known) == len(seconds) else f", of {len(known)} of {counted(len(seconds), 'generation')}"
        pace = f"{np.median(known):.1f} s a generation (median){part}"
        ended = f"; the last ended at {self.history.finished}" if self.history.finished else ""
        return joined([number(float(known.sum()), 1, "s"), f", {pace}{ended}"], "")

    def _machine(self) -> list[tuple[str, Text]]:
        about: dict[str, Any] = read_environment(self.history.path)
        versions = about.get("versions") or {}
        told = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
        machine = ", ".join(str(about[name]) for name in ("processor", "platform") if about.get(name))
        cores = f", {about['cpu_count']} CPUs" if about.get("cpu_count") else ""
        return [("Versions", told or None), ("Machine", machine + cores if machine else None)]

    def _variables(self) -> Html:
        variables = self.kind.problem.space.variables
        rows = [
            (_called(group), f"{group[0].low:g} to {group[0].high:g}", group[0].kind, str(len(group)))
            for group in (list(each) for _, each in groupby(variables, key=_like))
        ]
        return table(counted(len(variables), "variable"), ("Variables", "Range", "Kind", "Count"), rows)

    def _search(self) -> list[Html]:
        generations, (what, unit) = self.history.generations, self.kind.score
        label = Objective(what, unit).label

        def scores(axes: Any) -> None:
            draw_run(axes, generations)
            axes.set_ylabel(label)

        climbers = generations[-1].scores
        lines = f"; thin lines are of {counted(len(climbers), 'climber')}" if climbers else ""
        alt = f"Best and mean {what} over {counted(len(generations) - 1, 'generation')}"
        parts = [picture(chart(scores, alt), f"Best so far and mean of what the search keeps{lines}.")]
        if self.kind.curves:

            def details(axes: Any) -> None:
                draw_best(axes, generations, self.kind.curves)
                one, *others = self.kind.curves.values()
                axes.set_ylabel((f"of the best design [{unit}]" if unit else "of the best design") if others else one)

            told = ", ".join(self.kind.curves.values())
            parts.append(
                picture(
                    chart(details, f"The best design over generations: {told}"),
                    f"What the best design so far does: {told}.",
                )
            )
        return [side_by_side(parts), folded("The curves as a table", self._generations())]

    def _generations(self) -> Html:
        generations = self.history.generations
        chosen = np.unique(np.linspace(0, len(generations) - 1, min(len(generations), MOST_ROWS)).round().astype(int))
        rows = [
            (
                str(one.generation),
                number(one.evaluations, 0),
                number(one.best),
                number(one.mean),
                number(one.median),
                str(one.failed),
                number(self.history.seconds[n], 1),
                *(number((one.best_details or {}).get(name)) for name in self.kind.curves),
            )
            for n, one in ((n, generations[n]) for n in chosen.tolist())
        ]
        named = "Generation", "Evaluations", "Best", "Mean", "Median", "Failed", "Time [s]"
        header = (*named, *self.kind.curves.values())
        part = "" if len(rows) == len(generations) else f", {len(rows)} of {len(generations)}; log.jsonl has all"
        return table(f"Generations{part}", header, rows)

    def _reproduce(self) -> list[Html]:
        folder, about = self.history.path, read_environment(self.history.path)
        lines = [("The run, as it was started", _as_typed(str(about["command"])))] if about.get("command") else []
        last = self.history.generations[-1].best_point
        best = None if last is None else self.kind.problem.space.from_dict(last)
        lines += self.kind.commands(folder, best)
        lines.append(("This page", f"morpholab report {shlex.quote(str(folder))} --out report.html"))
        same = "In f64 on one kind of machine the same settings give the same bits; in f32 too, with the same versions."
        return [listing(lines), paragraph(same), self._files()]

    def _files(self) -> Html:
        folder = self.history.path
        found = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
        rows = [
            (
                code(path.name),
                FILES.get(path.name, _guessed(path)),
                number(path.stat().st_size, 0),
                code(files.sha256(path.read_bytes())[:12]),
            )
            for path in found
        ]
        return table(f"Files of {folder}", ("File", "What it holds", "Bytes", "SHA-256, first 12"), rows)


def _as_typed(command: str) -> str:
    """A command line with the program's own name."""
    words = shlex.split(command)
    return shlex.join(["morpholab", *words[1:]]) if words else ""


def _like(variable: Variable) -> tuple[str, float, float, str]:
    return variable.name.rstrip("0123456789_"), variable.low, variable.high, variable.kind


def _called(group: list[Variable]) -> str:
    return group[0].name if len(group) == 1 else f"{group[0].name} to {group[-1].name}"


def _guessed(path: Path) -> str:
    if path.name.startswith("failed-"):
        return "designs that could not be evaluated"
    return "picture of the best gait" if path.suffix == ".png" else ""
