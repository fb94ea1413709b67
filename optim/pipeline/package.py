"""The hardware package: gaits, tables, the state machine, pictures, a player page and a report, in one folder.

The report says what was chosen and why, how fast it is, how shapes change.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import write_json
from optim.pipeline.changes import Change, Crossing
from optim.pipeline.machine import MACHINE, RULES, change_name, entry_name, machine_document, read_machine
from optim.pipeline.plans import Plan, core_of
from optim.pipeline.tables import RIG, package_tables
from optim.pipeline.task import PipelineTask
from optim.pipeline.trials import State
from optim.problems.inflatable.settings import RIG_FILE
from optim.report.markup import (
    Html,
    Section,
    Text,
    code,
    facts,
    number,
    page,
    paragraph,
    picture,
    picture_of,
    table,
    tiles,
)
from robots.calibration import save_properties
from robots.hardware import write_csv
from robots.inflatable.design import InflatableDesign, save_design
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text
from taichi_sim.base.short_text import decimal

FOLDERS = ("gaits", "tables", "pictures")
NUMBERS, REPORT = "numbers.json", "report.html"
PLAYER = "journey.html"  # the page with the motions, beside this one
CHANGE = (
    *("Change", "Where", "How", "From the shape [mm]", "Moves [BL]", "Turns [°]", "Contact [voxels]"),
    *("Next gait", "Faults"),
)  # columns of the table of changes
FOOT = "Made by morpholab pipeline. This page is one file and needs no network."


@dataclass(frozen=True, eq=False)
class Package:
    """All that the pipeline has found."""

    task: PipelineTask  # what was asked for
    candidates: Mapping[str, InflatableDesign]  # gaits that were tried, by name
    speeds: Mapping[str, Floats]  # of them, see ``speeds_of``
    plan: Plan  # the one chosen
    one_gait: Plan | None  # the best with one gait everywhere; None if no gait works everywhere
    one_shape: Plan | None  # the best with one shape everywhere; None if no shape works everywhere
    states: Sequence[State]  # one per terrain
    changes: Mapping[tuple[str, str], Change | None]  # from state to state, by their names; None where the shape stays
    crossings: Mapping[tuple[str, str], Crossing]  # changes of terrain mid-way, by the names of the states
    rejected: Sequence[str]  # plans that were faster, and why they were not chosen

    def numbers(self) -> dict[str, Any]:
        """What was measured, for machines."""
        names, plans = [terrain.name for terrain in self.task.terrains], (self.plan, self.one_gait, self.one_shape)
        plan, one_gait, one_shape = (each and {"gaits": list(each.gaits), "speed": each.speed} for each in plans)
        return {
            "terrains": names,
            "candidates": {
                name: dict(zip(names, map(_mean_and_deviation, self.speeds[name]), strict=True))
                for name in self.candidates
            },
            "plan": plan,
            "one_gait": one_gait,
            "one_shape": one_shape,
            "rejected": list(self.rejected),
            "crossings": [
                {
                    "from": first,
                    "to": second,
                    "single_gait": crossing.gait,
                    "machine": crossing.machine.mean(axis=0).tolist(),
                    "single": crossing.single.mean(axis=0).tolist(),
                    "machine_survives": crossing.survived[0],
                    "single_survives": crossing.survived[1],
                }
                for (first, second), crossing in self.crossings.items()
            ],
        }


def _mean_and_deviation(speeds: Floats) -> list[float | None]:
    values = [float(speeds.mean()), float(speeds.std(ddof=1))]
    return [value if np.isfinite(value) else None for value in values]


def write_package(package: Package, folder: Path) -> list[str]:
    """Write the package in place of an earlier one, and list its files; raises ValueError if the rig refuses a table.

    Then nothing is written. Files of the earlier one that this one lacks are deleted last, and no others.
    """
    from robots.inflatable.view.motion import journey_motion
    from robots.inflatable.view.picture import save_motion_picture
    from robots.view.player import MOST_MOTIONS
    from robots.view.player import page as player

    task, written = package.task, [RIG]
    shapes = {pair: change.design if change else None for pair, change in package.changes.items()}
    tables = package_tables(package.states, shapes, task)
    earlier = _possible_files([*_states_of(folder), *(state.name for state in package.states)])
    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    designs = {state.name: state.design for state in package.states}
    designs |= {change_name(pair): design for pair, design in shapes.items() if design}
    for name, design in designs.items():
        written.append(f"gaits/{name}.json")
        save_design(design, folder / written[-1])
    for name, made in tables.files.items():
        written.append(f"tables/{name}.csv")
        write_csv(made, folder / written[-1])
    task.rig.save(folder / RIG)
    for state in package.states:
        written.append(f"pictures/{state.name}.png")
        save_motion_picture(state.design, state.terrain, folder / written[-1], **task.robot)
    if package.crossings:
        motions = [
            journey_motion(one.shown, one.legs, actuation=task.robot["actuation"], name=f"{first} to {second}")
            for (first, second), one in package.crossings.items()
        ]
        write_text(folder / PLAYER, player(motions[:MOST_MOTIONS], "From terrain to terrain"))
        written.append(PLAYER)
    if task.calibration is not None:
        save_properties(task.calibration, task.geometry, folder / RIG_FILE, task.weight)
        written.append(RIG_FILE)
    write_json(folder / MACHINE, machine_document(package.states, package.changes, tables.entries, task))
    write_json(folder / NUMBERS, package.numbers())
    write_text(folder / REPORT, report_page(package, folder, tables.entries))
    for name in earlier.difference(written):
        (folder / name).unlink(missing_ok=True)
    return [*written, MACHINE, NUMBERS, REPORT]


def _states_of(folder: Path) -> list[str]:
    """Names of the states of the package in a folder; none if there is none, or a damaged one."""
    with suppress(ValueError):
        return [state["name"] for state in read_machine(folder)["states"]]
    return []


def _possible_files(states: Iterable[str]) -> set[str]:
    """Files that packages with these states may have or lack, by what is planned; names that are paths have none."""
    names = {name for name in states if Path(name).name == name}
    changes = [change_name(pair) for pair in permutations(names, 2)]
    entries = [entry_name(pair) for pair in permutations(names, 2)]
    return {
        *(f"gaits/{name}.json" for name in [*names, *changes]),
        *(f"tables/{name}.csv" for name in [*names, *changes, *entries]),
        *(f"pictures/{name}.png" for name in names),
        *(PLAYER, RIG_FILE),
    }


def report_page(package: Package, folder: Path, entries: Mapping[tuple[str, str], str]) -> str:
    """The page as text; pictures are read from the folder of the package, entries are names of tables."""
    names = " and ".join(terrain.name for terrain in package.task.terrains)
    lead = [
        paragraph("Which gait the robot uses on which terrain, and how it gets from one shape to another.", "lead"),
        *_conditions(package.task),
        tiles((f"{state.terrain.name} [BL/s]", state.speed) for state in package.states),
    ]
    sections = [
        Section("Which gait where", _plans(package)),
        Section("Gaits", [_picture(state, folder) for state in package.states]),
        Section("Changes of shape", _changes(package)),
        *([Section("A change of terrain mid-way", _crossings(package))] if package.crossings else []),
        Section("Playing it", _playing(package, entries)),
    ]
    return page(f"From task to machine: {names}", lead, sections, FOOT)


def _conditions(task: PipelineTask) -> list[Html]:
    """What differs from the published ground and weight, if anything does."""
    told = [f"{t.name}: {t.friction}" for t in task.terrains if t.friction]
    told += [] if task.weight == "published" else [f"weight of bladders: {task.weight}"]
    return [paragraph("; ".join(told))] if told else []


def _plans(package: Package) -> list[Html]:
    """Candidates, and the plans that were compared."""
    rows = []
    for name, design in package.candidates.items():
        shape = number(core_of(design) / 1000, 2), number(design.orientation, 1)
        rows.append((name, *shape, *package.speeds[name].mean(axis=1).tolist()))
    header = ("Gait", "Core [kPa]", "Heading [°]", *(f"On {t.name} [BL/s]" for t in package.task.terrains))
    plans = {"chosen": package.plan, "best of one gait": package.one_gait, "best of one shape": package.one_shape}
    compared = [
        (label, ", ".join(plan.gaits), plan.speed) if plan else (label, "no gait works everywhere", None)
        for label, plan in plans.items()
    ]
    stretch = f"stretches of {package.task.stretch:g} body lengths with changes of shape"
    return [
        table(f"Candidates, means of {package.task.runs} noisy runs", header, rows),
        table(f"Plans, by the mean speed over {stretch}", ("Plan", "Gaits", "Speed [BL/s]"), compared),
        *(paragraph(f"With faults in changes of shape: {line}") for line in package.rejected),
    ]


def _picture(state: State, folder: Path) -> Html:
    """Poses of a state's gait."""
    png = (folder / "pictures" / f"{state.name}.png").read_bytes()
    shown = picture_of(png, f"poses of the gait {state.terrain.where}")
    return picture(shown, f"{state.gait} {state.terrain.where}: {decimal(state.speed)} BL/s")


