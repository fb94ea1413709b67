"""Problems of gaits as plain numbers and texts, as settings of runs have them, and back."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from optim.problem import GAIT, check_kind
from optim.problems.inflatable.outcomes import NEXT
from robots.calibration import Properties
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain

if TYPE_CHECKING:
    from optim.problems.inflatable.problem import GaitProblem

OPTIONS = ("columns", "repeats", "geometry", "weight", "precision", "device")
# Described where they differ from these.
LATER_OPTIONS = {
    "encoding": "codes",
    "objectives": "mean",
    "ramp_steps": None,
    "steps": None,
    "warm_up": 0,
    "stages": 1,
    "ladder": False,
    "ahead": NEXT,
    "hard": False,
    "effort": 0.0,
}


def description_of(problem: "GaitProblem") -> dict[str, Any]:
    """All that results depend on."""
    fixed = {
        "orientation": problem.orientation,
        "pressure": list(problem.pressure) if isinstance(problem.pressure, tuple) else problem.pressure,
        "schedule": problem.schedule.to_text() if problem.schedule else None,
        "properties": dataclasses.asdict(problem.properties) if problem.properties else None,
    }
    return {
        "terrains": [_given(dataclasses.asdict(terrain)) for terrain in problem.terrains],
        "free": list(problem.free),
        **_given(fixed),
        **{name: getattr(problem, name) for name in OPTIONS},
        **{name: getattr(problem, name) for name, usual in LATER_OPTIONS.items() if getattr(problem, name) != usual},
    }


def problem_of_description(kind: "type[GaitProblem]", description: Mapping[str, Any]) -> "GaitProblem":
    """The problem that was so described.

    Raises:
        ValueError: in one line, that names what is missing, unknown or not allowed.
    """
    check_kind(description, GAIT)
    settings = {name: value for name, value in description.items() if name not in ("free", "kind")}
    try:
        settings["terrains"] = tuple(Terrain(**terrain) for terrain in settings["terrains"])
        if "properties" in settings:
            settings["properties"] = Properties(**settings["properties"])
        if "schedule" in settings:
            settings["schedule"] = GaitSchedule.from_text(settings["schedule"], settings["repeats"])
        problem = kind(**settings)
    except (KeyError, TypeError) as error:
        raise ValueError(f"problem: its description is damaged ({error})") from None
    for name, value in problem.describe().items():
        if description.get(name) != value:
            raise ValueError(f"problem.{name}: {description.get(name)!r} contradicts the rest, which says {value!r}")
    return problem


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}
