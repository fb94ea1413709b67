"""The report of a package: what was chosen and why, how fast it is, how shapes change."""

from pathlib import Path
from typing import TYPE_CHECKING

from optim.pipeline.changes import Change
from optim.pipeline.machine import RULES, change_name
from optim.pipeline.plans import Plan, core_of
from optim.report.charts import picture_of
from optim.report.markup import Html, Section, Text, code, facts, number, page, paragraph, picture, table, text, tiles

if TYPE_CHECKING:
    from optim.pipeline.package import Package

PLAYER = "journey.html"  # the page with the motions, beside this one
FOOT = "Made by morpholab pipeline. This page is one file and needs no network."


def report_page(package: "Package", folder: Path) -> str:
    """The page as text; pictures are read from the folder of the package."""
    names = " and ".join(terrain.name for terrain in package.task.terrains)
    lead = [
        paragraph("Which gait the robot uses on which terrain, and how it gets from one shape to another.", "lead"),
        tiles((f"{state.terrain.name} [BL/s]", number(state.speed)) for state in package.states),
    ]
    sections = [_plans(package), _states(package, folder), _changes(package)]
    if package.crossings:
        sections.append(_crossings(package))
    sections.append(_playing(package))
    return page(f"From task to machine: {names}", lead, sections, FOOT)


def _plans(package: "Package") -> Section:
    """Candidates, and the plans that were compared."""
    terrains = [terrain.name for terrain in package.task.terrains]
    rows = [
        (
            name,
            number(core_of(design) / 1000, 2),
            number(design.orientation, 1),
            *(number(float(row.mean())) for row in package.speeds[name]),
        )
        for name, design in package.candidates.items()
    ]
    header = ("Gait", "Core [kPa]", "Heading [°]", *(f"On {name} [BL/s]" for name in terrains))
    plans = [("chosen", package.plan), ("best of one gait", package.one_gait), ("best of one shape", package.one_shape)]
    compared = [(label, *_of_plan(plan)) for label, plan in plans]
    content = [
        table(f"Candidates, means of {package.task.runs} noisy runs", header, rows),
        table(
            f"Plans, by the mean speed over stretches of {package.task.stretch:g} body lengths with changes of shape",
            ("Plan", "Gaits", "Speed [BL/s]"),
            compared,
        ),
        *(paragraph(f"With faults in changes of shape: {line}") for line in package.rejected),
    ]
    return Section("Which gait where", content)


def _of_plan(plan: Plan | None) -> tuple[Text, Text]:
    return ("no gait works everywhere", None) if plan is None else (", ".join(plan.gaits), number(plan.speed))


def _states(package: "Package", folder: Path) -> Section:
    """A picture of every gait."""
    content: list[Html] = []
    for state in package.states:
        png = (folder / "pictures" / f"{state.name}.png").read_bytes()
        shown = picture_of(png, f"poses of the gait {state.terrain.where}")
        content.append(picture(shown, f"{state.gait} {state.terrain.where}: {state.speed:.4f} BL/s"))
    return Section("Gaits", content)


def _changes(package: "Package") -> Section:
    """How shapes change, and how well."""
    rows = [_change(pair, change) for pair, change in package.changes.items()]
    header = (
        "Change",
        "Where",
        "How",
        "From the shape [mm]",
        "Moves [BL]",
        "Turns [°]",
        "Contact [voxels]",
        "Next gait",
        "Faults",
    )
    meaning = (
        "Numbers are of the worst of the runs, one by one. From the shape: mean distance of voxels, rigid motion "
        "removed. Contact: the deepest overlap of voxels that may collide. Next gait: its mean speed from there, per "
        "that from a new start."
    )
    return Section("Changes of shape", [table("From state to state", header, rows), paragraph(meaning)])


def _change(pair: tuple[str, str], change: Change | None) -> tuple[Text, ...]:
    name = f"{pair[0]} to {pair[1]}"
    if change is None:
        return (name, None, "the shape stays", None, None, None, None, None, "none")
    found = change.judgement
    return (
        name,
        change.terrain.where,
        change.way,
        number(1e3 * found.shape_error, 2),
        number(found.moved, 3),
        number(found.turned, 1),
        number(found.deepest, 2),
        number(100 * change.next_speed, 0, "%"),
        "; ".join(change.faults) or "none",
    )


def _crossings(package: "Package") -> Section:
    """What a change of terrain mid-way does to the robot."""
    rows = []
    for (first, second), crossing in package.crossings.items():
        machine, single = crossing.machine.mean(axis=0), crossing.single.mean(axis=0)
        rows += [
            (f"{first} to {second}", "state machine", *map(number, machine.tolist()), _yes(crossing.survived[0])),
            (f"{first} to {second}", crossing.gait, *map(number, single.tolist()), _yes(crossing.survived[1])),
        ]
    header = ("Terrains", "Robot", "First [BL/s]", "Second [BL/s]", "Gets ahead on both")
    note = paragraph("Speeds by the time that the legs take, not by that of a published gait.")
    link = Html(f'<p><a href="{PLAYER}">Play the journeys.</a></p>')
    return Section("A change of terrain mid-way", [table("In one simulation", header, rows), note, link])


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _playing(package: "Package") -> Section:
    """What a controller does with the files."""
    files = [(state.terrain.name, text(f"tables/{state.name}.csv")) for state in package.states]
    files += [(f"{a} to {b}", text(f"tables/{change_name((a, b))}.csv")) for (a, b), c in package.changes.items() if c]
    steps = [paragraph(rule) for rule in RULES]
    return Section("Playing it", [facts("Tables of line pressures", files), *steps, code("machine.json says the same")])