def _changes(package: Package) -> list[Html]:
    """How shapes change, and how well."""
    rows = [_change(pair, change) for pair, change in package.changes.items()]
    meaning = (
        "Numbers are of the worst of the runs, one by one. From the shape: mean distance of voxels, rigid motion "
        "removed. Contact: the deepest overlap of voxels that may collide. Next gait: its mean speed from there, per "
        "that from a new start."
    )
    return [table("From state to state", CHANGE, rows), paragraph(meaning)]


def _change(pair: tuple[str, str], change: Change | None) -> tuple[Text, ...]:
    name = " to ".join(pair)
    if change is None:
        return (name, None, "the shape stays", None, None, None, None, None, "none")
    found, faults = change.judgement, "; ".join(change.faults) or "none"
    moves = number(1e3 * found.shape_error, 2), number(found.moved, 3), number(found.turned, 1)
    speed = number(100 * change.next_speed, 0, "%")
    return (name, change.terrain.where, change.way, *moves, number(found.deepest, 2), speed, faults)


def _crossings(package: Package) -> list[Html]:
    """The section on robots that cross from one terrain to another."""
    rows = []
    for pair, crossing in package.crossings.items():
        robots = ("state machine", crossing.machine), (crossing.gait, crossing.single)
        for (robot, speeds), survived in zip(robots, crossing.survived, strict=True):
            rows.append((" to ".join(pair), robot, *speeds.mean(axis=0).tolist(), "yes" if survived else "no"))
    header = ("Terrains", "Robot", "First [BL/s]", "Second [BL/s]", "Gets ahead on both")
    note = paragraph("Speeds by the time that the legs take, not by that of a published gait.")
    return [table("In one simulation", header, rows), note, Html(f'<p><a href="{PLAYER}">Play the journeys.</a></p>')]


def _playing(package: Package, entries: Mapping[tuple[str, str], str]) -> list[Html]:
    """The section on how a controller plays the files."""
    files = [(state.terrain.name, f"tables/{state.name}.csv") for state in package.states]
    for pair, change in package.changes.items():
        played = [change_name(pair)] * (change is not None) + [entries[pair]]
        files.append((" to ".join(pair), ", then ".join(f"tables/{name}.csv" for name in played)))
    return [facts("Tables of line pressures", files), *map(paragraph, RULES), code("machine.json says the same")]
