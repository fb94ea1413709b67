"""What a report says of a run's problem and of its best design, for robots of any kind and for plain functions."""

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from optim.problem import Objective, Problem, objectives_of, score_of
from optim.problems import problem_of_description
from optim.problems.robot import RobotDesigning
from optim.report.charts import chart, image
from optim.report.markup import Html, Section, Text, facts, joined, number, paragraph, picture, side_by_side, table
from optim.report.rig import rig_section
from optim.runs.config import problem_of
from optim.runs.generation import Generation
from optim.wording import counted
from robots.hardware import PneumaticRig
from robots.robot import KINDS, Facts, Measure, Quantity, Replay, Robot
from taichi_sim.base.arrays import Floats

Progress = Callable[[float], None]
PIXELS = 110  # an inch, of printed strips


@dataclass(frozen=True)
class Best:
    """What there is to say of the best design.

    Attributes:
        content: markup.
        sections: more of the page.
        document: for machines.
    """

    content: Sequence[Html]
    sections: Sequence[Section] = ()
    document: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunSubject:
    """What a run designs.

    Attributes:
        problem: as its folder describes it.
    """

    problem: Problem

    @classmethod
    def of(cls, folder: Path, config: Mapping[str, Any]) -> "RunSubject":
        """The subject of a run with these settings.

        Raises:
            ValueError: for a problem that is unknown or cannot be read.
        """
        return cls(problem_of(folder, config, problem_of_description))

    @property
    def _robots(self) -> RobotDesigning | None:
        return self.problem if isinstance(self.problem, RobotDesigning) else None

    @property
    def title(self) -> str:
        """What is designed and where, in a few words that follow a colon."""
        return str(getattr(self.problem, "subject", type(self.problem).__name__))

    @property
    def score(self) -> tuple[str, str]:
        """What the score is, and its unit."""
        score = score_of(objectives_of(self.problem))
        return score.name, score.unit

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """What is designed, and how it is judged."""
        told = getattr(self.problem, "facts", None)
        if told is not None:
            return _shown(told())
        objectives = ", ".join(objective.label for objective in objectives_of(self.problem))
        return [("Objective", f"{objectives}, maximised"), ("Free", counted(self.problem.space.size, "variable"))]

    @property
    def curves(self) -> Mapping[str, str]:
        """Numbers in ``best_details`` that are worth a curve each, and what they are called."""
        return self._robots.curves if self._robots else {}

    @property
    def plays_on_rigs(self) -> bool:
        """Whether a rig can play designs of this run; the robot of any point says so."""
        return self._robots is not None and self._robots.exportable

    def replays(self, point: Floats, frames: int, progress: Progress) -> list[Replay]:
        """Try a point again in each world, with about so many frames of each motion; none of plain functions."""
        if self._robots is None:
            return []
        problem, robot = self._robots, self._robots.robot_of(point)
        found = []
        for n, world in enumerate(problem.tried_in):
            name = world.spoken or robot.name
            tick = _part(progress, n, len(problem.tried_in))
            settings: dict[str, Any] = {"frames": frames, "name": name, "compute": problem.compute, "progress": tick}
            found.append(robot.replay((), world, **settings))
        return found

    def best(self, last: Generation, point: Floats, replays: Sequence[Replay], rig: PneumaticRig | None) -> Best:
        """The best design, of the last generation."""
        details, values = last.best_details or {}, self.problem.space.to_dict(point)
        if self._robots is None:
            told: list[tuple[str, Text]] = [(name, f"{value:.6g}") for name, value in values.items()]
            shown = {name: value for name, value in details.items() if isinstance(value, int | float)}
            more = [facts("Its details", [(name, number(value, 4)) for name, value in shown.items()])] if shown else []
            return Best([facts("The best point", told), *more], [], {"values": values, "details": details})
        robot = self._robots.robot_of(point)
        measured, document = self._measured(robot, point, last, replays)
        own = _shown(robot.facts_of(()))
        free: list[tuple[str, Text]] = [(name, f"{value:.4g}") for name, value in values.items()]
        about = facts("Its body and behaviour", own) if own else facts("What was free", free)
        content = [measured, about, *self._pictures(robot, replays)]
        sections = []
        document = {**document, **robot.document(), "values": values}
        if self._robots.exportable:
            section, document["rig"] = self._on_rig(robot, rig)
            sections.append(section)
        return Best(content, sections, document)

    def _measured(
        self, robot: Robot, point: Floats, last: Generation, replays: Sequence[Replay]
    ) -> tuple[Html, dict[str, Any]]:
        """A row for each world: what the log says, and what came of it here."""
        problem, option = self._robots, KINDS[robot.kind].world_option
        assert problem is not None
        logged = problem.logged(point, last.best, last.best_details or {})
        known = [measure for measure in robot.measures if any(measure.name in row for row in logged)]
        again = [measure for measure in robot.measures if replays]
        header = [option.capitalize(), *(_label(measure) for measure in known)]
        header += [f"{_label(measure)}, replayed here" for measure in again]
        rows, told = [], []
        for n, world in enumerate(problem.tried_in):
            found = {m.name: _finite(float(replays[n].outcome.measures[m.name][0])) for m in again}
            shown = [*(logged[n].get(measure.name) for measure in known), *found.values()]
            rows.append([world.spoken or world.name, *map(number, shown)])
            first = robot.measures[0].name
            told.append({option: world.name, **found, **logged[n], "replayed": found.get(first)})
        return table("The best design", header, rows), {f"{option}s": told}

    def _pictures(self, robot: Robot, replays: Sequence[Replay]) -> list[Html]:
        """The robot's own pictures; prints show poses above a chart instead of the player."""
        from robots.view.picture import motion_picture

        assert self._robots is not None
        drawn = [
            (picture(chart(each.draw, each.words, size=each.size), each.words, each.style), each.style)
            for each in robot.pictures((), replays, self._robots.compute)
        ]
        plain = [html for html, style in drawn if not style]
        found = [html for html, style in drawn if style] + ([side_by_side(plain)] if plain else [])
        strips = []
        for world, replay in zip(self._robots.tried_in, replays, strict=False):
            words = f"Six poses of the best design {world.spoken}".strip() + ", above the chart of what drives it"
            strip = motion_picture(replay.motion, title=replay.title or None)
            strips.append(picture(image(strip, words, pixels=PIXELS), words))
        return [*found, *([Html(f'<div class="print-only">{joined(strips, "")}</div>')] if strips else [])]

    def _on_rig(self, robot: Robot, rig: PneumaticRig | None) -> tuple[Section, dict[str, Any] | None]:
        """What the design asks of the rig, or why no rig plays it."""
        try:
            found, seconds = robot.rig_report(rig)
        except ValueError as error:
            return Section("On the pneumatic rig", [paragraph(str(error).partition(": ")[2], "note")]), None
        return rig_section(found, rig is None, seconds)

    def columns(self, points: Floats) -> Mapping[str, Sequence[Text]]:
        """What a table of several designs, shape (C, D), tells of each beside its objectives."""
        if self._robots is not None:
            return self._robots.columns_of(points)
        return {name: [f"{value:.4g}" for value in points[:, n]] for n, name in enumerate(self.problem.space.names)}

    def commands(self, folder: Path, best: Floats | None = None) -> list[tuple[str, str]]:
        """What can be done with the run, and with its best point: words, and a command."""
        where, file = (shlex.quote(str(path)) for path in (folder, folder / "best.json"))
        if self._robots is None:
            return []
        found = [("Go on with the run, if it was interrupted", f"morpholab codesign --resume --out {where}")]
        named = self._robots.command_options(folder)
        named |= {"precision": self._robots.precision, "device": self._robots.device}
        options = " ".join(f"--{name} {shlex.quote(str(value))}" for name, value in named.items() if value is not None)
        option = KINDS[self._robots.robot_kind].world_option
        for world in self._robots.tried_in:
            line = f"morpholab simulate --gait {file} --{option} {world.name} {options}"
            found.append((f"Simulate the best design {world.spoken}".strip(), line))
        found.append(("Watch it", f"morpholab view {where} --out best.html"))
        if best is not None and self._robots.robot_of(best).exportable:
            found.append(("Write its pressures for the rig", f"morpholab export {where} --csv gait.csv --units psi"))
        return found


def _shown(rows: Facts) -> list[tuple[str, Text]]:
    """Rows as markup."""
    return [
        (name, number(told.value, told.digits, told.unit) if isinstance(told, Quantity) else told)
        for name, told in rows
    ]


def _label(measure: Measure) -> str:
    """A measure with its unit, as the head of a column."""
    return Objective(measure.name.replace("_", " ").capitalize(), measure.unit).label


def _part(report: Progress, number: int, count: int) -> Progress:
    """Progress of one of several trials, as that of all."""
    return lambda fraction: report((number + fraction) / count)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
