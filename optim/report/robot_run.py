"""What a report says of a run's problem and of its best design, for robots of any kind and for plain functions."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress
from optim.problem import Objective, Problem, objectives_of, score_of
from optim.problems import problem_of_run
from optim.problems.robot_designing import RobotDesigning
from optim.report.markup import (
    Html,
    Section,
    Text,
    charted,
    facts,
    image,
    joined,
    number,
    paragraph,
    picture,
    side_by_side,
    table,
)
from optim.report.rig import rig_section
from optim.runs.config import check_ground_files
from optim.runs.generation import Generation
from optim.runs.history import History
from robots.ground_files import by_file_read
from robots.hardware import PneumaticRig
from robots.robot import KINDS, Facts, Quantity, Replay, Robot, part_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.options import flag_of, spelled
from taichi_sim.base.results_folder import BEST_DESIGN
from taichi_sim.base.short_text import counted


@dataclass(frozen=True)
class Best:
    """What there is to say of the best design."""

    content: Sequence[Html]  # markup
    document: dict[str, Any] = field(default_factory=dict)  # for machines
    sections: Sequence[Section] = ()  # more of the page


@dataclass(frozen=True)
class Subject:
    """What a run designs: a point of some function; see :class:`RobotSubject`."""

    problem: Problem  # as its folder describes it

    @property
    def title(self) -> str:
        """What is designed and where, in a few words that follow a colon."""
        return str(getattr(self.problem, "subject", type(self.problem).__name__))

    @property
    def score(self) -> Objective:
        """What the score is, and its unit."""
        return score_of(objectives_of(self.problem))

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
        return {}

    @property
    def plays_on_rigs(self) -> bool:
        """Whether a rig can play designs of this run."""
        return False

    def unplayable(self, history: History) -> str:
        """Why designs of a run cannot be tried again as it tried them, in a line; empty if they can."""
        return ""

    def replays(self, point: Floats, frames: int, progress: Progress) -> list[Replay]:
        """Try a point again in each world, with about so many frames of each motion; none if it cannot be shown."""
        return []

    def unshown(self, point: Floats) -> str:
        """Why there is no player of a point, where one might be expected; empty otherwise."""
        return ""

    def best(self, last: Generation, point: Floats, replays: Sequence[Replay], rig: PneumaticRig | None) -> Best:
        """The best design, of the last generation."""
        details, values = last.best_details or {}, self.problem.space.to_dict(point)
        content = [facts("The best point", [(name, f"{value:.6g}") for name, value in values.items()])]
        if shown := [(name, number(value)) for name, value in details.items() if isinstance(value, int | float)]:
            content.append(facts("Its details", shown))
        return Best(content, {"values": values, "details": details})

    def columns(self, points: Floats) -> Mapping[str, Sequence[Text]]:
        """What a table of several designs, shape (C, D), tells of each beside its objectives."""
        return {name: [f"{value:.4g}" for value in points[:, n]] for n, name in enumerate(self.problem.space.names)}

    def commands(self, folder: Path, best: Floats | None = None) -> list[tuple[str, str]]:
        """What can be done with the run, and with its best point: words, and a command."""
        return []


@dataclass(frozen=True)
class RobotSubject(Subject):
    """What a run designs: a robot of any kind."""

    problem: RobotDesigning

    @property
    def curves(self) -> Mapping[str, str]:
        """Numbers in ``best_details`` that are worth a curve each, and what they are called."""
        return self.problem.curves

    @property
    def plays_on_rigs(self) -> bool:
        """Whether a rig can play designs of this run; the robot of any point says so."""
        return self.problem.plays_on_rigs

    def unplayable(self, history: History) -> str:
        """Why designs of a run cannot be tried again: a file of its ground is missing, or not the one it began with."""
        try:
            check_ground_files(history.config, self.problem.ground_files, history.path)
        except ValueError as refused:
            return str(refused)
        return ""

    def replays(self, point: Floats, frames: int, progress: Progress) -> list[Replay]:
        """Try a point again in each world, with about so many frames of each motion; none if it cannot be shown."""
        problem, robot = self.problem, self.problem.robot_of(point)
        found: list[Replay] = []
        if not robot.has_motion:
            return found
        for n, world in enumerate(problem.tried_in):
            tick, name = part_of(progress, n, len(problem.tried_in)), world.spoken or robot.name
            found.append(robot.replay((), world, frames=frames, name=name, compute=problem.compute, progress=tick))
        return found

    def unshown(self, point: Floats) -> str:
        """Why there is no player of a point; empty if there is one."""
        robot = self.problem.robot_of(point)
        return "" if robot.has_motion else f"there is no player: {KINDS.of(robot).title} cannot be shown"

    def best(self, last: Generation, point: Floats, replays: Sequence[Replay], rig: PneumaticRig | None) -> Best:
        """The best design, of the last generation."""
        values, robot = self.problem.space.to_dict(point), self.problem.robot_of(point)
        measured, document = self._measured(robot, point, last, replays)
        own = _shown(robot.facts_of(()))
        free = facts("What was free", [(name, f"{value:.4g}") for name, value in values.items()])
        about = facts("Its body and behaviour", own) if own else free
        content = [measured, about, *self._pictures(robot, replays)]
        document |= {**robot.document(), "values": values}
        if not self.plays_on_rigs or (rig is None and robot.no_table_reason):  # by the usual one
            return Best(content, document)
        section, document["rig"] = _on_rig(robot, rig)
        return Best(content, document, [section])

    def _measured(
        self, robot: Robot, point: Floats, last: Generation, replays: Sequence[Replay]
    ) -> tuple[Html, dict[str, Any]]:
        """A row for each world: what the log says, and what came of it here."""
        worlds, kind = self.problem.tried_in, KINDS.of(robot)
        logged = self.problem.logged(point, last.best, last.best_details or {})
        known = [measure for measure in robot.measures if any(measure.name in row for row in logged)]
        again = robot.measures if replays else ()
        labels = {m.name: Objective(m.name.replace("_", " ").capitalize(), m.unit).label for m in robot.measures}
        drawn = f", over {self.problem.draws} draws" if self.problem.uncertain else ""
        header = [kind.world_option.capitalize(), *(labels[measure.name] + drawn for measure in known)]
        header += [f"{labels[measure.name]}, replayed here" for measure in again]
        rows, told = [], []
        for n, world in enumerate(worlds):
            found = {m.name: _finite(float(replays[n].outcome.measures[m.name][0])) for m in again}
            shown = [*(logged[n].get(measure.name) for measure in known), *found.values()]
            rows.append([world.spoken or world.name, *map(number, shown)])
            about = {**kind.world_values(world), **found, **logged[n]}
            told.append({**about, "replayed": found.get(robot.measures[0].name)})
        return table("The best design", header, rows), {f"{kind.world_option}s": told}

    def _pictures(self, robot: Robot, replays: Sequence[Replay]) -> list[Html]:
        """The robot's own pictures; prints show poses above a chart instead of the player."""
        from robots.view.picture import motion_picture

        own = robot.pictures((), replays, self.problem.compute)
        styled = [charted(one.draw, one.words, size=one.size, kind=one.style) for one in own if one.style]
        plain = [charted(one.draw, one.words, size=one.size) for one in own if not one.style]
        strips = []
        for world, replay in zip(self.problem.tried_in, replays, strict=False):
            words = f"Six poses of the best design {world.spoken}".strip() + ", above the chart of what drives it"
            strip = motion_picture(replay.motion, title=replay.title or None)
            strips.append(picture(image(strip, words), words))
        printed = [Html(f'<div class="print-only">{joined(strips, "")}</div>')] if strips else []
        return [*styled, *([side_by_side(plain)] if plain else []), *printed]

    def columns(self, points: Floats) -> Mapping[str, Sequence[Text]]:
        """What a table of several designs, shape (C, D), tells of each beside its objectives."""
        return self.problem.columns_of(points)

    def commands(self, folder: Path, best: Floats | None = None) -> list[tuple[str, str]]:
        """What can be done with the run, and with its best point: words, and a command."""
        problem, (where, file) = self.problem, (shlex.quote(str(path)) for path in (folder, folder / BEST_DESIGN))
        found = [("Go on with the run, if it was interrupted", f"morpholab codesign --resume --out {where}")]
        named = {**problem.command_options(folder), "precision": problem.precision, "device": problem.device}
        options = " ".join(f"--{name} {shlex.quote(str(value))}" for name, value in named.items() if value is not None)
        kind = KINDS[problem.robot_kind]
        for world in problem.tried_in:
            values = kind.world_values(by_file_read(world))
            places = " ".join(f"{flag_of(name)} {shlex.quote(spelled(value))}" for name, value in values.items())
            line = f"morpholab simulate --gait {file} {places} {options}"
            found.append((f"Simulate the best design {world.spoken}".strip(), line))
        robot = None if best is None else problem.robot_of(best)
        if robot is None or robot.has_motion:
            found.append(("Watch it", f"morpholab view {where} --out best.html"))
        if robot is not None and robot.has_table:
            found.append(("Write its pressures for the rig", f"morpholab export {where} --csv gait.csv --units psi"))
        return found


def subject_of(folder: Path, config: Mapping[str, Any]) -> Subject:
    """The subject of a run with these settings; raises ValueError for a problem that is unknown or cannot be read."""
    problem = problem_of_run(folder, config)
    return RobotSubject(problem) if isinstance(problem, RobotDesigning) else Subject(problem)


def _on_rig(robot: Robot, rig: PneumaticRig | None) -> tuple[Section, dict[str, Any] | None]:
    """What the design asks of the rig, or why no rig plays it."""
    try:
        found, seconds = robot.rig_report(rig)
    except ValueError as error:
        return Section("On the pneumatic rig", [paragraph(str(error).partition(": ")[2], "note")]), None
    return rig_section(found, rig is None, seconds)


def _shown(rows: Facts) -> list[tuple[str, Text]]:
    """Rows as markup."""
    return [
        (name, number(told.value, told.digits, told.unit) if isinstance(told, Quantity) else told)
        for name, told in rows
    ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
