"""What a report tells of the folder of ``morpholab measure``: what a robot's body does to learning."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.experiments.study import StudyReport, StudySection
from taichi_sim.base.files import read_json
from taichi_sim.base.results_folder import read_settings
from taichi_sim.base.short_text import counted

KIND, METRICS = "measures", "metrics.json"  # of the settings, and the file of what was found
INTERVAL = ("Value", "95 % from", "to")
MUTATIONS = {
    "worst": "M1, missing to the bound in the worst environment",
    "angle": "M2, angle from equal gains in all environments [degrees]",
    "length": "M3, length",
    "share": "M4, share that is better in every environment",
}


def report(folder: Path) -> StudyReport:
    """What a report tells of the measures of a body; raises ValueError if they are not complete."""
    settings = read_settings(folder, KIND)
    if not (folder / METRICS).is_file():
        raise ValueError(f"run: {folder} has measures that are not complete; run their command to the end")
    return read_json(folder / METRICS, lambda found: _told(found, settings))


def _told(found: Mapping[str, Any], settings: Mapping[str, Any]) -> StudyReport:
    """The report of what was found; raises KeyError or TypeError if something of it is missing."""
    names, controllers = found["environments"], found["learnability"]["of"]
    kept = [" and ".join(bounds) for bounds in settings["success"]]
    each = [(name, bound, *_share(one)) for name, bound, one in zip(names, kept, found["each"], strict=True)]
    shares = [
        ("M_L, of all controllers", *_share(found["learnability"])),
        ("M_CI, of those that succeed in any", *_share(found["resistance"])),
    ]
    named = ("Measure", "Succeed", "Of", *INTERVAL)
    chance = f"M_CI would be {found['alone']:.4f} if environments did not depend on each other."
    sections = [
        StudySection("Environments", "Controllers that succeed", ("In", "Keep", "Succeed", "Of", *INTERVAL), each),
        StudySection("Learning", "Those that succeed in all", named, shares, 4, chance),
    ]
    if (changes := found["mutations"]) is not None:
        rows = [(told, *_mean(changes[name]), changes[name]["counted"]) for name, told in MUTATIONS.items()]
        note = "Distances are in parts of a bound, or in the measure's unit where the bound is 0."
        caption = f"{counted(changes['changes'], 'mutation')} that champions of climbers kept"
        sections.append(StudySection("Mutations", caption, ("Measure", *INTERVAL, "Runs"), rows, 4, note))
    if (felt := found["felt"]) is not None:
        row = ("mean warping distance", felt["distance"], felt["low"], felt["high"], felt["controllers"])
        caption = "What controllers that succeed in all feel in two environments"
        sections.append(StudySection("Homeostasis", caption, ("Measure", *INTERVAL, "Controllers"), [row]))
    return StudyReport(
        KIND,
        f"What the body of {found['robot']} does to learning: {counted(controllers, 'controller')}, each tried in "
        f"{counted(len(names), 'environment')}.",
        {"controllers": controllers, "environments": len(names), "climbers": settings["climbers"]},
        settings,
        sections,
        {"metrics": {name: value for name, value in found.items() if name != "folder"}},
    )


def _share(share: Mapping[str, Any]) -> tuple[Any, ...]:
    return share["count"], share["of"], *_mean(share)


def _mean(mean: Mapping[str, Any]) -> tuple[Any, ...]:
    return mean["value"], mean["low"], mean["high"]
