"""The report of a package: what was chosen and why, how fast it is, how shapes change."""

from pathlib import Path
from typing import TYPE_CHECKING

from optim.pipeline.changes import Change
from optim.pipeline.machine import RULES, change_name
from optim.pipeline.plans import core_of
from optim.pipeline.trials import State
from optim.report.charts import picture_of
from optim.report.markup import Html, Section, Text, code, facts, number, page, paragraph, picture, table, tiles

if TYPE_CHECKING:
    from optim.pipeline.package import Package

PLAYER = "journey.html"  # the page with the motions, beside this one
CHANGE = (
    *("Change", "Where", "How", "From the shape [mm]", "Moves [BL]", "Turns [°]", "Contact [voxels]"),
    *("Next gait", "Faults"),
)  # columns of the table of changes
FOOT = "Made by morpholab pipeline. This page is one file and needs no network."


def report_page(package: "Package", folder: Path) -> str:
    """The page as text; pictures are read from the folder of the package."""
    names = " and ".join(terrain.name for terrain in package.task.terrains)
    lead = [
        paragraph("Which gait the robot uses on which terrain, and how it gets from one shape to another.", "lead"),
        tiles((f"{state.terrain.name} [BL/s]", state.speed) for state in package.states),
    ]
    sections = [
        Section("Which gait where", _plans(package)),
        Section("Gaits", [_picture(state, folder) for state in package.states]),
        Section("Changes of shape", _changes(package)),
        *([Section("A change of terrain mid-way", _crossings(package))] if package.crossings else []),
        Section("Playing it", _playing(package)),
    ]
    return page(f"From task to machine: {names}", lead, sections, FOOT)


def _plans(package: "Package") -> list[Html]:
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
    return picture(shown, f"{state.gait} {state.terrain.where}: {state.speed:.4f} BL/s")


def _changes(package: "Package") -> list[Html]:
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


def _crossings(package: "Package") -> list[Html]:
    """What a change of terrain mid-way does to the robot."""
    rows = []
    for pair, crossing in package.crossings.items():
        robots = ("state machine", crossing.machine), (crossing.gait, crossing.single)
        for (robot, speeds), survived in zip(robots, crossing.survived, strict=True):
            rows.append((" to ".join(pair), robot, *speeds.mean(axis=0).tolist(), "yes" if survived else "no"))
    header = ("Terrains", "Robot", "First [BL/s]", "Second [BL/s]", "Gets ahead on both")
    note = paragraph("Speeds by the time that the legs take, not by that of a published gait.")
    return [table("In one simulation", header, rows), note, Html(f'<p><a href="{PLAYER}">Play the journeys.</a></p>')]


def _playing(package: "Package") -> list[Html]:
    """What a controller does with the files."""
    files = [(state.terrain.name, f"tables/{state.name}.csv") for state in package.states]
    files += [(" to ".join(pair), f"tables/{change_name(pair)}.csv") for pair, c in package.changes.items() if c]
    return [facts("Tables of line pressures", files), *map(paragraph, RULES), code("machine.json says the same")]
